# pyright: basic
"""Numba kernels of the camera solve. Poses map world to camera; a step (omega, v) makes x_cam -> exp(omega) x_cam + v."""

from typing import no_type_check

import numpy as np
from numba import njit

# `no_type_check` keeps the shape checker of the tests from wrapping a kernel before Numba sees it.

SHARED = 4
"""Unknowns that all observations share: log focal, k1, k2, readout. Those of the cameras, six each, follow."""


@njit(cache=True, nogil=True)
@no_type_check
def rotation_of(w0, w1, w2):
    """exp of a rotation vector: (3, 3)."""
    a2 = w0 * w0 + w1 * w1 + w2 * w2
    if a2 < 1e-8:
        a, b = 1.0 - a2 / 6.0, 0.5 - a2 / 24.0
    else:
        angle = np.sqrt(a2)
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / a2
    r = np.empty((3, 3))
    r[0, 0] = 1.0 - b * (w1 * w1 + w2 * w2)
    r[1, 1] = 1.0 - b * (w0 * w0 + w2 * w2)
    r[2, 2] = 1.0 - b * (w0 * w0 + w1 * w1)
    r[0, 1], r[1, 0] = b * w0 * w1 - a * w2, b * w0 * w1 + a * w2
    r[0, 2], r[2, 0] = b * w0 * w2 + a * w1, b * w0 * w2 - a * w1
    r[1, 2], r[2, 1] = b * w1 * w2 - a * w0, b * w1 * w2 + a * w0
    return r


@njit(cache=True, nogil=True)
@no_type_check
def robust_cost(intrinsics, rotation, translation, xyz, camera, point, xy, scale, residual):
    """Sum of Cauchy costs, in pixels squared: scale^2 / 2 log(1 + r^2 / scale^2); fills `residual` (obs, 2).

    A point behind its camera counts as 1e3 pixels off, so that a step through the camera never looks cheap.

    Args:
        intrinsics: (5,) focal, cx, cy, k1, k2. rotation: (cameras, 3, 3). translation: (cameras, 3). xyz: (points, 3).
        camera, point: (obs,) rows. xy: (obs, 2).
    """
    f, cx, cy, k1, k2 = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3], intrinsics[4]
    total = 0.0
    s2 = scale * scale
    for i in range(camera.shape[0]):
        c, p = camera[i], point[i]
        X, Y, Z = xyz[p, 0], xyz[p, 1], xyz[p, 2]
        x = rotation[c, 0, 0] * X + rotation[c, 0, 1] * Y + rotation[c, 0, 2] * Z + translation[c, 0]
        y = rotation[c, 1, 0] * X + rotation[c, 1, 1] * Y + rotation[c, 1, 2] * Z + translation[c, 1]
        z = rotation[c, 2, 0] * X + rotation[c, 2, 1] * Y + rotation[c, 2, 2] * Z + translation[c, 2]
        if z > 1e-9:
            u, v = x / z, y / z
            r2 = u * u + v * v
            d = 1.0 + r2 * (k1 + r2 * k2)
            rx, ry = f * d * u + cx - xy[i, 0], f * d * v + cy - xy[i, 1]
        else:
            rx, ry = 1e3, 1e3
        residual[i, 0], residual[i, 1] = rx, ry
        total += 0.5 * s2 * np.log1p((rx * rx + ry * ry) / s2)
    return total


