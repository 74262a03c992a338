"""The camera: intrinsics, projection and its inverse. Pixels: the centre of the top-left pixel is (0.5, 0.5)."""

from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Float, Mat3, Vec2


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """One focal length, a principal point, and up to two radial terms (COLMAP's SIMPLE_RADIAL and RADIAL).

    A point with normalized coordinates (x, y) = (X/Z, Y/Z) is seen at `principal_point + focal * (1 + k1 r^2 + k2 r^4) * (x, y)`, r^2 = x^2 + y^2.
    """

    focal: float
    """Pixels."""
    principal_point: Vec2
    image_size: tuple[int, int]
    """Width, height."""
    distortion: tuple[float, ...] = ()
    """(), (k1,) or (k1, k2)."""

    @property
    def matrix(self) -> Mat3:
        """The calibration matrix K; it leaves the distortion out."""
        cx, cy = self.principal_point
        return np.array([[self.focal, 0.0, cx], [0.0, self.focal, cy], [0.0, 0.0, 1.0]])

    def pinhole(self) -> "Intrinsics":
        """The same camera without distortion."""
        return replace(self, distortion=())

    def project(self, points_in_cam: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 2"]:
        """Pixels of points in front of the camera (z > 0); points behind it give meaningless pixels."""
        return self.to_pixels(points_in_cam[:, :2] / points_in_cam[:, 2:])

    def to_pixels(self, normalized: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
        """Pixels of undistorted normalized coordinates."""
        if not self.distortion:
            return self.principal_point + self.focal * normalized
        r2 = (normalized**2).sum(axis=1, keepdims=True)
        return self.principal_point + self.focal * _radial_scale(r2, self.distortion) * normalized

    def normalize(self, xy: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
        """Undistorted normalized coordinates of pixels: the inverse of `to_pixels`, by Newton's method on the radius."""
        distorted = (xy - self.principal_point) / self.focal
        if not self.distortion:
            return distorted
        target = np.linalg.norm(distorted, axis=1, keepdims=True)
        k1, k2 = (*self.distortion, 0.0)[:2]
        r = target.copy()
        for _ in range(20):
            value = r * (1 + k1 * r**2 + k2 * r**4) - target
            slope = 1 + 3 * k1 * r**2 + 5 * k2 * r**4
            r = r - value / np.where(np.abs(slope) < 1e-3, 1e-3, slope)
        return distorted * np.where(target > 1e-12, r / np.maximum(target, 1e-12), 1.0)


def _radial_scale(r2: Float[np.ndarray, "points 1"], distortion: tuple[float, ...]) -> Float[np.ndarray, "points 1"]:
    k1, k2 = (*distortion, 0.0)[:2]
    return 1.0 + k1 * r2 + k2 * r2**2
