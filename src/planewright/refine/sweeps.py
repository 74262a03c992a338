"""Corners whose depth the lift left open: found along their click's ray by the edges that end in them.

A corner seen at a grazing angle, or on a face that no reference view shows, has a depth that a pixel's error of the click moves
by a tenth. Its edges tell: the projected segments from the corners that are known run along steep grey values in all views only
where the depth is right.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from planewright.arrays import Bool, Float
from planewright.lifting.rays import MarkRays, meet
from planewright.lifting.views import Views
from planewright.tracking.kernels import segment_steepness


def sweep_corners(
    views: Views,
    rays: MarkRays,
    edges: Sequence[tuple[int, int, int]],
    drawn: Mapping[tuple[int, int], bool],
    points: Float[np.ndarray, "points 3"],
    known: Bool[np.ndarray, "points"],
    normals: Float[np.ndarray, "faces 3"],
    face_known: Bool[np.ndarray, "faces"],
    click_sigma: float,
    *,
    open_above: float = 0.015,
    depths: int = 161,
) -> Float[np.ndarray, "points 3"]:
    """The points, with those moved along their ray whose relative depth sigma (from the click, over all their faces) is above `open_above`."""
    projections = views.projections.copy()
    projections[:, :2] -= 0.5 * projections[:, 2:3]
    spread = _depth_sigma(rays, edges, points, known, normals, face_known, click_sigma)
    moved = points.copy()
    for c in np.nonzero(known & (spread > open_above))[0]:
        neighbours = sorted({b if a == c else a for _, a, b in edges if c in (a, b) and drawn.get((min(a, b), max(a, b)), True)})
        neighbours = [n for n in neighbours if known[n] and spread[n] <= open_above]
        mark = rays.of_point(int(c))
        if not neighbours or len(mark) == 0:
            continue
        row = int(mark[0])
        depth = float((points[c] - rays.origin[row]) @ views.rotation[rays.view[row]][2])
        reach = min(4.0 * float(spread[c]), 0.5)
        ratio = np.exp(np.linspace(-reach, reach, depths))
        ends = rays.origin[row] + depth * ratio[:, None] * rays.direction[row]
        facing = np.zeros(len(views.frame), bool)
        for f, a, b in edges:
            if c in (a, b) and face_known[f]:
                facing |= (views.centers - points[c]) @ normals[f] > 0.1 * np.linalg.norm(views.centers - points[c], axis=1)
        chosen = np.nonzero(facing)[0]
        chosen = chosen[np.unique(np.linspace(0, len(chosen) - 1, 40).round().astype(int))] if len(chosen) else chosen
        if len(chosen) < 4:
            continue
        total = np.zeros(depths)
        for n in neighbours:
            score = np.empty(depths)
            segment_steepness(views.images, chosen, projections, points[n], ends, 30, 40.0, score)
            total += score
        height = total - np.median(total)
        sharpness = float(height.max()) / max(1.4826 * float(np.median(np.abs(height))), 1e-6)
        if sharpness > 4.0:
            moved[c] = ends[int(np.argmax(total))]
    return moved


def _depth_sigma(
    rays: MarkRays,
    edges: Sequence[tuple[int, int, int]],
    points: Float[np.ndarray, "points 3"],
    known: Bool[np.ndarray, "points"],
    normals: Float[np.ndarray, "faces 3"],
    face_known: Bool[np.ndarray, "faces"],
    click_sigma: float,
) -> Float[np.ndarray, "points"]:
    """Relative depth sigma of each corner along its first mark's ray: what the click gives on its least grazing face."""
    spread = np.full(len(points), np.inf)
    for f, a, b in edges:
        for c in (a, b):
            mark = rays.of_point(c)[:1]
            if face_known[f] and known[c] and len(mark):
                _, slope = meet(rays, mark, normals[f], float(normals[f] @ points[c]))
                spread[c] = min(spread[c], float(slope[0]) * click_sigma)
    return spread
