"""Which frames see a face well."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.geometry.raster import face_buffer
from planewright.model.atlas import FaceChart
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.polygons import face_loops, scene_polygons
from planewright.progress import Progress, silent, steps
from planewright.sfm.cameras import Cameras
from planewright.texture.atlas import FaceRectangle, chart_mask


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """How the frames for the texture are chosen."""

    max_frames: int = 48
    """Frames that are looked at in all, spread over the clip; of neighbours, the one that moves least is taken."""
    max_views: int = 20
    """Frames a face takes its texture from."""
    min_cos: float = 0.2
    """Smallest cosine of the angle between a face's normal and the ray to the camera; flatter views smear."""
    depth_tolerance: float = 0.005
    """How far behind the nearest face, as a fraction of its depth, a face still counts as seen: corners are not exact."""


@dataclass(frozen=True, eq=False)
class FaceViews:
    """The frames chosen for one face, by increasing frame."""

    row: Int[np.ndarray, "views"]
    """Rows of the cameras."""
    weight: Float[np.ndarray, "views"]
    """How much each is worth: 1 for the best, less for a flatter or more distant look."""
    footprint: float
    """Side of a pixel on the face, held straight before the camera of the best view; world units."""


def spread_rows(scene: PlanarScene, cameras: Cameras, available: Sequence[int], max_frames: int) -> Int[np.ndarray, "rows"]:
    """Rows of at most `max_frames` posed cameras among the frames that are available, evenly spread; of neighbours, the one whose image moves least.

    The motion stands in for motion blur: it is known for every frame without decoding it.
    """
    rows = np.flatnonzero(cameras.posed & np.isin(cameras.frame, np.asarray(available, dtype=np.int64)))
    known = scene.points[scene.point_known]
    if len(rows) <= 2 or len(known) == 0:
        return rows[:max_frames]
    in_cam = np.einsum("kij,pj->kpi", cameras.rotation[rows], known) + cameras.translation[rows, None]
    xy = in_cam[..., :2] / np.maximum(in_cam[..., 2:], 1e-6) * cameras.intrinsics.focal
    gap = np.maximum(np.diff(cameras.frame[rows]), 1)[:, None]
    step = np.median(np.linalg.norm(np.diff(xy, axis=0), axis=2) / gap, axis=1)
    speed = np.maximum(np.append(step, step[-1]), np.append(step[0], step))
    bounds = np.linspace(0, len(rows), min(max_frames, len(rows)) + 1).round().astype(int)
    return np.array([rows[a + int(np.argmin(speed[a:b]))] for a, b in pairwise(bounds)], dtype=np.int64)


def choose_views(
    scene: PlanarScene,
    cameras: Cameras,
    rectangles: dict[int, FaceRectangle],
    available: Sequence[int],
    options: ViewOptions = ViewOptions(),
    *,
    progress: Progress = silent,
) -> dict[int, FaceViews]:
    """For each face with a rectangle, the frames its texture is taken from; a face that is never seen has none, and no entry.

    Each face is sampled at up to 16 x 16 points. One after the other, the view is taken which adds most to the points seen least so far (sum over its
    points of weight / (1 + views that see the point)), so that what a few frames see is not lost to the many frames that see the rest better.
    """
    rows = spread_rows(scene, cameras, available, options.max_frames)
    samples = _sample_points(scene, rectangles)
    polygons = scene_polygons(scene)
    intrinsics = cameras.intrinsics.pinhole()
    width, height = intrinsics.image_size
    faces = sorted(samples)
    value = {f: np.zeros((len(rows), len(samples[f]))) for f in faces}
    depth = {f: np.full((len(rows), len(samples[f])), np.nan) for f in faces}
    for k, row in enumerate(steps(rows.tolist(), "Choosing views", progress)):
        pose = cameras.cam_from_world(row)
        buffer = face_buffer(polygons, intrinsics, pose)
        for f in faces:
            in_cam = pose.apply(samples[f])
            z = in_cam[:, 2]
            cos = -(in_cam @ (pose.rotation @ scene.normals[f])) / np.linalg.norm(in_cam, axis=1)
            ahead = np.flatnonzero((z > 1e-6) & (cos > options.min_cos))
            xy = intrinsics.project(in_cam[ahead])
            inside = (xy >= 0).all(axis=1) & (xy[:, 0] < width) & (xy[:, 1] < height)
            ahead, (x, y) = ahead[inside], xy[inside].astype(int).T
            seen = ahead[(buffer.face[y, x] == f) | (np.abs(buffer.depth[y, x] - z[ahead]) < options.depth_tolerance * z[ahead])]
            # Pixels that fall on a unit of area of the face, up to the focal length.
            value[f][k, seen] = cos[seen] / z[seen] ** 2
            depth[f][k, seen] = z[seen]
    views: dict[int, FaceViews] = {}
    for f in faces:
        chosen = _greedy(value[f], options.max_views)
        if len(chosen):
            mean = np.array([value[f][k][value[f][k] > 0].mean() for k in chosen])
            best = chosen[int(np.argmax(mean))]
            views[f] = FaceViews(rows[chosen], mean / mean.max(), float(np.nanmedian(depth[f][best])) / intrinsics.focal)
    return views


def _sample_points(scene: PlanarScene, rectangles: dict[int, FaceRectangle]) -> dict[int, Float[np.ndarray, "_points 3"]]:
    loops = face_loops(scene)
    samples: dict[int, Float[np.ndarray, "points 3"]] = {}
    for f, rectangle in sorted(rectangles.items()):
        texel = max(rectangle.size) / 16
        width, height = (max(1, int(np.ceil(side / texel))) for side in rectangle.size)
        chart = FaceChart(f, rectangle.origin, rectangle.axis_u, rectangle.axis_v, texel, width, height)
        inside: Bool[np.ndarray, "height width"] = chart_mask(chart, loops[f])
        y, x = np.nonzero(inside)
        # A sliver may slip between the points.
        samples[f] = chart.to_world(np.stack([x, y], axis=1) + 0.5) if len(x) else loops[f][0].mean(axis=0, keepdims=True)
    return samples


def _greedy(value: Float[np.ndarray, "views points"], max_views: int) -> Int[np.ndarray, "chosen"]:
    """Rows of the chosen views, increasing."""
    chosen: list[int] = []
    times = np.zeros(value.shape[1])
    left = value.copy()
    while len(chosen) < min(max_views, len(value)):
        # Not a matrix product: threaded ones may add in another order.
        gain = (left / (1.0 + times)).sum(axis=1)
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            break
        chosen.append(best)
        times += left[best] > 0
        left[best] = 0.0
    return np.array(sorted(chosen), dtype=np.int64)
