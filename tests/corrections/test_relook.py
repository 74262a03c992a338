"""Edges at a corner measured again, and whether a corner is off by the same in all its marks."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from planewright.corrections.relook import constant_offset, look_again, offsets_in_plane, place_by_marks
from planewright.planes.evidence import CornerMarks
from planewright.sketch.graph import PointId


def test_an_offset_is_constant_up_to_one_and_a_half_standard_deviations_from_the_mean() -> None:
    spread = np.tile(np.diag([0.04, 0.01]), (2, 1, 1))
    apart = np.array([[0.0, 0.0], [2.0 * 1.5 * 0.2, 0.0]])
    assert constant_offset(3.0 + 0.99 * apart, spread)
    assert not constant_offset(3.0 + 1.01 * apart, spread)
    assert not constant_offset(3.0 + 0.99 * apart[:, ::-1], spread)


def test_an_unsure_offset_weighs_little() -> None:
    spread = np.stack([1e-4 * np.eye(2), 1e-4 * np.eye(2), 25.0 * np.eye(2)])
    assert constant_offset(np.array([[1.0, 1.0], [1.0, 1.01], [4.0, 5.0]]), spread)


def test_offsets_are_told_in_the_plane() -> None:
    basis = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    place, beside = np.array([0.0, 0.0, 5.0]), np.array([0.3, -0.2, 5.0])
    rays = [(center, (beside - center) / np.linalg.norm(beside - center)) for center in (np.zeros(3), np.array([2.0, 1.0, -1.0]))]
    rays.append((np.zeros(3), np.array([1.0, 0.0, 0.0])))
    found = offsets_in_plane(rays, place, basis)
    assert_allclose(found[:2], [[0.3, -0.2]] * 2)
    assert np.isnan(found[2]).all()


def test_edges_draw_a_corner_that_is_a_little_beside_them_to_where_they_meet(stage) -> None:
    staged = stage()
    session = staged.session
    scene = session.model.structure.scene
    row = session.row(PointId("w0"))
    pixel = 2e-3 * np.linalg.norm(np.ptp(scene.points, axis=0))
    along = scene.points[session.row(PointId("w1"))] - scene.points[row]
    points, spread = scene.points.copy(), scene.point_covariance.copy()
    points[row] += 1.5 * pixel * along / np.linalg.norm(along)
    spread[row] = (2.0 * pixel) ** 2 * np.eye(3)
    beside = replace(scene, points=points, point_covariance=spread)
    again = look_again(session.frames, beside, session.model.cameras, scene.points, row, np.arange(40))
    assert again.edges
    assert np.linalg.norm(again.place - scene.points[row]) < 0.5 * np.linalg.norm(points[row] - scene.points[row])


def test_two_marks_off_by_the_same_have_one_place(stage) -> None:
    staged = stage()
    session = staged.session
    row = session.row(PointId("m3"))
    scene, cameras = session.model.structure.scene, session.model.cameras
    face = next(f for f, drawn in enumerate(scene.sketch.faces) if "m3" in drawn.corners)
    middle = np.mean([scene.points[session.row(c)] for c in scene.sketch.faces[face].corners], axis=0)
    other = scene.points[row] + 0.3 * (middle - scene.points[row])
    matrices = [cameras.intrinsics.matrix @ np.column_stack([cameras.rotation[k], cameras.translation[k]]) for k in (8, 30)]
    seen = [p @ np.append(other, 1.0) for p in matrices]
    marks = CornerMarks(np.array([row, row]), np.array(matrices), np.array([q[:2] / q[2] for q in seen]), np.ones(2))
    found = place_by_marks(marks, scene.points[row], scene.normals[face : face + 1])
    assert found is not None
    assert_allclose(found[0], other, atol=1e-6)
    apart = replace(marks, xy=marks.xy + np.array([[12.0, -9.0], [0.0, 0.0]]))
    assert place_by_marks(apart, scene.points[row], scene.normals[face : face + 1]) is None
    assert (
        place_by_marks(replace(marks, corner=marks.corner[:1], projection=marks.projection[:1], xy=marks.xy[:1], sigma=marks.sigma[:1]), other, scene.normals)
        is None
    )
