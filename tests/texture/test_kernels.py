"""The robust colour against a plain NumPy reckoning."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from planewright.texture.kernels import fuse_views


def fuse(samples: np.ndarray, valid: np.ndarray, weight: np.ndarray, spread: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    tone = np.broadcast_to(np.arange(256.0), (len(weight), 3, 256)).copy()
    color, count = np.zeros((samples.shape[1], 3), dtype=np.uint8), np.zeros(samples.shape[1], dtype=np.int64)
    agreed = np.zeros(samples.shape[1])
    fuse_views(samples, valid, weight, tone, spread, color, count, agreed)
    return color, count, agreed


def test_it_is_the_sample_with_most_support_and_its_neighbors() -> None:
    rng = np.random.default_rng(0)
    samples = rng.integers(0, 80, (9, 60, 3), dtype=np.uint8)
    weight, valid, spread = rng.uniform(0.2, 1, 9), rng.random((9, 60)) < 0.8, 30.0
    color, count, agreed = fuse(samples, valid, weight, spread)
    assert_array_equal(count, valid.sum(axis=0))
    for t in range(60):
        seen, shares = samples[valid[:, t], t].astype(float), weight[valid[:, t]]
        near = np.maximum(0.0, 1.0 - ((seen[:, None] - seen) ** 2).sum(axis=2) / spread**2)
        best = np.argmax(near @ shares)
        assert_allclose(agreed[t], shares[near[best] > 0].sum() / shares.sum())
        assert_allclose(color[t], near[best] * shares @ seen / (near[best] @ shares), atol=0.51)


def test_views_that_agree_are_averaged_and_others_do_not_count() -> None:
    rng = np.random.default_rng(1)
    samples = (100 + rng.normal(size=(12, 400, 3)) * 3).round().astype(np.uint8)
    # Seven of twelve are wrong, but no two in the same way: they would carry a median.
    samples[:7] = rng.integers(130, 256, (7, 400, 3))
    color, _, agreed = fuse(samples, np.ones((12, 400), dtype=bool), np.ones(12), 30.0)
    off = np.abs(color.astype(float) - 100).max(axis=1)
    assert (off < 8).mean() > 0.97
    assert_allclose(np.median(agreed), 5 / 12)
    assert np.abs(np.median(samples, axis=0) - 100).mean() > 25
    assert color[off < 8].std() < 0.7 * 3


def test_a_heavy_view_outweighs_light_ones() -> None:
    samples = np.array([[[10, 10, 10]], [[200, 200, 200]], [[202, 202, 202]]], dtype=np.uint8)
    valid = np.ones((3, 1), dtype=bool)
    assert fuse(samples, valid, np.array([1.0, 0.2, 0.2]), 10.0)[0][0, 0] == 10
    assert fuse(samples, valid, np.array([1.0, 0.7, 0.7]), 10.0)[0][0, 0] == 201


def test_views_that_do_not_see_a_texel_have_no_say() -> None:
    samples = np.array([[[10, 20, 30]] * 2, [[200, 210, 220]] * 2], dtype=np.uint8)
    color, count, _ = fuse(samples, np.array([[True, False], [False, False]]), np.ones(2), 8.0)
    assert_allclose(color, [[10, 20, 30], [0, 0, 0]])
    assert_array_equal(count, [1, 0])
