"""Edges at a point in one frame."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.mending.lines import lines_at

CORNER = np.array([60.3, 80.6])
"""The dark square's upper left corner; its edges run to the right and down."""
ENDS = np.array([[150.0, 80.6], [60.3, 150.0]])


def square(noise: float = 2.0) -> np.ndarray:
    y, x = np.mgrid[0:180, 0:200] + 0.5
    inside = np.clip(x - CORNER[0] + 0.5, 0, 1) * np.clip(y - CORNER[1] + 0.5, 0, 1)
    return np.clip(170.0 - 90.0 * inside + np.random.default_rng(0).normal(0.0, noise, inside.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("off", [(0.0, 0.0), (3.0, -2.5), (-4.0, 5.0)])
def test_lines_run_through_the_corner_wherever_it_was_thought_to_be(off: tuple[float, float]) -> None:
    found = lines_at(square(), CORNER + off, ENDS)
    assert (found[:, 3] > 0.3).all()
    assert_allclose((found[:, :2] * CORNER).sum(axis=1), found[:, 2], atol=0.3)


def test_a_bare_wall_and_an_unknown_end_give_no_line() -> None:
    bare = np.random.default_rng(1).normal(128.0, 2.0, (180, 200)).astype(np.uint8)
    assert (lines_at(bare, CORNER, ENDS)[:, 3] == 0.0).mean() >= 0.5
    unknown = np.array([[np.nan, np.nan], ENDS[1]])
    found = lines_at(square(), CORNER, unknown)
    assert found[0, 3] == 0.0
    assert found[1, 3] > 0.0


def test_too_short_an_edge_says_nothing() -> None:
    assert lines_at(square(), CORNER, CORNER + np.array([[20.0, 0.0]]))[0, 3] == 0.0
