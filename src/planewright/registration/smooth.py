"""One smooth path through positions of unequal trust, in time linear in the number of frames."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded  # pyright: ignore[reportUnknownVariableType]

from planewright.arrays import Bool, Float


@dataclass(frozen=True, kw_only=True)
class SmoothOptions:
    """How stiff a path is."""

    least_bend: float = 1.0
    """Least standard deviation of the change of velocity from a frame to the next, pixels; more where the path itself shows more, for hands shake."""
    rounds: int = 5
    """Of reweighting."""
    doubt: float = 4.0
    """Sigmas at which a position has lost three quarters of its weight (Geman and McClure)."""


def smooth_path(
    xy: Float[np.ndarray, "frames 2"],
    covariance: Float[np.ndarray, "frames 2 2"],
    known: Bool[np.ndarray, "frames"],
    options: SmoothOptions = SmoothOptions(),
) -> Float[np.ndarray, "frames 2"]:
    """The path that is nearest to the known positions and bends least: sum rho(|x_k - z_k|^2) + sum |x_(k-1) - 2 x_k + x_(k+1)|^2 / bend^2.

    rho is that of Geman and McClure, so that one wrong position does not bend the path. Runs of known frames are solved each by itself: a banded
    system, in time linear in the number of frames. Frames that are not known stay as they are.

    Args:
        covariance: of what differs from frame to frame. An error that all frames share must not be in it: it would let the path stray.
    """
    out = xy.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(np.int8), [0]])))
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        if b - a >= 3:
            out[a:b] = _smooth_run(xy[a:b], covariance[a:b], options)
    return out


def _smooth_run(z: Float[np.ndarray, "n 2"], covariance: Float[np.ndarray, "n 2 2"], options: SmoothOptions) -> Float[np.ndarray, "n 2"]:
    information = np.linalg.inv(covariance + 1e-9 * np.eye(2))
    bend = 1.4826 * float(np.median(np.abs(np.diff(z, n=2, axis=0))))
    stiff = 1.0 / max(options.least_bend, 1.5 * bend) ** 2
    x = z.copy()
    weight = np.ones(len(z))
    for _ in range(options.rounds):
        x = _solve_banded(information * weight[:, None, None], z, stiff)
        away = np.einsum("ki,kij,kj->k", x - z, information, x - z)
        weight = 1.0 / (1.0 + away / options.doubt**2) ** 2
    return x


def _solve_banded(information: Float[np.ndarray, "n 2 2"], z: Float[np.ndarray, "n 2"], stiff: float) -> Float[np.ndarray, "n 2"]:
    """Block-pentadiagonal Cholesky by scipy's banded solver: unknowns x0, y0, x1, y1, ..."""
    n = len(z)
    diagonal = np.full(n, 6.0)
    diagonal[[0, -1]] = 1.0
    diagonal[[1, -2]] = 5.0 if n > 3 else 4.0
    first = np.full(n - 1, -4.0)
    first[[0, -1]] = -2.0
    if n == 3:
        diagonal[1] = 4.0
    band = np.zeros((5, 2 * n))  # row d: entries d to the right of the diagonal, lower form
    band[0, 0::2] = information[:, 0, 0] + stiff * diagonal
    band[0, 1::2] = information[:, 1, 1] + stiff * diagonal
    band[1, 0::2] = information[:, 0, 1]
    band[2, : 2 * (n - 1)] = np.repeat(stiff * first, 2)
    band[4, : 2 * (n - 2)] = stiff
    right = np.einsum("kij,kj->ki", information, z).reshape(-1)
    return np.asarray(solveh_banded(band, right, lower=True)).reshape(n, 2)
