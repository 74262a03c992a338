"""Where every sketch point is in every frame, how sure that is, and how it is known."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from planewright.arrays import Float, Int


class State(IntEnum):
    """How a position is known; the names in lower case are those of `reconstruction.json`."""

    MARKED = 0
    TRACKED = 1
    BRIDGED = 2
    PREDICTED = 3
    HIDDEN = 4


@dataclass(frozen=True, eq=False)
class Tracks:
    """One row per claimed position, sorted by point, then frame."""

    point_index: Int[np.ndarray, "rows"]
    """Row of the sketch's `points`."""
    frame: Int[np.ndarray, "rows"]
    """Frame number in the clip."""
    xy: Float[np.ndarray, "rows 2"]
    """Pixels of the frame as displayed (lens distortion included); the centre of the top-left pixel is (0.5, 0.5)."""
    covariance: Float[np.ndarray, "rows 2 2"]
    """Pixels squared, common-mode terms (camera, click, edge identity) included."""
    state: Int[np.ndarray, "rows"]
    """A `State`."""
