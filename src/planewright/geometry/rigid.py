"""Rigid motions. `b_from_a` maps a to b, so that neighbours match: `cam_from_world @ world_from_plane`."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Float, Mat3, Vec3


@dataclass(frozen=True, eq=False)
class Rigid:
    """x -> rotation @ x + translation."""

    rotation: Mat3
    translation: Vec3

    def __matmul__(self, other: "Rigid") -> "Rigid":
        return Rigid(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def apply(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
        """The points, moved."""
        return points @ self.rotation.T + self.translation

    def inverse(self) -> "Rigid":
        """The motion back."""
        return Rigid(self.rotation.T, -self.rotation.T @ self.translation)


def rotations_from_vectors(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Rotation matrices of rotation vectors (radians): Rodrigues' formula, exact near zero."""
    angle2 = np.einsum("ni,ni->n", vectors, vectors)[:, None, None]
    angle = np.sqrt(angle2)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0 - angle2 / 6.0, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle2 / 24.0, (1.0 - np.cos(safe)) / (safe * safe))
    k = np.zeros((len(vectors), 3, 3))
    k[:, 0, 1], k[:, 0, 2], k[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    k -= k.transpose(0, 2, 1)
    return np.eye(3) + a * k + b * (k @ k)


def rotation_angle(a: Mat3, b: Mat3) -> float:
    """Angle of the rotation between two orientations, in radians; accurate for small angles too."""
    r = a @ b.T
    vector = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    return float(np.arctan2(np.linalg.norm(vector), np.trace(r) - 1.0))