@njit(cache=True, nogil=True)
@no_type_check
def observation_jacobian(intrinsics, rotation, translation, xyz, jc, jp):
    """Derivatives of one projection: jc (2, 10) for log focal, k1, k2, readout, omega, v; jp (2, 3) for the point. Returns u, v pixels and depth.

    The readout does not move a projection but the observation that it is compared with; its column is left as it is.
    """
    f, cx, cy, k1, k2 = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3], intrinsics[4]
    X, Y, Z = xyz[0], xyz[1], xyz[2]
    x0 = rotation[0, 0] * X + rotation[0, 1] * Y + rotation[0, 2] * Z
    y0 = rotation[1, 0] * X + rotation[1, 1] * Y + rotation[1, 2] * Z
    z0 = rotation[2, 0] * X + rotation[2, 1] * Y + rotation[2, 2] * Z
    x, y, z = x0 + translation[0], y0 + translation[1], z0 + translation[2]
    if z <= 1e-9:
        return 0.0, 0.0, z
    u, v = x / z, y / z
    r2 = u * u + v * v
    d = 1.0 + r2 * (k1 + r2 * k2)
    e = 2.0 * (k1 + 2.0 * r2 * k2)
    # d(pixel) / d(u, v), symmetric.
    a, b, c = f * (d + e * u * u), f * e * u * v, f * (d + e * v * v)
    # The derivative by x_cam, in scalars: an array here would be made anew for each of millions of calls.
    q00, q01, q02 = a / z, b / z, -(a * u + b * v) / z
    q10, q11, q12 = b / z, c / z, -(b * u + c * v) / z
    jc[0, 0], jc[1, 0] = f * d * u, f * d * v
    jc[0, 1], jc[1, 1] = f * r2 * u, f * r2 * v
    jc[0, 2], jc[1, 2] = f * r2 * r2 * u, f * r2 * r2 * v
    # d(x_cam) = omega x x_cam + v, and x_cam holds the translation too.
    jc[0, 4], jc[0, 5], jc[0, 6] = q02 * y - q01 * z, q00 * z - q02 * x, q01 * x - q00 * y
    jc[1, 4], jc[1, 5], jc[1, 6] = q12 * y - q11 * z, q10 * z - q12 * x, q11 * x - q10 * y
    jc[0, 7], jc[0, 8], jc[0, 9] = q00, q01, q02
    jc[1, 7], jc[1, 8], jc[1, 9] = q10, q11, q12
    for m in range(3):
        jp[0, m] = q00 * rotation[0, m] + q01 * rotation[1, m] + q02 * rotation[2, m]
        jp[1, m] = q10 * rotation[0, m] + q11 * rotation[1, m] + q12 * rotation[2, m]
    return f * d * u + cx, f * d * v + cy, z


