"""Evens out the exposure: cameras brighten and darken while they film, which would show as patches in the texture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Int, UInt8


@dataclass(frozen=True, eq=False)
class FaceSamples:
    """What the chosen views say about the texels of one face."""

    frame: Int[np.ndarray, "views"]
    """Row among the frames that are evened out."""
    color: UInt8[np.ndarray, "views texels 3"]
    valid: Bool[np.ndarray, "views texels"]


# A recorded value is about gain * true + bias. The priors keep a frame that saw little, or only bare walls, near (1, 0).
GAIN_SIGMA = 0.15
BIAS_SIGMA = 4.0  # grey levels
NOISE_SIGMA = 6.0  # grey levels: noise, misalignment and shine together; also the scale beyond which a sample counts as an outlier
MAX_INFORMATION = 400.0  # samples of one frame are not independent: they share misalignment and shine


def even_out(faces: Sequence[FaceSamples], num_frames: int, *, texels_per_face: int = 600, rounds: int = 5) -> tuple[
    Float[np.ndarray, "frames 3"], Float[np.ndarray, "frames 3"]
]:  # fmt: skip
    """Gain and bias of each frame and channel (recorded = gain * true + bias, grey levels), their averages over the frames being 1 and 0.

    Alternates between the true colours (median over the frames) and each frame's line through them (robust least squares, Cauchy), on a regular
    subset of the texels that at least three views see.
    """
    subsets = [subset for face in faces if (subset := _subset(face, texels_per_face)) is not None]
    gain, bias = np.ones((num_frames, 3)), np.zeros((num_frames, 3))
    for _ in range(rounds if subsets else 0):
        truth = [np.nanmedian((color - bias[frame, None]) / gain[frame, None], axis=0) for frame, color in subsets]
        for k in range(num_frames):
            pairs = [(true, color[view]) for true, (frame, color) in zip(truth, subsets, strict=True) for view in np.flatnonzero(frame == k)]
            if pairs:
                x, y = np.concatenate([true for true, _ in pairs]), np.concatenate([seen for _, seen in pairs])
                for c in range(3):
                    known = np.isfinite(y[:, c])
                    gain[k, c], bias[k, c] = _line(x[known, c], y[known, c], float(gain[k, c]), float(bias[k, c]))
        gain /= gain.mean(axis=0)
        bias -= bias.mean(axis=0)
    return gain, bias


def _subset(face: FaceSamples, size: int) -> tuple[Int[np.ndarray, "views"], Float[np.ndarray, "views texels 3"]] | None:
    shared = np.flatnonzero(face.valid.sum(axis=0) >= 3)
    if len(shared) == 0:
        return None
    pick = shared[:: max(1, len(shared) // size)]
    return face.frame, np.where(face.valid[:, pick, None], face.color[:, pick].astype(np.float64), np.nan)


def _line(x: Float[np.ndarray, "n"], y: Float[np.ndarray, "n"], gain: float, bias: float) -> tuple[float, float]:
    """Robust line y = gain x + bias, one reweighting."""
    if len(x) == 0:
        return gain, bias
    weight = 1.0 / (1.0 + ((y - gain * x - bias) / NOISE_SIGMA) ** 2)
    weight *= min(1.0, MAX_INFORMATION / float(weight.sum())) / NOISE_SIGMA**2
    # Sums, not dot products: threaded ones may add in another order.
    across = (weight * x).sum()
    a = np.array([[(weight * x * x).sum() + GAIN_SIGMA**-2, across], [across, weight.sum() + BIAS_SIGMA**-2]])
    b = np.array([(weight * x * y).sum() + GAIN_SIGMA**-2, (weight * y).sum()])
    solved = np.linalg.solve(a, b)
    return float(np.clip(solved[0], 0.3, 3.0)), float(solved[1])
