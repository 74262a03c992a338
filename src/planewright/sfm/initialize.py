"""The focal length and the first cameras: a profile over focal lengths, each tried on a pair and a few keyframes around it."""

from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Bool, Float
from planewright.progress import Progress, silent, steps
from planewright.sfm.bundle import FocalPrior
from planewright.sfm.growth import Growth, GrowthOptions, KeyframeTable, adjust_growth, grow, restrict, start_pair


@dataclass(frozen=True, kw_only=True)
class StartOptions:
    """How the first cameras are found."""

    focals: tuple[float, ...] = (0.42, 0.52, 0.65, 0.8, 1.0, 1.25, 1.55, 1.95, 2.5, 3.3, 4.6, 7.0)
    """Tried, as multiples of the image's longer side. A step of 1.25 costs 1.1 to 2.8 times the best, so no minimum is missed in between."""
    extra_keyframes: int = 5
    """Posed beside the pair: two views alone hardly tell the focal of an orbit."""
    refine: int = 2
    """How many of the best focals are followed with the focal free."""
    max_points: int = 300
    """Tracks used for the profile."""
    pairs: int = 4
    """Pairs tried where the best does not start."""


@dataclass(frozen=True, eq=False)
class Start:
    """First cameras, and how the focal lengths compared."""

    growth: Growth
    focals: Float[np.ndarray, "n"]
    costs: Float[np.ndarray, "n"]
    """Mean Cauchy cost an observation at each focal tried, pixels squared; inf where nothing came of it."""


def find_start(
    table: KeyframeTable,
    pairs: tuple[tuple[int, int], ...],
    image_size: tuple[int, int],
    growth_options: GrowthOptions,
    *,
    prior: FocalPrior | None,
    options: StartOptions = StartOptions(),
    seed: int,
    progress: Progress = silent,
) -> Start | None:
    """First cameras from the best pair that starts at all; None where none does."""
    size, centre = max(image_size), np.array(image_size) / 2
    focals = np.array(options.focals) * size if prior is None else np.exp(prior.log_focal) * np.array([0.9, 1.0, 1.1])
    small = replace(growth_options, max_points=options.max_points)
    for a, b in pairs[: options.pairs]:
        judged = neighbours(table, a, b, options.extra_keyframes)
        tried: list[tuple[float, int, Growth]] = []
        costs = np.full(len(focals), np.inf)
        for k, focal in enumerate(steps(focals, "Trying focal lengths", progress)):
            values = np.array([focal, *centre, 0.0, 0.0])
            growth = start_pair(table, a, b, values, small, seed)
            if growth is None:
                continue
            growth = adjust_growth(growth, table, small, free_focal=False, update_scale=False)
            growth = grow(growth, table, replace(small, adjust_every=100), free_focal=False, seed=seed, max_new=options.extra_keyframes)
            costs[k] = mean_cost(growth, table, judged, growth_options.start_scale)
            tried.append((costs[k], k, growth))
        if not tried:
            continue
        tried.sort(key=lambda entry: (entry[0], entry[1]))
        refined: list[tuple[float, int, Growth]] = []
        for _, k, growth in tried[: options.refine]:
            free = adjust_growth(
                replace(growth, scale=growth_options.start_scale), table, small, free_focal=True, prior=prior, max_iterations=25, update_scale=False
            )
            refined.append((mean_cost(free, table, judged, growth_options.start_scale), k, free))
        refined.sort(key=lambda entry: (entry[0], entry[1]))
        return Start(growth=refined[0][2], focals=focals, costs=costs)
    return None


def neighbours(table: KeyframeTable, a: int, b: int, extra: int) -> Bool[np.ndarray, "keyframes"]:
    """The pair and the `extra` keyframes that see most of the tracks it shares: on these every focal is judged, posed there or not."""
    point, camera = table.seen.point, table.seen.camera
    both = np.zeros(len(table.track), np.intp)
    np.add.at(both, point[(camera == a) | (camera == b)], 1)
    counts = np.bincount(camera[both[point] == 2], minlength=table.num_keyframes)
    counts[[a, b]] = counts.max() + 1
    chosen = np.zeros(table.num_keyframes, bool)
    chosen[np.argsort(-counts, kind="stable")[: extra + 2]] = True
    return chosen


def mean_cost(growth: Growth, table: KeyframeTable, judged: Bool[np.ndarray, "keyframes"], scale: float) -> float:
    """Mean Cauchy cost an observation over the keyframes in `judged`.

    A track without a point and a keyframe without a pose count as 3 scales off: a wrong focal that poses only the pair fits it perfectly.
    """
    seen, kept = restrict(table.seen, np.ones(len(table.track), bool), judged)
    point = seen.point
    x = np.einsum("oij,oj->oi", growth.rotation[judged][seen.camera], growth.xyz[kept[point]]) + growth.translation[judged][seen.camera]
    x[~growth.posed[judged][seen.camera]] = np.nan
    with np.errstate(invalid="ignore", divide="ignore"):
        residual = growth.values[1:3] + growth.values[0] * x[:, :2] / x[:, 2:] - seen.xy
        r2 = np.where(x[:, 2] > 1e-9, (residual**2).sum(axis=1), np.nan)
    r2 = np.where(np.isfinite(r2), r2, (3 * scale) ** 2)[(np.diff(seen.first) >= 2)[point]]
    return float(0.5 * scale**2 * np.log1p(r2 / scale**2).mean()) if len(r2) else np.inf