@njit(cache=True, nogil=True)
@no_type_check
def reduced_system(intrinsics, rotation, translation, xyz, first, camera, xy, drift, scale, damping, system, gradient, cross, inverse, point_gradient):
    """Normal equations with the points eliminated (Triggs et al. 2000, section 6): system (n, n) and gradient (n,), n = SHARED + 6 cameras.

    Args:
        first: (points + 1,) where each point's observations begin; camera, xy: observations sorted by point, then camera.
        drift: (obs, 2) how an observation moves with the readout, pixels; none (0, 2) where the readout is not an unknown.
        damping: Marquardt's factor on the points' diagonals (the caller damps the cameras).
        cross: (obs, 10, 3) and inverse: (points, 3, 3), point_gradient: (points, 3): kept for the back-substitution.
    """
    n_points = first.shape[0] - 1
    s2 = scale * scale
    rolls = drift.shape[0] > 0
    jc, jp = np.zeros((2, 10)), np.empty((2, 3))
    longest = 0
    for p in range(n_points):
        longest = max(longest, first[p + 1] - first[p])
    reduced = np.empty((longest, 10, 3))
    v, shared, turned = np.empty((3, 3)), np.empty((4, 3)), np.empty((3, 6 * longest))
    system[:] = 0.0
    gradient[:] = 0.0
    for p in range(n_points):
        v[:] = 0.0
        g0, g1, g2 = 0.0, 0.0, 0.0
        for i in range(first[p], first[p + 1]):
            c = camera[i]
            px, py, z = observation_jacobian(intrinsics, rotation[c], translation[c], xyz[p], jc, jp)
            if z <= 1e-9:
                cross[i] = 0.0
                continue
            if rolls:
                jc[0, 3], jc[1, 3] = -drift[i, 0], -drift[i, 1]
            rx, ry = px - xy[i, 0], py - xy[i, 1]
            w = 1.0 / (1.0 + (rx * rx + ry * ry) / s2)
            for a in range(3):
                for b in range(3):
                    v[a, b] += w * (jp[0, a] * jp[0, b] + jp[1, a] * jp[1, b])
            g0 += w * (jp[0, 0] * rx + jp[1, 0] * ry)
            g1 += w * (jp[0, 1] * rx + jp[1, 1] * ry)
            g2 += w * (jp[0, 2] * rx + jp[1, 2] * ry)
            base = 6 * c
            for a in range(10):
                row = a if a < 4 else base + a
                gradient[row] += w * (jc[0, a] * rx + jc[1, a] * ry)
                line = system[row]
                for b in range(a, 4):
                    line[b] += w * (jc[0, a] * jc[0, b] + jc[1, a] * jc[1, b])
                own = line[base + 4 : base + 10]
                for b in range(max(a - 4, 0), 6):
                    own[b] += w * (jc[0, a] * jc[0, b + 4] + jc[1, a] * jc[1, b + 4])
                for b in range(3):
                    cross[i, a, b] = w * (jc[0, a] * jp[0, b] + jc[1, a] * jp[1, b])
        for a in range(3):
            v[a, a] *= 1.0 + damping
            v[a, a] += 1e-12
        # Inverse of a symmetric 3 x 3 by cofactors.
        c00, c01, c02 = v[1, 1] * v[2, 2] - v[1, 2] * v[1, 2], v[0, 2] * v[1, 2] - v[0, 1] * v[2, 2], v[0, 1] * v[1, 2] - v[0, 2] * v[1, 1]
        det = v[0, 0] * c00 + v[0, 1] * c01 + v[0, 2] * c02
        if det > 1e-300:
            inverse[p, 0, 0], inverse[p, 0, 1], inverse[p, 0, 2] = c00 / det, c01 / det, c02 / det
            inverse[p, 1, 1] = (v[0, 0] * v[2, 2] - v[0, 2] * v[0, 2]) / det
            inverse[p, 1, 2] = (v[0, 1] * v[0, 2] - v[0, 0] * v[1, 2]) / det
            inverse[p, 2, 2] = (v[0, 0] * v[1, 1] - v[0, 1] * v[0, 1]) / det
            inverse[p, 1, 0], inverse[p, 2, 0], inverse[p, 2, 1] = inverse[p, 0, 1], inverse[p, 0, 2], inverse[p, 1, 2]
        else:
            inverse[p] = 0.0
        point_gradient[p, 0], point_gradient[p, 1], point_gradient[p, 2] = g0, g1, g2
        start = first[p]
        count = first[p + 1] - start
        for i in range(count):
            for a in range(10):
                for b in range(3):
                    reduced[i, a, b] = (
                        cross[start + i, a, 0] * inverse[p, 0, b] + cross[start + i, a, 1] * inverse[p, 1, b] + cross[start + i, a, 2] * inverse[p, 2, b]
                    )
        # The intrinsics are seen by every observation: their rows are summed over the point first, which leaves one product an observation.
        shared[:] = 0.0
        for i in range(count):
            ci = 6 * camera[start + i]
            for a in range(10):
                row = a if a < 4 else ci + a
                gradient[row] -= reduced[i, a, 0] * g0 + reduced[i, a, 1] * g1 + reduced[i, a, 2] * g2
            for a in range(4):
                for b in range(3):
                    shared[a, b] += reduced[i, a, b]
        for j in range(count):
            cj = 6 * camera[start + j]
            mine = cross[start + j]
            for a in range(4):
                h0, h1, h2 = shared[a, 0], shared[a, 1], shared[a, 2]
                own = system[a, cj + 4 : cj + 10]
                for b in range(4):
                    system[a, b] -= h0 * mine[b, 0] + h1 * mine[b, 1] + h2 * mine[b, 2]
                for b in range(6):
                    own[b] -= h0 * mine[b + 4, 0] + h1 * mine[b + 4, 1] + h2 * mine[b + 4, 2]
        # Cameras that follow on each other have columns that do: a row is one long sum then, which runs in the vector units. This is most of a camera solve.
        for i in range(count):
            for k in range(3):
                for b in range(6):
                    turned[k, 6 * i + b] = cross[start + i, b + 4, k]
        for i in range(count):
            j = i
            while j < count:
                stop = j + 1
                while stop < count and camera[start + stop] == camera[start + stop - 1] + 1:
                    stop += 1
                x0, x1, x2 = turned[0, 6 * j : 6 * stop], turned[1, 6 * j : 6 * stop], turned[2, 6 * j : 6 * stop]
                first_row, first_column = 6 * camera[start + i] + 4, 6 * camera[start + j] + 4
                for a in range(6):
                    r0, r1, r2 = reduced[i, a + 4, 0], reduced[i, a + 4, 1], reduced[i, a + 4, 2]
                    row = system[first_row + a, first_column : first_column + 6 * (stop - j)]
                    for b in range(6 * (stop - j)):
                        row[b] -= r0 * x0[b] + r1 * x1[b] + r2 * x2[b]
                j = stop
    for a in range(system.shape[0]):
        for b in range(a):
            system[a, b] = system[b, a]


