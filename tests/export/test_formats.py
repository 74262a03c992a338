"""The table of formats, and the way from a finished result to a file."""

from pathlib import Path

import pytest

from planewright.errors import ResultError, UsageError
from planewright.export.formats import WRITERS, export_model, read_result_model
from planewright.export.gltf import write_glb


def test_every_format_can_be_written_from_a_result_folder(make_model, tmp_path: Path) -> None:
    write_glb(make_model(["a", "b"]), tmp_path / "model.glb")
    model = read_result_model(tmp_path)
    for name in WRITERS:
        export_model(model, name, tmp_path / f"out.{name}")
        assert (tmp_path / f"out.{name}").stat().st_size > 200


def test_an_unknown_format_is_told_with_the_known_ones(make_model, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="glb, obj, ply"):
        export_model(make_model(["a"]), "stl", tmp_path / "a.stl")


def test_a_folder_without_a_result_is_told(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="no finished result"):
        read_result_model(tmp_path)
