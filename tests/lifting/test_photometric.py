"""Planes found by how they carry one view into others."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.lifting.photometric import (
    NOBODY,
    PhotometricOptions,
    descend,
    equations,
    hypotheses,
    plane_from_scene_points,
    plane_from_world,
    plane_to_world,
    reference_from_mask,
    refine,
    shift_per_rho,
    sweep,
    transfers,
)


def true_plane(wall, reference) -> np.ndarray:
    plane = plane_from_world(wall.views, reference, wall.normal, wall.offset)
    assert plane is not None
    return plane


def depth_error(wall, reference, plane: np.ndarray) -> float:
    """Largest relative error of inverse depth over the pixels of the reference."""
    true = reference.basis @ true_plane(wall, reference)
    return float(np.abs((reference.basis @ plane) / true - 1.0).max())


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def test_a_plane_goes_to_the_world_and_back(wall) -> None:
    reference = wall.reference()
    rng = np.random.default_rng(0)
    for _ in range(30):
        plane = np.array([*rng.normal(0.0, 0.05, 2), rng.uniform(0.2, 0.6)])
        normal, offset = plane_to_world(wall.views, reference, plane)
        assert_allclose(np.linalg.norm(normal), 1.0)
        assert wall.views.centers[4] @ normal - offset > 0
        assert_allclose(plane_from_world(wall.views, reference, normal, offset), plane, atol=1e-12)
        assert_allclose(plane_from_world(wall.views, reference, -normal, -offset), plane, atol=1e-12)


def test_the_inverse_depth_of_a_plane_is_linear_in_the_pixel(wall) -> None:
    reference = wall.reference()
    inverse = np.linalg.inv(wall.views.calibration)
    rays = np.column_stack([reference.pixels + 0.5, np.ones(len(reference.pixels))]) @ inverse.T @ wall.views.rotation[4]
    center = wall.views.centers[4]
    depth = (wall.offset - center @ wall.normal) / (rays @ wall.normal)
    assert_allclose(reference.basis @ true_plane(wall, reference), 1.0 / depth, rtol=1e-12)


def test_no_plane_through_the_cameras_centre(wall) -> None:
    assert plane_from_world(wall.views, wall.reference(), wall.normal, float(wall.normal @ wall.views.centers[4])) is None


def test_pixels_are_carried_to_where_the_other_views_show_the_same_point(wall) -> None:
    targets = np.array([0, 3, 8])
    rotations, shifts = transfers(wall.views, 4, targets)
    rng = np.random.default_rng(1)
    for point in rng.normal(0.0, 0.4, (20, 3)):
        here = wall.views.projections[4] @ [*point, 1.0]
        pixel = here[:2] / here[2] - 0.5
        for a, s, target in zip(rotations, shifts, targets, strict=True):
            x, y, z = a @ [*pixel, 1.0] + s / here[2]
            there = wall.views.projections[target] @ [*point, 1.0]
            assert_allclose([x / z + 0.5, y / z + 0.5], there[:2] / there[2], atol=1e-9)


def test_the_shift_per_inverse_depth_is_the_derivative_of_where_the_point_is_seen(wall) -> None:
    center, rho, step = np.array([70.0, 50.0]), 0.33, 1e-6
    move, inside = shift_per_rho(wall.views, 4, center, rho)
    a, s = transfers(wall.views, 4, np.arange(9))
    places = []
    for r in (rho - step, rho + step):
        p = a @ [*center, 1.0] + s * r
        places.append(p[:, :2] / p[:, 2:])
    assert_allclose(move, np.linalg.norm(places[1] - places[0], axis=1) / (2 * step), rtol=1e-5, atol=1e-6)
    assert not inside[4]
    assert inside[[3, 5]].all()


def test_a_reference_takes_the_steepest_pixels_from_all_over_the_mask(wall) -> None:
    mask = np.zeros((120, 160), bool)
    mask[20:100, 30:130] = True
    options = PhotometricOptions(max_pixels=300)
    reference = reference_from_mask(wall.views, 4, mask, options)
    assert reference is not None
    assert len(reference.pixels) <= 300
    x, y = reference.pixels.T.astype(int)
    assert mask[y, x].all()
    assert_allclose(reference.values, wall.views.images[4][y, x])
    quarters = np.histogram2d(x, y, bins=[[30, 80, 130], [20, 60, 100]])[0]
    assert quarters.min() > 0.2 * len(x)
    slope = np.hypot(*np.gradient(wall.views.images[4].astype(float)))
    assert slope[y, x].mean() > 1.15 * slope[mask].mean()


def test_a_mask_of_fewer_than_forty_pixels_is_no_reference(wall) -> None:
    mask = np.zeros((120, 160), bool)
    mask[50:53, 60:73] = True
    assert reference_from_mask(wall.views, 4, mask, PhotometricOptions()) is None
    mask[53, 60] = True
    assert reference_from_mask(wall.views, 4, mask, PhotometricOptions()) is not None


@pytest.mark.parametrize("off", [(0.0, 0.0, 0.0), (0.004, -0.002, 0.003), (-0.003, 0.004, -0.002)])
@pytest.mark.parametrize("half", [(40, 30), (10, 8)])
def test_gradient_and_hessian_are_those_of_the_cost(wall, off: tuple[float, float, float], half: tuple[int, int]) -> None:
    """By finite differences, with a sigma floor that keeps the weights still; the image's slope is a difference over two pixels, hence 5 %.

    On the small patch the print looks much like light that slopes, and the information that is left is a fifth less.
    """
    reference, targets, noise = wall.reference(half=half), np.array([1, 3, 5, 7]), 40.0
    plane = true_plane(wall, reference) + off

    def at(moved: np.ndarray):
        return equations(wall.views, reference, targets, moved, NOBODY, -1, noise)

    here = at(plane)
    assert here.used == 4 * len(reference.pixels)
    scale = np.sqrt(np.diag(here.hessian))
    step = 2e-3
    gradient, hessian = np.empty(3), np.empty((3, 3))
    for c in range(3):
        ahead, back = at(plane + step * np.eye(3)[c]), at(plane - step * np.eye(3)[c])
        gradient[c] = (ahead.cost - back.cost) / (2 * step)
        hessian[c] = (ahead.gradient - back.gradient) / (2 * step)
    if any(off):
        assert np.linalg.norm((gradient - here.gradient) / scale) < 0.08 * np.linalg.norm(here.gradient / scale)
    else:
        normalized = (hessian + hessian.T) / 2 / np.outer(scale, scale)
        assert_allclose(normalized, here.hessian / np.outer(scale, scale), atol=0.06)


def test_gain_bias_and_light_that_slopes_over_the_face_do_not_move_the_plane(wall) -> None:
    reference, targets = wall.reference(), np.array([1, 2, 3, 5, 6, 7])
    images = wall.views.images.astype(float)
    slope = np.linspace(-12.0, 12.0, 160)
    lit = np.stack([image * (1.0 + 0.04 * (k - 4)) - 3.0 * (k - 4) + slope * (k - 4) / 4 for k, image in enumerate(images)])
    views = replace(wall.views, images=np.clip(np.rint(lit), 0, 255).astype(np.uint8))
    start = true_plane(wall, reference) * 1.003
    plane, _ = descend(views, reference, targets, start, PhotometricOptions())
    assert depth_error(wall, reference, plane) < 0.0006


def test_a_known_print_gives_its_plane_from_a_start_pixels_off(wall) -> None:
    """Half a pixel wrong in the calibration would turn the plane by 0.2 degrees."""
    reference = wall.reference()
    true = true_plane(wall, reference)
    for tilt, depth in [(0.0, 1.02), (0.02, 1.0), (-0.015, 0.985)]:
        found = refine(wall.views, reference, true * depth + np.array([tilt * true[2], 0.0, 0.0]), 12.0, PhotometricOptions())
        assert found is not None
        assert depth_error(wall, reference, found.plane) < 0.0005
        normal, offset = plane_to_world(wall.views, reference, found.plane)
        assert angle_deg(normal, wall.normal) < 0.05
        assert abs(offset - wall.offset) < 0.001
        assert found.zncc > 0.99


def test_the_sweep_has_a_start_near_the_plane(wall) -> None:
    reference = wall.reference()
    starts = sweep(wall.views, reference, (0.22, 0.5), PhotometricOptions())
    assert 1 <= len(starts) <= 8
    true = true_plane(wall, reference)
    assert min(abs(start[2] / true[2] - 1.0) for start in starts) < 0.02


def test_hypotheses_need_no_start_and_the_best_is_the_plane(wall) -> None:
    reference = wall.reference()
    found = hypotheses(wall.views, reference, (0.22, 0.5))
    assert 1 <= len(found) <= PhotometricOptions().keep
    assert depth_error(wall, reference, found[0].plane) < 0.0005


def test_a_plane_that_the_views_contradict_is_refused(wall) -> None:
    rng = np.random.default_rng(5)
    other = replace(wall.views, images=rng.integers(0, 255, wall.views.images.shape).astype(np.uint8))
    assert hypotheses(other, wall.reference(), (0.22, 0.5)) == []


def test_what_another_face_hides_takes_no_part(wall) -> None:
    """A patch that stands still in every image is stuck over the wall: known as another face it does no harm, unknown it does."""
    reference = wall.reference()
    images, owners = wall.views.images.copy(), np.full(wall.views.images.shape, 0, np.int16)
    patch = np.random.default_rng(2).integers(0, 255, (50, 34)).astype(np.uint8)
    images[:, 35:85, 60:94] = patch
    owners[:, 35:85, 60:94] = 1
    views = replace(wall.views, images=images)
    mask = np.zeros((120, 160), bool)
    mask[30:90, 40:120] = True
    mask[33:87, 58:96] = False
    reference = reference_from_mask(views, 4, mask, PhotometricOptions())
    assert reference is not None
    targets, start = np.array([0, 1, 2, 3, 5, 6, 7, 8]), true_plane(wall, reference) * 1.002
    known, with_owners = descend(views, reference, targets, start, PhotometricOptions(), owners=owners, face=0)
    _, without = descend(views, reference, targets, start, PhotometricOptions())
    assert depth_error(wall, reference, known) < 0.0005
    assert with_owners.used < without.used


def test_scene_features_on_the_plane_outvote_those_before_it(wall) -> None:
    reference, rng = wall.reference(), np.random.default_rng(4)
    inverse = np.linalg.inv(wall.views.calibration)
    pixels = rng.uniform([45, 35], [115, 85], (60, 2))
    rays = np.column_stack([pixels + 0.5, np.ones(60)]) @ inverse.T @ wall.views.rotation[4]
    center = wall.views.centers[4]
    xyz = center + rays * ((wall.offset - center @ wall.normal) / (rays @ wall.normal))[:, None]
    xyz[:20] = center + (xyz[:20] - center) * rng.uniform(0.6, 0.9, (20, 1))
    polygon = np.array([[40.0, 30.0], [120.0, 30.0], [120.0, 90.0], [40.0, 90.0]])
    plane = plane_from_scene_points(wall.views, reference, polygon, xyz, rng)
    assert plane is not None
    assert depth_error(wall, reference, plane) < 0.01
    assert plane_from_scene_points(wall.views, reference, polygon, xyz[:4], rng) is None
    assert plane_from_scene_points(wall.views, reference, polygon + 200.0, xyz, rng) is None


def test_the_same_is_found_twice(wall) -> None:
    a, b = (hypotheses(wall.views, wall.reference(), (0.22, 0.5)) for _ in range(2))
    assert [p.plane.tobytes() for p in a] == [p.plane.tobytes() for p in b]
