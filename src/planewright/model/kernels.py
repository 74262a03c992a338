# pyright: basic
"""The inner loop of `render`: the texture under every pixel."""

from typing import no_type_check

import numpy as np
from numba import njit


# Without `no_type_check` the shape checker of the tests wraps the function before Numba sees it.
@njit(cache=True)
@no_type_check
def paint_faces(face, warps, chosen, atlas, image):
    """Paint `image` (height, width, 3; uint8) where `face` (height, width; int16) is a chosen one with the atlas (rows, columns, 3; uint8), bilinearly.

    warps (faces, 3, 3): homogeneous pixel to texel coordinates, outer corners at 0. chosen (faces; bool).
    """
    height, width = face.shape
    rows, columns = atlas.shape[0], atlas.shape[1]
    for y in range(height):
        for x in range(width):
            f = face[y, x]
            if f < 0 or not chosen[f]:
                continue
            h = warps[f]
            px, py = x + 0.5, y + 0.5
            w = h[2, 0] * px + h[2, 1] * py + h[2, 2]
            u = (h[0, 0] * px + h[0, 1] * py + h[0, 2]) / w - 0.5
            v = (h[1, 0] * px + h[1, 1] * py + h[1, 2]) / w - 0.5
            u = min(max(u, 0.0), columns - 1.0)
            v = min(max(v, 0.0), rows - 1.0)
            left, top = int(u), int(v)
            right, below = min(left + 1, columns - 1), min(top + 1, rows - 1)
            a, b = u - left, v - top
            for c in range(3):
                upper = (1 - a) * atlas[top, left, c] + a * atlas[top, right, c]
                lower = (1 - a) * atlas[below, left, c] + a * atlas[below, right, c]
                image[y, x, c] = np.uint8((1 - b) * upper + b * lower + 0.5)
