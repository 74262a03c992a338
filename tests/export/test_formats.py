"""The table of formats, and the way from a finished result to a file."""

from pathlib import Path

import pytest

from planewright.errors import ResultError, UsageError
from planewright.export.formats import WRITERS, export_model, files_of, read_result_model
from planewright.export.gltf import write_glb


def test_every_format_can_be_written_from_a_result_folder(make_model, tmp_path: Path) -> None:
    write_glb(make_model(["a", "b"]), tmp_path / "model.glb")
    model = read_result_model(tmp_path)
    for name in WRITERS:
        export_model(model, name, tmp_path / f"as_{name}.{name}")
        assert (tmp_path / f"as_{name}.{name}").stat().st_size > 200


def test_nothing_that_is_there_is_written_over_unasked(make_model, tmp_path: Path) -> None:
    photo = tmp_path / "house.png"
    photo.write_bytes(b"a photograph of the same name")
    for name in ("obj", "ply"):
        with pytest.raises(UsageError, match=r"house\.png"):
            export_model(make_model(["a"]), name, tmp_path / f"house.{name}")
    assert list(tmp_path.iterdir()) == [photo]
    export_model(make_model(["a"]), "obj", tmp_path / "house.obj", force=True)
    assert photo.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(UsageError, match="texture"):
        export_model(make_model(["a"]), "obj", tmp_path / "other.png")


@pytest.mark.parametrize("format", list(WRITERS))
def test_the_files_that_are_written_are_those_announced(make_model, tmp_path: Path, format: str) -> None:
    path = tmp_path / f"my model.{format}"
    export_model(make_model(["a"]), format, path)
    assert sorted(tmp_path.iterdir()) == sorted(files_of(format, path))


def test_an_unknown_format_is_told_with_the_known_ones(make_model, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="glb, obj, ply"):
        export_model(make_model(["a"]), "stl", tmp_path / "a.stl")


def test_a_folder_without_a_result_is_told(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="no finished result"):
        read_result_model(tmp_path)
