"""Where the sketch is by now: the planes chosen for its faces, and the corners that these and the marks locate."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Bool, Float, UInt8
from planewright.lifting.hypothesis import Hypothesis
from planewright.lifting.photometric import relative_sigma
from planewright.lifting.rays import meet
from planewright.lifting.task import Task


@dataclass(frozen=True, eq=False)
class Located:
    """What is known of a sketch between two rounds of a lift."""

    chosen: tuple[Hypothesis | None, ...]
    """The plane of each face, where one was chosen."""
    points: Float[np.ndarray, "points 3"]
    """NaN where a corner never was known, its last place where it is known no more."""
    known: Bool[np.ndarray, "points"]
    spread: Float[np.ndarray, "points"]
    """Relative standard deviation of the depth of known corners, infinite elsewhere."""
    told_by: tuple[frozenset[int], ...]
    """Faces that located each corner."""


def nothing_located(task: Task) -> Located:
    """The state before the first round."""
    points = task.num_points
    nobody = (frozenset[int](),) * points
    return Located((None,) * task.num_faces, np.full((points, 3), np.nan), np.zeros(points, bool), np.full(points, np.inf), nobody)


def corner_depths(task: Task, face: int, guess: Hypothesis) -> dict[int, tuple[float, float]]:
    """Depth of each marked corner of the face on the hypothesis' plane, along its first mark's ray, with its relative sigma."""
    rays, tolerances = task.rays, task.tolerances
    out: dict[int, tuple[float, float]] = {}
    for c in task.corners[face]:
        rows = rays.of_point(c)[:1]
        if len(rows):
            depth, slope = meet(rays, rows, guess.normal, guess.offset)
            at = rays.origin[rows[0]] + depth[0] * rays.direction[rows[0]]
            own = relative_sigma(task.views, guess.found, at) if guess.found is not None else 0.0
            out[c] = (float(depth[0]), float(np.sqrt((slope[0] * tolerances.mark_sigma) ** 2 + tolerances.plane_sigma**2 + own**2)))
    return out


def locate(task: Task, chosen: Sequence[Hypothesis | None], before: Located) -> Located:
    """Corners from the chosen planes and from marks far apart; corners of which these say nothing stay where they were `before`, unknown."""
    sayings: list[list[tuple[float, float]]] = [[] for _ in range(task.num_points)]
    told_by: list[set[int]] = [set() for _ in range(task.num_points)]
    for f, guess in enumerate(chosen):
        if guess is not None:
            for c, saying in corner_depths(task, f, guess).items():
                if saying[0] > 0:
                    sayings[c].append(saying)
                    told_by[c].add(f)
    points, known, spread = before.points.copy(), np.zeros(task.num_points, bool), np.full(task.num_points, np.inf)
    for c, said in enumerate(sayings):
        rows = task.rays.of_point(c)
        if len(rows) == 0:
            continue
        if c in task.triangulated:
            said.append(task.triangulated[c])
        if said:
            depth, spread[c] = _agreed_depth(said)
            points[c] = task.rays.origin[rows[0]] + depth * task.rays.direction[rows[0]]
            known[c] = True
    return Located(tuple(chosen), points, known, spread, tuple(map(frozenset, told_by)))


def _agreed_depth(said: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The weighted mean of depths that agree with their weighted median, and its relative sigma."""
    z = np.array([depth for depth, _ in said])
    sigma = np.array([sure for _, sure in said])
    order = np.argsort(z, kind="stable")
    weight = np.cumsum(1.0 / sigma[order] ** 2)
    middle = z[order][np.searchsorted(weight, 0.5 * weight[-1])]
    agree = np.abs(np.log(z / middle)) < 3.0 * np.hypot(sigma, sigma.min())
    w = 1.0 / sigma[agree] ** 2
    depth = float((w * z[agree]).sum() / w.sum())
    return depth, float(1.0 / np.sqrt(w.sum())) if len(w) > 1 else float(sigma[agree].min())


def places_in_view(task: Task, located: Located, view: int, corners: Sequence[int]) -> list[tuple[float, float]]:
    """Where corners are in a view, those of which it is known: marked there, or known in 3D and projected. Array coordinates."""
    out: list[tuple[float, float]] = []
    p = task.views.projections[view]
    for c in corners:
        rows = np.nonzero((task.rays.point == c) & (task.rays.view == view))[0]
        if len(rows):
            x, y = task.rays.xy[rows[0]]
            out.append((float(x) - 0.5, float(y) - 0.5))
        elif located.known[c]:
            q = p @ np.append(located.points[c], 1.0)
            if q[2] > 1e-9:
                out.append((float(q[0] / q[2]) - 0.5, float(q[1] / q[2]) - 0.5))
    return out


def face_in_view(task: Task, located: Located, view: int, face: int) -> tuple[UInt8[np.ndarray, "height width"], Float[np.ndarray, "corners 2"]] | None:
    """The face's polygon in a view (1 inside, holes 0) and its border; None where fewer than three corners of its loop are located."""
    loop = places_in_view(task, located, view, task.loops[face])
    if len(loop) < 3:
        return None
    height, width = task.views.images.shape[1:]
    mask = np.zeros((height, width), np.uint8)
    polygon = np.clip(np.array(loop), -4 * max(width, height), 5 * max(width, height))
    cv2.fillPoly(mask, [np.round(polygon * 16).astype(np.int32)], 1, shift=4)
    for hole in task.holes[face]:
        border = places_in_view(task, located, view, hole)
        if len(border) >= 3:
            cv2.fillPoly(mask, [np.round(np.array(border) * 16).astype(np.int32)], 0, shift=4)
    return mask, polygon