@njit(cache=True, nogil=True)
@no_type_check
def observation_pulls(intrinsics, rotation, translation, xyz, first, camera, xy, scale, direction, cross, inverse, pulls):
    """How much each observation pulls the unknowns along `direction` (n,) at the optimum, its point free to follow: fills `pulls` (obs,).

    `cross` and `inverse` as `reduced_system` leaves them without damping. The pulls sum to `direction . gradient`, which is zero.
    """
    jc, jp = np.zeros((2, 10)), np.empty((2, 3))
    moved, q = np.empty(3), np.empty(3)
    for p in range(first.shape[0] - 1):
        moved[:] = 0.0
        for i in range(first[p], first[p + 1]):
            for a in range(10):
                d = direction[a] if a < 4 else direction[6 * camera[i] + a]
                for b in range(3):
                    moved[b] += cross[i, a, b] * d
        for a in range(3):
            q[a] = inverse[p, a, 0] * moved[0] + inverse[p, a, 1] * moved[1] + inverse[p, a, 2] * moved[2]
        for i in range(first[p], first[p + 1]):
            c = camera[i]
            px, py, z = observation_jacobian(intrinsics, rotation[c], translation[c], xyz[p], jc, jp)
            pulls[i] = 0.0
            if z <= 1e-9:
                continue
            rx, ry = px - xy[i, 0], py - xy[i, 1]
            w = 1.0 / (1.0 + (rx * rx + ry * ry) / (scale * scale))
            for a in range(10):
                d = direction[a] if a < 4 else direction[6 * c + a]
                pulls[i] += w * d * (jc[0, a] * rx + jc[1, a] * ry)
            for b in range(3):
                pulls[i] -= w * q[b] * (jp[0, b] * rx + jp[1, b] * ry)


@njit(cache=True, nogil=True)
@no_type_check
def solve_spd(a, b, n):
    """Solve a x = b in place for a small symmetric positive definite a (n, n) by Cholesky; b (n,) becomes x. False where a is not positive."""
    for i in range(n):
        for j in range(i + 1):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            if i == j:
                if s <= 1e-300:
                    return False
                a[i, i] = np.sqrt(s)
            else:
                a[i, j] = s / a[j, j]
    for i in range(n):
        s = b[i]
        for k in range(i):
            s -= a[i, k] * b[k]
        b[i] = s / a[i, i]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= a[k, i] * b[k]
        b[i] = s / a[i, i]
    return True


@njit(cache=True, nogil=True)
@no_type_check
def adapted(damping, better):
    """Marquardt's factor after a step that made the cost better, or did not."""
    return max(damping / 5.0, 1e-9) if better else damping * 8.0


