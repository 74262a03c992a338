"""A path between two anchors: places and steps weighed, at every length."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.mending.settle import SettleOptions, settle_path


@pytest.mark.parametrize("count", [3, 4, 5, 12])
def test_a_path_is_where_the_sum_of_squares_is_least(count: int) -> None:
    # With one inner frame the system has one unknown, which is a case of its own.
    rng = np.random.default_rng(count)
    truth = np.cumsum(rng.normal(0.0, 3.0, (count, 2)), axis=0)
    places = truth + rng.normal(0.0, 0.05, (count, 2))
    steps = np.diff(truth, axis=0) + rng.normal(0.0, 0.05, (count - 1, 2))
    options = SettleOptions(iterations=1)
    path, sigma = settle_path(places, steps, np.ones(count - 1), options)

    def cost(inner: np.ndarray) -> float:
        whole = np.concatenate([places[:1], inner, places[-1:]])
        return float(((inner - places[1:-1]) ** 2).sum() / options.place_sigma**2 + ((np.diff(whole, axis=0) - steps) ** 2).sum() / options.step_sigma**2)

    best = cost(path[1:-1])
    for _ in range(20):
        assert cost(path[1:-1] + rng.normal(0.0, 1e-3, (count - 2, 2))) > best
    assert (path[[0, -1]] == places[[0, -1]]).all()
    assert sigma.shape == (count,)
    assert (sigma[[0, -1]] == 0.0).all()


def test_one_inner_frame_has_the_sigma_of_its_place_and_both_steps() -> None:
    places = np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]])
    options = SettleOptions()
    path, sigma = settle_path(places, np.diff(places, axis=0), np.ones(2), options)
    assert_allclose(path, places, atol=1e-12)
    assert_allclose(sigma[1], (1.0 / options.place_sigma**2 + 2.0 / options.step_sigma**2) ** -0.5)
