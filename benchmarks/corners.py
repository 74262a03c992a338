"""Every true corner-frame beside what was claimed for it: what tables pool and what a user would look at."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from planewright.arrays import Float, Int
from planewright.sketch.graph import Sketch
from planewright.tracking.tracks import State, Tracks


@dataclass(frozen=True, eq=False)
class CornerErrors:
    """One row a truly visible corner-frame, in the order of the truth."""

    corner: tuple[str, ...]
    """Its id, a row."""
    frame: Int[np.ndarray, "rows"]
    true_xy: Float[np.ndarray, "rows 2"]
    """Pixels."""
    error: Float[np.ndarray, "rows"]
    """Pixels between claim and truth; infinite where nothing is claimed, or the corner is said to be hidden."""

    def medians(self) -> dict[str, float]:
        """Median error of each corner that is ever visible."""
        ids = np.array(self.corner)
        return {corner: float(np.median(self.error[ids == corner])) for corner in dict.fromkeys(self.corner)}

    def within(self, pixels: float) -> float:
        """Percentage of the rows whose error is at most that."""
        return 100.0 * float((self.error <= pixels).mean()) if len(self.error) else 100.0


def corner_errors(found: Mapping[str, Any], truth: Mapping[str, Any]) -> CornerErrors:
    """Claims against the truth.

    found: point -> frame -> entry, as in `reconstruction.json`. truth: point -> {xy, visible} lists, or -> frame -> [x, y] (all visible).
    """
    corner: list[str] = []
    frame: list[int] = []
    true: list[Sequence[float]] = []
    error: list[float] = []
    for point, known in truth.items():
        if "xy" in known:
            rows = [(k, xy) for k, (xy, visible) in enumerate(zip(known["xy"], known["visible"], strict=True)) if visible]
        else:
            rows = sorted((int(k), xy) for k, xy in known.items())
        claims = found.get(point, {})
        for k, xy in rows:
            claim = claims.get(str(k))
            silent = claim is None or claim.get("state") == "hidden" or claim.get("xy") is None
            corner.append(point)
            frame.append(k)
            true.append(xy)
            error.append(np.inf if silent else float(np.hypot(claim["xy"][0] - xy[0], claim["xy"][1] - xy[1])))
    return CornerErrors(tuple(corner), np.array(frame, dtype=np.int64), np.array(true, dtype=np.float64).reshape(-1, 2), np.array(error))


def claims(tracks: Tracks, sketch: Sketch) -> dict[str, dict[str, dict[str, Any]]]:
    """Positions and states as `reconstruction.json` writes them: point -> frame -> {xy, state}."""
    found: dict[str, dict[str, dict[str, Any]]] = {point.id: {} for point in sketch.points}
    for point, frame, xy, state in zip(tracks.point_index, tracks.frame, tracks.xy, tracks.state, strict=True):
        found[sketch.points[int(point)].id][str(int(frame))] = {"xy": xy.tolist(), "state": State(int(state)).name.lower()}
    return found
