"""What a plane earns by itself."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.lifting.hypothesis import AGREEMENT, CORNERS, Hypothesis, agreement
from planewright.lifting.photometric import PhotometricOptions, hypotheses


@pytest.fixture(scope="module")
def on_wall(wall) -> Hypothesis:
    found = hypotheses(wall.views, wall.reference(), (0.2, 0.6), (), PhotometricOptions())[0]
    return Hypothesis(wall.normal, wall.offset, agreement(found), 4, np.zeros((1, 3)), np.zeros((1, 1), bool), found)


def test_views_that_agree_earn_and_views_that_do_not_cost(on_wall: Hypothesis) -> None:
    assert on_wall.quality > 0.9
    assert on_wall.energy <= -AGREEMENT
    assert_allclose(replace(on_wall, quality=0.4).energy, 0.0, atol=1e-12)
    assert replace(on_wall, quality=0.1).energy > 0.0


def test_corners_earn_by_what_speaks_for_them(on_wall: Hypothesis) -> None:
    through = replace(on_wall, found=None, quality=float("nan"), view=-1)
    assert_allclose(through.energy, -CORNERS)
    assert_allclose(replace(through, support=2.0).energy, -2.0 * CORNERS)


def test_features_seen_through_a_plane_cost_more_than_any_agreement_earns(on_wall: Hypothesis) -> None:
    assert replace(on_wall, seen_through=1.0).energy > on_wall.energy
    assert replace(on_wall, seen_through=10.0).energy > 0.0
    assert replace(on_wall, seen_through=50.0).energy == replace(on_wall, seen_through=10.0).energy


def test_a_plane_that_few_views_show_agrees_less(on_wall: Hypothesis) -> None:
    assert on_wall.found is not None
    assert_allclose(agreement(replace(on_wall.found, share=0.25)), 0.5 * on_wall.found.zncc)
    assert agreement(replace(on_wall.found, share=0.6)) == on_wall.found.zncc
