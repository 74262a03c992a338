"""Homographies of a face and their first-order changes.

A homography maps face coordinates (the frame in which the face was drawn, moved and scaled so that the face fills about -1 to 1) to pixels of a frame with
centres at integers. A change acts on the face's side: h W(d) with W(d) = [[1 + d0, d1, d2], [d3, 1 + d4, d5], [d6, d7, 1]].
"""

import numpy as np

from planewright.arrays import Float, Mat3


def apply_homography(h: Float[np.ndarray, "*batch 3 3"], q: Float[np.ndarray, "*batch n 2"]) -> Float[np.ndarray, "*batch n 2"]:
    """Points through homographies; not finite where they go to infinity or behind it."""
    out = q @ np.swapaxes(h[..., :2], -1, -2) + h[..., None, :, 2]
    w = np.where(out[..., 2:] > 1e-9, out[..., 2:], np.nan)
    return out[..., :2] / w


def changed(h: Mat3, d: Float[np.ndarray, "8"]) -> Mat3:
    """h W(d), scaled so that its last entry is one."""
    moved = h @ np.array([[1 + d[0], d[1], d[2]], [d[3], 1 + d[4], d[5]], [d[6], d[7], 1.0]])
    return moved / moved[2, 2]


def point_jacobian(h: Float[np.ndarray, "*batch 3 3"], q: Float[np.ndarray, "*batch n 2"]) -> Float[np.ndarray, "*batch n 2 2"]:
    """Derivative of the pixel by the face coordinates."""
    out = q @ np.swapaxes(h[..., :2], -1, -2) + h[..., None, :, 2]
    w = np.where(out[..., 2] > 1e-9, out[..., 2], np.nan)[..., None, None]
    xy = out[..., :2, None] / w
    return (h[..., None, :2, :2] - xy * h[..., None, 2:, :2]) / w


def change_jacobian(h: Float[np.ndarray, "*batch 3 3"], q: Float[np.ndarray, "*batch n 2"]) -> Float[np.ndarray, "*batch n 2 8"]:
    """Derivative of the pixel by the change d."""
    x, y = q[..., 0], q[..., 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    first = np.stack([x, y, one, zero, zero, zero, -x * x, -x * y], axis=-1)
    second = np.stack([zero, zero, zero, x, y, one, -x * y, -y * y], axis=-1)
    return point_jacobian(h, q) @ np.stack([first, second], axis=-2)
