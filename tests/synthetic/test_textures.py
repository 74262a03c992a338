"""Paint: the asked size, within the range of colours, and with detail at several scales."""

from collections.abc import Callable
from itertools import pairwise

import cv2
import numpy as np
import pytest

from planewright.synthetic.textures import Painter, books, bricks, door, octaves, parcel, planks, plaster, print_on, screen, shingles, siding, speckled, window

PAINTERS: list[Callable[[], Painter]] = [
    lambda: bricks((178, 96, 70), (205, 196, 184)),
    lambda: shingles((104, 70, 62)),
    lambda: planks((150, 112, 74)),
    lambda: planks((150, 112, 74), upright=True),
    lambda: siding((196, 190, 160)),
    lambda: speckled((52, 98, 34), (118, 158, 62)),
    lambda: plaster((188, 196, 200)),
    lambda: print_on((206, 204, 196)),
    lambda: parcel((168, 126, 82)),
    screen,
    books,
    window,
    door,
]


@pytest.mark.parametrize("make", PAINTERS)
def test_paint_has_the_asked_size_and_detail_at_three_scales(make: Callable[[], Painter]) -> None:
    image = make()(1.4, 1.1, 150.0, np.random.default_rng(3))
    assert image.shape == (165, 210, 3)
    assert 10 < image.mean() < 245
    gray = image.mean(axis=2).astype(np.float32)
    blurred = [gray, *(cv2.GaussianBlur(gray, (0, 0), sigma) for sigma in (2, 6, 18))]
    bands = [float((fine - coarse).std()) for fine, coarse in pairwise(blurred)]
    assert min(bands) > 0.4, bands


def test_paint_is_a_function_of_its_seed() -> None:
    paint = print_on((206, 204, 196))
    one, same, other = (paint(1.0, 1.0, 80.0, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_noise_is_of_about_unit_deviation_whatever_its_cells() -> None:
    for cell in ((2.0, 2.0), (20.0, 20.0), (4.0, 60.0)):
        noise = octaves((400, 400), cell, np.random.default_rng(0))
        assert 0.6 < noise.std() < 1.6, cell
