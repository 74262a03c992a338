"""A path settled between two anchors: pulled to places as the images say them, and by steps as the traces say them."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from planewright.arrays import Float


@dataclass(frozen=True, kw_only=True)
class SettleOptions:
    """What is believed how much."""

    place_sigma: float = 0.6
    """Standard deviation of a place on the path, pixels; a place further off counts less and less (Geman and McClure's loss)."""
    step_sigma: float = 0.15
    """Standard deviation of a step of the traces, pixels a frame."""
    iterations: int = 8
    """Reweighted solutions."""


def settle_path(
    places: Float[np.ndarray, "frames 2"],
    steps: Float[np.ndarray, "steps 2"],
    step_weights: Float[np.ndarray, "steps"],
    options: SettleOptions = SettleOptions(),
) -> tuple[Float[np.ndarray, "frames 2"], Float[np.ndarray, "frames"]]:
    """The path of least sum of squares, and its standard deviation an axis (pixels); the first and the last place stay.

    The system is tridiagonal, so time is linear in the number of frames; both axes share it.

    Args:
        steps: motion from each frame to the next.
        step_weights: trust in each step, from 0 to 1.
    """
    count = len(places)
    if count < 3:
        return places.copy(), np.zeros(count)
    stiffness = step_weights / options.step_sigma**2
    # Where nothing trusts a step it still is no leap: a hundredth of a trusted one keeps the system regular.
    stiffness = np.maximum(stiffness, 0.01 / options.step_sigma**2)
    path = places.copy()
    weight = np.ones(count)
    for _ in range(options.iterations):
        pull = weight / options.place_sigma**2
        right = pull[:, None] * places
        right[1:] += stiffness[:, None] * steps
        right[:-1] -= stiffness[:, None] * steps
        inner = right[1:-1].copy()
        inner[0] += stiffness[0] * places[0]
        inner[-1] += stiffness[-1] * places[-1]
        diagonal = (pull[1:-1] + stiffness[:-1] + stiffness[1:]).copy()
        # SciPy's banded solver takes no system of one unknown.
        path[1:-1] = solveh_banded(np.stack([np.concatenate([[0.0], -stiffness[1:-1]]), diagonal]), inner) if count > 3 else inner / diagonal[:, None]
        off = ((path - places) ** 2).sum(axis=1) / (2.0 * options.place_sigma) ** 2
        weight = 1.0 / (1.0 + off) ** 2
    return path, _sigmas(weight / options.place_sigma**2, stiffness)


def _sigmas(pull: Float[np.ndarray, "frames"], stiffness: Float[np.ndarray, "steps"]) -> Float[np.ndarray, "frames"]:
    """Square roots of the diagonal of the inverse of the tridiagonal information, by elimination from both ends."""
    count = len(pull)
    ahead, behind = np.zeros(count), np.zeros(count)
    ahead[1], behind[-2] = stiffness[0], stiffness[-1]
    # What the frames on one side say about a frame: their information passed on through a step, like conductors in series.
    for k in range(2, count - 1):
        there = ahead[k - 1] + pull[k - 1]
        ahead[k] = there * stiffness[k - 1] / (there + stiffness[k - 1])
    for k in range(count - 3, 0, -1):
        there = behind[k + 1] + pull[k + 1]
        behind[k] = there * stiffness[k] / (there + stiffness[k])
    information = ahead + behind + pull
    information[[0, -1]] = np.inf
    return 1.0 / np.sqrt(information)
