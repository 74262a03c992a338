"""The faces of a scene as polygons in the world."""

import numpy as np

from planewright.arrays import Float
from planewright.geometry.raster import PlanarPolygons, planar_polygons
from planewright.planes.planar_scene import PlanarScene


def face_loops(scene: PlanarScene) -> list[list[Float[np.ndarray, "... 3"]]]:
    """For each face its loops in the world, the border first, then the holes; none for a face whose plane or a corner of whose border is not known.

    A hole with an unknown corner is left out, so that the face is at least whole.
    """
    row = scene.point_row()
    loops: list[list[Float[np.ndarray, "... 3"]]] = []
    for f, face in enumerate(scene.sketch.faces):
        rows = [[row[corner] for corner in loop] for loop in (face.loop, *face.holes)]
        known = [bool(scene.point_known[loop].all()) for loop in rows]
        usable = bool(scene.face_known[f]) and known[0]
        loops.append([scene.points[loop] for loop, is_known in zip(rows, known, strict=True) if is_known] if usable else [])
    return loops


def scene_polygons(scene: PlanarScene) -> PlanarPolygons:
    """The faces for `geometry.raster.face_buffer`; row f is face f, and faces that are not known are never seen."""
    return planar_polygons(scene.normals, scene.offsets, face_loops(scene))
