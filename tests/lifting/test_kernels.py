"""The small parts of the kernels against the libraries whose work they do faster."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.lifting.kernels import factor, median, plane_sums, shading_sums, solve_factored


def test_the_median_is_the_one_that_numpy_gives() -> None:
    rng = np.random.default_rng(0)
    bins, kept = np.empty(256, np.int64), np.empty(700)
    for count in (1, 2, 3, 20, 21, 599, 600, 700):
        for values in (
            rng.exponential(3.0, count),
            np.abs(rng.standard_cauchy(count)) ** 3,  # nearly all of them in the first bin
            np.round(rng.exponential(3.0, count)),  # many equal ones
            np.zeros(count),
            np.where(np.arange(count) % 2 == 0, 0.0, 7.0),
        ):
            assert median(np.append(values, 1e9), count, float(values.sum()), bins, kept) == np.median(values), count


def test_a_shading_is_the_weighted_least_squares_solution() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        gray, u, v, w = rng.uniform(20, 230, 50), rng.uniform(-1, 1, 50), rng.uniform(-1, 1, 50), rng.uniform(0.1, 1, 50)
        seen = 0.9 * gray + 5.0 - 3.0 * u + 2.0 * v + rng.normal(0, 1.0, 50)
        a, b, found = np.zeros((4, 4)), np.zeros(4), np.empty(4)
        shading_sums(w, gray, u, v, seen, 50, a, b)
        factor(a)
        solve_factored(a, b, found)
        rows = np.column_stack([gray, np.ones(50), u, v]) * np.sqrt(w)[:, None]
        assert_allclose(found, np.linalg.lstsq(rows, seen * np.sqrt(w), rcond=None)[0], rtol=1e-8)


def test_the_sums_of_a_plane_are_those_of_its_slopes() -> None:
    rng = np.random.default_rng(2)
    gray, u, v, w, slope, res = rng.uniform(20, 230, 70), *rng.uniform(-1, 1, (2, 70)), rng.uniform(0.1, 1, 70), *rng.normal(0, 3, (2, 70))
    h, g, cross = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 4))
    plane_sums(w, slope, u, v, gray, res, 60, h, g, cross)
    d, s = slope[:60, None] * np.column_stack([u, v, np.ones(70)])[:60], np.column_stack([gray, np.ones(70), u, v])[:60]
    assert_allclose(h, np.tril(d.T @ (w[:60, None] * d)), atol=1e-9)
    assert_allclose(g, d.T @ (w[:60] * res[:60]), atol=1e-9)
    assert_allclose(cross, d.T @ (w[:60, None] * s), atol=1e-9)
