import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.geometry.camera import Intrinsics
from planewright.geometry.lens import Lens, RollingShutter, on_grid, rays_at_middle, turned
from planewright.geometry.rigid import rotations_from_vectors

SIZE = (960, 540)


def shutter(readout: float = 0.7) -> RollingShutter:
    rng = np.random.default_rng(4)
    return RollingShutter(
        readout=readout,
        frame=np.array([3, 5, 8]),
        turn=rng.normal(0, 1, (3, 3, 3)) * np.array([0.02, 0.008, 0.004])[:, None],
        shift=rng.normal(0, 1, (3, 3, 3)) * np.array([0.08, 0.03, 0.01])[:, None],
        inverse_depth=rng.uniform(0.1, 0.2, (3, 4, 6)),
    )


def camera(distortion: tuple[float, ...] = ()) -> Intrinsics:
    return Intrinsics(780.0, np.array([470.0, 281.0]), SIZE, distortion)


def places(count: int = 80) -> np.ndarray:
    return np.random.default_rng(1).uniform([20, 20], [940, 520], (count, 2))


@pytest.mark.parametrize("distortion", [(), (-0.12,), (-0.1, 0.03)])
@pytest.mark.parametrize("readout", [0.7, -0.9])
def test_there_and_back_is_where_we_started(distortion: tuple[float, ...], readout: float) -> None:
    lens, xy = Lens(camera(distortion), shutter(readout)), places()
    shown = lens.to_displayed(5, xy)
    assert np.linalg.norm(shown - lens.intrinsics.to_pixels(lens.intrinsics.pinhole().normalize(xy)), axis=1).max() > 3
    assert_allclose(lens.to_straight(5, shown), xy, atol=2e-3)


def test_a_point_is_displayed_where_the_camera_of_its_row_sees_it() -> None:
    lens, rolls = Lens(camera((-0.08,)), shutter()), shutter()
    depth = np.random.default_rng(2).uniform(4, 12, 80)
    xy = places()
    shown = lens.to_displayed(8, xy, depth)
    in_middle = np.column_stack([lens.intrinsics.pinhole().normalize(xy), np.ones(80)]) * depth[:, None]
    s = rolls.readout * (shown[:, 1] / SIZE[1] - 0.5)
    powers = np.column_stack([s, s**2, s**3])
    in_row = np.einsum("nij,nj->ni", rotations_from_vectors(powers @ rolls.turn[2]), in_middle) + powers @ rolls.shift[2]
    assert_allclose(lens.intrinsics.project(in_row), shown, atol=1e-3)


def test_frames_may_differ_from_point_to_point() -> None:
    lens, xy = Lens(camera(), shutter()), places(3)
    together = lens.to_displayed(np.array([3, 8, 8]), xy)
    assert_allclose(together, [lens.to_displayed(f, xy[k : k + 1])[0] for k, f in enumerate((3, 8, 8))])


def test_frames_without_a_camera_and_global_shutters_are_only_bent() -> None:
    for lens, frame in ((Lens(camera((-0.1,)), shutter()), 4), (Lens(camera((-0.1,))), 3), (Lens(camera((-0.1,)), shutter()), 99)):
        bent = lens.intrinsics.to_pixels(lens.intrinsics.pinhole().normalize(places()))
        assert_allclose(lens.to_displayed(frame, places()), bent, atol=1e-9)
        assert_allclose(lens.to_straight(frame, bent), places(), atol=1e-6)
    assert Lens(camera()).straight and Lens(camera((0.0,))).straight
    assert not Lens(camera(), shutter()).straight


def test_the_middle_row_is_shown_as_it_is() -> None:
    middle = np.array([[100.0, 270.0], [800.0, 270.0]])
    assert_allclose(Lens(camera(), shutter()).to_straight(3, middle), middle, atol=1e-9)


def test_the_size_of_the_world_does_not_matter() -> None:
    lens, larger = Lens(camera(), shutter()), Lens(camera(), shutter().scaled(25.0))
    assert_allclose(larger.to_displayed(3, places()), lens.to_displayed(3, places()), atol=1e-9)
    depth = np.full(80, 7.0)
    assert_allclose(larger.to_displayed(3, places(), 25 * depth), lens.to_displayed(3, places(), depth), atol=1e-9)


def test_points_turn_as_by_rodrigues() -> None:
    rng = np.random.default_rng(0)
    vectors, points = rng.normal(0, 1, (20, 3)) * rng.choice([1e-9, 1e-3, 1.0], (20, 1)), rng.normal(0, 1, (20, 3))
    assert_allclose(turned(vectors, points), np.einsum("nij,nj->ni", rotations_from_vectors(vectors), points), atol=1e-12)


def test_rays_come_back_from_a_camera_that_moved() -> None:
    rng = np.random.default_rng(3)
    middle = np.column_stack([rng.uniform(-1, 1, (30, 2)) * 3, rng.uniform(4, 9, 30)])
    turn, shift = rng.normal(0, 0.02, (30, 3)), rng.normal(0, 0.1, (30, 3))
    row = turned(turn, middle) + shift
    assert_allclose(rays_at_middle(turn, shift, row[:, :2] / row[:, 2:], 1 / middle[:, 2]), middle[:, :2] / middle[:, 2:], atol=1e-12)


def test_a_grid_is_bilinear_between_its_nodes_and_flat_outside() -> None:
    u, v = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 4))
    values = np.stack([2 + 3 * u - v, np.zeros_like(u)])
    place = np.random.default_rng(0).uniform(0, 1, (40, 2))
    assert_allclose(on_grid(values, np.zeros(40, np.int64), place), 2 + 3 * place[:, 0] - place[:, 1], atol=1e-12)
    assert_allclose(on_grid(values, np.array([0, 0, 1]), np.array([[-3.0, 0.0], [1.5, 2.0], [0.5, 0.5]])), [2.0, 4.0, 0.0])
