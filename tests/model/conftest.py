"""Scenes of faces on planes, made from loops in the plane."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pytest

from planewright.geometry.rigid import rotations_from_vectors
from planewright.model.atlas import Atlas, FaceChart
from planewright.planes.planar_scene import PlanarScene
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint
from planewright.texture.atlas import chart_mask, face_rectangle, lay_charts

Loops = Sequence[Sequence[tuple[float, float]]]
Builder = Callable[[Mapping[str, Loops], np.random.Generator], tuple[PlanarScene, Atlas]]


def scattered(faces: Mapping[str, Loops], rng: np.random.Generator) -> tuple[PlanarScene, Atlas]:
    """Each face on a plane of its own anywhere, with corners of its own, and an atlas in which the face's texels are 200 + its row."""
    points: list[np.ndarray] = []
    sketch_faces: list[SketchFace] = []
    normals: list[np.ndarray] = []
    worlds: list[list[np.ndarray]] = []
    for name, loops in faces.items():
        frame, origin = rotations_from_vectors(rng.normal(size=(1, 3)) * 2)[0], rng.normal(size=3) * 3
        worlds.append([np.array(loop, dtype=np.float64) @ frame[:2] + origin for loop in loops])
        names = []
        for loop in worlds[-1]:
            names.append(tuple(PointId(f"c{len(points) + i}") for i in range(len(loop))))
            points += list(loop)
        sketch_faces.append(SketchFace(FaceId(name), names[0], tuple(names[1:])))
        normals.append(frame[2])
    num_points, num_faces = len(points), len(faces)
    scene = PlanarScene(
        sketch=Sketch(tuple(SketchPoint(PointId(f"c{i}"), {}) for i in range(num_points)), faces=tuple(sketch_faces)),
        points=np.array(points), point_known=np.ones(num_points, dtype=bool), point_covariance=np.zeros((num_points, 3, 3)), normals=np.array(normals),
        offsets=np.array([normal @ loops[0][0] for normal, loops in zip(normals, worlds, strict=True)]), face_known=np.ones(num_faces, dtype=bool),
        plane_covariance=np.zeros((3 * num_faces, 3 * num_faces)),
    )  # fmt: skip
    rectangles = {f: r for f, loops in enumerate(worlds) if (r := face_rectangle(scene.normals[f], loops[0], np.array([0.0, 0, 1]))) is not None}
    charts, (width, height) = lay_charts(rectangles, dict.fromkeys(rectangles, 0.02), 4096, 2)
    image = np.zeros((height, width, 3), dtype=np.uint8)
    for chart in charts:
        fill(image, chart, chart_mask(chart, worlds[chart.face]))
    return scene, Atlas(image, np.zeros((height, width), dtype=bool), charts)


def fill(image: np.ndarray, chart: FaceChart, mask: np.ndarray) -> None:
    image[chart.row : chart.row + chart.height, chart.column : chart.column + chart.width][mask] = 200 + chart.face


@pytest.fixture(scope="session")
def build() -> Builder:
    return scattered
