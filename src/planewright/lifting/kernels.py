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
def plane_equations(images, targets, homographies, shifts, pixels, basis, values, owners, face, owner_scale, plane, noise, hessian, gradient, stats):
    """Gauss-Newton equations of a plane over all targets; a gain and a bias that may slope over the face are eliminated for each target.

    The slope matters on bare faces: light that changes smoothly over a face would else pass for parallax (2.5 degrees on a small plain gable).

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
    place = np.empty((n, 2))
    shade = np.empty(4)
    model = np.empty(4)
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
            b = bilinear(image, px, py)
            gx = 0.5 * (bilinear(image, px + 1.0, py) - bilinear(image, px - 1.0, py))
            gy = 0.5 * (bilinear(image, px, py + 1.0) - bilinear(image, px, py - 1.0))
            # d pixel / d rho, then the image's slope along it
            slope = gx * (s[0] - px * s[2]) / z + gy * (s[1] - py * s[2]) / z
            val[count] = b
            ref[count] = values[i]
            for c in range(3):
                dens[count, c] = slope * basis[i, c]
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
        model[:] = 0.0
        model[0] = 1.0
        for _ in range(4):
            c4 = np.zeros((4, 4))
            e4 = np.zeros(4)
            # a weak prior (gain 1 +- 0.5) keeps bare faces from having their texture scaled away
            c4[0, 0] = 4.0 * sigma * sigma
            e4[0] = 4.0 * sigma * sigma
            for i in range(count):
                shade[0] = ref[i]
                shade[1] = 1.0
                shade[2] = place[i, 0]
                shade[3] = place[i, 1]
                for c in range(4):
                    e4[c] += w[i] * shade[c] * val[i]
                    for d in range(4):
                        c4[c, d] += w[i] * shade[c] * shade[d]
            for c in range(4):
                c4[c, c] += 1e-9 * (c4[c, c] + 1.0)
            model[:] = np.linalg.solve(c4, e4)
            for i in range(count):
                res[i] = val[i] - model[0] * ref[i] - model[1] - model[2] * place[i, 0] - model[3] * place[i, 1]
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
        # normal equations in (plane, shading), the shading eliminated
        info = 1.0 / (sigma * sigma)
        h = np.zeros((3, 3))
        g = np.zeros(3)
        cross = np.zeros((3, 4))
        c4 = np.zeros((4, 4))
        e4 = np.zeros(4)
        c4[0, 0] = 4.0 * sigma * sigma
        for i in range(count):
            wi = w[i]
            shade[0] = -ref[i]
            shade[1] = -1.0
            shade[2] = -place[i, 0]
            shade[3] = -place[i, 1]
            for c in range(3):
                g[c] += wi * dens[i, c] * res[i]
                for d in range(4):
                    cross[c, d] += wi * dens[i, c] * shade[d]
                for d in range(c + 1):
                    h[c, d] += wi * dens[i, c] * dens[i, d]
            for c in range(4):
                e4[c] += wi * shade[c] * res[i]
                for d in range(4):
                    c4[c, d] += wi * shade[c] * shade[d]
            q = res[i] / (2.0 * sigma)
            cost += 2.0 * np.log(1.0 + q * q) + np.log(sigma)
        for c in range(4):
            c4[c, c] += 1e-9 * (c4[c, c] + 1.0)
        solved = np.linalg.solve(c4, cross.T)
        for c in range(3):
            for d in range(4):
                g[c] -= solved[d, c] * e4[d]
            gradient[c] += info * g[c]
            for d in range(c + 1):
                low = h[c, d]
                for k in range(4):
                    low -= cross[c, k] * solved[k, d]
                hessian[c, d] += info * low
        used += count
    for c in range(3):
        for d in range(c):
            hessian[d, c] = hessian[c, d]
    return cost, used
