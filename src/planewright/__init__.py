"""Planar 3D models from a handheld clip and a drawn sketch: `from planewright import reconstruct, Sketch`."""

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from planewright.corrections.correct import correct as correct
    from planewright.corrections.session import Mark as Mark
    from planewright.corrections.session import Session as Session
    from planewright.corrections.suggest import suggest as suggest
    from planewright.pipeline.corrected import open_session as open_session
    from planewright.pipeline.result import Result as Result
    from planewright.pipeline.run import ReconstructOptions as ReconstructOptions
    from planewright.pipeline.run import reconstruct as reconstruct
    from planewright.sketch.graph import Sketch as Sketch
    from planewright.sketch.read import read_sketch as read_sketch

# The public names and their homes. They are loaded when they are first asked for: the numerical libraries take a second to import,
# and neither `planewright --version` nor a program that needs one type should wait for them.
_HOMES = {
    "Mark": "planewright.corrections.session",
    "ReconstructOptions": "planewright.pipeline.run",
    "Result": "planewright.pipeline.result",
    "Session": "planewright.corrections.session",
    "Sketch": "planewright.sketch.graph",
    "correct": "planewright.corrections.correct",
    "open_session": "planewright.pipeline.corrected",
    "read_sketch": "planewright.sketch.read",
    "reconstruct": "planewright.pipeline.run",
    "suggest": "planewright.corrections.suggest",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'planewright' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
