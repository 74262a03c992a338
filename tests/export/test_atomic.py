"""Whole files or none."""

from pathlib import Path

import pytest

from planewright.errors import OutputError
from planewright.export.atomic import write_whole


def test_a_file_is_replaced_and_nothing_else_is_left(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    write_whole(path, b"old")
    write_whole(path, b"new")
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_written_leaves_no_trace(tmp_path: Path) -> None:
    blocked = tmp_path / "a.bin"
    blocked.mkdir()
    with pytest.raises(OutputError, match=r"a\.bin"):
        write_whole(blocked, b"new")
    assert list(tmp_path.iterdir()) == [blocked]
    with pytest.raises(OutputError):
        write_whole(tmp_path / "absent" / "b.bin", b"new")
