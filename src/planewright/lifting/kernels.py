# pyright: basic
"""Compiled loops over pixels: planes scored and refined by how well they carry one view into others.

Pixels here are array coordinates: the centre of the top-left pixel is (0, 0).
A pixel u of the reference view with inverse depth rho lies at the pixel A u + a rho (homogeneous) of a target view,
A = K R K^-1, a = K t with (R, t) = target_from_reference; on a plane rho is linear in u.
"""

from typing import no_type_check

import numpy as np
from numba import njit

from planewright.geometry.bilinear_kernels import bilinear

# `no_type_check` keeps the shape checker of the tests from wrapping a kernel before Numba sees it.


@njit(cache=True)
@no_type_check
def score_planes(images, targets, homographies, shifts, pixels, basis, values, planes, scores, shares):
    """ZNCC of the reference's pixels against each target for each candidate plane.

    images (V, h, w) uint8; targets (T,) int64; homographies (T, 3, 3); shifts (T, 3); pixels (N, 2); basis (N, 3);
    values (N,) grey values in the reference; planes (P, 3): rho = basis @ plane.
    Fills scores (P, T), -1 where less than half of the pixels land inside, and shares (P, T) of pixels inside.
    """
    n = pixels.shape[0]
    for p in range(planes.shape[0]):
        for t in range(targets.shape[0]):
            image = images[targets[t]]
            m, s = homographies[t], shifts[t]
            count = 0
            sa = sb = saa = sbb = sab = 0.0
            for i in range(n):
                rho = basis[i, 0] * planes[p, 0] + basis[i, 1] * planes[p, 1] + basis[i, 2] * planes[p, 2]
                x, y = pixels[i, 0], pixels[i, 1]
                z = m[2, 0] * x + m[2, 1] * y + m[2, 2] + s[2] * rho
                if rho <= 0.0 or z <= 1e-9:
                    continue
                b = bilinear(image, (m[0, 0] * x + m[0, 1] * y + m[0, 2] + s[0] * rho) / z, (m[1, 0] * x + m[1, 1] * y + m[1, 2] + s[1] * rho) / z)
                if b < 0.0:
                    continue
                a = values[i]
                count += 1
                sa += a
                sb += b
                saa += a * a
                sbb += b * b
                sab += a * b
            scores[p, t] = -1.0
            shares[p, t] = count / n
            if count >= 12 and 2 * count >= n:
                va = saa - sa * sa / count
                vb = sbb - sb * sb / count
                if va > 1e-9 and vb > 1e-9:
                    scores[p, t] = (sab - sa * sb / count) / np.sqrt(va * vb)


@njit(cache=True)
@no_type_check
def median(values, count, bins, kept):
    """Median of the first `count` (at least one) of values, none of them negative: counted into bins, then sorted only around the middle.

    bins (any, integers) and kept (at least count,) are scratch. Gives what `np.median` gives, in a quarter of its time for 600 values.
    """
    top = 0.0
    for i in range(count):
        top = max(top, values[i])
    if not top > 0.0:
        return 0.0
    scale = (bins.shape[0] - 1) / top
    bins[:] = 0
    for i in range(count):
        bins[int(values[i] * scale)] += 1
    low, high = (count - 1) // 2, count // 2
    below, first = 0, 0
    while below + bins[first] <= low:
        below += bins[first]
        first += 1
    upto, last = below, first
    while upto + bins[last] <= high:
        upto += bins[last]
        last += 1
    n = 0
    for i in range(count):
        if first <= int(values[i] * scale) <= last:
            k = n
            while k > 0 and kept[k - 1] > values[i]:
                kept[k] = kept[k - 1]
                k -= 1
            kept[k] = values[i]
            n += 1
    return 0.5 * (kept[low - below] + kept[high - below])


@njit(cache=True)
@no_type_check
def factor(a):
    """Cholesky of a (4, 4), symmetric and positive, into its upper half, which alone is read. A library call costs as much as a hundred pixels."""
    for j in range(4):
        for k in range(j):
            a[j, j] -= a[k, j] * a[k, j]
        a[j, j] = np.sqrt(max(a[j, j], 1e-300))
        for i in range(j + 1, 4):
            for k in range(j):
                a[j, i] -= a[k, j] * a[k, i]
            a[j, i] /= a[j, j]


