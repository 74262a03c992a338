"""From corners, planes and a texture atlas to triangles."""

from collections.abc import Sequence

import mapbox_earcut
import numpy as np

from planewright.arrays import Float, Int, Vec3
from planewright.model.atlas import Atlas, FaceChart
from planewright.model.planar_model import FaceMesh, PlanarModel
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.polygons import face_loops
from planewright.sfm.cameras import Cameras

AREA_TOLERANCE = 1e-6
"""Relative difference between the area of a loop and that of its triangles beyond which the loop must cross itself or a hole."""


def build_model(scene: PlanarScene, atlas: Atlas, *, cameras: Cameras | None = None, unit: str | None = None, world_up: Vec3 | None = None) -> PlanarModel:
    """The known faces as textured triangles; their vertices are the scene's corners, exactly.

    A face whose plane or corners are not known, or that has no area, is left out, and `notes` says so. A loop that crosses itself is filled as well as
    can be, with a note.

    Args:
        cameras: say how the model was held while it was filmed, for want of `world_up`.
        unit: of the scene's coordinates, where a length is known.
        world_up: unit vector in the world, where it is known.
    """
    charts = {chart.face: chart for chart in atlas.charts}
    loops = face_loops(scene)
    meshes: list[FaceMesh] = []
    notes: list[str] = []
    for f, face in enumerate(scene.sketch.faces):
        if not loops[f]:
            notes.append(f"Face {face.id} is left out: its plane or a corner is not known.")
        elif f not in charts:
            notes.append(f"Face {face.id} is left out: its corners lie on one line.")
        else:
            if len(loops[f]) < 1 + len(face.holes):
                notes.append(f"Face {face.id} is shown without a hole: a corner of the hole is not known.")
            triangles, whole = triangulate(loops[f], charts[f], scene.normals[f])
            if len(triangles) == 0:
                notes.append(f"Face {face.id} is left out: its corners lie on one line.")
                continue
            if not whole:
                notes.append(f"The border of face {face.id} crosses itself or a hole; look at the order of its corners.")
            vertices = np.concatenate(loops[f])
            meshes.append(FaceMesh(face.id, scene.normals[f], vertices, triangles, atlas.uv(charts[f], vertices)))
    return PlanarModel(tuple(meshes), atlas.image, unit, world_up, atlas.inferred, None if cameras is None else average_up(cameras), tuple(notes))


def average_up(cameras: Cameras) -> Vec3:
    """Upwards as the cameras were held: the direction at right angles to the rows of all images, since people hold cameras level.

    The average of the images' own up directions is off by as much as the camera looked down; the rows are not. Where the camera hardly turned, the
    rows leave a direction open, and the average decides it.
    """
    rows, average = cameras.rotation[cameras.posed, 0], -cameras.rotation[cameras.posed, 1].sum(axis=0)
    length = float(np.linalg.norm(average))
    if length < 1e-9:
        return np.array([0.0, -1.0, 0.0])
    average /= length
    # One part in a hundred: as much as the rows of a camera that turned by 6 degrees (standard deviation) have to say.
    spread = rows.T @ rows / len(rows) + 0.01 * (np.eye(3) - np.outer(average, average))
    up = np.linalg.eigh(spread)[1][:, 0]
    return up if up @ average > 0 else -up


def triangulate(loops: Sequence[Float[np.ndarray, "... 3"]], chart: FaceChart, normal: Vec3) -> tuple[Int[np.ndarray, "triangles 3"], bool]:
    """Triangles (rows of all loops' corners, one loop after the other), counter-clockwise seen from the front, and whether they fill the face exactly.

    Corners on the line between their neighbours may be left out of the triangles. By ear clipping (Eberly 2002) in the plane of the face.
    """
    flat = [chart.to_texels(loop) for loop in loops]
    points = np.concatenate(flat)
    ends = np.cumsum([len(loop) for loop in flat]).astype(np.uint32)
    triangles = np.asarray(mapbox_earcut.triangulate_float64(points, ends), dtype=np.int64).reshape(-1, 3)
    areas = _triangle_areas(points, triangles)
    total = np.abs(areas).sum()
    kept = np.abs(areas) > 1e-12 * total
    # In the chart v points down, so a positive area is clockwise to the eye. The chart's front is the face's front: u x v is minus the normal.
    handed = float(np.cross(chart.axis_u, chart.axis_v) @ normal)
    triangles = np.where((areas * handed < 0)[:, None], triangles[:, ::-1], triangles)[kept]
    border, holes = _loop_area(flat[0]), sum(_loop_area(hole) for hole in flat[1:])
    return triangles, bool(abs(border - holes - total) <= AREA_TOLERANCE * total)


def _triangle_areas(points: Float[np.ndarray, "points 2"], triangles: Int[np.ndarray, "triangles 3"]) -> Float[np.ndarray, "triangles"]:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return 0.5 * ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))


def _loop_area(loop: Float[np.ndarray, "... 2"]) -> float:
    x, y = (loop - loop.mean(axis=0)).T
    return abs(float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))))
