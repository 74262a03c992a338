"""Marks as rays: through the marked pixel, scaled to depth, and where they meet."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planewright.lifting.rays import MarkRays, mark_rays, meet, on_plane, triangulate_marks
from planewright.sketch.graph import PointId, Sketch, SketchPoint

WORLD = np.array([[0.3, 0.1, -0.2], [-0.4, 0.0, 0.3], [0.0, 0.2, 0.1]])


def seen(wall, view: int, point: np.ndarray) -> tuple[float, float]:
    x, y, z = wall.views.projections[view] @ [*point, 1.0]
    return float(x / z), float(y / z)


@pytest.fixture
def rays(wall) -> MarkRays:
    """Point 0 marked in views 1 and 7 and in a frame without a view, point 1 in view 4, point 2 nowhere."""
    marks = [{1: seen(wall, 1, WORLD[0]), 7: seen(wall, 7, WORLD[0]), 99: (1.0, 1.0)}, {4: seen(wall, 4, WORLD[1])}, {}]
    return mark_rays(wall.views, Sketch(tuple(SketchPoint(PointId(f"p{i}"), m) for i, m in enumerate(marks))))


def test_a_ray_passes_through_its_point_at_the_points_depth(wall, rays: MarkRays) -> None:
    assert_array_equal(rays.point, [0, 0, 1])
    assert_array_equal(rays.view, [1, 7, 4])
    for row in range(3):
        point, view = WORLD[rays.point[row]], rays.view[row]
        depth = (wall.views.rotation[view] @ point + wall.views.translation[view])[2]
        assert_allclose(rays.origin[row] + depth * rays.direction[row], point, atol=1e-12)


def test_marks_are_in_pixels_of_the_clip_and_rays_in_those_of_the_views(wall) -> None:
    point = SketchPoint(PointId("p"), {4: seen(wall, 4, WORLD[0])})
    half = replace(wall.views, scale=0.5, calibration=np.diag([0.5, 0.5, 1.0]) @ wall.views.calibration)
    assert_allclose(mark_rays(half, Sketch((point,))).direction, mark_rays(wall.views, Sketch((point,))).direction)


def test_a_pixel_more_turns_the_ray_as_said(wall, rays: MarkRays) -> None:
    x, y = rays.xy[2]
    for axis, moved in enumerate([(x + 1, y), (x, y + 1)]):
        other = mark_rays(wall.views, Sketch((SketchPoint(PointId("p"), {4: moved}),)))
        assert_allclose(other.direction[0] - rays.direction[2], rays.per_pixel[2, axis], atol=1e-12)


def test_a_ray_meets_a_plane_through_its_point_at_the_points_depth_and_the_slope_is_the_relative_change_a_pixel(wall, rays: MarkRays) -> None:
    normal = np.array([0.2, -0.9, 0.3]) / np.linalg.norm([0.2, -0.9, 0.3])
    depth, slope = meet(rays, rays.of_point(1), normal, float(normal @ WORLD[1]))
    true_depth = (wall.views.rotation[4] @ WORLD[1] + wall.views.translation[4])[2]
    assert_allclose(depth, [true_depth], rtol=1e-12)
    gradient = []
    for step in np.eye(2):
        x, y = rays.xy[2] + 0.01 * step
        moved = mark_rays(wall.views, Sketch((SketchPoint(PointId("p"), {4: (x, y)}),)))
        gradient.append((np.log(meet(moved, np.array([0]), normal, float(normal @ WORLD[1]))[0][0]) - np.log(true_depth)) / 0.01)
    assert_allclose(slope, [np.linalg.norm(gradient)], rtol=1e-3)


def test_a_plane_behind_the_camera_is_met_at_a_depth_that_is_not_positive(wall, rays: MarkRays) -> None:
    normal = wall.views.rotation[4][2]
    behind = float(normal @ wall.views.centers[4]) - 1.0
    assert meet(rays, rays.of_point(1), normal, behind)[0][0] <= 0


def test_two_marks_give_the_point_and_the_angle_between_their_rays_and_one_gives_none(wall, rays: MarkRays) -> None:
    assert triangulate_marks(rays, rays.of_point(1)) is None
    found = triangulate_marks(rays, rays.of_point(0))
    assert found is not None
    assert_allclose(found[0], WORLD[0], atol=1e-9)
    a, b = (WORLD[0] - rays.origin[row] for row in (0, 1))
    assert_allclose(found[1], np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)), atol=1e-9)


def test_rays_that_miss_each_other_are_weighed_by_pixels_not_by_space(wall) -> None:
    """Least squares in pixels share a gap so that the errors in pixels go as the distances: the near camera, which sees finer, errs less."""
    views = replace(wall.views, translation=wall.views.translation.copy())
    views.translation[1] -= [0.0, 0.0, 1.6]
    marks = {}
    for view, up in ((1, 0.2), (7, -0.2)):
        x, y, z = views.projections[view] @ [*WORLD[0], 1.0]
        marks[view] = (float(x / z), float(y / z) + up)
    rays = mark_rays(views, Sketch((SketchPoint(PointId("p"), marks),)))
    found = triangulate_marks(rays, np.array([0, 1]))
    assert found is not None
    errors, distances = [], []
    for row, view in enumerate((1, 7)):
        x, y, z = views.projections[view] @ [*found[0], 1.0]
        errors.append(np.hypot(x / z - rays.xy[row, 0], y / z - rays.xy[row, 1]))
        distances.append(np.linalg.norm(found[0] - rays.origin[row]))
    assert distances[0] < 0.6 * distances[1]
    assert_allclose(errors[0] / errors[1], distances[0] / distances[1], rtol=0.05)


def test_pixels_carried_to_a_plane_lie_on_it_and_are_seen_where_they_were(wall) -> None:
    pixels = np.array([[10.0, 20.0], [80.5, 61.0], [150.0, 100.0]])
    points = on_plane(wall.views, 2, pixels, wall.normal, wall.offset)
    assert_allclose(points @ wall.normal, wall.offset, atol=1e-12)
    assert_allclose([seen(wall, 2, point) for point in points], pixels, atol=1e-9)
