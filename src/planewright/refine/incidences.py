"""Corners drawn inside a face that lie on its plane: chimney feet on a roof, a box on a table."""

from collections.abc import Mapping

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.lifting.rays import MarkRays
from planewright.planes.polygons import polygons_of
from planewright.sketch.graph import PointId, Sketch
from planewright.tracking.visibility import inside_polygon


def propose_incidences(
    sketch: Sketch,
    rays: MarkRays,
    points: Float[np.ndarray, "points 3"],
    covariance: Float[np.ndarray, "points 3 3"],
    known: Bool[np.ndarray, "points"],
    normals: Float[np.ndarray, "faces 3"],
    offsets: Float[np.ndarray, "faces"],
    face_known: Bool[np.ndarray, "faces"],
    tolerance: float,
) -> Int[np.ndarray, "incidences 2"]:
    """(face, point) of known corners over the inside of a known face and within `tolerance` times their depth of its plane.

    Points of no face are left alone: their patch says where they are. Corners whose height over the plane is less sure than half of
    that are left for a later round: that they agree would mean nothing, and enough of them bend the plane. These are proposals: the
    adjustment keeps those that agree with the views.
    """
    polygons = polygons_of(sketch, points, np.where(face_known[:, None], normals, np.nan), offsets)
    row = {point.id: i for i, point in enumerate(sketch.points)}
    found: list[tuple[int, int]] = []
    alone = ~np.isin(np.arange(len(points)), [row[c] for face in sketch.faces for c in face.corners])
    for f, face in enumerate(sketch.faces):
        if not face_known[f]:
            continue
        own = {row[c] for c in face.corners}
        heights: dict[int, float] = {}
        for c in np.nonzero(known)[0]:
            marks = rays.of_point(int(c))
            if int(c) in own or len(marks) == 0 or not np.isfinite(covariance[c]).all() or alone[c]:
                continue
            depth = float(np.linalg.norm(points[c] - rays.origin[marks[0]]))
            height = float(normals[f] @ points[c] - offsets[f])
            sigma = float(np.sqrt(max(normals[f] @ covariance[c] @ normals[f], 0.0)))
            foot = points[c] - height * normals[f]
            if abs(height) < tolerance * depth and sigma < 0.5 * tolerance * depth and inside_polygon(polygons, f, foot[None])[0]:
                heights[int(c)] = abs(height)
        flat = _would_lie_flat(sketch, row, f, heights)
        found += [(f, c) for c in sorted(heights) if c not in flat]
    return np.array(found, int).reshape(-1, 2)


def _would_lie_flat(sketch: Sketch, row: Mapping[PointId, int], plane: int, heights: dict[int, float]) -> set[int]:
    """Corners whose incidence would press another face flat onto the plane: of each face only its two lowest may lie on it, and
    only where the others stand clearly higher (a shallow dormer on its roof)."""
    barred: set[int] = set()
    faces = [[row[c] for c in dict.fromkeys(face.corners)] for g, face in enumerate(sketch.faces) if g != plane]
    for corners in faces:
        near = sorted((c for c in corners if c in heights), key=lambda c: heights[c])
        if len(near) > 2:
            clear = heights[near[2]] > 2.5 * heights[near[1]]
            barred |= set(near[2:] if clear else near)
    return barred
