"""The file formats of `planewright export`, by name."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from planewright.errors import ResultError, UsageError
from planewright.export.gltf import read_glb, write_glb
from planewright.export.obj import write_obj
from planewright.export.ply import write_ply
from planewright.model.planar_model import PlanarModel

Writer = Callable[[PlanarModel, Path], None]

WRITERS: Mapping[str, Writer] = MappingProxyType({"glb": write_glb, "obj": write_obj, "ply": write_ply})
"""Name of a format -> what writes it. A new format is a new file here and a line in this table."""


def export_model(model: PlanarModel, format: str, path: Path) -> None:
    """Write the model in a format. Raises UsageError for a format that is not known, OutputError where the file cannot be written."""
    if format not in WRITERS:
        raise UsageError(f"{format!r} is not a format that can be written. Choose one of: {', '.join(WRITERS)}.")
    WRITERS[format](model, path)


def read_result_model(folder: Path) -> PlanarModel:
    """The model of a finished result, from its `model.glb`. Raises ResultError."""
    path = folder / "model.glb"
    if not path.is_file():
        raise ResultError(f"{folder} holds no finished result: {path.name} is missing. Run planewright reconstruct with --output {folder.name}.")
    return read_glb(path)
