"""The model drawn over a frame: where its edges and corners fall, and which parts of them the model itself hides."""

import itertools
from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float
from planewright.geometry.raster import PlanarPolygons, face_buffer
from planewright.planes.planar_scene import PlanarScene
from planewright.sfm.cameras import Cameras

SAMPLES = 64
"""Points an edge is cut into; the switch between solid and dashed is right to 1/64 of the edge."""
OCCLUSION_TOLERANCE = 0.012
"""Of the depth: an edge lies on the faces that it bounds, whose buffer is known to a pixel and a corner's error only."""


@dataclass(frozen=True, eq=False)
class Stroke:
    """A connected part of an edge."""

    xy: Float[np.ndarray, "samples 2"]
    """Pixels of the frame as displayed."""
    visible: bool


def model_edges(scene: PlanarScene) -> list[tuple[int, int]]:
    """Pairs of rows of known points: the borders of known faces and what else was drawn, each once, in the order of the sketch."""
    row = scene.point_row()
    pairs: dict[tuple[int, int], None] = {}
    for f, face in enumerate(scene.sketch.faces):
        for loop in (face.loop, *face.holes) if scene.face_known[f] else ():
            closed = (*loop, loop[0]) if not (face.open and loop is face.loop) else loop
            for a, b in itertools.pairwise(closed):
                pairs[min(row[a], row[b]), max(row[a], row[b])] = None
    for a, b in scene.sketch.edges:
        pairs[min(row[a], row[b]), max(row[a], row[b])] = None
    return [pair for pair in pairs if scene.point_known[list(pair)].all()]


def edge_strokes(scene: PlanarScene, polygons: PlanarPolygons, cameras: Cameras, row: int) -> list[Stroke]:
    """The edges of the model in one frame, cut where they leave the image, and where the model starts or stops hiding them."""
    edges = np.array(model_edges(scene), dtype=np.int64).reshape(-1, 2)
    pose, lens = cameras.cam_from_world(row), cameras.intrinsics
    buffer = face_buffer(polygons, lens, pose)
    height, width = buffer.depth.shape
    along = np.linspace(0.0, 1.0, SAMPLES)[None, :, None]
    in_world = (1 - along) * scene.points[edges[:, :1]] + along * scene.points[edges[:, 1:]]
    in_cam = pose.apply(in_world.reshape(-1, 3))
    front = in_cam[:, 2] > 1e-6
    in_cam[~front] = [0.0, 0.0, 1.0]
    straight = lens.pinhole().project(in_cam)
    column, line = np.floor(straight).astype(np.int64).T
    inside = front & (column >= 0) & (column < width) & (line >= 0) & (line < height)
    nearest = np.zeros(len(in_cam))
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            seen = buffer.depth[np.clip(line + dy, 0, height - 1), np.clip(column + dx, 0, width - 1)]
            nearest = np.maximum(nearest, seen)
    visible = nearest >= in_cam[:, 2] * (1 - OCCLUSION_TOLERANCE)
    drawn = cameras.lens.to_displayed(int(cameras.frame[row]), straight, in_cam[:, 2]).reshape(-1, SAMPLES, 2)
    shape = (len(edges), SAMPLES)
    return [stroke for e in range(len(edges)) for stroke in _cut(drawn[e], inside.reshape(shape)[e], visible.reshape(shape)[e])]


def _cut(xy: Float[np.ndarray, "samples 2"], inside: Bool[np.ndarray, "samples"], visible: Bool[np.ndarray, "samples"]) -> list[Stroke]:
    """Runs of samples of one kind; a run reaches to the first sample of the next one, so that the strokes meet."""
    kind = np.where(inside, np.where(visible, 2, 1), 0)
    starts = [0, *(np.flatnonzero(np.diff(kind)) + 1).tolist(), len(kind)]
    strokes: list[Stroke] = []
    for start, stop in itertools.pairwise(starts):
        reach = min(stop + 1, len(kind)) if stop < len(kind) and kind[stop] else stop
        if kind[start] and reach - start >= 2:
            strokes.append(Stroke(xy[start:reach], bool(kind[start] == 2)))
    return strokes
