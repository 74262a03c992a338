"""What hides what: faces against faces in the views, and corners against faces in every frame."""

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.geometry.camera import Intrinsics
from planewright.geometry.raster import PlanarPolygons, face_buffer
from planewright.geometry.rigid import Rigid
from planewright.lifting.views import Views
from planewright.planes.polygons import polygons_of
from planewright.sketch.graph import Sketch


def owners_in_views(views: Views, polygons: PlanarPolygons, scale: float = 0.5) -> Int[np.ndarray, "views height width"]:
    """The nearest face at each pixel of each view, -1 where there is none; `scale` is the size of the buffers relative to the views."""
    height, width = views.images.shape[1:]
    k = views.calibration
    intrinsics = Intrinsics(float(k[0, 0]), k[:2, 2].copy(), (width, height))
    near = 1e-3 * float(np.median(np.linalg.norm(polygons.corners - views.centers.mean(axis=0), axis=1))) if len(polygons.corners) else 1e-3
    return np.stack([
        face_buffer(polygons, intrinsics, Rigid(r, t), scale=scale, near=near).face for r, t in zip(views.rotation, views.translation, strict=True)
    ])  # fmt: skip


def corner_visibility(
    sketch: Sketch,
    points: Float[np.ndarray, "points 3"],
    normals: Float[np.ndarray, "faces 3"],
    offsets: Float[np.ndarray, "faces"],
    centers: Float[np.ndarray, "frames 3"],
    tolerance: float,
    seen: Bool[np.ndarray, "frames points"] | None = None,
) -> Bool[np.ndarray, "frames points"]:
    """Whether nothing of the model hides a corner from a camera centre: a face at the corner faces the camera, and no face crosses
    the line of sight nearer than the corner by more than `tolerance` (world units).

    Points on no known face count as facing the camera.

    seen: where a person saw the corner. A face that would hide it there is beside its place by what it is too near, or the corner is; so in
    all frames that face hides it only where it is nearer than twice that.
    """
    polygons = polygons_of(sketch, points, normals, offsets)
    row = {point.id: i for i, point in enumerate(sketch.points)}
    known_face = np.asarray(np.isfinite(normals).all(axis=1))
    side = np.einsum("kj,fj->kf", centers, np.where(known_face[:, None], normals, 0.0)) - np.where(known_face, offsets, 0.0)[None]
    visible = np.tile(np.asarray(np.isfinite(points).all(axis=1)), (len(centers), 1))
    at_face = np.zeros((len(points), len(sketch.faces)), bool)
    for f, face in enumerate(sketch.faces):
        if known_face[f]:
            at_face[[row[c] for c in face.corners], f] = True
    on_some = np.asarray(at_face.any(axis=1))
    facing = np.einsum("kf,pf->kp", (side > 0).astype(np.int32), at_face.astype(np.int32)) > 0
    visible &= facing | ~on_some
    for f in range(len(sketch.faces)):
        if polygons.face_start[f] == polygons.face_start[f + 1]:
            continue
        normal = normals[f]
        others = np.nonzero(~at_face[:, f] & np.isfinite(points).all(axis=1))[0]
        if len(others) == 0:
            continue
        ray = points[others][None] - centers[:, None]
        length = np.linalg.norm(ray, axis=2)
        along = ray @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = -side[:, f][:, None] / along
        crosses = (reach > 1e-9) & (reach * length < length - tolerance)
        if seen is not None:
            crosses &= ~_believed_too_near(polygons, f, centers, ray, length, reach, crosses, seen[:, others])
        hit = centers[:, None] + np.where(crosses, reach, 0.0)[..., None] * ray
        k, i = np.nonzero(crosses)
        if len(k):
            covered = inside_polygon(polygons, f, hit[k, i])
            visible[k[covered], others[i[covered]]] = False
    return visible


def _believed_too_near(
    polygons: PlanarPolygons,
    face: int,
    centers: Float[np.ndarray, "frames 3"],
    ray: Float[np.ndarray, "frames others 3"],
    length: Float[np.ndarray, "frames others"],
    reach: Float[np.ndarray, "frames others"],
    crosses: Bool[np.ndarray, "frames others"],
    seen: Bool[np.ndarray, "frames others"],
) -> Bool[np.ndarray, "frames others"]:
    """Where a face is nearer than a corner by less than twice what it would be where the corner was seen through it."""
    k, i = np.nonzero(crosses & seen)
    gap = np.zeros(length.shape[1])
    if len(k):
        hit = centers[k] + reach[k, i][:, None] * ray[k, i]
        wrong = inside_polygon(polygons, face, hit)
        np.maximum.at(gap, i[wrong], (length * (1.0 - reach))[k[wrong], i[wrong]])
    return crosses & (np.where(crosses, length * (1.0 - reach), 0.0) < 2.0 * gap)


def inside_polygon(polygons: PlanarPolygons, face: int, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """Whether points of a face's plane lie inside it: even-odd over all its loops, so that holes are outside."""
    drop = int(np.argmax(np.abs(polygons.normals[face])))
    keep = [axis for axis in range(3) if axis != drop]
    x, y = points[:, keep[0]], points[:, keep[1]]
    inside = np.zeros(len(points), bool)
    for number in range(polygons.face_start[face], polygons.face_start[face + 1]):
        loop = polygons.corners[polygons.loop_start[number] : polygons.loop_start[number + 1]]
        a, b = loop[:, keep], np.roll(loop, -1, axis=0)[:, keep]
        for (ax, ay), (bx, by) in zip(a, b, strict=True):
            cross = (ay > y) != (by > y)
            with np.errstate(divide="ignore", invalid="ignore"):
                inside ^= cross & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    return inside
