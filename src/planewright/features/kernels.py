# pyright: basic
"""Numba kernel of feature following: registration of many small patches to the frames they were born in."""

from typing import no_type_check

import numpy as np
from numba import njit

# `no_type_check` keeps the shape checker of the tests from wrapping a kernel before Numba sees it.


SUMS = {"reassoc", "contract", "nsz"}
"""Freedom to add in any order, so that sums over a patch run in the vector units. The order is settled when the kernel is compiled: a machine gives the
same bits every time, whatever the number of threads."""


@njit(cache=True, nogil=True, fastmath=SUMS)
@no_type_check
def align_patches(image, templates, steepest, inverse_hessians, offsets, weights, stiffness, affine, centre, zncc, start, stop, max_iterations):
    """Register patches `start` to `stop` to `image`, in place: inverse-compositional Gauss-Newton on 6 affine, 1 gain and 1 bias parameter.

    Baker and Matthews, "Lucas-Kanade 20 years on" (2004), section 3.2, with the gain and bias of Bartoli's dual parametrization left to right.

    Args:
        image: (height, width) float32, smoothed as the birth frame was.
        templates: (n, pixels) float32, grey values of the birth patch.
        steepest: (n, 2, pixels) float32, x and y gradient of the birth patch.
        inverse_hessians: (n, 8, 8) of the parameters (a00, a01, a10, a11, tx, ty, gain, bias).
        offsets: (pixels, 2) of the patch's pixels from its centre. weights: (pixels,).
        stiffness: weight, in grey levels squared, of a departure of the affine shape from the one it starts with; the inverse Hessians know it too.
        affine: (n, 2, 2), current from birth; read as a start, overwritten. centre: (n, 2) likewise, pixels with centres at integers.
        zncc: (n,) overwritten with the weighted correlation of patch and image; -1 where the patch leaves the image or the step fails.
    """
    height, width = image.shape
    pixels = offsets.shape[0]
    values = np.empty(pixels)
    us, vs = offsets[:, 0].copy(), offsets[:, 1].copy()
    reach_u, reach_v = np.abs(us).max(), np.abs(vs).max()
    total = weights.sum()
    b, d = np.empty(8), np.empty(6)
    one = np.uintp(1)
    for i in range(start, stop):
        a00, a01, a10, a11 = affine[i, 0, 0], affine[i, 0, 1], affine[i, 1, 0], affine[i, 1, 1]
        cx, cy = centre[i, 0], centre[i, 1]
        det = a00 * a11 - a01 * a10
        if det < 1e-6:
            zncc[i] = -1.0
            continue
        # Rows of the inverse of the shape at the start: what has changed since is that times the shape now, less the identity.
        s00, s01, s10, s11 = a11 / det, -a01 / det, -a10 / det, a00 / det
        gain, bias = 1.0, 0.0
        inside = True
        done = False
        template, along, down = templates[i], steepest[i, 0], steepest[i, 1]
        st, stt = 0.0, 0.0
        for k in range(pixels):
            st += weights[k] * template[k]
            stt += weights[k] * template[k] * template[k]
        mean_t = st / total
        var_t = stt / total - mean_t * mean_t
        for iteration in range(max_iterations + 1):
            # The patch is a rectangle: all of it is inside where its corners are.
            half_x, half_y = abs(a00) * reach_u + abs(a01) * reach_v, abs(a10) * reach_u + abs(a11) * reach_v
            if not (cx - half_x >= 0.0 and cy - half_y >= 0.0 and cx + half_x < width - 1.001 and cy + half_y < height - 1.001):
                inside = False
                break
            for k in range(pixels):
                x = a00 * us[k] + a01 * vs[k] + cx
                y = a10 * us[k] + a11 * vs[k] + cy
                # Unsigned indices spare the check for negative ones.
                x0, y0 = np.uintp(x), np.uintp(y)
                fx, fy = x - x0, y - y0
                top = image[y0, x0] * (1.0 - fx) + image[y0, x0 + one] * fx
                bottom = image[y0 + one, x0] * (1.0 - fx) + image[y0 + one, x0 + one] * fx
                values[k] = top * (1.0 - fy) + bottom * fy
            sv, svv, stv = 0.0, 0.0, 0.0
            for k in range(pixels):
                wv = weights[k] * values[k]
                sv += wv
                svv += wv * values[k]
                stv += wv * template[k]
            mean_v = sv / total
            var_v, cov = svv / total - mean_v * mean_v, stv / total - mean_v * mean_t
            if var_v <= 1e-6 or var_t <= 1e-6:
                inside = False
                break
            zncc[i] = cov / np.sqrt(var_v * var_t)
            if done or iteration == max_iterations:
                break
            # Gain and bias are linear: their best values come in closed form, which leaves the step to the geometry.
            gain = cov / var_t
            if gain < 0.05:
                inside = False
                break
            bias = mean_v - gain * mean_t
            b0 = b1 = b2 = b3 = b4 = b5 = b6 = b7 = 0.0
            for k in range(pixels):
                e = weights[k] * (values[k] - gain * template[k] - bias)
                ex, ey = e * along[k], e * down[k]
                b0 += ex * us[k]
                b1 += ex * vs[k]
                b2 += ey * us[k]
                b3 += ey * vs[k]
                b4 += ex
                b5 += ey
                b6 += e * template[k]
                b7 += e
            b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7] = b0, b1, b2, b3, b4, b5, b6, b7
            pull = stiffness * gain
            b[0] += pull * (s00 * a00 + s01 * a10 - 1.0)
            b[1] += pull * (s00 * a01 + s01 * a11)
            b[2] += pull * (s10 * a00 + s11 * a10)
            b[3] += pull * (s10 * a01 + s11 * a11 - 1.0)
            for m in range(6):
                s = 0.0
                for n in range(8):
                    s += inverse_hessians[i, m, n] * b[n]
                d[m] = s / gain
            # x -> W(x) o W(d)^-1 with W(d) u = (I + D) u + t.
            det = (1.0 + d[0]) * (1.0 + d[3]) - d[1] * d[2]
            if not (det > 0.2 and det < 5.0):
                inside = False
                break
            i00, i01, i10, i11 = (1.0 + d[3]) / det, -d[1] / det, -d[2] / det, (1.0 + d[0]) / det
            n00, n01 = a00 * i00 + a01 * i10, a00 * i01 + a01 * i11
            n10, n11 = a10 * i00 + a11 * i10, a10 * i01 + a11 * i11
            sx, sy = n00 * d[4] + n01 * d[5], n10 * d[4] + n11 * d[5]
            change = np.sqrt(sx * sx + sy * sy) + 3.0 * (abs(d[0]) + abs(d[1]) + abs(d[2]) + abs(d[3]))
            a00, a01, a10, a11 = n00, n01, n10, n11
            cx, cy = cx - sx, cy - sy
            done = change < 0.01
        if inside:
            affine[i, 0, 0], affine[i, 0, 1], affine[i, 1, 0], affine[i, 1, 1] = a00, a01, a10, a11
            centre[i, 0], centre[i, 1] = cx, cy
        else:
            zncc[i] = -1.0