@njit(cache=True, nogil=True)
@no_type_check
def damped_step(h, g, damping, work, step, n):
    """The step (n,) of Levenberg and Marquardt for a Hessian h (n, n) and a gradient g (n,); work (n, n) is overwritten. False as `solve_spd`."""
    work[:] = h
    for k in range(n):
        work[k, k] = work[k, k] * (1.0 + damping) + 1e-12
        step[k] = -g[k]
    return solve_spd(work, step, n)


@njit(cache=True, nogil=True)
@no_type_check
def resect_pose(intrinsics, rotation, translation, xyz, xy, scale, iterations):
    """Levenberg-Marquardt on one pose (3, 3), (3,), in place, over points xyz (n, 3) seen at xy (n, 2), Cauchy cost. Returns the cost."""
    n = xyz.shape[0]
    s2 = scale * scale
    jc, jp = np.zeros((2, 10)), np.empty((2, 3))
    h, g, b, d = np.empty((6, 6)), np.empty(6), np.empty((6, 6)), np.empty(6)
    kept_h, kept_g = np.zeros((6, 6)), np.zeros(6)
    r, t = rotation.copy(), translation.copy()
    damping = 1e-4
    cost = -1.0
    for _ in range(iterations):
        h[:] = 0.0
        g[:] = 0.0
        fresh = 0.0
        for i in range(n):
            px, py, z = observation_jacobian(intrinsics, r, t, xyz[i], jc, jp)
            if z <= 1e-9:
                fresh += 0.5 * s2 * np.log1p(2e6 / s2)
                continue
            rx, ry = px - xy[i, 0], py - xy[i, 1]
            e = rx * rx + ry * ry
            fresh += 0.5 * s2 * np.log1p(e / s2)
            w = 1.0 / (1.0 + e / s2)
            for k in range(6):
                g[k] += w * (jc[0, 4 + k] * rx + jc[1, 4 + k] * ry)
                for m in range(k + 1):
                    h[k, m] += w * (jc[0, 4 + k] * jc[0, 4 + m] + jc[1, 4 + k] * jc[1, 4 + m])
        if cost < 0.0 or fresh < cost:
            small = cost >= 0.0 and cost - fresh < 1e-8 * cost
            cost = fresh
            rotation[:] = r
            translation[:] = t
            kept_h[:] = h
            kept_g[:] = g
            damping = adapted(damping, True)
            if small:
                break
        else:
            damping = adapted(damping, False)
            if damping > 1e6:
                break
        if not damped_step(kept_h, kept_g, damping, b, d, 6):
            damping = adapted(damping, False)
            continue
        step = rotation_of(d[0], d[1], d[2])
        r = step @ rotation
        t = step @ translation + d[3:]
    return cost


