# pyright: basic
"""The inner loop of the texture: one robust colour from many views."""

from typing import no_type_check

import numpy as np
from numba import njit


# Without `no_type_check` the shape checker of the tests wraps the function before Numba sees it.
@njit(cache=True)
@no_type_check
def fuse_views(samples, valid, weight, tone, spread, color, count, agreed):
    """Into `color` (texels, 3; uint8) what most of the views agree on; into `count` the views that see the texel, into `agreed` their share that agrees.

    The sample with the most support, each other sample supporting it by its weight times 1 - (distance / spread)^2 down to zero, then the average
    with that support (one step of mean shift with Epanechnikov's kernel; Comaniciu & Meer 2002).
    samples (views, texels, 3; uint8), valid (views, texels; bool), weight (views,), tone (views, 3, 256): the evened-out value of each recorded one;
    spread: distance in RGB, grey levels. Texels that no view saw keep their colour.
    """
    views, texels = valid.shape
    value = np.empty((views, 3))
    share = np.empty(views)
    support = np.empty(views)
    for t in range(texels):
        found = 0
        for k in range(views):
            if valid[k, t]:
                for c in range(3):
                    value[found, c] = tone[k, c, samples[k, t, c]]
                share[found] = weight[k]
                support[found] = weight[k]
                found += 1
        count[t] = found
        if found == 0:
            continue
        for i in range(found):
            for j in range(i):
                distance2 = (value[i, 0] - value[j, 0]) ** 2 + (value[i, 1] - value[j, 1]) ** 2 + (value[i, 2] - value[j, 2]) ** 2
                near = 1.0 - distance2 / (spread * spread)
                if near > 0.0:
                    support[i] += share[j] * near
                    support[j] += share[i] * near
        best = 0
        for i in range(1, found):
            if support[i] > support[best]:
                best = i
        total, red, green, blue = 0.0, 0.0, 0.0, 0.0
        for_it, in_all = 0.0, 0.0
        for j in range(found):
            distance2 = (value[best, 0] - value[j, 0]) ** 2 + (value[best, 1] - value[j, 1]) ** 2 + (value[best, 2] - value[j, 2]) ** 2
            near = 1.0 - distance2 / (spread * spread)
            in_all += share[j]
            if near > 0.0:
                for_it += share[j]
                total += share[j] * near
                red += share[j] * near * value[j, 0]
                green += share[j] * near * value[j, 1]
                blue += share[j] * near * value[j, 2]
        agreed[t] = for_it / in_all
        color[t, 0] = np.uint8(min(max(red / total, 0.0), 255.0) + 0.5)
        color[t, 1] = np.uint8(min(max(green / total, 0.0), 255.0) + 0.5)
        color[t, 2] = np.uint8(min(max(blue / total, 0.0), 255.0) + 0.5)
