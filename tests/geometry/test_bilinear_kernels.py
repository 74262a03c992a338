"""Grey values between pixel centres."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.geometry.bilinear_kernels import bilinear

ROWS, COLUMNS = np.mgrid[0:7, 0:9].astype(float)


@pytest.mark.parametrize("kind", [np.uint8, np.float64])
def test_an_image_that_is_bilinear_is_reproduced_exactly(kind: type) -> None:
    image = (10 + 3 * COLUMNS + 2 * ROWS + COLUMNS * ROWS).astype(kind)
    rng = np.random.default_rng(0)
    for x, y in [*rng.uniform([0, 0], [8, 6], (50, 2)), (0.0, 0.0), (7.999, 5.999), (3.0, 2.0)]:
        assert_allclose(bilinear(image, x, y), 10 + 3 * x + 2 * y + x * y, rtol=1e-12)


def test_outside_the_outermost_centres_there_is_no_value() -> None:
    image = np.full((7, 9), 50, np.uint8)
    for x, y in [(-1e-9, 3.0), (8.0, 3.0), (3.0, -1e-9), (3.0, 6.0), (np.nan, 3.0), (3.0, np.nan), (1e12, 3.0)]:
        assert bilinear(image, x, y) == -1.0
