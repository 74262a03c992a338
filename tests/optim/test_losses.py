import numpy as np
from numpy.testing import assert_allclose

from planewright.optim.losses import cauchy, robust_scale


def test_the_weight_is_the_slope_of_the_loss() -> None:
    squared = np.linspace(0.0, 400.0, 50)
    above, _ = cauchy(squared + 1e-5, 3.0)
    below, _ = cauchy(np.maximum(squared - 1e-5, 0.0), 3.0)
    loss, weight = cauchy(squared, 3.0)
    assert_allclose((above - below)[1:] / 2e-5, weight[1:], rtol=1e-5)
    assert_allclose(loss[0], 0.0)


def test_an_infinite_scale_is_plain_least_squares() -> None:
    squared = np.array([0.0, 1.0, 1e6])
    loss, weight = cauchy(squared, np.inf)
    assert_allclose(loss, squared)
    assert_allclose(weight, 1.0)


def test_the_robust_scale_is_the_noise_and_hardly_sees_a_tenth_of_outliers() -> None:
    rng = np.random.default_rng(0)
    for size in (1, 2, 3):
        residual = 2.5 * rng.normal(size=(20000, size))
        squared = (residual**2).sum(axis=1)
        assert_allclose(robust_scale(squared, np.ones(20000), size), 2.5, rtol=0.03)
        assert_allclose(robust_scale(0.5 * squared, np.full(20000, 0.5), size), 2.5, rtol=0.03)
        squared[: 20000 // 10] = 1e6
        assert robust_scale(squared, np.ones(20000), size) < 2.5 * 1.15