@njit(cache=True, nogil=True)
@no_type_check
def triangulate_points(intrinsics, rotation, translation, first, camera, xy, rays, scale, iterations, xyz, covariance, quality):
    """Each point on its own: rays' nearest point, then Gauss-Newton on the Cauchy cost.

    Args:
        first: (points + 1,); camera: (obs,) rows of the poses; xy: (obs, 2); rays: (obs, 2) undistorted normalized coordinates.
        xyz: (points, 3) overwritten; a finite row is taken as the start. covariance: (points, 3, 3) for one pixel of noise, overwritten.
        quality: (points, 3) overwritten: root mean square residual in pixels (Cauchy-weighted), largest angle between rays in radians, smallest depth.
    """
    s2 = scale * scale
    jc, jp = np.zeros((2, 10)), np.empty((2, 3))
    h, g, b3, x = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    for p in range(first.shape[0] - 1):
        start, stop = first[p], first[p + 1]
        directions = np.empty((stop - start, 3))
        h[:] = 0.0
        g[:] = 0.0
        for i in range(start, stop):
            c = camera[i]
            norm = np.sqrt(rays[i, 0] ** 2 + rays[i, 1] ** 2 + 1.0)
            for a in range(3):
                directions[i - start, a] = (rotation[c, 0, a] * rays[i, 0] + rotation[c, 1, a] * rays[i, 1] + rotation[c, 2, a]) / norm
            d = directions[i - start]
            for a in range(3):
                centre_dot = 0.0
                for b in range(3):
                    m = (1.0 if a == b else 0.0) - d[a] * d[b]
                    h[a, b] += m
                    o = -(rotation[c, 0, b] * translation[c, 0] + rotation[c, 1, b] * translation[c, 1] + rotation[c, 2, b] * translation[c, 2])
                    centre_dot += m * o
                g[a] += centre_dot
        widest = 1.0
        for i in range(stop - start):
            dot = directions[0, 0] * directions[i, 0] + directions[0, 1] * directions[i, 1] + directions[0, 2] * directions[i, 2]
            widest = min(widest, dot)
        # The first ray against the others, and the farthest of those against all: within a factor of two of the true widest pair, mostly equal to it.
        far = 0
        for i in range(stop - start):
            dot = directions[0, 0] * directions[i, 0] + directions[0, 1] * directions[i, 1] + directions[0, 2] * directions[i, 2]
            if dot <= widest:
                far = i
        for i in range(stop - start):
            dot = directions[far, 0] * directions[i, 0] + directions[far, 1] * directions[i, 1] + directions[far, 2] * directions[i, 2]
            widest = min(widest, dot)
        quality[p, 1] = np.arccos(max(min(widest, 1.0), -1.0))
        if not np.isfinite(xyz[p, 0]):
            for a in range(3):
                h[a, a] += 1e-12
                x[a] = g[a]
            if not solve_spd(h, x, 3):
                quality[p, 0], quality[p, 2] = 1e3, -1.0
                covariance[p] = 0.0
                continue
            xyz[p] = x
        cost = -1.0
        damping = 1e-6
        x[:] = xyz[p]
        kept_h, kept_g = np.zeros((3, 3)), np.zeros(3)
        for _ in range(iterations):
            h[:] = 0.0
            g[:] = 0.0
            fresh, weighted, weights = 0.0, 0.0, 0.0
            nearest = 1e300
            for i in range(start, stop):
                c = camera[i]
                px, py, z = observation_jacobian(intrinsics, rotation[c], translation[c], x, jc, jp)
                nearest = min(nearest, z)
                if z <= 1e-9:
                    fresh += 0.5 * s2 * np.log1p(2e6 / s2)
                    continue
                rx, ry = px - xy[i, 0], py - xy[i, 1]
                e = rx * rx + ry * ry
                w = 1.0 / (1.0 + e / s2)
                fresh += 0.5 * s2 * np.log1p(e / s2)
                weighted += w * e
                weights += w
                for a in range(3):
                    g[a] += w * (jp[0, a] * rx + jp[1, a] * ry)
                    for b in range(3):
                        h[a, b] += w * (jp[0, a] * jp[0, b] + jp[1, a] * jp[1, b])
            if cost < 0.0 or fresh < cost:
                small = cost >= 0.0 and cost - fresh < 1e-8 * cost
                cost = fresh
                xyz[p] = x
                kept_h[:] = h
                kept_g[:] = g
                quality[p, 0] = np.sqrt(weighted / max(weights, 1e-12))
                quality[p, 2] = nearest
                damping = adapted(damping, True)
                if small:
                    break
            else:
                damping = adapted(damping, False)
                if damping > 1e6:
                    break
            if not damped_step(kept_h, kept_g, damping, b3, x, 3):
                break
            for a in range(3):
                x[a] += xyz[p, a]
        for a in range(3):
            b3[:] = kept_h
            for b in range(3):
                b3[b, b] += 1e-12
                x[b] = 1.0 if a == b else 0.0
            if solve_spd(b3, x, 3):
                covariance[p, a] = x
            else:
                covariance[p, a] = 0.0
