"""Corners that clicks and planes leave open, from the shape of a four-sided face.

A corner seen at a grazing angle slides along its click's ray by a tenth of its depth for a pixel of the click. Most four-sided
faces that people draw are parallelograms, near enough to say where to look for the edges that then fix the corner.
"""

import numpy as np

from planewright.arrays import Float
from planewright.planes.evidence import CornerPriors
from planewright.planes.planar_scene import PlanarScene
from planewright.sketch.graph import Sketch


def fourth_corners(sketch: Sketch, scene: PlanarScene, *, open_above: float, sigma: float = 0.06) -> CornerPriors:
    """Weak priors at the fourth corner of a parallelogram for corners less sure than `open_above` (standard deviation, world units).

    sigma: of the prior, as a share of the face's longer side. The three other corners must be twice as sure as the open one.
    """
    row = scene.point_row()
    worst = np.sqrt(np.maximum(np.linalg.eigvalsh(np.where(np.isfinite(scene.point_covariance), scene.point_covariance, 0.0))[:, 2], 0.0))
    worst = np.where(scene.point_known & np.isfinite(scene.point_covariance).all(axis=(1, 2)), worst, np.inf)
    corner: list[int] = []
    mean: list[Float[np.ndarray, "3"]] = []
    whitening: list[Float[np.ndarray, "3 3"]] = []
    for face in sketch.faces:
        if len(face.loop) != 4 or face.open:
            continue
        loop = [row[c] for c in face.loop]
        for i, c in enumerate(loop):
            before, across, after = (loop[(i + k) % 4] for k in (3, 2, 1))
            others = [before, across, after]
            if worst[c] < open_above or not scene.point_known[others].all() or 2 * worst[others].max() > worst[c]:
                continue
            sides = scene.points[[before, after]] - scene.points[across]
            corner.append(c)
            mean.append(scene.points[before] + scene.points[after] - scene.points[across])
            whitening.append(np.eye(3) / (sigma * float(np.linalg.norm(sides, axis=1).max())))
    return CornerPriors(np.array(corner, int), np.array(mean, float).reshape(-1, 3), np.array(whitening, float).reshape(-1, 3, 3))


def joined(a: CornerPriors, b: CornerPriors) -> CornerPriors:
    """Both together."""
    return CornerPriors(np.concatenate([a.corner, b.corner]), np.concatenate([a.mean, b.mean]), np.concatenate([a.whitening, b.whitening]))
