"""Marks and pixels as rays in the world, and where they meet planes."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Float, Int, Vec3
from planewright.lifting.views import Views
from planewright.sketch.graph import Sketch


@dataclass(frozen=True, eq=False)
class MarkRays:
    """Every mark in a view with a pose: one row a mark, sorted by point, then frame."""

    point: Int[np.ndarray, "marks"]
    """Row of the sketch's points."""
    view: Int[np.ndarray, "marks"]
    xy: Float[np.ndarray, "marks 2"]
    """Working pixels."""
    origin: Float[np.ndarray, "marks 3"]
    direction: Float[np.ndarray, "marks 3"]
    """World; scaled so that `origin + z * direction` has depth z in its camera."""
    per_pixel: Float[np.ndarray, "marks 2 3"]
    """Change of `direction` per pixel in x and in y."""

    def of_point(self, point: int) -> Int[np.ndarray, "rows"]:
        """Rows of a point."""
        return np.nonzero(self.point == point)[0]


def mark_rays(views: Views, sketch: Sketch) -> MarkRays:
    """The rays of all marks whose frame has a view."""
    rows: list[tuple[int, int, float, float]] = []
    for i, point in enumerate(sketch.points):
        for frame in sorted(point.marks):
            view = views.index(frame)
            if view is not None:
                x, y = point.marks[frame]
                rows.append((i, view, x * views.scale, y * views.scale))
    table = np.array(rows, float).reshape(-1, 4)
    view = table[:, 1].astype(int)
    inverse = np.linalg.inv(views.calibration)
    xy = table[:, 2:4]
    rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=1) @ inverse.T
    world_from_cam = views.rotation[view].transpose(0, 2, 1)
    per_pixel = np.einsum("nij,jp->npi", world_from_cam, inverse[:, :2])
    return MarkRays(table[:, 0].astype(int), view, xy, views.centers[view], np.einsum("nij,nj->ni", world_from_cam, rays), per_pixel)


def meet(rays: MarkRays, rows: Int[np.ndarray, "rows"], normal: Vec3, offset: float) -> tuple[Float[np.ndarray, "rows"], Float[np.ndarray, "rows"]]:
    """Depth at which each ray meets the plane (not positive: it does not), and its relative change per pixel of the mark."""
    along = rays.direction[rows] @ normal
    safe = np.where(np.abs(along) < 1e-9, 1e-9, along)
    depth = (offset - rays.origin[rows] @ normal) / safe
    slope = np.linalg.norm(rays.per_pixel[rows] @ normal, axis=1) / np.abs(safe)
    return depth, slope


def triangulate_marks(rays: MarkRays, rows: Int[np.ndarray, "rows"]) -> tuple[Vec3, float] | None:
    """The point nearest to the rays of two or more marks, and the largest angle between them in radians; None below two marks."""
    if len(rows) < 2:
        return None
    direction = rays.direction[rows] / np.linalg.norm(rays.direction[rows], axis=1, keepdims=True)
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    # in pixels rather than in space: weigh each ray by its depth, found in a first pass
    weight = np.ones(len(rows))
    xyz = np.zeros(3)
    for _ in range(3):
        total = np.einsum("n,nij->ij", weight, across)
        if np.linalg.cond(total) > 1e12:
            return None
        xyz = np.linalg.solve(total, np.einsum("n,nij,nj->i", weight, across, rays.origin[rows]))
        weight = 1.0 / np.maximum(((xyz - rays.origin[rows]) ** 2).sum(axis=1), 1e-12)
    angle = float(np.arccos(np.clip((direction @ direction.T).min(), -1.0, 1.0)))
    return xyz, angle


def on_plane(views: Views, view: int, pixels: Float[np.ndarray, "n 2"], normal: Vec3, offset: float) -> Float[np.ndarray, "n 3"]:
    """World points of a plane at working pixels of a view."""
    rays = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ np.linalg.inv(views.calibration).T
    directions = rays @ views.rotation[view]
    center = views.centers[view]
    along = directions @ normal
    along = np.where(np.abs(along) < 1e-9, 1e-9, along)
    return center + directions * ((offset - center @ normal) / along)[:, None]
