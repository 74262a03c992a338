"""Scene features: small patches of the whole image, followed through the clip."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Float, Int


@dataclass(frozen=True, eq=False)
class Features:
    """Where each scene feature was seen: one row per observation, sorted by frame, then track."""

    track_index: Int[np.ndarray, "obs"]
    """0 .. num_tracks - 1."""
    frame: Int[np.ndarray, "obs"]
    """Frame number in the clip."""
    xy: Float[np.ndarray, "obs 2"]
    """Pixels; the centre of the top-left pixel is (0.5, 0.5)."""
    num_tracks: int
