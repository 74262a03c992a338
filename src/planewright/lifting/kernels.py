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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
@no_type_check
def median(values, count, total, bins, kept):
    """Median of the first `count` (at least one) of values, none negative and `total` their sum: counted into bins, then sorted only around the middle.

    The bins span twice the mean, which half of the values cannot exceed; a few far off leave them as fine as they are. bins (any, integers) and
    kept (at least count,) are scratch. Gives what `np.median` gives, in a tenth of its time for 600 values.
    """
    if not total > 0.0:
        return 0.0
    last_bin = bins.shape[0] - 1
    scale = last_bin * count / (2.0 * total)
    bins[:] = 0
    for i in range(count):
        bins[int(min(values[i] * scale, last_bin))] += 1
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
        if first <= int(min(values[i] * scale, last_bin)) <= last:
            k = n
            while k > 0 and kept[k - 1] > values[i]:
                kept[k] = kept[k - 1]
                k -= 1
            kept[k] = values[i]
            n += 1
    return 0.5 * (kept[low - below] + kept[high - below])


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


SUMS = {"reassoc", "contract", "nsz"}
"""Freedom to add in any order, so that sums over pixels run in the vector units. The order is settled when a kernel is compiled: a machine gives the
same bits every time, whatever the number of threads. What has this freedom must stand in one kernel (`inline`): a function of its own is compiled
twice, by itself and within its caller, and which of the two runs depends on whether the kernel came from the cache."""


@njit(cache=True, nogil=True, inline="always")
@no_type_check
def shading_sums(w, ref, along, down, val, count, a, b):
    """Adds w s s^T and w s val of the first `count` pixels, s = (ref, 1, along, down), to the upper half of a (4, 4) and to b (4,)."""
    a00 = a01 = a02 = a03 = a11 = a12 = a13 = a22 = a23 = a33 = 0.0
    b0 = b1 = b2 = b3 = 0.0
    for i in range(count):
        r, u, v, y = ref[i], along[i], down[i], val[i]
        wr, wu, wv = w[i] * r, w[i] * u, w[i] * v
        a00 += wr * r
        a01 += wr
        a02 += wr * u
        a03 += wr * v
        a11 += w[i]
        a12 += wu
        a13 += wv
        a22 += wu * u
        a23 += wu * v
        a33 += wv * v
        b0 += wr * y
        b1 += w[i] * y
        b2 += wu * y
        b3 += wv * y
    a[0, 0] += a00
    a[0, 1] += a01
    a[0, 2] += a02
    a[0, 3] += a03
    a[1, 1] += a11
    a[1, 2] += a12
    a[1, 3] += a13
    a[2, 2] += a22
    a[2, 3] += a23
    a[3, 3] += a33
    b[0] += b0
    b[1] += b1
    b[2] += b2
    b[3] += b3


@njit(cache=True, nogil=True, inline="always")
@no_type_check
def plane_sums(w, slope, along, down, ref, res, count, h, g, cross):
    """Fills h (3, 3, lower half) with the sum of w d d^T, g (3,) with w d res and cross (3, 4) with w d s^T, d = slope (along, down, 1), s as above."""
    s1 = sr = su = sv = sur = svr = suu = suv = svv = 0.0
    e1 = eu = ev = 0.0
    h1 = hu = hv = huu = huv = hvv = 0.0
    for i in range(count):
        u, v = along[i], down[i]
        ws = w[i] * slope[i]
        wsu, wsv = ws * u, ws * v
        s1 += ws
        sr += ws * ref[i]
        su += wsu
        sv += wsv
        sur += wsu * ref[i]
        svr += wsv * ref[i]
        suu += wsu * u
        suv += wsu * v
        svv += wsv * v
        e1 += ws * res[i]
        eu += wsu * res[i]
        ev += wsv * res[i]
        h1 += ws * slope[i]
        hu += wsu * slope[i]
        hv += wsv * slope[i]
        huu += wsu * slope[i] * u
        huv += wsu * slope[i] * v
        hvv += wsv * slope[i] * v
    h[0, 0], h[1, 0], h[1, 1] = huu, huv, hvv
    h[2, 0], h[2, 1], h[2, 2] = hu, hv, h1
    g[0], g[1], g[2] = eu, ev, e1
    cross[0, 0], cross[0, 1], cross[0, 2], cross[0, 3] = sur, su, suu, suv
    cross[1, 0], cross[1, 1], cross[1, 2], cross[1, 3] = svr, sv, suv, svv
    cross[2, 0], cross[2, 1], cross[2, 2], cross[2, 3] = sr, s1, su, sv


