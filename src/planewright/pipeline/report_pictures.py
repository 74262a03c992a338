"""Pictures of the report that lie over a frame of the clip: the sketch, the model, the tracks."""

from collections.abc import Sequence

import numpy as np

from planewright.pipeline.drawing import Picture, Shape, data_uri, hue_of, path_d, stride
from planewright.pipeline.overlay import edge_strokes
from planewright.pipeline.report_tables import short
from planewright.pipeline.result import Result
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.polygons import scene_polygons
from planewright.progress import Progress, steps
from planewright.tracking.tracks import State
from planewright.video.frames import Frames

NUM_OVERLAYS = 9
IMAGE_WIDTH = 720
CIRCLE_95 = float(np.sqrt(5.991))
"""Radius of the circle that holds 95 % of a round 2D Gaussian, in sigmas (chi-square, two degrees of freedom)."""


def main_frame(scene: PlanarScene) -> int | None:
    """The frame in which most points are marked; the first of several."""
    counts: dict[int, int] = {}
    for point in scene.sketch.points:
        for frame in point.marks:
            counts[frame] = counts.get(frame, 0) + 1
    return min(counts, key=lambda frame: (-counts[frame], frame)) if counts else None


def sketch_picture(frames: Frames, result: Result) -> Picture | None:
    """The drawing over the frame in which most of it was made."""
    sketch, frame = result.scene.sketch, main_frame(result.scene)
    if frame is None:
        return None
    marks = {point.id: point.marks[frame] for point in sketch.points if frame in point.marks}
    shapes: list[Shape] = []
    for f, face in enumerate(sketch.faces):
        polygon = [marks[corner] for corner in face.loop if corner in marks]
        if len(polygon) >= 3:
            shapes.append(Shape("path", "face", d=path_d(polygon, closed=True), hue=hue_of(f)))
    edges = {tuple(sorted(pair)): pair for face in sketch.faces for pair in zip(face.loop, (*face.loop[1:], face.loop[0]), strict=True)}
    edges |= {tuple(sorted(edge)): edge for edge in sketch.edges}
    shapes += [Shape("path", "drawn", d=path_d([marks[a], marks[b]])) for a, b in edges.values() if a in marks and b in marks]
    for point, (x, y) in marks.items():
        shapes += [Shape("circle", "mark", x=x, y=y, r=result.clip.image_size[0] / 300), Shape("text", "label", x=x, y=y, text=short(point, 12))]
    elsewhere = len(sketch.points) - len(marks)
    note = f"{len(marks)} points marked here" + (f"; {elsewhere} in other frames." if elsewhere else ".")
    return _over(frames, frame, f"The sketch, frame {frame}", shapes, note)


def overlay_pictures(frames: Frames, result: Result, progress: Progress) -> list[Picture]:
    """The model over frames spread through the clip: solid where it is visible, dashed where it hides itself; corners with their 95 % circles."""
    cameras, scene, tracks = result.cameras, result.scene, result.tracks
    posed = np.flatnonzero(cameras.posed)
    chosen = np.unique(posed[np.linspace(0, len(posed) - 1, min(NUM_OVERLAYS, len(posed))).round().astype(int)]) if len(posed) else posed
    polygons = scene_polygons(scene)
    sigma = np.sqrt(np.maximum(np.linalg.eigvalsh(np.where(np.isfinite(tracks.covariance), tracks.covariance, 0.0))[:, -1], 0.0))
    pictures: list[Picture] = []
    for row in steps([int(row) for row in chosen], "Drawing the report", progress):
        number = int(cameras.frame[row])
        strokes = sorted(edge_strokes(scene, polygons, cameras, row), key=lambda stroke: stroke.visible)
        shapes = [Shape("path", "solid" if stroke.visible else "dashed", d=path_d(stroke.xy)) for stroke in strokes]
        for k in np.flatnonzero(tracks.frame == number):
            (x, y), state = tracks.xy[k].tolist(), State(int(tracks.state[k]))
            if state is not State.HIDDEN and sigma[k] > 0:
                shapes.append(Shape("circle", f"corner {state.name.lower()}", x=x, y=y, r=float(CIRCLE_95 * sigma[k])))
        pictures.append(_over(frames, number, f"Frame {number}", shapes))
    return pictures


def trails_picture(frames: Frames, result: Result) -> Picture | None:
    """The way of every corner through the clip, over the sketch's frame."""
    frame, tracks = main_frame(result.scene), result.tracks
    if frame is None:
        return None
    shapes: list[Shape] = []
    for i in range(len(result.scene.sketch.points)):
        mine = tracks.point_index == i
        for state, css in ((State.HIDDEN, "trail faint"), (State.TRACKED, "trail")):
            rows = np.flatnonzero(mine & ((tracks.state == State.HIDDEN) == (state == State.HIDDEN)))
            breaks = np.flatnonzero(np.diff(tracks.frame[rows]) > stride(frames.numbers)) + 1
            for run in np.split(rows, breaks):
                if len(run) > 1:
                    shapes.append(Shape("path", css, d=path_d(tracks.xy[run]), hue=hue_of(i)))
    return _over(frames, frame, f"Where the corners went, over frame {frame}", shapes, "Faint where the corner is hidden.")


def _over(frames: Frames, number: int, title: str, shapes: Sequence[Shape], note: str = "") -> Picture:
    _, image = next(iter(frames.color([number])))
    width, height = frames.image_size
    return Picture(title, float(width), float(height), tuple(shapes), data_uri(image, IMAGE_WIDTH), note)
