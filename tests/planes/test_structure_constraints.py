import numpy as np
from numpy.testing import assert_array_equal

from planewright.planes.structure_constraints import StructureConstraints, group_faces
from planewright.synthetic.structure_truth import house_truth, start_of

TRUTH = house_truth()
ROW = {face.id: f for f, face in enumerate(TRUTH.sketch.faces)}


def test_a_window_and_a_door_lie_in_their_wall_and_nothing_else_is_forced() -> None:
    for seed in range(5):
        start = start_of(TRUTH, np.random.default_rng(seed), point_error=0.002)
        direction, plane = group_faces(start.points, start.normals, TRUTH.incidences)
        expected = np.arange(len(TRUTH.normals))
        expected[[ROW["window"], ROW["door"]]] = ROW["front"]
        assert_array_equal(plane, expected)
        assert_array_equal(direction, expected)


def test_parallel_planes_that_share_a_corner_are_one() -> None:
    pair = np.array([[ROW["left"], ROW["left_gable"]], [ROW["left"], ROW["chimney_left"]]])
    direction, plane = group_faces(TRUTH.points, TRUTH.normals, TRUTH.incidences, StructureConstraints(same_direction=pair))
    assert plane[ROW["left_gable"]] == plane[ROW["left"]]
    assert plane[ROW["chimney_left"]] != plane[ROW["left"]]
    assert direction[ROW["chimney_left"]] == direction[ROW["left"]]


def test_corners_on_a_line_force_nothing() -> None:
    # A wall's foot, with the feet of a door, belongs to the ground as well: four shared corners on one line, a pixel or so off.
    rng = np.random.default_rng(0)
    points = np.column_stack([np.linspace(0.0, 4.0, 6), np.zeros(6), np.zeros(6)]) + rng.normal(0.0, 0.01, (6, 3))
    points = np.concatenate([points, [[0.0, 0.0, 2.0], [0.0, 3.0, 0.0]]])
    incidences = np.array([(face, corner) for face in (0, 1) for corner in range(6)] + [(0, 6), (1, 7)])
    _, plane = group_faces(points, np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), incidences)
    assert_array_equal(plane, [0, 1])


def test_one_merge_may_force_the_next() -> None:
    # Two halves of a wall, and a sign that has two corners on either half.
    points = np.array([[0, 0, 0], [2, 0, 0], [2, 0, 2], [0, 0, 2], [4, 0, 0], [4, 0, 2], [1, 0, 1], [3, 0, 1.0]])
    incidences = np.array([(0, 0), (0, 1), (0, 2), (0, 3), (0, 6), (1, 1), (1, 4), (1, 5), (1, 2), (1, 7), (2, 6), (2, 7), (2, 2)])
    normals = np.tile([0.0, -1.0, 0.0], (3, 1))
    _, apart = group_faces(points, normals, incidences)
    assert len(set(apart.tolist())) == 3
    _, joined = group_faces(points, normals, incidences, StructureConstraints(same_plane=np.array([[0, 1]])))
    assert_array_equal(joined, [0, 0, 0])
