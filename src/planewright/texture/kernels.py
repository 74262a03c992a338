# pyright: basic
"""The inner loop of the texture: one robust colour from many views."""

from typing import no_type_check

import numpy as np
from numba import njit


# Without `no_type_check` the shape checker of the tests wraps the function before Numba sees it.
@njit(cache=True)
@no_type_check
def fuse_views(samples, valid, weight, tone, tolerance, color, count):
    """Into `color` (texels, 3; uint8) the weighted median over the views, then the weighted mean of what lies near it; into `count` the views that took part.

    samples (views, texels, 3; uint8), valid (views, texels; bool), weight (views,), tone (views, 3, 256): the evened-out value of each recorded one;
    tolerance: grey levels. Texels that no view saw keep their colour.
    """
    views, texels = valid.shape
    value = np.empty(views)
    share = np.empty(views)
    for t in range(texels):
        found = 0
        for c in range(3):
            found = 0
            total = 0.0
            for k in range(views):
                if not valid[k, t]:
                    continue
                v = tone[k, c, samples[k, t, c]]
                w = weight[k]
                j = found - 1
                while j >= 0 and value[j] > v:
                    value[j + 1] = value[j]
                    share[j + 1] = share[j]
                    j -= 1
                value[j + 1] = v
                share[j + 1] = w
                found += 1
                total += w
            if found == 0:
                break
            below = 0.0
            middle = value[found - 1]
            for k in range(found):
                below += share[k]
                if below >= 0.5 * total:
                    middle = value[k]
                    break
            top, bottom = 0.0, 0.0
            for k in range(found):
                if abs(value[k] - middle) <= tolerance:
                    top += share[k] * value[k]
                    bottom += share[k]
            color[t, c] = np.uint8(min(max(top / bottom, 0.0), 255.0) + 0.5)
        count[t] = found
