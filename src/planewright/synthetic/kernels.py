# pyright: basic
"""Inner loops of the renderer: visible polygon a pixel, textured colour a pixel, light a point, and what covers a point.

Polygons are flat arrays. Loops of polygon p are `polygon_loop[p]:polygon_loop[p + 1]`; vertices of loop l are `loop_start[l]:loop_start[l + 1]`.
All loops of a polygon together bound its inside by the even-odd rule, so holes need no triangulation.
"""

from typing import no_type_check

import numpy as np
from numba import njit

# `no_type_check` keeps the shape checker of the tests from wrapping a kernel before Numba sees it.


@njit(cache=True)
@no_type_check
def rasterize(vertices, loop_start, polygon_loop, inverse_depth, camera, near, nearest, index):
    """Write which polygon is nearest in every pixel.

    vertices: (v, 3) in the camera frame. inverse_depth: (p, 3), 1/z of polygon p at pixel (x, y) is its dot product with (x, y, 1).
    camera: (focal, cx, cy, dx, dy); the sample of pixel (column, row) lies at (column + dx, row + dy).
    nearest: (height, width), largest 1/z so far, zeros at first. index: (height, width), polygon or -1. Both are written.
    """
    height, width = nearest.shape
    focal, cx, cy, dx, dy = camera
    largest = 0
    for p in range(len(polygon_loop) - 1):
        largest = max(largest, loop_start[polygon_loop[p + 1]] - loop_start[polygon_loop[p]])
    edges = np.empty((2 * largest + 8, 4))
    clipped = np.empty((2 * largest + 8, 2))
    crossing = np.empty(2 * largest + 8)
    for p in range(len(polygon_loop) - 1):
        num_edges = 0
        top, bottom = 1e30, -1e30
        left, right = 1e30, -1e30
        for loop in range(polygon_loop[p], polygon_loop[p + 1]):
            a, b = loop_start[loop], loop_start[loop + 1]
            count = 0
            for i in range(a, b):
                j = a if i + 1 == b else i + 1
                zi, zj = vertices[i, 2], vertices[j, 2]
                if zi >= near:
                    clipped[count, 0] = cx + focal * vertices[i, 0] / zi
                    clipped[count, 1] = cy + focal * vertices[i, 1] / zi
                    count += 1
                if (zi >= near) != (zj >= near):
                    t = (near - zi) / (zj - zi)
                    clipped[count, 0] = cx + focal * (vertices[i, 0] + t * (vertices[j, 0] - vertices[i, 0])) / near
                    clipped[count, 1] = cy + focal * (vertices[i, 1] + t * (vertices[j, 1] - vertices[i, 1])) / near
                    count += 1
            for i in range(count):
                j = 0 if i + 1 == count else i + 1
                # From the upper to the lower end, so that two polygons compute a shared edge alike and leave no crack.
                k, m = (i, j) if clipped[i, 1] <= clipped[j, 1] else (j, i)
                edges[num_edges, 0], edges[num_edges, 1] = clipped[k, 0], clipped[k, 1]
                edges[num_edges, 2], edges[num_edges, 3] = clipped[m, 0], clipped[m, 1]
                top, bottom = min(top, clipped[k, 1]), max(bottom, clipped[m, 1])
                left, right = min(left, min(clipped[k, 0], clipped[m, 0])), max(right, max(clipped[k, 0], clipped[m, 0]))
                num_edges += 1
        if num_edges == 0 or right < 0.0 or left > width or bottom < 0.0 or top > height:
            continue
        q0, q1, q2 = inverse_depth[p, 0], inverse_depth[p, 1], inverse_depth[p, 2]
        for row in range(max(0, int(np.ceil(top - dy))), min(height, int(np.ceil(bottom - dy)))):
            y = row + dy
            n = 0
            for e in range(num_edges):
                if edges[e, 1] <= y < edges[e, 3]:
                    x = edges[e, 0] + (edges[e, 2] - edges[e, 0]) * ((y - edges[e, 1]) / (edges[e, 3] - edges[e, 1]))
                    k = n
                    while k > 0 and crossing[k - 1] > x:
                        crossing[k] = crossing[k - 1]
                        k -= 1
                    crossing[k] = x
                    n += 1
            for k in range(0, n - 1, 2):
                if crossing[k + 1] < 0.0 or crossing[k] > width:
                    continue
                first = max(0, int(np.ceil(crossing[k] - dx)))
                last = min(width, int(np.ceil(crossing[k + 1] - dx)))
                for column in range(first, last):
                    q = q0 * (column + dx) + q1 * y + q2
                    if q > nearest[row, column]:
                        nearest[row, column] = q
                        index[row, column] = p


