# pyright: basic
"""Numba kernel of face registration: one face to one pyramid level of one frame."""

from typing import no_type_check

import numpy as np
from numba import njit

# `no_type_check` keeps the shape checker of the tests from wrapping a kernel before Numba sees it.


@njit(cache=True, nogil=True)
@no_type_check
def align_face(image, q, values, steepest, h, deviation, prior, floor, independent, iterations, tolerance, weights, information, figures):
    """Register a face to `image`, in place: inverse-compositional Gauss-Newton on 8 homography and 4 light parameters, with a Gaussian prior.

    Light: a gain, a bias, and a slope of the bias across the face, for bare faces show hardly more than shading, which does not move with them.

    Baker and Matthews, "Lucas-Kanade 20 years on" (2004), section 3.2; Tukey weights about the median absolute deviation. The warp is
    W(d) q = ((1 + d0) x + d1 y + d2, d3 x + (1 + d4) y + d5) / (1 + d6 x + d7 y), and h <- h W(d)^-1.

    Args:
        image: (height, width) float32.
        q: (n, 2) face coordinates of the template's pixels. values: (n,) float32 grey values there. steepest: (n, 8) float32, the derivative of a
            template pixel by the warp's parameters.
        h: (3, 3) face coordinates -> pixels of `image` with centres at integers; a start, overwritten.
        deviation: (8,) how far h is from where the prior has its mean, to first order; overwritten. prior: (8, 8) its information.
        floor: smallest standard deviation of a grey value. independent: pixels that count as one, because smoothing and the lens correlate them.
        tolerance: pixels of motion below which the iteration ends.
        weights: (n,) overwritten with Tukey weights, -1 outside the image. information: (8, 8) overwritten with that of the pixels alone, light
            eliminated. figures: (6,) overwritten with weighted correlation, mean weight inside, share inside, sigma of a grey value, gain, bias.

    Returns whether the iteration stayed within reason.
    """
    rows, columns = image.shape
    n = q.shape[0]
    got = np.empty(n)
    size = np.empty(n)
    normal = np.empty((12, 12))
    right = np.empty(12)
    column = np.empty(12)
    light = np.array([1.0, 0.0, 0.0, 0.0])
    shade, shaded = np.empty((4, 4)), np.empty(4)
    sigma = 1e9
    done = False
    for iteration in range(iterations + 1):
        inside = 0
        sv, st = 0.0, 0.0
        for k in range(n):
            x, y = q[k, 0], q[k, 1]
            z = h[2, 0] * x + h[2, 1] * y + h[2, 2]
            weights[k] = -1.0
            if z <= 1e-6:
                continue
            u = (h[0, 0] * x + h[0, 1] * y + h[0, 2]) / z
            v = (h[1, 0] * x + h[1, 1] * y + h[1, 2]) / z
            if not (u >= 0.0 and v >= 0.0 and u < columns - 1 and v < rows - 1):
                continue
            i, j = int(v), int(u)
            fx, fy = u - j, v - i
            top = image[i, j] * (1.0 - fx) + image[i, j + 1] * fx
            low = image[i + 1, j] * (1.0 - fx) + image[i + 1, j + 1] * fx
            got[k] = top * (1.0 - fy) + low * fy
            weights[k] = 1.0
            sv += got[k]
            st += values[k]
            inside += 1
        figures[2] = inside / n
        if inside < 24 or inside < 0.25 * n:
            return False
        if iteration == 0:
            light[1] = sv / inside - st / inside
        # The light first, by weighted regression from the last residuals: they are linear, and the geometry's step is the better for it.
        for _again in range(2):
            m = 0
            for k in range(n):
                if weights[k] >= 0.0:
                    size[m] = abs(got[k] - light[0] * values[k] - light[1] - light[2] * q[k, 0] - light[3] * q[k, 1])
                    m += 1
            sigma = max(1.4826 * np.median(size[:m]), floor)
            limit = 4.685 * sigma
            sw, sv, st, stt, svv, stv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            shade[:] = 0.0
            shaded[:] = 0.0
            for k in range(n):
                if weights[k] < 0.0:
                    continue
                r = (got[k] - light[0] * values[k] - light[1] - light[2] * q[k, 0] - light[3] * q[k, 1]) / limit
                w = 0.0
                if abs(r) < 1.0:
                    w = (1.0 - r * r) ** 2
                weights[k] = w
                sw += w
                sv += w * got[k]
                st += w * values[k]
                stt += w * values[k] * values[k]
                svv += w * got[k] * got[k]
                stv += w * values[k] * got[k]
                column[8], column[9], column[10], column[11] = values[k], 1.0, q[k, 0], q[k, 1]
                for a in range(4):
                    shaded[a] += w * column[8 + a] * got[k]
                    for b in range(4):
                        shade[a, b] += w * column[8 + a] * column[8 + b]
            if sw < 8.0:
                return False
            mv, mt = sv / sw, st / sw
            vt, vv, cov = max(stt / sw - mt * mt, 0.0), max(svv / sw - mv * mv, 0.0), stv / sw - mv * mt
            # A face without contrast has a gain of one; a slope of the light takes more than a fraction of a grey level.
            ridge = floor * floor * sw
            shade[0, 0] += ridge
            shaded[0] += ridge
            shade[2, 2] += 0.01 * sw
            shade[3, 3] += 0.01 * sw
            shade[1, 1] += 1e-9
            light = np.linalg.solve(shade, shaded)
            if not (light[0] > 0.3 and light[0] < 3.0):
                light[0] = min(max(light[0], 0.3), 3.0)
                light[1], light[2], light[3] = mv - light[0] * mt, 0.0, 0.0
            figures[0] = cov / np.sqrt(max(vt * vv, 1e-12))
            figures[1] = sw / inside
        figures[3], figures[4], figures[5] = sigma, light[0], light[1]
        scale = 1.0 / (sigma * sigma * independent)
        for a in range(12):
            right[a] = 0.0
            for b in range(12):
                normal[a, b] = 0.0
        for k in range(n):
            if weights[k] <= 0.0:
                continue
            w = weights[k] * scale
            for a in range(8):
                column[a] = light[0] * steepest[k, a]
            column[8], column[9], column[10], column[11] = values[k], 1.0, q[k, 0], q[k, 1]
            r = w * (got[k] - light[0] * values[k] - light[1] - light[2] * q[k, 0] - light[3] * q[k, 1])
            for a in range(12):
                right[a] += column[a] * r
                c = w * column[a]
                for b in range(a, 12):
                    normal[a, b] += c * column[b]
        for a in range(12):
            for b in range(a):
                normal[a, b] = normal[b, a]
        # Schur complement of the light.
        for a in range(4):
            normal[8 + a, 8 + a] = normal[8 + a, 8 + a] * (1.0 + 1e-6) + 1e-9
        taken = np.linalg.solve(normal[8:, 8:].copy(), normal[8:, :8].copy())
        step = np.empty(8)
        left = np.empty((8, 8))
        for a in range(8):
            step[a] = right[a]
            for c in range(4):
                step[a] -= taken[c, a] * right[8 + c]
            for b in range(8):
                information[a, b] = normal[a, b]
                for c in range(4):
                    information[a, b] -= normal[a, 8 + c] * taken[c, b]
                left[a, b] = information[a, b] + prior[a, b]
                step[a] += prior[a, b] * deviation[b]
            left[a, a] = left[a, a] * (1.0 + 1e-9) + 1e-12
        if done or iteration == iterations:
            return True
        step = np.linalg.solve(left, step)
        warp = np.array([[1.0 + step[0], step[1], step[2]], [step[3], 1.0 + step[4], step[5]], [step[6], step[7], 1.0]])
        det = warp[0, 0] * warp[1, 1] - warp[0, 1] * warp[1, 0]
        if not (det > 0.2 and det < 5.0 and abs(step[6]) < 0.5 and abs(step[7]) < 0.5):
            return False
        moved = h @ np.linalg.inv(warp)
        if not moved[2, 2] > 1e-9:
            return False
        for a in range(3):
            for b in range(3):
                h[a, b] = moved[a, b] / moved[2, 2]
        most = 0.0
        for a in range(8):
            deviation[a] -= step[a]
            most = max(most, abs(step[a]))
        area = abs((h[0, 0] - h[0, 2] * h[2, 0]) * (h[1, 1] - h[1, 2] * h[2, 1]) - (h[0, 1] - h[0, 2] * h[2, 1]) * (h[1, 0] - h[1, 2] * h[2, 0]))
        done = most * np.sqrt(area) < tolerance
    return True


