"""What a lift is given, in rows and in the units of its views; nothing here changes while it runs."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Int
from planewright.lifting.photometric import PhotometricOptions
from planewright.lifting.rays import MarkRays, mark_rays, triangulate_marks
from planewright.lifting.views import Views
from planewright.sfm.cameras import ScenePoints
from planewright.sketch.graph import Sketch

APART_DEG = 4.0
"""Marks whose rays meet at less than this angle do not tell a depth."""


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """What is allowed in a lift, in the units of its views."""

    mark_sigma: float
    """Standard deviation of a mark an axis, working pixels."""
    plane_sigma: float
    """Relative depth error allowed to a plane on top of what the mark gives."""
    same_depth: float
    """A face is hidden by another drawn over it that stands this far before it; relative depth."""
    behind: float
    """A feature contradicts a plane that it lies behind by more than this, relative depth."""
    witness_frames: int
    """Scene features count as seen in a view when they were observed within this many frames of it."""
    worth: float
    """By how much a pixel (log-likelihood) a plane must explain pixels better than another to be told from it."""


@dataclass(frozen=True, eq=False)
class Task:
    """A sketch to lift: its faces by rows of its points, its marks as rays, and what the clip says about where they are."""

    views: Views
    scene: ScenePoints
    photometric: PhotometricOptions
    tolerances: Tolerances
    rays: MarkRays
    loops: tuple[tuple[int, ...], ...]
    """Corners of each face's border."""
    holes: tuple[tuple[tuple[int, ...], ...], ...]
    """Corners of each hole of each face."""
    corners: tuple[tuple[int, ...], ...]
    """Rows of each face's corners, holes included."""
    faces_at: Int[np.ndarray, "points"]
    """How many faces meet in each corner."""
    triangulated: dict[int, tuple[float, float]]
    """Corners marked in frames far enough apart: depth along the first mark's ray, and its relative sigma."""

    @property
    def num_faces(self) -> int:
        """How many faces are drawn."""
        return len(self.loops)

    @property
    def num_points(self) -> int:
        """How many points are drawn."""
        return len(self.faces_at)

    def first_marks(self, points: tuple[int, ...]) -> Int[np.ndarray, "rows"]:
        """The row of the first mark of each point that has one, in the order of the points."""
        return np.array([rows[0] for point in points if len(rows := self.rays.of_point(point))], int)

    def rho_range(self, view: int) -> tuple[float, float] | None:
        """Inverse depths worth trying in a view: those of the scene features, with room on both sides; None where there are too few."""
        z = self.scene.xyz @ self.views.rotation[view][2] + self.views.translation[view][2]
        z = z[z > 0]
        if len(z) < 8:
            return None
        near, far = np.percentile(z, [1.0, 98.0])
        room = far - near
        return 1.0 / min(1.4 * far, far + 0.5 * room), 1.0 / max(0.75 * near, near - 0.4 * room)


def task_of(views: Views, sketch: Sketch, scene: ScenePoints, photometric: PhotometricOptions, tolerances: Tolerances) -> Task:
    """A sketch by rows, its marks as rays."""
    rays = mark_rays(views, sketch)
    row = {point.id: i for i, point in enumerate(sketch.points)}
    loops = tuple(tuple(row[c] for c in face.loop) for face in sketch.faces)
    holes = tuple(tuple(tuple(row[c] for c in hole) for hole in face.holes) for face in sketch.faces)
    corners = tuple((*loop, *(c for hole in inside for c in hole)) for loop, inside in zip(loops, holes, strict=True))
    faces_at = np.bincount([c for face in corners for c in set(face)], minlength=len(sketch.points))
    triangulated = _triangulated(views, rays, len(sketch.points), tolerances.mark_sigma)
    return Task(views, scene, photometric, tolerances, rays, loops, holes, corners, faces_at, triangulated)


def _triangulated(views: Views, rays: MarkRays, num_points: int, mark_sigma: float) -> dict[int, tuple[float, float]]:
    out: dict[int, tuple[float, float]] = {}
    for c in range(num_points):
        rows = rays.of_point(c)
        hit = triangulate_marks(rays, rows)
        if hit is None or hit[1] < np.radians(APART_DEG):
            continue
        first = rows[0]
        depth = float((hit[0] - rays.origin[first]) @ views.rotation[rays.view[first]][2])
        if depth > 0:
            out[c] = (depth, float(2.0 * mark_sigma / (views.calibration[0, 0] * np.sin(hit[1]))))
    return out
