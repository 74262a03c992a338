"""Whole files or none."""

from pathlib import Path

import pytest

from planewright.errors import OutputError
from planewright.export.atomic import whole_file, write_whole


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
    (tmp_path / "file").write_bytes(b"in the way")
    with pytest.raises(OutputError):
        write_whole(tmp_path / "file" / "b.bin", b"new")


def test_a_writer_that_fails_half_way_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(b"old")

    def fail(error: Exception) -> None:
        with whole_file(path) as temporary:
            assert (temporary.parent, temporary.suffix) == (tmp_path, ".mp4")
            temporary.write_bytes(b"half")
            raise error

    with pytest.raises(OutputError, match="No space left"):
        fail(OSError(28, "No space left on device"))
    with pytest.raises(ZeroDivisionError):
        fail(ZeroDivisionError())
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
