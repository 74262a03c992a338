"""What the images say about corners and planes, as whitened residuals of corners and planes; cameras are given.

Every term is one number: value / sigma. `tau` scales nothing here: robust losses are the solver's business.
"""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Int


@dataclass(frozen=True, eq=False)
class PlanePoints:
    """Points known to lie on planes (photometric planes as three virtual points each, scene features on faces): (n_f . point - d_f) / sigma."""

    face: Int[np.ndarray, "terms"]
    point: Float[np.ndarray, "terms 3"]
    sigma: Float[np.ndarray, "terms"]
    """World units, along the normal."""


@dataclass(frozen=True, eq=False)
class CornerMarks:
    """Clicks: (pixels of corner i in a camera - xy) / sigma; two numbers a term. Pixels are those of the pinhole camera (distortion removed)."""

    corner: Int[np.ndarray, "terms"]
    projection: Float[np.ndarray, "terms 3 4"]
    """K [R | t]."""
    xy: Float[np.ndarray, "terms 2"]
    sigma: Float[np.ndarray, "terms"]
    firm: Bool[np.ndarray, "terms"] | None = None
    """Marks that no robust loss lets go, because a person put them there to correct the model; None where there are none."""


@dataclass(frozen=True, eq=False)
class CornerLines:
    """Edges relocated in the images: corner i lies on the plane m . X = c (through the line, at right angles to its face): (m . X_i - c) / sigma."""

    corner: Int[np.ndarray, "terms"]
    direction: Float[np.ndarray, "terms 3"]
    """m, unit."""
    offset: Float[np.ndarray, "terms"]
    """c."""
    sigma: Float[np.ndarray, "terms"]
    """World units."""


@dataclass(frozen=True, eq=False)
class CornerPriors:
    """Corners located as patches: whitening @ (X_i - mean), three numbers a term."""

    corner: Int[np.ndarray, "terms"]
    mean: Float[np.ndarray, "terms 3"]
    whitening: Float[np.ndarray, "terms 3 3"]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Everything the structured adjustment is given besides the incidences."""

    plane_points: PlanePoints
    marks: CornerMarks
    lines: CornerLines
    priors: CornerPriors
