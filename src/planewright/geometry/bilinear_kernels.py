# pyright: basic
"""Grey values between pixel centres, for compiled loops over pixels. Array coordinates: the centre of the top-left pixel is (0, 0)."""

from typing import no_type_check

from numba import njit


# Without `no_type_check` the shape checker of the tests wraps the function before Numba sees it.
# Numba's cache of a caller does not notice a change here: delete __pycache__ after one.
@njit(cache=True)
@no_type_check
def bilinear(image, x, y):
    """Value of image (height, width) at column x and row y, interpolated between the four pixels around; -1 outside the outermost centres."""
    h, w = image.shape
    if not (x >= 0.0 and y >= 0.0 and x < w - 1 and y < h - 1):
        return -1.0
    i, j = int(y), int(x)
    fx, fy = x - j, y - i
    top = image[i, j] * (1.0 - fx) + image[i, j + 1] * fx
    low = image[i + 1, j] * (1.0 - fx) + image[i + 1, j + 1] * fx
    return top * (1.0 - fy) + low * fy
