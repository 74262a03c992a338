"""Filling in what was not seen."""

import numpy as np
from numpy.testing import assert_array_equal

from planewright.texture.fill import fill_unseen


def test_what_was_seen_stays_and_what_was_not_lies_between_its_surroundings() -> None:
    rng = np.random.default_rng(0)
    for shape in ((64, 64), (37, 101), (1, 9), (130, 3)):
        image = rng.integers(40, 200, (*shape, 3), dtype=np.uint8)
        seen = rng.random(shape) < 0.2
        seen[0, 0] = True
        filled = fill_unseen(image, seen)
        assert_array_equal(filled[seen], image[seen])
        assert (filled >= image[seen].min(axis=0) - 1).all()
        assert (filled <= image[seen].max(axis=0) + 1).all()


def test_a_hole_in_one_color_is_filled_with_it() -> None:
    image = np.full((80, 120, 3), [200, 30, 90], dtype=np.uint8)
    seen = np.ones((80, 120), dtype=bool)
    seen[20:70, 10:100] = False
    image[~seen] = 0
    assert np.abs(fill_unseen(image, seen).astype(int) - [200, 30, 90]).max() <= 1


def test_two_sides_meet_in_between() -> None:
    image = np.zeros((32, 96, 3), dtype=np.uint8)
    image[:, -16:] = 200
    seen = np.zeros((32, 96), dtype=bool)
    seen[:, :16] = seen[:, -16:] = True
    middle = fill_unseen(image, seen)[:, :, 0].astype(int)
    assert (np.diff(middle, axis=1) >= -2).all()
    # Not exactly half-way: the coarse levels are blocks.
    assert 40 < middle[:, 48].mean() < 160


def test_where_nothing_was_seen_it_is_grey() -> None:
    assert (fill_unseen(np.zeros((5, 4, 3), dtype=np.uint8), np.zeros((5, 4), dtype=bool)) == 128).all()
