"""Laws of the smooth path."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from planewright.registration.smooth import SmoothOptions, smooth_path


def path(n: int) -> np.ndarray:
    t = np.arange(n)
    return np.column_stack([100 + 2.0 * t + 20 * np.sin(t / 15), 50 + 30 * np.cos(t / 20)])


def test_a_straight_path_is_left_alone() -> None:
    t = np.arange(20.0)
    xy = np.column_stack([3 + 2 * t, 5 - t])
    assert_allclose(smooth_path(xy, np.tile(np.eye(2), (20, 1, 1)), np.ones(20, bool)), xy, atol=1e-9)


def test_noise_shrinks_and_one_wrong_position_does_not_bend_the_path() -> None:
    rng = np.random.default_rng(0)
    true = path(80)
    z = true + rng.normal(0, 0.8, true.shape)
    z[40] += [25, -10]
    smooth = smooth_path(z, np.tile(0.64 * np.eye(2), (80, 1, 1)), np.ones(80, bool))
    fine = np.arange(80) != 40
    assert np.sqrt(((smooth - true)[fine] ** 2).mean()) < 0.85 * np.sqrt(((z - true)[fine] ** 2).mean())
    assert np.linalg.norm(smooth[40] - true[40]) < 3


def test_the_solution_is_the_minimum_of_what_is_written() -> None:
    rng = np.random.default_rng(1)
    n = 12
    z, spread = rng.normal(0, 5, (n, 2)), np.array([(lambda a: a @ a.T + 0.3 * np.eye(2))(rng.normal(0, 1, (2, 2))) for _ in range(n)])
    found = smooth_path(z, spread, np.ones(n, bool), SmoothOptions(rounds=1, least_bend=50.0))
    bend = max(50.0, 1.5 * 1.4826 * float(np.median(np.abs(np.diff(z, n=2, axis=0)))))
    second = np.zeros((n - 2, n))
    for k in range(n - 2):
        second[k, k : k + 3] = [1, -2, 1]
    stiff = np.kron(second.T @ second, np.eye(2)) / bend**2
    weight = np.zeros((2 * n, 2 * n))
    for k in range(n):
        weight[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.linalg.inv(spread[k] + 1e-9 * np.eye(2))
    assert_allclose(found.reshape(-1), np.linalg.solve(weight + stiff, weight @ z.reshape(-1)), atol=1e-6)


def test_unknown_frames_stay_as_they_are() -> None:
    z = path(30)
    known = np.ones(30, bool)
    known[10:15] = False
    z[10:15] = -7.0
    assert_array_equal(smooth_path(z, np.tile(np.eye(2), (30, 1, 1)), known)[10:15], z[10:15])
