"""Diagrams of the report: how the corners are known over time, the errors over time, the camera's path."""

from collections.abc import Sequence

import numpy as np

from planewright.model.build import average_up
from planewright.model.planar_model import PlanarModel
from planewright.pipeline.drawing import Picture, Shape, path_d, stride
from planewright.pipeline.overlay import model_edges
from planewright.pipeline.report_tables import short
from planewright.pipeline.result import Result, reprojection_errors
from planewright.pipeline.views import any_right
from planewright.planes.planar_scene import PlanarScene
from planewright.sfm.cameras import Cameras
from planewright.tracking.tracks import State, Tracks

LEFT, WIDTH = 90.0, 1000.0
"""Of the diagrams over frames: where the first frame begins, and where the last one ends."""


def lanes_picture(tracks: Tracks, scene: PlanarScene, numbers: Sequence[int]) -> Picture:
    """One lane for each point: how its position is known in every frame."""
    lane = 14.0
    first, last, step = numbers[0], numbers[-1], stride(numbers)
    per_frame = (WIDTH - LEFT) / max(last - first + step, 1)
    shapes: list[Shape] = []
    for i, point in enumerate(scene.sketch.points):
        y = lane * (i + 0.5)
        shapes.append(Shape("text", "lane-label", x=LEFT - 8, y=y + 4, text=short(point.id, 12)))
        rows = np.flatnonzero(tracks.point_index == i)
        cuts = np.flatnonzero((np.diff(tracks.state[rows]) != 0) | (np.diff(tracks.frame[rows]) > step)) + 1
        for run in np.split(rows, cuts):
            if len(run):
                a, b = ((float(f) - first) * per_frame + LEFT for f in (tracks.frame[run[0]], tracks.frame[run[-1]] + step))
                state = State(int(tracks.state[run[0]])).name.lower()
                shapes.append(Shape("path", f"lane {state}", d=path_d([(a, y), (max(b, a + 2), y)])))
        shapes += [Shape("circle", "lane-mark", x=LEFT + (frame - first + step / 2) * per_frame, y=y, r=3.2) for frame in sorted(point.marks)]
    height = lane * len(scene.sketch.points)
    return Picture("How each corner is known, frame by frame", WIDTH, height + 22, (*shapes, *_frame_axis(first, last, per_frame, height)))


def error_picture(result: Result, numbers: Sequence[int]) -> Picture | None:
    """Root mean square of the measured corners' reprojection errors in every frame."""
    frames, errors = reprojection_errors(result)
    if not len(errors):
        return None
    height, room = 120.0, 10.0
    first, last, step = numbers[0], numbers[-1], stride(numbers)
    per_frame = (WIDTH - LEFT) / max(last - first + step, 1)
    unique = np.unique(frames)
    values = np.array([np.sqrt((errors[frames == frame] ** 2).mean()) for frame in unique])
    top = max(float(np.ceil(values.max() * 2) / 2), 0.5)
    xy = np.stack([LEFT + (unique - first + step / 2) * per_frame, room + height * (1 - values / top)], axis=1)
    ticks = [0.0, top / 2, top]
    shapes = [Shape("path", "rule", d=path_d([(LEFT, room + height * (1 - tick / top)), (WIDTH, room + height * (1 - tick / top))])) for tick in ticks]
    shapes += [Shape("text", "lane-label", x=LEFT - 8, y=room + height * (1 - tick / top) + 4, text=f"{tick:.2f} px") for tick in ticks]
    shapes.append(Shape("path", "curve", d=path_d(xy)))
    return Picture("Reprojection error, frame by frame", WIDTH, room + height + 22, (*shapes, *_frame_axis(first, last, per_frame, room + height)))


def camera_picture(cameras: Cameras, scene: PlanarScene, model: PlanarModel) -> Picture | None:
    """The camera's path from above: the model in grey, the path from its start (open circle) to its end (full), view directions as short lines."""
    posed = np.flatnonzero(cameras.posed)
    if len(posed) < 2 or not scene.point_known.any():
        return None
    centers, corners = cameras.centers[posed], scene.points[scene.point_known]
    up = average_up(cameras) if model.world_up is None else model.world_up
    right = any_right(up)
    # Seen from above with the line from the path to the model pointing up the page.
    towards = corners.mean(axis=0) - centers.mean(axis=0)
    towards = towards - (towards @ up) * up
    if np.linalg.norm(towards) > 1e-9:
        right = np.cross(towards, up) / np.linalg.norm(np.cross(towards, up))
    away = np.cross(up, right)
    plan = np.stack([right, -away], axis=1)
    everything = np.concatenate([centers, corners]) @ plan
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale = 860.0 / max(float((high - low).max()), 1e-12)
    offset = np.array([20.0, 20.0]) - low * scale
    size = (high - low) * scale + 40.0
    path = centers @ plan * scale + offset
    points = scene.points @ plan * scale + offset
    shapes = [Shape("path", "plan", d=path_d([points[a], points[b]])) for a, b in model_edges(scene)]
    looks = cameras.rotation[posed, 2] @ plan
    for k in range(0, len(posed), max(len(posed) // 24, 1)):
        shapes.append(Shape("path", "look", d=path_d([path[k], path[k] + 26 * looks[k] / max(float(np.linalg.norm(looks[k])), 1e-9)])))
    shapes += [
        Shape("path", "way", d=path_d(path)),
        Shape("circle", "way-start", x=float(path[0, 0]), y=float(path[0, 1]), r=5.0),
        Shape("circle", "way-end", x=float(path[-1, 0]), y=float(path[-1, 1]), r=5.0),
    ]
    return Picture("The camera's path from above", float(max(size[0], 300.0)), float(size[1]), tuple(shapes), note="Open circle: first frame. Full: last.")


def _frame_axis(first: int, last: int, per_frame: float, height: float) -> list[Shape]:
    """Frame numbers below a diagram, about eight of them at round steps."""
    rough = max((last - first) / 8, 1.0)
    magnitude = 10 ** int(np.floor(np.log10(rough)))
    step = next(factor * magnitude for factor in (1, 2, 5, 10) if factor * magnitude >= rough)
    ticks = range(-(-first // step) * step, last + 1, step)
    return [Shape("text", "axis", x=LEFT + (tick - first) * per_frame, y=height + 16, text=str(tick)) for tick in ticks]
