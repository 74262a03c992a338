"""The file formats of `planewright export`, by name."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from planewright.errors import ResultError, UsageError
from planewright.export.gltf import read_glb, write_glb
from planewright.export.obj import one_word, write_obj
from planewright.export.ply import write_ply
from planewright.model.planar_model import PlanarModel

Writer = Callable[[PlanarModel, Path], None]

WRITERS: Mapping[str, Writer] = MappingProxyType({"glb": write_glb, "obj": write_obj, "ply": write_ply})
"""Name of a format -> what writes it. A new format is a new file here and a line in this table."""


BESIDE: Mapping[str, tuple[str, ...]] = MappingProxyType({"obj": (".mtl", ".png"), "ply": (".png",)})
"""Endings of the files that a format puts beside the one that was asked for."""


def files_of(format: str, path: Path) -> tuple[Path, ...]:
    """Every file that writing `path` in a format makes, `path` first. Raises UsageError for a format that is not known, or a name that cannot be."""
    if format not in WRITERS:
        raise UsageError(f"{format!r} is not a format that can be written. Choose one of: {', '.join(WRITERS)}.")
    beside = tuple(path.with_name(one_word(path.stem) + ending) for ending in BESIDE.get(format, ()))
    if path in beside:
        raise UsageError(f"{path.name} is the name of the texture that goes with it. Choose a name that ends in .{format}.")
    return (path, *beside)


def export_model(model: PlanarModel, format: str, path: Path, *, force: bool = False) -> None:
    """Write the model in a format.

    Raises:
        UsageError: the format is not known, or a file that would be written is there already and `force` is not given.
        OutputError: a file cannot be written.
    """
    there = [file for file in files_of(format, path) if file.exists()]
    if there and not force:
        raise UsageError(f"{', '.join(map(str, there))} exists. Choose another name, or replace it with --force.")
    WRITERS[format](model, path)


def read_result_model(folder: Path) -> PlanarModel:
    """The model of a finished result, from its `model.glb`. Raises ResultError."""
    path = folder / "model.glb"
    if not path.is_file():
        raise ResultError(f"{folder} holds no finished result: {path.name} is missing. Run planewright reconstruct with --output {folder.name}.")
    return read_glb(path)