@njit(cache=True, error_model="numpy")
@no_type_check
def shade(index, axes, inverse_depth, camera, density, gain, texture, level_start, level_size, texels, total):
    """Add the textured colour of every pixel to `total`.

    index: (height, width) from `rasterize`. axes: (p, 2, 4); plane coordinates (u, v) of a point x in the camera frame are `axes[..., :3] @ x + axes[..., 3]`.
    density: (p,) texels a unit. gain: (p,). texture: (p,) which texture. level_start, level_size: (t, levels) and (t, levels, 2) rows and columns.
    texels: (n, 3) uint8, all levels of all textures. total: (height, width, 3) float32, written.

    Trilinear (Williams 1983, Pyramidal parametrics); the level follows the area of the pixel's footprint, half a level sharper
    because several samples share a pixel.
    """
    height, width = index.shape
    focal, cx, cy, dx, dy = camera
    top_level = level_start.shape[1] - 1
    for row in range(height):
        y = row + dy
        ry = (y - cy) / focal
        for column in range(width):
            p = index[row, column]
            if p < 0:
                continue
            x = column + dx
            rx = (x - cx) / focal
            q0, q1 = inverse_depth[p, 0], inverse_depth[p, 1]
            q = q0 * x + q1 * y + inverse_depth[p, 2]
            nu = axes[p, 0, 0] * rx + axes[p, 0, 1] * ry + axes[p, 0, 2]
            nv = axes[p, 1, 0] * rx + axes[p, 1, 1] * ry + axes[p, 1, 2]
            u = (nu / q + axes[p, 0, 3]) * density[p]
            v = (nv / q + axes[p, 1, 3]) * density[p]
            ux = (axes[p, 0, 0] / focal * q - nu * q0) / (q * q)
            uy = (axes[p, 0, 1] / focal * q - nu * q1) / (q * q)
            vx = (axes[p, 1, 0] / focal * q - nv * q0) / (q * q)
            vy = (axes[p, 1, 1] / focal * q - nv * q1) / (q * q)
            area = abs(ux * vy - uy * vx) * density[p] * density[p]
            # The level is log4(area / 2), by chords between whole levels: a logarithm would take a third of the kernel's time.
            area *= 0.5
            low = 0
            while area > 4.0 and low < top_level:
                area *= 0.25
                low += 1
            part = min(max((area - 1.0) / 3.0, 0.0), 1.0)
            red, green, blue = 0.0, 0.0, 0.0
            for step in range(2):
                weight = 1.0 - part if step == 0 else part
                k = min(low + step, top_level)
                if weight <= 0.0:
                    continue
                rows, columns = level_size[texture[p], k, 0], level_size[texture[p], k, 1]
                scale = 1.0 / (1 << k)
                s = min(max(u * scale - 0.5, 0.0), columns - 1.0)
                t = min(max(v * scale - 0.5, 0.0), rows - 1.0)
                i, j = int(t), int(s)
                fi, fj = t - i, s - j
                i1, j1 = min(i + 1, rows - 1), min(j + 1, columns - 1)
                base = level_start[texture[p], k]
                a, b = base + i * columns + j, base + i * columns + j1
                c, d = base + i1 * columns + j, base + i1 * columns + j1
                wa, wb = (1.0 - fi) * (1.0 - fj), (1.0 - fi) * fj
                wc, wd = fi * (1.0 - fj), fi * fj
                weight *= gain[p]
                wa, wb, wc, wd = weight * wa, weight * wb, weight * wc, weight * wd
                red += wa * texels[a, 0] + wb * texels[b, 0] + wc * texels[c, 0] + wd * texels[d, 0]
                green += wa * texels[a, 1] + wb * texels[b, 1] + wc * texels[c, 1] + wd * texels[d, 1]
                blue += wa * texels[a, 2] + wb * texels[b, 2] + wc * texels[c, 2] + wd * texels[d, 2]
            total[row, column, 0] += np.float32(red)
            total[row, column, 1] += np.float32(green)
            total[row, column, 2] += np.float32(blue)


