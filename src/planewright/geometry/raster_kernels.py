# pyright: basic
"""The scan-line filler behind `raster.face_buffer`."""

from typing import no_type_check

import numpy as np
from numba import njit


# Without `no_type_check` the shape checker of the tests wraps the function before Numba sees it.
@njit(cache=True)
@no_type_check
def fill_faces(normals, offsets, corners, loop_start, face_start, rotation, translation, focal, cx, cy, near, face, inverse_depth):
    """Fill `face` (height, width; int16) and `inverse_depth` (height, width; float32) with the nearest polygon at each pixel centre.

    normals (faces, 3), offsets (faces,): planes in the world. corners (corners, 3): all loops, one after the other; loop i is
    corners[loop_start[i]:loop_start[i + 1]]; face f has the loops face_start[f] to face_start[f + 1]. rotation (3, 3), translation (3,).
    Inside is what an odd number of borders separates from the outside, so holes need no special care, and neither do the double
    borders which clipping a concave loop leaves along the near plane.
    """
    height, width = face.shape
    edges = np.empty((2 * len(corners) + 1, 4))
    crossings = np.empty(2 * len(corners) + 1)
    for f in range(len(normals)):
        if not np.isfinite(normals[f]).all():
            continue
        # The plane in the camera: n_cam . x = d_cam. Along the ray (x, y, 1) the inverse depth is n_cam . ray / d_cam.
        n_cam = rotation @ normals[f]
        d_cam = offsets[f] + n_cam[0] * translation[0] + n_cam[1] * translation[1] + n_cam[2] * translation[2]
        if abs(d_cam) < 1e-12:
            continue
        count = 0
        low, high = np.inf, 0.0
        top, bottom = np.inf, -np.inf
        finite = True
        for loop in range(face_start[f], face_start[f + 1]):
            start, stop = loop_start[loop], loop_start[loop + 1]
            have_last = False
            last_x, last_y, first_x, first_y = 0.0, 0.0, 0.0, 0.0
            for i in range(start, stop):
                a = corners[i]
                b = corners[i + 1 if i + 1 < stop else start]
                az = rotation[2, 0] * a[0] + rotation[2, 1] * a[1] + rotation[2, 2] * a[2] + translation[2]
                bz = rotation[2, 0] * b[0] + rotation[2, 1] * b[1] + rotation[2, 2] * b[2] + translation[2]
                if not (np.isfinite(az) and np.isfinite(bz)):
                    finite = False
                    break
                # Sutherland-Hodgman against z = near: a corner in front is kept, a border that crosses leaves its crossing.
                for part in range(2):
                    if part == 0:
                        if az < near:
                            continue
                        weight = 0.0
                    else:
                        if (az < near) == (bz < near):
                            continue
                        weight = (near - az) / (bz - az)
                    px = a[0] + weight * (b[0] - a[0])
                    py = a[1] + weight * (b[1] - a[1])
                    pz = a[2] + weight * (b[2] - a[2])
                    z = max(near, az + weight * (bz - az))
                    u = cx + focal * (rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + translation[0]) / z
                    v = cy + focal * (rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + translation[1]) / z
                    low, high = min(low, 1.0 / z), max(high, 1.0 / z)
                    top, bottom = min(top, v), max(bottom, v)
                    if have_last:
                        edges[count] = (last_x, last_y, u, v)
                        count += 1
                    else:
                        first_x, first_y = u, v
                        have_last = True
                    last_x, last_y = u, v
            if have_last:
                edges[count] = (last_x, last_y, first_x, first_y)
                count += 1
        if not finite or count < 3:
            continue
        row_first = int(max(0.0, np.ceil(top - 0.5)))
        row_last = int(min(height - 1.0, np.floor(bottom - 0.5)))
        slope_x = n_cam[0] / (focal * d_cam)
        for row in range(row_first, row_last + 1):
            y = row + 0.5
            found = 0
            for e in range(count):
                x0, y0, x1, y1 = edges[e]
                if (y0 <= y) != (y1 <= y):
                    # From the lower end always, so that a border shared by two faces is cut at the very same place.
                    if y0 > y1:
                        x0, y0, x1, y1 = x1, y1, x0, y0
                    crossings[found] = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
                    found += 1
            for i in range(1, found):
                value = crossings[i]
                j = i - 1
                while j >= 0 and crossings[j] > value:
                    crossings[j + 1] = crossings[j]
                    j -= 1
                crossings[j + 1] = value
            at_zero = (n_cam[2] + n_cam[1] * (y - cy) / focal - n_cam[0] * cx / focal) / d_cam
            for i in range(0, found - 1, 2):
                column_first = int(np.ceil(min(max(crossings[i], 0.0), width) - 0.5))
                column_stop = int(np.ceil(min(max(crossings[i + 1], 0.0), width) - 0.5))
                for column in range(column_first, column_stop):
                    # No nearer and no farther than the corners, which matters for a face seen edge-on.
                    value = min(max(at_zero + slope_x * (column + 0.5), low), high)
                    if value > inverse_depth[row, column]:
                        inverse_depth[row, column] = value
                        face[row, column] = f
