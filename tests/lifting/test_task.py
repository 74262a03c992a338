"""The sketch by rows, and what its marks and the scene say before any plane is known."""

import numpy as np
from numpy.testing import assert_array_equal

from planewright.lifting.task import Task
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint


def test_faces_become_rows_of_points_holes_included(shed, to_task) -> None:
    names = [PointId(name) for name in "abcdefgh"]
    points = tuple(SketchPoint(name, {20: (100.0 + 9.0 * i, 80.0 + i * i)} if name != "b" else {}) for i, name in enumerate(names))
    a, b, c, d, e, f, g, h = names
    faces = (SketchFace(FaceId("with hole"), (d, c, b, a), ((e, f, g),)), SketchFace(FaceId("other"), (a, b, h)))
    task = to_task(shed, Sketch(points, shed.clip.intrinsics.image_size, (), faces))
    assert task.loops == ((3, 2, 1, 0), (0, 1, 7))
    assert task.holes == (((4, 5, 6),), ())
    assert task.corners == ((3, 2, 1, 0, 4, 5, 6), (0, 1, 7))
    assert_array_equal(task.faces_at, [2, 2, 1, 1, 1, 1, 1, 1])
    # in the order of the points, and nothing for one without marks
    assert_array_equal(task.rays.point[task.first_marks(task.loops[0])], [3, 2, 0])
    assert (task.num_faces, task.num_points) == (2, 8)


def test_two_marks_far_apart_fix_a_point_without_a_face(shed, lift, to_task) -> None:
    spot = np.array([[0.0, -1.2, 0.5]])  # in the air: no patch shows it
    where = shed.pixels(spot)[:, 0]
    point = SketchPoint(PointId("air"), {k: (float(where[k, 0]), float(where[k, 1])) for k in (2, 37)})
    sketch = Sketch((point,), shed.clip.intrinsics.image_size)
    found = lift(shed, sketch)
    assert np.linalg.norm(found.points[0] - spot[0]) < 1e-3
    depth, sigma = to_task(shed, sketch).triangulated[0]
    assert abs(depth - shed.cameras.cam_from_world(2).apply(spot)[0, 2]) < 1e-3
    assert 0 < sigma < 0.05


def test_two_marks_near_each_other_tell_no_depth(shed, to_task) -> None:
    where = shed.pixels(np.array([[0.0, -1.2, 0.5]]))[:, 0]
    point = SketchPoint(PointId("air"), {k: (float(where[k, 0]), float(where[k, 1])) for k in (20, 21)})
    assert to_task(shed, Sketch((point,), shed.clip.intrinsics.image_size)).triangulated == {}


def test_the_depths_worth_trying_hold_those_of_the_scene(shed, task: Task) -> None:
    for view in (0, len(task.views.frame) - 1):
        near_rho, far_rho = task.rho_range(view)[::-1]
        z = shed.cloud.xyz @ task.views.rotation[view][2] + task.views.translation[view][2]
        assert 0 < far_rho < near_rho
        inside = (1.0 / z < near_rho) & (1.0 / z > far_rho)
        assert inside.mean() > 0.97