@njit(cache=True, nogil=True)
@no_type_check
def find_lines(image, ends, radius, spacing, least, out):
    """Straight lines near predicted edges of one frame.

    Args:
        image: (height, width) float32. ends: (edges, 4) end points x0, y0, x1, y1, pixels with centres at integers.
        radius: pixels looked at to both sides. spacing: pixels between samples along an edge. least: weakest step, grey levels over one pixel.
        out: (edges, 4) overwritten with the offsets at the two ends along (-dy, dx) / length, the standard deviation of a sample about the line, and
            the share of the samples in the image that lie on it (0 where there is no line).

    Each sample votes for the steepest place across the edge, nearer ones before slightly steeper ones; Cauchy weights (0.5 px) about the line.
    """
    rows, columns = image.shape
    half = int(2 * radius)
    width = 2 * half + 3
    profile = np.empty(width)
    t, d, w = np.empty(64), np.empty(64), np.empty(64)
    for e in range(ends.shape[0]):
        out[e, 0], out[e, 1], out[e, 2], out[e, 3] = 0.0, 0.0, 0.0, 0.0
        x0, y0 = ends[e, 0], ends[e, 1]
        dx, dy = ends[e, 2] - x0, ends[e, 3] - y0
        length = np.hypot(dx, dy)
        if not (length > 10.0 and length < 1e4):
            continue
        nx, ny = -dy / length, dx / length
        count = min(max(int(length / spacing), 5), 64)
        n, looked = 0, 0
        for s in range(count):
            u = 0.04 + 0.92 * (s + 0.5) / count
            whole = True
            for j in range(width):
                o = 0.5 * (j - 1 - half)
                x, y = x0 + u * dx + o * nx, y0 + u * dy + o * ny
                if not (x >= 0.0 and y >= 0.0 and x < columns - 1 and y < rows - 1):
                    whole = False
                    break
                r, c = int(y), int(x)
                fx, fy = x - c, y - r
                top = image[r, c] * (1.0 - fx) + image[r, c + 1] * fx
                low = image[r + 1, c] * (1.0 - fx) + image[r + 1, c + 1] * fx
                profile[j] = top * (1.0 - fy) + low * fy
            if not whole:
                continue
            looked += 1
            best, at = least, -1
            for j in range(1, width - 1):
                o = 0.5 * (j - 1 - half) / radius
                g = abs(profile[j + 1] - profile[j - 1]) / (1.0 + o * o)
                if g > best:
                    best, at = g, j
            if at < 0:
                continue
            # The top of the bell through three differences a pixel apart: exact where the step is one of a Gaussian.
            shift = 0.0
            if at > 2 and at < width - 3:
                a, b, c = abs(profile[at - 1] - profile[at - 3]), abs(profile[at + 1] - profile[at - 1]), abs(profile[at + 3] - profile[at + 1])
                if a > 0.1 and c > 0.1:
                    a, b, c = np.log(a), np.log(b), np.log(c)
                    bend = a - 2.0 * b + c
                    if bend < -1e-3:
                        shift = min(max((a - c) / bend, -1.0), 1.0)
            t[n], d[n] = u, 0.5 * (at - 1 - half + shift)
            n += 1
        if n < 5 or 2 * n < looked:
            continue
        p0 = np.median(d[:n])
        p1 = p0
        scale = 1.0
        for _ in range(8):
            s00, s01, s11, r0, r1 = 1e-9, 0.0, 1e-9, 0.0, 0.0
            for i in range(n):
                a = 1.0 - t[i]
                r = (d[i] - p0 * a - p1 * t[i]) / scale
                w[i] = 1.0 / (1.0 + r * r)
                s00 += w[i] * a * a
                s01 += w[i] * a * t[i]
                s11 += w[i] * t[i] * t[i]
                r0 += w[i] * a * d[i]
                r1 += w[i] * t[i] * d[i]
            det = s00 * s11 - s01 * s01
            if det < 1e-9:
                break
            p0, p1 = (r0 * s11 - r1 * s01) / det, (r1 * s00 - r0 * s01) / det
            scale = max(0.7 * scale, 0.5)
        on, total = 0, 0.0
        for i in range(n):
            r = d[i] - p0 * (1.0 - t[i]) - p1 * t[i]
            if abs(r) < 1.0:
                on += 1
                total += r * r
        if on >= 5:
            out[e, 0], out[e, 1] = p0, p1
            out[e, 2], out[e, 3] = max(np.sqrt(total / on), 0.05), on / looked
