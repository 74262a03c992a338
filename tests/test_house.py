"""The house rules, checked in the same command as everything else: style, types, the floors, and how the repository is laid out."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "planewright"


def run(*command: str) -> None:
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, encoding="utf-8", errors="replace")
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}\n{done.stderr}"


def test_ruff_finds_nothing() -> None:
    run("ruff", "check", "--no-cache", ".")


def test_every_file_is_formatted() -> None:
    run("ruff", "format", "--no-cache", "--check", ".")


def test_types_hold_strictly_in_the_library() -> None:
    run("pyright", "--pythonpath", sys.executable)


def test_packages_import_only_from_the_floors_below() -> None:
    command = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    done = subprocess.run([sys.executable, "-c", command], cwd=ROOT, capture_output=True, text=True, encoding="utf-8", errors="replace")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("test_file", sorted((ROOT / "tests").glob("*/test_*.py")), ids=lambda path: f"{path.parent.name}/{path.name}")
def test_every_test_mirrors_a_source_file(test_file: Path) -> None:
    if test_file.parent.name in ("end_to_end", "golden"):
        return
    mirrored = SOURCE / test_file.parent.name / test_file.name.removeprefix("test_")
    assert mirrored.exists(), f"{test_file.relative_to(ROOT)} tests no file of src/planewright/{test_file.parent.name}"


def test_no_room_for_odds_and_ends() -> None:
    assert not [path for path in SOURCE.rglob("*.py") if path.stem in ("utils", "helpers", "misc", "common")]


def test_the_library_never_unpickles() -> None:
    for path in SOURCE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"^\s*(import|from) (pickle|shelve|marshal|dill)\b|allow_pickle=True", text, re.MULTILINE), path