@njit(cache=True)
@no_type_check
def solve_factored(a, b, x):
    """Fills x (4,) with the solution of the factored a x = b."""
    for i in range(4):
        x[i] = b[i]
        for k in range(i):
            x[i] -= a[k, i] * x[k]
        x[i] /= a[i, i]
    for i in range(3, -1, -1):
        for k in range(i + 1, 4):
            x[i] -= a[i, k] * x[k]
        x[i] /= a[i, i]


@njit(cache=True)
@no_type_check
def add_shading(a, b, w, r, u, v, y):
    """Adds w s s^T and w s y of one pixel, s = (r, 1, u, v), to the upper half of a (4, 4) and to b (4,)."""
    wr, wu, wv = w * r, w * u, w * v
    a[0, 0] += wr * r
    a[0, 1] += wr
    a[0, 2] += wr * u
    a[0, 3] += wr * v
    a[1, 1] += w
    a[1, 2] += wu
    a[1, 3] += wv
    a[2, 2] += wu * u
    a[2, 3] += wu * v
    a[3, 3] += wv * v
    b[0] += wr * y
    b[1] += w * y
    b[2] += wu * y
    b[3] += wv * y


@njit(cache=True)
@no_type_check
def plane_equations(images, targets, homographies, shifts, pixels, basis, values, owners, face, owner_scale, plane, noise, hessian, gradient, stats):
    """Gauss-Newton equations of a plane over all targets; a gain and a bias that may slope over the face are eliminated for each target.

    The slope matters on bare faces: light that changes smoothly over a face would else pass for parallax (2.5 degrees on a small plain gable).

    As in `score_planes`; owners (V, h2, w2) int16 says which face is nearest at `owner_scale` times the resolution (a 1x1
    array switches it off); a pixel counts only where `face` or nothing is nearest. noise: floor of the residual's sigma, grey levels.
    Fills hessian (3, 3), gradient (3,) and stats (T, 3): ZNCC, share of pixels used, robust sigma of the residual.
    Returns the robust cost (sum of log-likelihood ratios, Cauchy) over all targets, and the number of pixels used.

    This is where a third of a run goes: 90 ns a pixel and target.
    """
    n = pixels.shape[0]
    res = np.empty(n)
    away = np.empty(n)
    dens = np.empty((n, 3))
    val = np.empty(n)
    ref = np.empty(n)
    w = np.empty(n)
    place = np.empty((n, 2))
    model = np.empty(4)
    c4 = np.empty((4, 4))
    e4 = np.empty(4)
    h = np.empty((3, 3))
    g = np.empty(3)
    cross = np.empty((3, 4))
    solved = np.empty((3, 4))
    bins = np.empty(256, np.int64)
    kept = np.empty(n)
    hessian[:, :] = 0.0
    gradient[:] = 0.0
    cost = 0.0
    used = 0
    masked = owners.shape[1] > 1
    for t in range(targets.shape[0]):
        image = images[targets[t]]
        m, s = homographies[t], shifts[t]
        count = 0
        for i in range(n):
            rho = basis[i, 0] * plane[0] + basis[i, 1] * plane[1] + basis[i, 2] * plane[2]
            x, y = pixels[i, 0], pixels[i, 1]
            z = m[2, 0] * x + m[2, 1] * y + m[2, 2] + s[2] * rho
            if rho <= 0.0 or z <= 1e-9:
                continue
            near = 1.0 / z
            px = (m[0, 0] * x + m[0, 1] * y + m[0, 2] + s[0] * rho) * near
            py = (m[1, 0] * x + m[1, 1] * y + m[1, 2] + s[1] * rho) * near
            if px < 1.0 or py < 1.0 or px >= image.shape[1] - 2 or py >= image.shape[0] - 2:
                continue
            if masked:
                owner = owners[targets[t], int((py + 0.5) * owner_scale), int((px + 0.5) * owner_scale)]
                if owner != face and owner != -1:
                    continue
            # The value, and half the difference of the values a pixel to either side: bilinear each, from the twelve pixels that they share.
            r, c = int(py), int(px)
            fx, fy = px - c, py - r
            ex, ey = 1.0 - fx, 1.0 - fy
            top = image[r, c] * ex + image[r, c + 1] * fx
            low = image[r + 1, c] * ex + image[r + 1, c + 1] * fx
            above = image[r - 1, c] * ex + image[r - 1, c + 1] * fx
            below = image[r + 2, c] * ex + image[r + 2, c + 1] * fx
            left = (image[r, c - 1] * ex + image[r, c] * fx) * ey + (image[r + 1, c - 1] * ex + image[r + 1, c] * fx) * fy
            right = (image[r, c + 1] * ex + image[r, c + 2] * fx) * ey + (image[r + 1, c + 1] * ex + image[r + 1, c + 2] * fx) * fy
            gx = 0.5 * (right - left)
            gy = 0.5 * ((low * ey + below * fy) - (above * ey + top * fy))
            # d pixel / d rho, then the image's slope along it
            slope = (gx * (s[0] - px * s[2]) + gy * (s[1] - py * s[2])) * near
            val[count] = top * ey + low * fy
            ref[count] = values[i]
            dens[count, 0] = slope * basis[i, 0]
            dens[count, 1] = slope * basis[i, 1]
            dens[count, 2] = slope * basis[i, 2]
            place[count, 0] = basis[i, 0]
            place[count, 1] = basis[i, 1]
            count += 1
        stats[t, 0] = -1.0
        stats[t, 1] = count / n
        stats[t, 2] = 0.0
        if count < 20 or 4 * count < n:
            continue
        w[:count] = 1.0
        sigma = noise
        for _ in range(4):
            # a weak prior (gain 1 +- 0.5) keeps bare faces from having their texture scaled away
            c4[:, :] = 0.0
            e4[:] = 0.0
            c4[0, 0] = 4.0 * sigma * sigma
            e4[0] = 4.0 * sigma * sigma
            for i in range(count):
                add_shading(c4, e4, w[i], ref[i], place[i, 0], place[i, 1], val[i])
            for c in range(4):
                c4[c, c] += 1e-9 * (c4[c, c] + 1.0)
            factor(c4)
            solve_factored(c4, e4, model)
            gain, bias, along, down = model[0], model[1], model[2], model[3]
            for i in range(count):
                res[i] = val[i] - gain * ref[i] - bias - along * place[i, 0] - down * place[i, 1]
                away[i] = abs(res[i])
            sigma = max(noise, 1.4826 * median(away, count, bins, kept))
            scale = 0.5 / sigma
            for i in range(count):
                q = res[i] * scale
                w[i] = 1.0 / (1.0 + q * q)
        # ZNCC with the robust weights
        sw = sa = sb = saa = sbb = sab = 0.0
        for i in range(count):
            sw += w[i]
            sa += w[i] * ref[i]
            sb += w[i] * val[i]
            saa += w[i] * ref[i] * ref[i]
            sbb += w[i] * val[i] * val[i]
            sab += w[i] * ref[i] * val[i]
        va = saa - sa * sa / sw
        vb = sbb - sb * sb / sw
        if va > 1e-9 and vb > 1e-9:
            stats[t, 0] = (sab - sa * sb / sw) / np.sqrt(va * vb)
        stats[t, 2] = sigma
        # normal equations in (plane, shading), the shading eliminated; its columns are those of the model with their signs turned
        info = 1.0 / (sigma * sigma)
        scale = 0.5 / sigma
        h[:, :] = 0.0
        g[:] = 0.0
        cross[:, :] = 0.0
        c4[:, :] = 0.0
        e4[:] = 0.0
        c4[0, 0] = 4.0 * sigma * sigma
        cost += count * np.log(sigma)
        product = 1.0
        for i in range(count):
            r, u, v, e = ref[i], place[i, 0], place[i, 1], res[i]
            add_shading(c4, e4, w[i], r, u, v, e)
            for c in range(3):
                wd = w[i] * dens[i, c]
                g[c] += wd * e
                cross[c, 0] += wd * r
                cross[c, 1] += wd
                cross[c, 2] += wd * u
                cross[c, 3] += wd * v
                for d in range(c + 1):
                    h[c, d] += wd * dens[i, d]
            # One logarithm for 16 pixels: their product stays far below the largest number.
            q = e * scale
            product *= 1.0 + q * q
            if i % 16 == 15:
                cost += 2.0 * np.log(product)
                product = 1.0
        cost += 2.0 * np.log(product)
        for c in range(4):
            c4[c, c] += 1e-9 * (c4[c, c] + 1.0)
        factor(c4)
        for c in range(3):
            solve_factored(c4, cross[c], solved[c])
        for c in range(3):
            for d in range(4):
                g[c] -= solved[c, d] * e4[d]
            gradient[c] += info * g[c]
            for d in range(c + 1):
                low = h[c, d]
                for k in range(4):
                    low -= cross[c, k] * solved[d, k]
                hessian[c, d] += info * low
        used += count
    for c in range(3):
        for d in range(c):
            hessian[d, c] = hessian[c, d]
    return cost, used
