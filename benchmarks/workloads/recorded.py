"""Clips of the folder that the environment variable PLANEWRIGHT_DATA names: `NAME/clip.mp4`, `NAME/sketch.json`, `NAME/truth*.json`."""

import os
from functools import partial
from pathlib import Path

from benchmarks.workloads.workload import ClipFiles, Workload

_SMOOTHED = "truth_tracks_smooth.json"
"""Stands in for `truth_tracks.json` where both are there: marks by hand scatter by a pixel, smoothed ones are the better yardstick."""


def recorded() -> list[Workload]:
    """One workload a folder; none where the variable is not set."""
    root = os.environ.get("PLANEWRIGHT_DATA")
    if not root:
        return []
    return [Workload(folder.name, partial(_find, folder)) for folder in sorted(Path(root).iterdir()) if (folder / "clip.mp4").exists()]


def _find(folder: Path, made: Path) -> ClipFiles:
    del made
    truths = sorted(folder.glob("truth*.json"))
    if any(t.name == _SMOOTHED for t in truths):
        truths = [t for t in truths if t.name != "truth_tracks.json"]
    return ClipFiles(folder / "clip.mp4", folder / "sketch.json", tuple(truths))
