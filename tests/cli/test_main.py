"""Every error becomes a sentence on standard error and an exit status; what came from a file stays text."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import planewright
from planewright.cli import app, main
from planewright.errors import Cancelled, GeometryError, OutputError, PlanewrightError, SketchError, UsageError, VideoError


def outcome(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> int:
    def fails(prog_name: str) -> None:
        raise error

    monkeypatch.setattr(app, "app", fails)
    return main.run()


@pytest.mark.parametrize(
    ("error", "status"),
    [(UsageError, 2), (VideoError, 3), (SketchError, 3), (OutputError, 3), (GeometryError, 4), (Cancelled, 130)],
)
def test_each_kind_of_error_has_its_status(
    error: type[PlanewrightError], status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert outcome(error("What is wrong, and what to do."), monkeypatch) == status
    assert capsys.readouterr().err == "What is wrong, and what to do.\n"


def test_an_unforeseen_error_asks_for_a_report_and_keeps_the_details(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.delenv("PLANEWRIGHT_DEBUG", raising=False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert outcome(ZeroDivisionError("the details"), monkeypatch) == 1
    (log,) = tmp_path.iterdir()
    said = capsys.readouterr().err
    assert str(log) in said
    assert "report" in said
    assert "Traceback" not in said
    assert "the details" in log.read_text(encoding="utf-8")


def test_a_path_that_the_system_refuses_is_the_users_to_correct(planewright: Callable, tmp_path: Path) -> None:
    name = "x" * 5000
    for words in (("export", name, "--format", "obj", "--output", tmp_path / "a.obj"), ("reconstruct", "a.mp4", "--sketch", "s", "--output", tmp_path / name)):
        outcome = planewright(*words)
        assert outcome.status == 3
        assert "Check the path." in outcome.err


def test_a_developer_may_ask_for_the_traceback(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("PLANEWRIGHT_DEBUG", "1")
    assert outcome(ZeroDivisionError("the details"), monkeypatch) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize("hostile", ["\x1b[2Jgone", "a\rb", "\x9b31m", "[bold red]text[/]", "<script>alert(1)</script>", "\ud800", "x" * 10_000])
def test_text_from_files_is_shown_not_obeyed(hostile: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert outcome(SketchError(f"The point {hostile} is wrong."), monkeypatch) == 3
    said = capsys.readouterr().err
    assert said.startswith("The point ")
    assert said.endswith(" is wrong.\n")
    assert all(character.isprintable() for character in said[:-1])
    assert len(said) < 2100


@pytest.mark.parametrize(
    ("words", "status"),
    [(["--version"], 0), (["--help"], 0), (["nonsense"], 2), (["reconstruct"], 2), (["reconstruct", "--frames"], 2), (["sketch", "chek"], 2)],
)
def test_the_words_of_the_command_decide_the_status(words: list[str], status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["planewright", *words])
    assert main.run() == status
    shown = capsys.readouterr()
    assert "Traceback" not in shown.err
    assert shown.err if status else shown.out


def test_the_version_is_the_packages(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["planewright", "--version"])
    assert main.run() == 0
    assert capsys.readouterr().out == f"planewright {planewright.__version__}\n"
