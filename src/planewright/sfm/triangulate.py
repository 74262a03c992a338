"""Points from rays: every track on its own, with the cameras held fixed."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float
from planewright.geometry.camera import Intrinsics
from planewright.sfm.bundle import Observations
from planewright.sfm.kernels import triangulate_points


@dataclass(frozen=True, eq=False)
class Triangulated:
    """One row per track; rows with fewer than two observations hold NaN."""

    xyz: Float[np.ndarray, "points 3"]
    covariance: Float[np.ndarray, "points 3 3"]
    """With the cameras held fixed, for one pixel of noise a coordinate."""
    rms: Float[np.ndarray, "points"]
    """Cauchy-weighted residual, pixels."""
    angle: Float[np.ndarray, "points"]
    """Largest angle between two rays, radians."""
    in_front: Bool[np.ndarray, "points"]
    """In front of every camera that sees it."""


def intrinsics_value(values: Float[np.ndarray, "5"], image_size: tuple[int, int], radial_terms: int) -> Intrinsics:
    """From what the kernels take: focal, principal point x and y, k1, k2."""
    return Intrinsics(
        focal=float(values[0]), principal_point=values[1:3].copy(), image_size=image_size, distortion=tuple(float(k) for k in values[3 : 3 + radial_terms])
    )


def normalize(values: Float[np.ndarray, "5"], xy: Float[np.ndarray, "obs 2"]) -> Float[np.ndarray, "obs 2"]:
    """Undistorted normalized coordinates of pixels."""
    terms = 2 if values[4] else 1 if values[3] else 0
    return intrinsics_value(values, (1, 1), terms).normalize(xy)


def triangulate(
    values: Float[np.ndarray, "5"],
    rotation: Float[np.ndarray, "cameras 3 3"],
    translation: Float[np.ndarray, "cameras 3"],
    seen: Observations,
    *,
    scale: float,
    start: Float[np.ndarray, "points 3"] | None = None,
    iterations: int = 10,
) -> Triangulated:
    """Least-squares points under a Cauchy cost of `scale` pixels, from the point nearest to all rays or from the finite rows of `start`."""
    num_points = len(seen.first) - 1
    xyz = np.full((num_points, 3), np.nan) if start is None else start.copy()
    covariance, quality = np.zeros((num_points, 3, 3)), np.zeros((num_points, 3))
    rays = normalize(values, seen.xy)
    triangulate_points(values, rotation, translation, seen.first, seen.camera, seen.xy, rays, scale, iterations, xyz, covariance, quality)
    few = np.diff(seen.first) < 2
    xyz[few] = np.nan
    return Triangulated(xyz=xyz, covariance=covariance, rms=quality[:, 0], angle=quality[:, 1], in_front=(quality[:, 2] > 1e-9) & ~few)
