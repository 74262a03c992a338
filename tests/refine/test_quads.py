"""The fourth corner of a parallelogram helps a corner that nothing else holds."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planewright.planes.evidence import CornerPriors
from planewright.planes.planar_scene import PlanarScene
from planewright.refine.quads import fourth_corners, joined
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint

QUAD = np.array([[0.0, 0, 0], [2, 0, 0], [2.4, 1, 0], [0.4, 1, 0]])


def scene(sigmas: list[float], points: np.ndarray = QUAD, open_face: bool = False, known: list[bool] | None = None, loop: int = 4) -> PlanarScene:
    names = [PointId(f"p{i}") for i in range(len(points))]
    faces = (SketchFace(FaceId("quad"), tuple(names[:loop]), open=open_face),)
    return PlanarScene(
        sketch=Sketch(tuple(SketchPoint(name, {}) for name in names), faces=faces), points=points,
        point_known=np.ones(len(points), bool) if known is None else np.array(known), point_covariance=np.array([np.diag([s**2] * 3) for s in sigmas]),
        normals=np.array([[0.0, 0.0, 1.0]]), offsets=np.zeros(1), face_known=np.ones(1, bool), plane_covariance=np.zeros((3, 3)),
    )  # fmt: skip


@pytest.mark.parametrize("corner", range(4))
def test_the_open_corner_is_expected_where_it_closes_the_parallelogram(corner: int) -> None:
    sigmas = [0.01] * 4
    sigmas[corner] = 0.5
    moved = QUAD.copy()
    moved[corner] += [0.3, 0.1, 0.4]
    found = fourth_corners(scene(sigmas, moved).sketch, scene(sigmas, moved), open_above=0.1, sigma=0.05)
    assert_array_equal(found.corner, [corner])
    assert_allclose(found.mean[0], QUAD[corner], atol=1e-12)
    sides = QUAD[[corner - 1, (corner + 1) % 4]] - QUAD[(corner + 2) % 4]
    assert_allclose(found.whitening[0], np.eye(3) / (0.05 * np.linalg.norm(sides, axis=1).max()))


def test_corners_that_are_sure_need_no_help_and_unsure_neighbours_give_none() -> None:
    for sigmas in ([0.01] * 4, [0.5, 0.3, 0.01, 0.01], [0.5, 0.5, 0.5, 0.5]):
        assert len(fourth_corners(scene(sigmas).sketch, scene(sigmas), open_above=0.1).corner) == 0


def test_a_corner_of_which_nothing_is_known_counts_as_open() -> None:
    unsure = scene([0.01, 0.01, np.inf, 0.01])
    assert_array_equal(fourth_corners(unsure.sketch, unsure, open_above=0.1).corner, [2])


def test_open_faces_other_shapes_and_unknown_neighbours_say_nothing() -> None:
    sigmas = [0.01, 0.01, 0.5, 0.01]
    opened = scene(sigmas, open_face=True)
    assert len(fourth_corners(opened.sketch, opened, open_above=0.1).corner) == 0
    unknown = scene(sigmas, known=[True, False, True, True])
    assert 2 not in fourth_corners(unknown.sketch, unknown, open_above=0.1).corner
    five = scene([*sigmas, 0.01], np.vstack([QUAD, [[-0.5, 0.5, 0.0]]]), loop=5)
    assert len(fourth_corners(five.sketch, five, open_above=0.1).corner) == 0


def test_joined_holds_both() -> None:
    a = CornerPriors(np.array([1]), np.ones((1, 3)), np.eye(3)[None])
    b = CornerPriors(np.array([2, 3]), np.zeros((2, 3)), np.tile(2 * np.eye(3), (2, 1, 1)))
    both = joined(a, b)
    assert_array_equal(both.corner, [1, 2, 3])
    assert_allclose(both.mean, [[1, 1, 1], [0, 0, 0], [0, 0, 0]])
    assert_allclose(both.whitening[:, 0, 0], [1, 2, 2])
