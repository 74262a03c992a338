"""Scene features as witnesses: faces are opaque, so a feature seen inside a face cannot lie behind it."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Vec3
from planewright.lifting.photometric import Reference, dominant_plane
from planewright.lifting.task import Task


@dataclass(frozen=True, eq=False)
class Witnesses:
    """Scene features seen inside a face's polygon about the time of a view."""

    xy: Float[np.ndarray, "n 2"]
    """Array coordinates."""
    rho: Float[np.ndarray, "n"]
    """Inverse depth there."""
    sigma: Float[np.ndarray, "n"]
    """Relative standard deviation of the depth."""

    def basis(self, reference: Reference) -> Float[np.ndarray, "n 3"]:
        """In which a plane of the reference is the inverse depth at each of them: basis @ plane."""
        return np.concatenate([(self.xy - reference.center) / reference.radius, np.ones((len(self.rho), 1))], axis=1)


def witnesses_in(task: Task, view: int, mask: Bool[np.ndarray, "height width"]) -> Witnesses:
    """Scene features observed about the time of a view that lie inside a mask there."""
    views, scene, near = task.views, task.scene, task.tolerances.witness_frames
    frame = int(views.frame[view])
    seen = (scene.seen[:, 0] <= frame + near) & (scene.seen[:, 1] >= frame - near)
    cam = scene.xyz[seen] @ views.rotation[view].T + views.translation[view]
    ahead = cam[:, 2] > 1e-6
    axis, cam = views.rotation[view][2], cam[ahead]
    sigma = np.sqrt(np.einsum("i,nij,j->n", axis, scene.covariance[seen][ahead], axis)) / cam[:, 2]
    k = views.calibration
    xy = (cam[:, :2] / cam[:, 2:]) @ k[:2, :2].T + k[:2, 2] - 0.5
    x, y = (np.rint(v).astype(int) for v in xy.T)
    inside = (x >= 0) & (y >= 0) & (x < mask.shape[1]) & (y < mask.shape[0])
    inside[inside] = mask[y[inside], x[inside]]
    return Witnesses(xy[inside], 1.0 / cam[inside, 2], sigma[inside])


def seen_through(witnesses: Witnesses, reference: Reference, plane: Vec3, behind: float) -> float:
    """How many features lie behind a plane through which they were seen, less a quarter of all: some are wrong, others seen beside what is drawn.

    behind: a feature counts from this far behind, relative depth, and from five of its own sigmas.
    """
    there = witnesses.basis(reference) @ plane
    hidden = witnesses.rho < there * (1.0 - np.maximum(behind, 5.0 * witnesses.sigma))
    return max(0.0, float(hidden.sum()) - 0.25 * len(witnesses.rho))


def plane_of_witnesses(witnesses: Witnesses, reference: Reference, behind: float, rng: np.random.Generator) -> tuple[Vec3, float, float] | None:
    """The plane of the features seen through what stands before the face: of those behind the plane most of them lie on.

    Returns the plane in the reference's basis, how much speaks for it, and how many features are seen through it.
    """
    rho, basis = witnesses.rho, witnesses.basis(reference)
    left = np.ones(len(rho), bool)
    tolerance = 0.5 * behind
    for _ in range(4):
        plane = dominant_plane(basis[left], rho[left], tolerance, rng)
        if plane is None or plane[2] <= 0 or (reference.basis @ plane).min() <= 0:
            return None
        through = seen_through(witnesses, reference, plane, behind)
        on = np.abs(basis @ plane - rho) < tolerance * rho
        if through < 3 and on.sum() >= 8:
            return plane, min(float(on.sum()) / 8.0, 2.0), through
        left &= rho < (basis @ plane) * (1.0 - tolerance)
    return None
