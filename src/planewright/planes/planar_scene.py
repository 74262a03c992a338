"""The structure: corners and planes in the world, with their joint uncertainty."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float
from planewright.sketch.graph import Sketch


@dataclass(frozen=True, eq=False)
class PlanarScene:
    """Corners and planes; row i of `points` is `sketch.points[i]`, row f of `normals` is `sketch.faces[f]`."""

    sketch: Sketch
    """With its faces; those found in the drawn graph included."""
    points: Float[np.ndarray, "points 3"]
    """World; NaN where `point_known` is False."""
    point_known: Bool[np.ndarray, "points"]
    point_covariance: Float[np.ndarray, "points 3 3"]
    """World units squared."""
    normals: Float[np.ndarray, "faces 3"]
    """Unit, towards the side from which the face was seen; NaN where `face_known` is False."""
    offsets: Float[np.ndarray, "faces"]
    """normal . x = offset."""
    face_known: Bool[np.ndarray, "faces"]
    plane_covariance: Float[np.ndarray, "planes3 planes3"]
    """Joint, 3 rows a face: tilt (radians) along each row of `tangent_basis(normal)`, then offset at the face's centre (world units)."""

    def point_row(self) -> dict[str, int]:
        """Point id -> row."""
        return {point.id: i for i, point in enumerate(self.sketch.points)}

    def face_row(self) -> dict[str, int]:
        """Face id -> row."""
        return {face.id: f for f, face in enumerate(self.sketch.faces)}