@njit(cache=True)
@no_type_check
def _hits(ray_from, ray_to, upto, corners, loop_start, polygon_loop, frames, spheres):
    """Whether a segment meets a polygon before the fraction `upto` of its length.

    corners: (v, 2) in plane coordinates. frames: (p, 3, 4), rows u, v and height above the plane. spheres: (p, 4) around the polygons.
    """
    dx, dy, dz = ray_to[0] - ray_from[0], ray_to[1] - ray_from[1], ray_to[2] - ray_from[2]
    length2 = dx * dx + dy * dy + dz * dz
    for p in range(len(polygon_loop) - 1):
        ox, oy, oz = spheres[p, 0] - ray_from[0], spheres[p, 1] - ray_from[1], spheres[p, 2] - ray_from[2]
        along = min(max((ox * dx + oy * dy + oz * dz) / length2, 0.0), 1.0)
        mx, my, mz = ox - along * dx, oy - along * dy, oz - along * dz
        if mx * mx + my * my + mz * mz > spheres[p, 3] * spheres[p, 3]:
            continue
        h0 = frames[p, 2, 0] * ray_from[0] + frames[p, 2, 1] * ray_from[1] + frames[p, 2, 2] * ray_from[2] + frames[p, 2, 3]
        h1 = frames[p, 2, 0] * ray_to[0] + frames[p, 2, 1] * ray_to[1] + frames[p, 2, 2] * ray_to[2] + frames[p, 2, 3]
        if h0 == h1:
            continue
        t = h0 / (h0 - h1)
        if t <= 0.0 or t >= upto:
            continue
        x, y, z = ray_from[0] + t * dx, ray_from[1] + t * dy, ray_from[2] + t * dz
        u = frames[p, 0, 0] * x + frames[p, 0, 1] * y + frames[p, 0, 2] * z + frames[p, 0, 3]
        v = frames[p, 1, 0] * x + frames[p, 1, 1] * y + frames[p, 1, 2] * z + frames[p, 1, 3]
        inside = False
        for loop in range(polygon_loop[p], polygon_loop[p + 1]):
            a, b = loop_start[loop], loop_start[loop + 1]
            j = b - 1
            for i in range(a, b):
                spans = (corners[i, 1] > v) != (corners[j, 1] > v)
                if spans and u < (corners[j, 0] - corners[i, 0]) * (v - corners[i, 1]) / (corners[j, 1] - corners[i, 1]) + corners[i, 0]:
                    inside = not inside
                j = i
        if inside:
            return True
    return False


@njit(cache=True)
@no_type_check
def covered(points, centers, slack, corners, loop_start, polygon_loop, frames, spheres, out):
    """Whether something stands between a camera centre and a point, nearer than the point by more than `slack`.

    points: (n, 3). centers: (f, 3). out: (n, f) bool, written.
    """
    for f in range(len(centers)):
        for n in range(len(points)):
            distance = np.sqrt(((points[n] - centers[f]) ** 2).sum())
            out[n, f] = _hits(centers[f], points[n], 1.0 - slack / distance, corners, loop_start, polygon_loop, frames, spheres)


@njit(cache=True)
@no_type_check
def light(points, normals, sun, sky, ambient, corners, loop_start, polygon_loop, frames, spheres, out):
    """Light on points: sun where its rays arrive, and the open part of the sky around.

    points, normals: (n, 3). sun: (s, 3) vectors to places of the sun, all of one strength. sky: (r, 3) vectors over the upper half
    of the sphere around +z, cosine distributed; what stands farther away than their length shades nothing. ambient: share of the sky's light.
    out: (n,), written.
    """
    for n in range(len(points)):
        nx, ny, nz = normals[n]
        start = points[n] + 2e-3 * normals[n]
        direct = 0.0
        for k in range(len(sun)):
            slope = (sun[k] * normals[n]).sum() / np.sqrt((sun[k] ** 2).sum())
            if slope > 0.0 and not _hits(start, start + sun[k], 1.0, corners, loop_start, polygon_loop, frames, spheres):
                direct += slope / len(sun)
        # An orthonormal frame around the normal: Duff et al. 2017, Building an orthonormal basis, revisited.
        sign = 1.0 if nz >= 0.0 else -1.0
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        open_sky = 0.0
        for k in range(len(sky)):
            sx, sy, sz = sky[k]
            way = np.empty(3)
            way[0] = (1.0 + sign * nx * nx * a) * sx + b * sy + nx * sz
            way[1] = sign * b * sx + (sign + ny * ny * a) * sy + ny * sz
            way[2] = -sign * nx * sx - ny * sy + nz * sz
            if not _hits(start, start + way, 1.0, corners, loop_start, polygon_loop, frames, spheres):
                open_sky += 1.0 / len(sky)
        out[n] = ambient * open_sky + (1.0 - ambient) * direct
