# pyright: basic
"""Compiled loops over pixels: planes scored and refined by how well they carry one view into others.

Pixels here are array coordinates: the centre of the top-left pixel is (0, 0).
A pixel u of the reference view with inverse depth rho lies at the pixel A u + a rho (homogeneous) of a target view,
A = K R K^-1, a = K t with (R, t) = target_from_reference; on a plane rho is linear in u.
"""

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
                b = _sample(image, (m[0, 0] * x + m[0, 1] * y + m[0, 2] + s[0] * rho) / z, (m[1, 0] * x + m[1, 1] * y + m[1, 2] + s[1] * rho) / z)
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
def plane_equations(images, targets, homographies, shifts, pixels, basis, values, owners, face, owner_scale, plane, noise, hessian, gradient, stats):
    """Gauss-Newton equations of a plane over all targets, gain and bias of each target eliminated.

    As in `score_planes`; owners (V, h2, w2) int16 says which face is nearest at `owner_scale` times the resolution (a 1x1
    array switches it off); a pixel counts only where `face` or nothing is nearest. noise: floor of the residual's sigma, grey levels.
    Fills hessian (3, 3), gradient (3,) and stats (T, 3): ZNCC, share of pixels used, robust sigma of the residual.
    Returns the robust cost (sum of log-likelihood ratios, Cauchy) over all targets, and the number of pixels used.
    """
    n = pixels.shape[0]
    res = np.empty(n)
    dens = np.empty((n, 3))
    val = np.empty(n)
    ref = np.empty(n)
    w = np.empty(n)
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
            px = (m[0, 0] * x + m[0, 1] * y + m[0, 2] + s[0] * rho) / z
            py = (m[1, 0] * x + m[1, 1] * y + m[1, 2] + s[1] * rho) / z
            if px < 1.0 or py < 1.0 or px >= image.shape[1] - 2 or py >= image.shape[0] - 2:
                continue
            if masked:
                owner = owners[targets[t], int((py + 0.5) * owner_scale), int((px + 0.5) * owner_scale)]
                if owner != face and owner != -1:
                    continue
            b = _sample(image, px, py)
            gx = 0.5 * (_sample(image, px + 1.0, py) - _sample(image, px - 1.0, py))
            gy = 0.5 * (_sample(image, px, py + 1.0) - _sample(image, px, py - 1.0))
            # d pixel / d rho, then the image's slope along it
            slope = gx * (s[0] - px * s[2]) / z + gy * (s[1] - py * s[2]) / z
            val[count] = b
            ref[count] = values[i]
            for c in range(3):
                dens[count, c] = slope * basis[i, c]
            count += 1
        stats[t, 0] = -1.0
        stats[t, 1] = count / n
        stats[t, 2] = 0.0
        if count < 20 or 4 * count < n:
            continue
        w[:count] = 1.0
        gain, bias, sigma = 1.0, 0.0, noise
        for _ in range(4):
            sw = sa = sb = saa = sab = 0.0
            for i in range(count):
                sw += w[i]
                sa += w[i] * ref[i]
                sb += w[i] * val[i]
                saa += w[i] * ref[i] * ref[i]
                sab += w[i] * ref[i] * val[i]
            # a weak prior (gain 1 +- 0.5) keeps bare faces from having their texture scaled away
            va = saa - sa * sa / sw
            prior = 4.0 * sigma * sigma
            gain = (sab - sa * sb / sw + prior) / (va + prior)
            gain = min(max(gain, 0.3), 3.0)
            bias = (sb - gain * sa) / sw
            for i in range(count):
                res[i] = val[i] - gain * ref[i] - bias
            sigma = max(noise, 1.4826 * np.median(np.abs(res[:count])))
            for i in range(count):
                r = res[i] / (2.0 * sigma)
                w[i] = 1.0 / (1.0 + r * r)
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
        info = 1.0 / (sigma * sigma)
        # normal equations in (plane, gain, bias), the last two eliminated
        h = np.zeros((3, 3))
        g = np.zeros(3)
        cross = np.zeros((3, 2))
        c00 = saa + 4.0 * sigma * sigma
        c01 = sa
        c11 = sw
        e0 = e1 = 0.0
        for i in range(count):
            wi = w[i]
            for c in range(3):
                g[c] += wi * dens[i, c] * res[i]
                cross[c, 0] -= wi * dens[i, c] * ref[i]
                cross[c, 1] -= wi * dens[i, c]
                for d in range(c + 1):
                    h[c, d] += wi * dens[i, c] * dens[i, d]
            e0 -= wi * ref[i] * res[i]
            e1 -= wi * res[i]
            q = res[i] / (2.0 * sigma)
            cost += 2.0 * np.log(1.0 + q * q) + np.log(sigma)
        det = c00 * c11 - c01 * c01
        if det <= 1e-12:
            continue
        i00, i01, i11 = c11 / det, -c01 / det, c00 / det
        for c in range(3):
            k0 = cross[c, 0] * i00 + cross[c, 1] * i01
            k1 = cross[c, 0] * i01 + cross[c, 1] * i11
            gradient[c] += info * (g[c] - k0 * e0 - k1 * e1)
            for d in range(c + 1):
                hessian[c, d] += info * (h[c, d] - k0 * cross[d, 0] - k1 * cross[d, 1])
        used += count
    for c in range(3):
        for d in range(c):
            hessian[d, c] = hessian[c, d]
    return cost, used