@njit(cache=True, nogil=True, inline="always")
@no_type_check
def shaded_residuals(model, ref, along, down, val, count, res, away):
    """Fills res with what the shading model (4,) leaves of val, and away with its size; returns the sum of the sizes."""
    gain, bias, right, below = model[0], model[1], model[2], model[3]
    total = 0.0
    for i in range(count):
        res[i] = val[i] - gain * ref[i] - bias - right * along[i] - below * down[i]
        away[i] = abs(res[i])
        total += away[i]
    return total


@njit(cache=True, nogil=True, inline="always")
@no_type_check
def correlation(w, ref, val, count):
    """Weighted ZNCC of the first `count` values; -1 where either does not vary."""
    sw = sa = sb = saa = sbb = sab = 0.0
    for i in range(count):
        wa, wb = w[i] * ref[i], w[i] * val[i]
        sw += w[i]
        sa += wa
        sb += wb
        saa += wa * ref[i]
        sbb += wb * val[i]
        sab += wa * val[i]
    va = saa - sa * sa / sw
    vb = sbb - sb * sb / sw
    return (sab - sa * sb / sw) / np.sqrt(va * vb) if va > 1e-9 and vb > 1e-9 else -1.0


@njit(cache=True, nogil=True, inline="always")
@no_type_check
def cauchy_weights(res, scale, count, w):
    """Fills w with 1 / (1 + (scale res)^2)."""
    for i in range(count):
        q = res[i] * scale
        w[i] = 1.0 / (1.0 + q * q)


@njit(cache=True, nogil=True, inline="always")
@no_type_check
def cauchy_cost(w, count):
    """Sum of -2 log w, with one logarithm for 16 pixels: the product of their reciprocals stays far below the largest number."""
    cost = 0.0
    for first in range(0, count, 16):
        product = 1.0
        for i in range(first, min(first + 16, count)):
            product *= w[i]
        cost -= 2.0 * np.log(product)
    return cost


@njit(cache=True, nogil=True, inline="always")
@no_type_check
def landings(m, s, x, y, rho, px, py, near):
    """Fills px and py (N,) with where pixels x, y at inverse depths rho land in a target, near with 1 / z there; px is -1 where that is behind a camera."""
    for i in range(x.shape[0]):
        z = m[2, 0] * x[i] + m[2, 1] * y[i] + m[2, 2] + s[2] * rho[i]
        ahead = (z > 1e-9) & (rho[i] > 0.0)
        near[i] = 1.0 / (z if ahead else 1.0)
        py[i] = (m[1, 0] * x[i] + m[1, 1] * y[i] + m[1, 2] + s[1] * rho[i]) * near[i]
        px[i] = (m[0, 0] * x[i] + m[0, 1] * y[i] + m[0, 2] + s[0] * rho[i]) * near[i] if ahead else -1.0


