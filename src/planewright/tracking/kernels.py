# pyright: basic
"""Compiled loops along edges. Pixels are array coordinates: the centre of the top-left pixel is (0, 0)."""

import numpy as np
from numba import njit


@njit(cache=True)
def _sample(image, x, y):
    """Bilinear grey value; -1 outside."""
    h, w = image.shape
    if not (x >= 0.0 and y >= 0.0 and x < w - 1 and y < h - 1):
        return -1.0
    i, j = int(y), int(x)
    fx, fy = x - j, y - i
    top = image[i, j] * (1.0 - fx) + image[i, j + 1] * fx
    low = image[i + 1, j] * (1.0 - fx) + image[i + 1, j + 1] * fx
    return top * (1.0 - fy) + low * fy


@njit(cache=True)
def edge_strip(images, chosen, projections, start, along, across, half, step, inside, owners, owner_scale, allowed, limit, strip, count):
    """Steepness across an edge, averaged over views in the edge's own plane.

    images (V, h, w) uint8; chosen (C,) views; projections (V, 3, 4) to array coordinates; start (3,) first corner, along (3,) to the
    second, across (3,) unit vector of the plane at right angles to the edge; offsets are (j - half) * step along `across`.
    inside: offset (world units, signed) at which a point just inside the face is looked up in owners (V, h2, w2); its face must
    be `allowed` (F,) bool. limit: a difference d of grey values over two steps counts as d / (1 + d / limit): monotonic, so a sharp edge keeps one peak.
    Adds to strip (S, 2 half + 1) and count (S,).
    """
    samples, width = strip.shape
    profile = np.empty(width + 2)
    for c in range(chosen.shape[0]):
        v = chosen[c]
        image, p = images[v], projections[v]
        for s in range(samples):
            t = (s + 0.5) / samples
            x0 = start[0] + t * along[0]
            y0 = start[1] + t * along[1]
            z0 = start[2] + t * along[2]
            # is the face there in this view?
            xi, yi, zi = x0 + inside * across[0], y0 + inside * across[1], z0 + inside * across[2]
            w = p[2, 0] * xi + p[2, 1] * yi + p[2, 2] * zi + p[2, 3]
            if w <= 1e-9:
                continue
            u = int(((p[0, 0] * xi + p[0, 1] * yi + p[0, 2] * zi + p[0, 3]) / w + 0.5) * owner_scale)
            q = int(((p[1, 0] * xi + p[1, 1] * yi + p[1, 2] * zi + p[1, 3]) / w + 0.5) * owner_scale)
            if u < 0 or q < 0 or q >= owners.shape[1] or u >= owners.shape[2]:
                continue
            owner = owners[v, q, u]
            if owner < 0 or not allowed[owner]:
                continue
            good = True
            for j in range(width + 2):
                d = (j - 1 - half) * step
                x, y, z = x0 + d * across[0], y0 + d * across[1], z0 + d * across[2]
                w = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
                if w <= 1e-9:
                    good = False
                    break
                value = _sample(image, (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / w, (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / w)
                if value < 0.0:
                    good = False
                    break
                profile[j] = value
            if not good:
                continue
            count[s] += 1
            for j in range(width):
                steep = abs(profile[j + 2] - profile[j])
                strip[s, j] += steep / (1.0 + steep / limit)


@njit(cache=True)
def line_scores(strip, valid, half, out):
    """Mean of strip (S, W) along each straight line across it: out (R, R) for end offsets a, b in -R//2..R//2 around the middle."""
    samples, width = strip.shape
    size = out.shape[0]
    r = size // 2
    for ia in range(size):
        for ib in range(size):
            a, b = ia - r, ib - r
            total = 0.0
            n = 0
            for s in range(samples):
                if not valid[s]:
                    continue
                t = (s + 0.5) / samples
                x = half + a * (1.0 - t) + b * t
                if x < 0.0 or x > width - 1.001:
                    continue
                j = int(x)
                f = x - j
                total += strip[s, j] * (1.0 - f) + strip[s, j + 1] * f
                n += 1
            out[ia, ib] = total / n if n else 0.0
