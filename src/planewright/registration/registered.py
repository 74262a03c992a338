"""Where every drawn face is in every frame, as homographies."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.registration.strands import Strand

CELLS = 6
"""The support of a face is kept on this many by this many cells of its square."""


@dataclass(frozen=True, eq=False)
class Registered:
    """One row a strand, one column a frame."""

    strands: tuple[Strand, ...]
    image_size: tuple[int, int]
    frame: Int[np.ndarray, "frames"]
    """Frame numbers, increasing."""
    homography: Float[np.ndarray, "strands frames 3 3"]
    """Face coordinates -> pixels with centres at integers; NaN where nothing is known."""
    covariance: Float[np.ndarray, "strands frames 8 8"]
    """Of the change of the homography (homography.py)."""
    found: Bool[np.ndarray, "strands frames"]
    """Registered there; where not, the homography is what its neighbourhood's motion predicts."""
    correlation: Float[np.ndarray, "strands frames"]
    """With the template, 0 where it was not registered."""
    support: Float[np.ndarray, "strands frames cells"]
    """Share of each cell's pixels that agree with the template; NaN where the cell has none or lies outside the image."""
    lines: Float[np.ndarray, "strands frames edges 4"]
    """`kernels.find_lines` at the drawn edges as the homography shows them; NaN rows pad strands with fewer edges."""
