"""Corners drawn inside a face are proposed to lie on it where they do."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planewright.lifting.rays import MarkRays
from planewright.refine.incidences import propose_incidences
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint

DEPTH, TOLERANCE = 5.0, 0.01
"""The floor is about five units from the camera: 0.05 units are within the tolerance."""
POINTS = np.array([
    [-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0],  # the floor
    [0.5, 0.5, 0], [1.5, 0.5, 0], [1.5, 1.5, 0], [0.5, 1.5, 0],  # its hole
    [-1, -1, 0.02], [-1, 0, 0.2], [1, 1, 0.0], [3, 0, 0.0], [0, -1, -0.02],  # on it, above it, over the hole, beside it, just below it
], float)  # fmt: skip


def drawing(count: int) -> Sketch:
    """The floor, and two faces of no known plane that hold the other corners; a last point of no face where there are more."""
    names = [PointId(f"p{i}") for i in range(count)]
    floor = SketchFace(FaceId("floor"), tuple(names[:4]), (tuple(names[4:8]),))
    return Sketch(
        tuple(SketchPoint(name, {}) for name in names),
        faces=(floor, SketchFace(FaceId("wall"), (names[8], names[9], names[12])), SketchFace(FaceId("board"), (names[10], names[11], names[9]))),
    )


def propose(points: np.ndarray = POINTS, sigma: float = 0.005, known: np.ndarray | None = None, face_known: bool = True) -> list[tuple[int, int]]:
    count = len(points)
    rays = MarkRays(np.arange(count), np.zeros(count, int), np.zeros((count, 2)), np.tile([0.0, 0.0, DEPTH], (count, 1)),
                    np.zeros((count, 3)), np.zeros((count, 2, 3)))  # fmt: skip
    known = np.ones(count, bool) if known is None else known
    covariance = np.tile(np.diag([sigma**2] * 3), (count, 1, 1))
    normals, offsets, planes = np.tile([0.0, 0.0, 1.0], (3, 1)), np.zeros(3), np.array([face_known, False, False])
    found = propose_incidences(drawing(count), rays, points, covariance, known, normals, offsets, planes, TOLERANCE)
    assert found.shape == (len(found), 2)
    return [(int(f), int(c)) for f, c in found]


def test_only_corners_over_the_face_and_near_its_plane_are_proposed() -> None:
    assert propose() == [(0, 8), (0, 12)]


def test_a_corner_whose_height_is_not_sure_is_left_for_later() -> None:
    assert propose(sigma=0.04) == []
    assert propose(sigma=np.inf) == []


@pytest.mark.parametrize("turn", range(3))
def test_the_plane_may_lie_in_any_direction(turn: int) -> None:
    axes = np.linalg.qr(np.random.default_rng(turn).normal(size=(3, 3)))[0]
    count = len(POINTS)
    rays = MarkRays(np.arange(count), np.zeros(count, int), np.zeros((count, 2)), np.tile([0.0, 0.0, DEPTH], (count, 1)) @ axes,
                    np.zeros((count, 3)), np.zeros((count, 2, 3)))  # fmt: skip
    covariance = np.tile(0.005**2 * np.eye(3), (count, 1, 1))
    normals, planes = np.repeat(axes[2:], 3, axis=0), np.array([True, False, False])
    found = propose_incidences(drawing(count), rays, POINTS @ axes, covariance, np.ones(count, bool), normals, np.zeros(3), planes, TOLERANCE)
    assert_array_equal(found, [[0, 8], [0, 12]])


def test_nothing_is_proposed_of_what_is_not_known() -> None:
    known = np.ones(len(POINTS), bool)
    known[8] = False
    assert propose(known=known) == [(0, 12)]
    assert propose(face_known=False) == []


def test_a_face_is_not_pressed_flat_onto_another() -> None:
    """All three corners of the wall near the floor: the two lowest are its feet only where the third stands clearly higher."""
    shallow, low = POINTS.copy(), POINTS.copy()
    shallow[[8, 9, 12], 2] = 0.005, 0.04, -0.005
    low[[8, 9, 12], 2] = 0.02, 0.03, -0.02
    assert propose(shallow) == [(0, 8), (0, 12)]
    assert propose(low) == []


def test_a_point_of_no_face_is_left_to_its_patch() -> None:
    more = np.concatenate([POINTS, [[-1.0, 1.0, 0.0]]])
    assert propose(more) == [(0, 8), (0, 12)]
