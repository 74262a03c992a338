"""Laws of homographies of a face."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.registration.homography import apply_homography, change_jacobian, changed, point_jacobian


def some_homography(rng: np.random.Generator) -> np.ndarray:
    return np.array([[80.0, 5.0, 200.0], [-7.0, 60.0, 150.0], [0.08, -0.05, 1.0]]) + rng.normal(0, 1, (3, 3)) * [[5, 5, 20], [5, 5, 20], [0.02, 0.02, 0]]


def test_derivatives_are_those_of_small_differences() -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        h, q, eps = some_homography(rng), rng.uniform(-1, 1, (7, 2)), 1e-6
        by_change = np.stack([(apply_homography(changed(h, eps * d), q) - apply_homography(changed(h, -eps * d), q)) / (2 * eps) for d in np.eye(8)], axis=-1)
        assert_allclose(change_jacobian(h, q), by_change, atol=1e-4)
        by_place = np.stack([(apply_homography(h, q + eps * d) - apply_homography(h, q - eps * d)) / (2 * eps) for d in np.eye(2)], axis=-1)
        assert_allclose(point_jacobian(h, q), by_place, atol=1e-4)


def test_what_is_behind_is_nowhere() -> None:
    h = np.array([[50.0, 0.0, 100.0], [0.0, 50.0, 100.0], [1.0, 0.0, 1.0]])
    there = apply_homography(h, np.array([[0.5, 0.0], [-1.0, 0.0], [-2.0, 0.3]]))
    assert_allclose(there[0], [125 / 1.5, 100 / 1.5])
    assert np.isnan(there[1:]).all()
