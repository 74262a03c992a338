# pyright: basic
"""Compiled loops along edges. Pixels are array coordinates: the centre of the top-left pixel is (0, 0)."""

from typing import no_type_check

import numpy as np
from numba import njit

from planewright.geometry.bilinear_kernels import bilinear

# `no_type_check` keeps the shape checker of the tests from wrapping a kernel before Numba sees it.


@njit(cache=True)
@no_type_check
def edge_strip(images, chroma, hue, grain, chosen, projections, start, along, across, half, step, inside, owners, owner_scale, face, limit, strip, count, texture, seen):
    """Steepness across an edge, and what its plane carries from view to view, both averaged in the edge's own plane.

    images (V, h, w) uint8; chroma (V, 2, h // 2, w // 2) uint8, whose differences count `hue` times; chosen (C,) views; projections (V, 3, 4) to array coordinates; start (3,) first corner, along (3,) to the
    second, across (3,) unit vector of the plane at right angles to the edge; offsets are (j - half) * step along `across`.
    inside: offset (world units, signed) at which a point just inside the face is looked up in owners (V, h2, w2), which must name
    `face` there. limit: a difference d of grey values over two steps counts as d / (1 + d / limit): monotonic, so a sharp edge keeps
    one peak.
    Adds to strip (S, 2 half + 1), count (S,), seen (C,) the samples used in each view, and texture (4, S, 2 half + 1): sums over views of
    the differences along the edge, of their absolute values, and the same of those across it.
    """
    samples, width = strip.shape
    rows = np.empty((samples, width + 2))
    red, blue = np.empty(width + 2), np.empty(width + 2)
    ratio_x, ratio_y = chroma.shape[3] / images.shape[2], chroma.shape[2] / images.shape[1]
    there = np.empty(samples, np.bool_)
    for c in range(chosen.shape[0]):
        v = chosen[c]
        image, p = images[v], projections[v]
        for s in range(samples):
            there[s] = False
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
            if owners[v, q, u] != face:
                continue
            there[s] = True
            for j in range(width + 2):
                d = (j - 1 - half) * step
                x, y, z = x0 + d * across[0], y0 + d * across[1], z0 + d * across[2]
                w = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
                if w <= 1e-9:
                    there[s] = False
                    break
                x, y = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / w, (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / w
                value = bilinear(image, x, y)
                if value < 0.0:
                    there[s] = False
                    break
                rows[s, j] = value
                # the border half pixel has no neighbour at half resolution: its colour is the outermost one
                x = min(max((x + 0.5) * ratio_x - 0.5, 0.0), chroma.shape[3] - 1.001)
                y = min(max((y + 0.5) * ratio_y - 0.5, 0.0), chroma.shape[2] - 1.001)
                red[j], blue[j] = bilinear(chroma[v, 0], x, y), bilinear(chroma[v, 1], x, y)
            if there[s]:
                for j in range(width):
                    steep = abs(rows[s, j + 2] - rows[s, j]) + hue * (max(abs(red[j + 2] - red[j]) - grain, 0.0) + max(abs(blue[j + 2] - blue[j]) - grain, 0.0))
                    strip[s, j] += steep / (1.0 + steep / limit)
        for s in range(samples):
            if not there[s]:
                continue
            count[s] += 1
            seen[c] += 1
            beside = s + 1 < samples and there[s + 1]
            for j in range(width):
                slope = rows[s, j + 2] - rows[s, j]
                texture[2, s, j] += slope
                texture[3, s, j] += abs(slope)
                if beside:
                    slope = rows[s + 1, j + 1] - rows[s, j + 1]
                    texture[0, s, j] += slope
                    texture[1, s, j] += abs(slope)


@njit(cache=True)
@no_type_check
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


@njit(cache=True)
@no_type_check
def cubic(image, x, y):
    """Value of image (height, width) at column x and row y by Catmull-Rom splines (Keys 1981, a = -1/2); the border is repeated."""
    height, width = image.shape
    i, j = int(np.floor(y)), int(np.floor(x))
    fy, fx = y - i, x - j
    total = 0.0
    for r in range(4):
        q = fy if r == 1 else 1.0 - fy if r == 2 else 1.0 + fy if r == 0 else 2.0 - fy
        wy = 1.0 + q * q * (1.5 * q - 2.5) if q <= 1.0 else 2.0 + q * (-4.0 + q * (2.5 - 0.5 * q))
        row = min(max(i + r - 1, 0), height - 1)
        for c in range(4):
            q = fx if c == 1 else 1.0 - fx if c == 2 else 1.0 + fx if c == 0 else 2.0 - fx
            wx = 1.0 + q * q * (1.5 * q - 2.5) if q <= 1.0 else 2.0 + q * (-4.0 + q * (2.5 - 0.5 * q))
            total += wy * wx * image[row, min(max(j + c - 1, 0), width - 1)]
    return total


@njit(cache=True)
@no_type_check
def frame_edges(image, ends, inverse_depth, own, blur, faces, depth, tolerance, radius, spacing, limit, out):
    """Where drawn edges run in one frame, near where they are predicted.

    image (h, w) uint8. ends (E, 4): predicted end points (x0, y0, x1, y1). inverse_depth (E, 2): of the ends, in front of the camera.
    own (E, F): the faces at each edge; faces (h2, w2) and depth (h2, w2): what the model shows; a sample is not looked at where
    another face is nearer by `tolerance`. blur (E, 2): length of the motion blur across the edge at both ends, pixels. radius: pixels
    searched to both sides. For each sample along an edge that lies in the image the largest change across it is found, over a base as
    long as the blur: a ramp's middle is where that is largest, while its steepest place is anywhere on it. Then a
    straight line by reweighted least squares about the median.
    Fills out (E, 6): offset at the first end, at the second (pixels, along the normal (-dy, dx) / length); the information of these
    two, 1st, cross, 2nd, in units in which an edge seen whole by 12 samples or more has a variance of 1 at its ends; share of the samples
    looked at that lie on the line. All 0 where there is no line.
    """
    half = int(2 * radius)
    widest = 2 * half + 2 * int(2 * radius) + 3
    profile = np.empty(widest)
    height, width = image.shape
    scale_x, scale_y = depth.shape[1] / width, depth.shape[0] / height
    t, d, w = np.empty(60), np.empty(60), np.empty(60)
    steps = np.empty(3)
    for e in range(ends.shape[0]):
        out[e] = 0.0
        x0, y0, x1, y1 = ends[e]
        length = np.hypot(x1 - x0, y1 - y0)
        # the part in the image (Liang-Barsky)
        first, last = 0.0, 1.0
        for axis in range(2):
            start, move = (x0, x1 - x0) if axis == 0 else (y0, y1 - y0)
            top = (width if axis == 0 else height) - 3.0
            if abs(move) < 1e-9:
                if start < 2.0 or start > top:
                    last = -1.0
                continue
            a, b = (2.0 - start) / move, (top - start) / move
            first, last = max(first, min(a, b)), min(last, max(a, b))
        seen = (last - first) * length
        if not seen >= 10.0:
            continue
        nx, ny = -(y1 - y0) / length, (x1 - x0) / length
        count = min(max(int(seen / spacing), 5), 60)
        n = 0
        looked = 0
        for s in range(count):
            u = first + (last - first) * (s + 0.5) / count
            if u < 0.04 or u > 0.96:
                continue
            x, y = x0 + u * (x1 - x0), y0 + u * (y1 - y0)
            row, column = int((y + 0.5) * scale_y), int((x + 0.5) * scale_x)
            if row < 0 or column < 0 or row >= depth.shape[0] or column >= depth.shape[1]:
                continue
            f = faces[row, column]
            if f >= 0 and not own[e, f]:
                z = 1.0 / (inverse_depth[e, 0] * (1.0 - u) + inverse_depth[e, 1] * u)
                if depth[row, column] < z - tolerance:
                    continue
            base = min(max(int(blur[e, 0] * (1.0 - u) + blur[e, 1] * u + 0.5), 1), int(2 * radius))
            size = 2 * half + 2 * base + 1
            good = True
            for j in range(size):
                o = 0.5 * (j - base - half)
                profile[j] = bilinear(image, x + o * nx, y + o * ny)
                if profile[j] < 0.0:
                    good = False
                    break
            if not good:
                continue
            looked += 1
            best, at = 0.0, -1
            for j in range(base, 2 * half + base + 1):
                # nearer places win over slightly steeper ones further off
                o = 0.5 * (j - base - half)
                g = abs(profile[j + base] - profile[j - base]) / (1.0 + (o / radius) ** 2)
                if g > best:
                    best, at = g, j
            if at < 0 or best < limit:
                continue
            # Between pixels straight interpolation draws the largest change to half pixels, by up to .25; cubic interpolation does not.
            place = 0.5 * (at - base - half)
            if at > base and at < 2 * half + base:
                for _ in range(2):
                    for j in range(3):
                        o, reach = place + 0.5 * (j - 1), 0.5 * base
                        steps[j] = abs(cubic(image, x + (o + reach) * nx, y + (o + reach) * ny) - cubic(image, x + (o - reach) * nx, y + (o - reach) * ny))
                    bend = steps[0] - 2.0 * steps[1] + steps[2]
                    if bend >= 0.0:
                        break
                    place += 0.5 * min(max(0.5 * (steps[0] - steps[2]) / bend, -0.5), 0.5)
            t[n] = u
            d[n] = place
            n += 1
        if n < 5 or 2 * n < looked:
            continue
        middle = np.median(d[:n])
        a, b = middle, middle
        scale = 1.0
        for _ in range(8):
            s0 = s1 = s2 = r0 = r1 = 0.0
            for i in range(n):
                r = (d[i] - a * (1.0 - t[i]) - b * t[i]) / scale
                w[i] = 1.0 / (1.0 + r * r)
                p, q = 1.0 - t[i], t[i]
                s0 += w[i] * p * p
                s1 += w[i] * p * q
                s2 += w[i] * q * q
                r0 += w[i] * p * d[i]
                r1 += w[i] * q * d[i]
            det = s0 * s2 - s1 * s1
            if det < 1e-9:
                break
            a, b = (r0 * s2 - r1 * s1) / det, (r1 * s0 - r0 * s1) / det
            scale = max(0.6 * scale, 0.3)
        on = 0
        s0 = s1 = s2 = 0.0
        for i in range(n):
            r = d[i] - a * (1.0 - t[i]) - b * t[i]
            if abs(r) < 0.8:
                on += 1
                s0 += (1.0 - t[i]) ** 2
                s1 += (1.0 - t[i]) * t[i]
                s2 += t[i] ** 2
        if on >= 5:
            unit = 4.0 / max(on, 12)
            out[e, 0], out[e, 1] = a, b
            out[e, 2], out[e, 3], out[e, 4] = unit * s0, unit * s1, unit * s2
            out[e, 5] = on / looked


@njit(cache=True)
@no_type_check
def sample_patches(image, points, patch, usable, face, borders, rotation, translation, focal, cx, cy, faces, depth, tolerance, values, distance):
    """What a frame shows at places on faces near their corners.

    image (h, w, 3) uint8. points (S, 3): world, sorted by patch (S,). usable (P,): whether the patch's corner can be seen. face (P,).
    borders (P, B, 2, 3): the edges of the face next to the corner, NaN where there are fewer. rotation, translation, focal, cx, cy:
    the camera, in pixels whose first centre is 0. faces (h2, w2), depth (h2, w2): what the model shows; a place that another face
    hides by more than `tolerance` is left out.
    Fills values (S, 3): the mean of four places 1.2 pixels apart, NaN where it is left out; distance (S,): pixels to the nearest of
    `borders`, as they are seen.
    """
    height, width = image.shape[0], image.shape[1]
    scale_x, scale_y = depth.shape[1] / width, depth.shape[0] / height
    ends = np.empty((borders.shape[1], 4))
    last = -1
    for s in range(points.shape[0]):
        values[s] = np.nan
        distance[s] = 0.0
        p = patch[s]
        if not usable[p]:
            continue
        if p != last:
            last = p
            for e in range(borders.shape[1]):
                for side in range(2):
                    q = rotation @ borders[p, e, side] + translation
                    z = q[2] if q[2] > 1e-9 else np.nan
                    ends[e, 2 * side] = focal * q[0] / z + cx
                    ends[e, 2 * side + 1] = focal * q[1] / z + cy
        q = rotation @ points[s] + translation
        if q[2] <= 1e-9:
            continue
        x, y = focal * q[0] / q[2] + cx, focal * q[1] / q[2] + cy
        if not (x >= 1.0 and y >= 1.0 and x < width - 2.0 and y < height - 2.0):
            continue
        row, column = min(int((y + 0.5) * scale_y), depth.shape[0] - 1), min(int((x + 0.5) * scale_x), depth.shape[1] - 1)
        if faces[row, column] >= 0 and faces[row, column] != face[p] and depth[row, column] < q[2] - tolerance:
            continue
        nearest = 1e9
        for e in range(borders.shape[1]):
            ax, ay = ends[e, 0], ends[e, 1]
            bx, by = ends[e, 2] - ax, ends[e, 3] - ay
            size = bx * bx + by * by
            if not size > 1e-9:
                continue
            u = min(max(((x - ax) * bx + (y - ay) * by) / size, 0.0), 1.0)
            nearest = min(nearest, np.hypot(x - ax - u * bx, y - ay - u * by))
        distance[s] = nearest
        for c in range(3):
            total = 0.0
            for tap in range(4):
                tx, ty = x + (0.6 if tap % 2 else -0.6), y + (0.6 if tap // 2 else -0.6)
                i, j = int(ty), int(tx)
                fx, fy = tx - j, ty - i
                top = image[i, j, c] * (1.0 - fx) + image[i, j + 1, c] * fx
                low = image[i + 1, j, c] * (1.0 - fx) + image[i + 1, j + 1, c] * fx
                total += top * (1.0 - fy) + low * fy
            values[s, c] = 0.25 * total
