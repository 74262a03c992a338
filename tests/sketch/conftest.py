"""Drawings of solids: corners in space seen through a camera, with the clicks' noise."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint

Draw = Callable[..., Sketch]


@pytest.fixture
def draw() -> Draw:
    """`draw(corners, faces, ...)`: a sketch of points id -> xyz with the edges of the loops, seen from `eye` towards the middle. z is up."""

    def make(
        corners: dict[str, Sequence[float]],
        loops: Sequence[Sequence[str]],
        *,
        eye: Sequence[float] = (6.0, -9.0, 7.0),
        hidden: dict[str, Sequence[float]] | None = None,
        noise: float = 0.0,
        give_faces: bool = False,
    ) -> Sketch:
        rng = np.random.default_rng(0)
        names = list(corners)
        middle = np.mean([corners[name] for name in names], axis=0)

        def mark(name: str, camera: Sequence[float]) -> tuple[float, float]:
            forward = middle - np.array(camera)
            forward /= np.linalg.norm(forward)
            right = np.cross(forward, [0.0, 0.0, 1.0])
            right /= np.linalg.norm(right)
            moved = np.array(corners[name]) - np.array(camera)
            depth = moved @ forward
            xy = np.array([moved @ right, -(moved @ np.cross(right, forward))]) / depth * 900 + [480, 270] + rng.normal(0, noise, 2)
            return float(xy[0]), float(xy[1])

        elsewhere = hidden or {}
        points = tuple(SketchPoint(PointId(name), {40: mark(name, elsewhere[name])} if name in elsewhere else {10: mark(name, eye)}) for name in names)
        edges = {frozenset(pair): (PointId(pair[0]), PointId(pair[1])) for loop in loops for pair in zip(loop, (*loop[1:], loop[0]), strict=True)}
        faces = tuple(SketchFace(FaceId(f"g{k}"), tuple(PointId(name) for name in loop)) for k, loop in enumerate(loops)) if give_faces else ()
        return Sketch(points=points, image_size=(960, 540), edges=tuple(edges.values()), faces=faces)

    return make
