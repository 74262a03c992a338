"""The faces of a scene, or of what is known of one so far, as polygons in the world."""

import numpy as np

from planewright.arrays import Bool, Float
from planewright.geometry.raster import PlanarPolygons, planar_polygons
from planewright.planes.planar_scene import PlanarScene
from planewright.sketch.graph import Sketch

Loops = list[list[Float[np.ndarray, "... 3"]]]
"""For each face its loops in the world, the border first, then the holes."""


def face_loops(scene: PlanarScene) -> Loops:
    """For each face its loops in the world, the border first, then the holes; none for a face whose plane or a corner of whose border is not known.

    A hole with an unknown corner is left out, so that the face is at least whole.
    """
    return _loops(scene.sketch, scene.points, scene.point_known, scene.face_known, whole=True)


def scene_polygons(scene: PlanarScene) -> PlanarPolygons:
    """The faces for `geometry.raster.face_buffer`; row f is face f, and faces that are not known are never seen."""
    return planar_polygons(scene.normals, scene.offsets, face_loops(scene))


def polygons_of(
    sketch: Sketch, points: Float[np.ndarray, "points 3"], normals: Float[np.ndarray, "faces 3"], offsets: Float[np.ndarray, "faces"]
) -> PlanarPolygons:
    """The same while the structure is being found; what is not known is NaN.

    A face that lacks a corner hides what is behind it all the same, so each loop keeps its known corners, and is left out below three.
    """
    return planar_polygons(normals, offsets, _loops(sketch, points, np.isfinite(points.sum(axis=1)), np.isfinite(normals.sum(axis=1)), whole=False))


def _loops(
    sketch: Sketch, points: Float[np.ndarray, "points 3"], point_known: Bool[np.ndarray, "points"], face_known: Bool[np.ndarray, "faces"], *, whole: bool
) -> Loops:
    """Loops of the known faces; whole: only those without an unknown corner, else what is known of them. No border, no holes."""
    row = {point.id: i for i, point in enumerate(sketch.points)}
    faces: Loops = []
    for face, is_known in zip(sketch.faces, face_known, strict=True):
        rows = [np.array([row[corner] for corner in loop]) for loop in (face.loop, *face.holes)]
        kept = [loop[point_known[loop]] for loop in rows]
        usable = [len(known) == len(loop) if whole else len(known) >= 3 for known, loop in zip(kept, rows, strict=True)]
        faces.append([points[known] for known, good in zip(kept, usable, strict=True) if good] if is_known and usable[0] else [])
    return faces
