"""The table of formats, and the way from a finished result to a file."""

from pathlib import Path

import pytest

from planewright.errors import ResultError, UsageError
from planewright.export.formats import ENCODERS, export_model, read_result_model
from planewright.export.gltf import write_glb


def test_every_format_can_be_written_from_a_result_folder(make_model, tmp_path: Path) -> None:
    write_glb(make_model(["a", "b"]), tmp_path / "model.glb")
    model = read_result_model(tmp_path)
    for name in ENCODERS:
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
    with pytest.raises(UsageError, match="goes with it"):
        export_model(make_model(["a"]), "obj", tmp_path / "other.png")


def test_all_formats_can_go_by_the_same_name(make_model, tmp_path: Path) -> None:
    model = make_model(["a"])
    for name in ENCODERS:
        export_model(model, name, tmp_path / f"house.{name}")
    assert {path.name for path in tmp_path.iterdir()} == {"house.glb", "house.obj", "house.mtl", "house.ply", "house.png"}
    for name in ENCODERS:
        with pytest.raises(UsageError, match=f"house.{name}"):
            export_model(model, name, tmp_path / f"house.{name}")


def test_an_unknown_format_is_told_with_the_known_ones(make_model, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="glb, obj, ply"):
        export_model(make_model(["a"]), "stl", tmp_path / "a.stl")


def test_a_folder_without_a_result_is_told(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="no finished result"):
        read_result_model(tmp_path)
