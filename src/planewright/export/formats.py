"""The file formats of `planewright export`, by name."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from planewright.errors import ResultError, UsageError
from planewright.export.atomic import write_whole
from planewright.export.gltf import encode_glb, read_glb
from planewright.export.obj import encode_obj
from planewright.export.ply import encode_ply
from planewright.model.planar_model import PlanarModel

Encoder = Callable[[PlanarModel, Path], Mapping[Path, bytes]]
"""What a format makes of a model to be written to a path: files and their content, in the order of writing, the path itself last."""


def _glb(model: PlanarModel, path: Path) -> dict[Path, bytes]:
    return {path: encode_glb(model)}


ENCODERS: Mapping[str, Encoder] = MappingProxyType({"glb": _glb, "obj": encode_obj, "ply": encode_ply})
"""The formats by name. A new format is a new file here and an entry in this table."""

BESIDE: Mapping[str, tuple[str, ...]] = MappingProxyType({"obj": (".mtl", ".png"), "ply": (".png",)})
"""Endings of the files that a format puts beside the one that was asked for."""


def export_model(model: PlanarModel, format: str, path: Path, *, force: bool = False) -> None:
    """Write the model in a format.

    Raises:
        UsageError: the format is not known, or something else would be written over and `force` is not given. A texture that is there already with the very
            same content, from another format under the same name, is not in the way.
        OutputError: a file cannot be written.
    """
    if format not in ENCODERS:
        raise UsageError(f"{format!r} is not a format that can be written. Choose one of: {', '.join(ENCODERS)}.")
    if format in BESIDE and path.suffix.lower() in BESIDE[format]:
        raise UsageError(f"{path.name} would be the name of a file that goes with it. Choose a name that ends in .{format}.")
    files = ENCODERS[format](model, path)
    there = [file for file, data in files.items() if file.exists() and (file == path or not file.is_file() or file.read_bytes() != data)]
    if there and not force:
        raise UsageError(f"{', '.join(map(str, there))} exists. Choose another name, or replace it with --force.")
    for file, data in files.items():
        write_whole(file, data)


def read_result_model(folder: Path) -> PlanarModel:
    """The model of a finished result, from its `model.glb`. Raises ResultError."""
    path = folder / "model.glb"
    if not path.is_file():
        raise ResultError(f"{folder} holds no finished result: {path.name} is missing. Run planewright reconstruct with --output {folder.name}.")
    return read_glb(path)
