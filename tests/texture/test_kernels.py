"""The robust colour against a plain NumPy reckoning."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from planewright.texture.kernels import fuse_views


def fuse(samples: np.ndarray, valid: np.ndarray, weight: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    tone = np.broadcast_to(np.arange(256.0), (len(weight), 3, 256)).copy()
    color, count = np.zeros((samples.shape[1], 3), dtype=np.uint8), np.zeros(samples.shape[1], dtype=np.int64)
    fuse_views(samples, valid, weight, tone, tolerance, color, count)
    return color, count


def test_with_equal_weights_it_is_the_median_of_an_odd_number() -> None:
    rng = np.random.default_rng(0)
    samples = rng.integers(0, 256, (7, 50, 3), dtype=np.uint8)
    color, count = fuse(samples, np.ones((7, 50), dtype=bool), np.ones(7), 0.0)
    assert_array_equal(color, np.median(samples, axis=0))
    assert_array_equal(count, 7)


def test_views_that_agree_are_averaged_and_others_do_not_count() -> None:
    rng = np.random.default_rng(1)
    samples = (100 + rng.normal(size=(12, 400, 3)) * 3).round().astype(np.uint8)
    samples[:4] = 250
    color, _ = fuse(samples, np.ones((12, 400), dtype=bool), np.ones(12), 8.0)
    assert abs(color.mean() - 100) < 0.5
    assert color.std() < 0.6 * 3


def test_a_heavy_view_outweighs_light_ones() -> None:
    samples = np.array([[[10, 10, 10]], [[200, 200, 200]], [[210, 210, 210]]], dtype=np.uint8)
    valid = np.ones((3, 1), dtype=bool)
    assert fuse(samples, valid, np.array([1.0, 0.2, 0.2]), 1.0)[0][0, 0] == 10
    assert fuse(samples, valid, np.array([1.0, 0.7, 0.7]), 1.0)[0][0, 0] == 200


def test_views_that_do_not_see_a_texel_have_no_say() -> None:
    samples = np.array([[[10, 20, 30]] * 2, [[200, 210, 220]] * 2], dtype=np.uint8)
    color, count = fuse(samples, np.array([[True, False], [False, False]]), np.ones(2), 8.0)
    assert_allclose(color, [[10, 20, 30], [0, 0, 0]])
    assert_array_equal(count, [1, 0])