@njit(cache=True, nogil=True, fastmath=SUMS)
@no_type_check
def plane_equations(images, targets, homographies, shifts, pixels, basis, values, owners, face, owner_scale, plane, noise, hessian, gradient, stats):
    """Gauss-Newton equations of a plane over all targets; a gain and a bias that may slope over the face are eliminated for each target.

    The slope matters on bare faces: light that changes smoothly over a face would else pass for parallax (2.5 degrees on a small plain gable).

    As in `score_planes`; basis[:, 2] is 1; owners (V, h2, w2) int16 says which face is nearest at `owner_scale` times the resolution (a 1x1
    array switches it off); a pixel counts only where `face` or nothing is nearest. noise: floor of the residual's sigma, grey levels.
    Fills hessian (3, 3), gradient (3,) and stats (T, 3): ZNCC, share of pixels used, robust sigma of the residual.
    Returns the robust cost (sum of log-likelihood ratios, Cauchy) over all targets, and the number of pixels used.

    This is where a fifth of a run goes: 48 ns a pixel and target, 20 of them for the sampling (81 with sums in one order).
    """
    n = pixels.shape[0]
    px_all, py_all, near = np.empty(n), np.empty(n), np.empty(n)
    x, y, right_of, below_of = pixels[:, 0].copy(), pixels[:, 1].copy(), basis[:, 0].copy(), basis[:, 1].copy()
    rho = right_of * plane[0] + below_of * plane[1] + plane[2]
    res, away, w, kept = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    slope, val, ref, along, down = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    model = np.empty(4)
    c4 = np.empty((4, 4))
    e4 = np.empty(4)
    h = np.empty((3, 3))
    g = np.empty(3)
    cross = np.empty((3, 4))
    solved = np.empty((3, 4))
    bins = np.empty(256, np.int64)
    hessian[:, :] = 0.0
    gradient[:] = 0.0
    cost = 0.0
    used = 0
    masked = owners.shape[1] > 1
    one, two = np.uintp(1), np.uintp(2)
    for t in range(targets.shape[0]):
        image = images[targets[t]]
        right, bottom = image.shape[1] - 2, image.shape[0] - 2
        m, s = homographies[t], shifts[t]
        landings(m, s, x, y, rho, px_all, py_all, near)
        count = 0
        for i in range(n):
            px, py = px_all[i], py_all[i]
            if not (px >= 1.0 and py >= 1.0 and px < right and py < bottom):
                continue
            if masked:
                owner = owners[targets[t], int((py + 0.5) * owner_scale), int((px + 0.5) * owner_scale)]
                if owner != face and owner != -1:
                    continue
            # The value, and half the difference of the values a pixel to either side: bilinear each, from the twelve pixels that they share.
            # Unsigned indices spare the check for negative ones.
            r, c = np.uintp(py), np.uintp(px)
            fx, fy = px - c, py - r
            ex, ey = 1.0 - fx, 1.0 - fy
            top = image[r, c] * ex + image[r, c + one] * fx
            low = image[r + one, c] * ex + image[r + one, c + one] * fx
            above = image[r - one, c] * ex + image[r - one, c + one] * fx
            below = image[r + two, c] * ex + image[r + two, c + one] * fx
            before = (image[r, c - one] * ex + image[r, c] * fx) * ey + (image[r + one, c - one] * ex + image[r + one, c] * fx) * fy
            behind = (image[r, c + one] * ex + image[r, c + two] * fx) * ey + (image[r + one, c + one] * ex + image[r + one, c + two] * fx) * fy
            gx = 0.5 * (behind - before)
            gy = 0.5 * ((low * ey + below * fy) - (above * ey + top * fy))
            # d pixel / d rho, then the image's slope along it
            slope[count] = (gx * (s[0] - px * s[2]) + gy * (s[1] - py * s[2])) * near[i]
            val[count] = top * ey + low * fy
            ref[count] = values[i]
            along[count] = right_of[i]
            down[count] = below_of[i]
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
            shading_sums(w, ref, along, down, val, count, c4, e4)
            for c in range(4):
                c4[c, c] += 1e-9 * (c4[c, c] + 1.0)
            factor(c4)
            solve_factored(c4, e4, model)
            total = shaded_residuals(model, ref, along, down, val, count, res, away)
            sigma = max(noise, 1.4826 * median(away, count, total, bins, kept))
            cauchy_weights(res, 0.5 / sigma, count, w)
        stats[t, 0] = correlation(w, ref, val, count)
        stats[t, 2] = sigma
        # normal equations in (plane, shading), the shading eliminated; its columns are those of the model with their signs turned
        info = 1.0 / (sigma * sigma)
        c4[:, :] = 0.0
        e4[:] = 0.0
        c4[0, 0] = 4.0 * sigma * sigma
        shading_sums(w, ref, along, down, res, count, c4, e4)
        plane_sums(w, slope, along, down, ref, res, count, h, g, cross)
        cost += count * np.log(sigma) + cauchy_cost(w, count)
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
