"""The folder of a result."""

from pathlib import Path

import pytest

from planewright.errors import OutputError
from planewright.pipeline.folder import make_folder, remove_leftovers


def test_folders_above_are_made_too(tmp_path: Path) -> None:
    make_folder(tmp_path / "a" / "b")
    make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()


def test_a_file_in_the_way_is_said(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("mine")
    for folder in (tmp_path / "a", tmp_path / "a" / "b"):
        with pytest.raises(OutputError, match="another output folder"):
            make_folder(folder)


def test_only_leftovers_are_removed(tmp_path: Path) -> None:
    for name in (".model.1a2b3c4d.part.glb", "model.glb", ".hidden", "part.txt"):
        (tmp_path / name).write_text("")
    remove_leftovers(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".hidden", "model.glb", "part.txt"]
