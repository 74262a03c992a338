"""How sure the focal length is: the cost along it, measured against errors that are not independent."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.special

from planewright.arrays import Float, Int
from planewright.geometry.rigid import rotations_from_vectors
from planewright.sfm.bundle import Adjusted, Bundle, FocalPrior, Observations, adjust
from planewright.sfm.kernels import SHARED, observation_pulls, reduced_system, robust_cost


@dataclass(frozen=True, kw_only=True)
class FocalOptions:
    """How the interval is found."""

    max_ratio: float = 20.0
    """Focal lengths beyond this multiple of the image's longer side are not told from infinity: the upper end is then open."""
    max_iterations: int = 8
    """Of the adjustment at each focal tried."""
    principal_point_sigma: float = 0.005
    """How far the principal point may be from the image's centre (1 sigma), as a fraction of the longer side.
    Lenses that shift to steady the picture move it so much."""
    place_cells: tuple[int, int] = (8, 5)
    """Grid over the image whose cells may err together: what the lens model and a rolling shutter leave behind."""
    stretches: int = 10
    """Parts of the clip that may err together."""


@dataclass(frozen=True, eq=False)
class FocalUncertainty:
    """What the views say of the focal length."""

    sigma: float
    """Pixels."""
    interval: tuple[float, float | None]
    """95 %, pixels; None where nothing bounds it from above."""
    inflation: float
    """Variance of the focal with errors as correlated as they are, over that with independent ones."""


@dataclass(frozen=True, eq=False)
class _Spread:
    """Variances at the optimum; those of log focal have no unit, that of a residual is in pixels squared."""

    independent: float
    inflation: float
    residual: float
    quantile: float
    """Of 95 %, in standard deviations: Student's, since few clusters tell their own spread badly."""


def focal_uncertainty(
    bundle: Bundle,
    seen: Observations,
    *,
    scale: float,
    radial_terms: int,
    image_size: tuple[int, int],
    prior: FocalPrior | None,
    options: FocalOptions = FocalOptions(),
) -> FocalUncertainty:
    """Standard deviation and 95 % interval of the focal length at the optimum `bundle`.

    The interval ends where the cost, with all else adjusted again, has risen by what chance explains in 5 % of clips (Wilks), the errors' correlation and
    the unknown principal point taken into account. It may be lopsided.
    """
    best = adjust(bundle, seen, scale=scale, radial_terms=radial_terms, prior=prior, max_iterations=options.max_iterations)
    spread = _spread(best.bundle, seen, scale, radial_terms, image_size, prior, options)
    centre = _centre_variance(best.bundle, best.cost, seen, scale, radial_terms, spread, image_size, prior, options)
    variance = spread.independent * spread.inflation + centre
    sigma, focal = float(np.sqrt(variance)), float(best.bundle.intrinsics[0])
    allowed = 0.5 * spread.quantile**2 * spread.residual * variance / spread.independent

    def end(direction: float) -> float | None:
        reached, held, rise = 0.0, best.bundle, 0.0
        step = float(np.clip(spread.quantile * sigma, 1e-4, 0.35))
        span = options.max_ratio * max(image_size) / focal if direction > 0 else focal / (0.1 * max(image_size))
        farthest = max(float(np.log(span)), step)
        while reached < farthest:
            at = min(reached + step, farthest)
            moved = with_focal(held, focal * np.exp(direction * at))
            tried = adjust(
                moved, seen, scale=scale, free_focal=False, radial_terms=radial_terms, prior=prior, max_iterations=options.max_iterations, tolerance=1e-5
            )
            fresh = tried.cost - best.cost
            if fresh >= allowed:
                # Near the end the root of the rise is close to linear in the logarithm of the focal.
                low, high = np.sqrt(max(rise, 0.0)), np.sqrt(fresh)
                return float(focal * np.exp(direction * (reached + (np.sqrt(allowed) - low) / (high - low) * (at - reached))))
            held, rise, reached = tried.bundle, fresh, at
            step = max(0.5 * step, 0.02)
        return None

    lower, upper = end(-1.0), end(1.0)
    return FocalUncertainty(sigma=focal * sigma, interval=(0.0 if lower is None else lower, upper), inflation=variance / spread.independent)


def settle_focal(
    best: Adjusted, seen: Observations, *, scale: float, radial_terms: int, prior: FocalPrior | None, limit: float, ratio: float = 1.25, max_hops: int = 8
) -> Adjusted:
    """Hops of the focal length, up to `limit` pixels, for as long as they lower the cost: nearly affine clips have a valley along which descent creeps."""
    for factor in (ratio, 1 / ratio):
        for _ in range(max_hops):
            focal = best.bundle.intrinsics[0] * factor
            if focal > limit:
                break
            start = with_focal(best.bundle, float(focal))
            tried = adjust(start, seen, scale=scale, radial_terms=radial_terms, prior=prior, max_iterations=12, tolerance=1e-7)
            if tried.cost >= best.cost * (1 - 1e-6):
                break
            best = tried
    return best


def with_focal(bundle: Bundle, focal: float) -> Bundle:
    """The focal changed and the cameras moved along their axes, so that the picture in the middle keeps its size: a start close to the new optimum."""
    ratio = focal / bundle.intrinsics[0]
    values = bundle.intrinsics.copy()
    values[0] = focal
    values[3:] *= [ratio**2, ratio**4]
    depth = np.array([np.median(bundle.xyz @ r[2]) for r in bundle.rotation]) + bundle.translation[:, 2]
    translation = bundle.translation.copy()
    translation[:, 2] += (ratio - 1.0) * depth
    return Bundle(values, bundle.rotation, translation, bundle.xyz)


def _spread(
    b: Bundle, seen: Observations, scale: float, radial_terms: int, image_size: tuple[int, int], prior: FocalPrior | None, options: FocalOptions
) -> _Spread:
    """Sandwich covariance (Liang and Zeger 1986) of log focal, with clusters of observations that may err together as they like.

    Three kinds of clusters, the worst counts: a track (the error of its birth patch is common to all its frames), a place in the image (what the lens
    model leaves), a stretch of the clip (a rolling shutter under one motion). Measured inflation: rendered clips 3 by tracks and 1 by stretches, phone
    clips 3 by tracks and up to 11 by stretches.
    """
    n = SHARED + 6 * len(b.rotation)
    num_points, num_obs = len(b.xyz), len(seen.camera)
    system, gradient = np.empty((n, n)), np.empty(n)
    cross, inverse = np.empty((num_obs, SHARED + 6, 3)), np.empty((num_points, 3, 3))
    reduced_system(
        b.intrinsics, b.rotation, b.translation, b.xyz, seen.first, seen.camera, seen.xy, np.zeros((0, 2)), scale, 0.0, system, gradient, cross, inverse,
        np.empty((num_points, 3)),
    )  # fmt: skip
    if prior:
        system[0, 0] += prior.precision
    use = _gauge_fixed(b, radial_terms)
    s = system[np.ix_(use, use)]
    s[np.diag_indices_from(s)] += 1e-12 * np.diag(s).max()
    unit = np.zeros(len(use))
    unit[0] = 1.0
    direction = np.zeros(n)
    direction[use] = scipy.linalg.solve(s, unit, assume_a="sym", check_finite=False)

    residual, pulls = np.empty((num_obs, 2)), np.empty(num_obs)
    point = seen.point
    robust_cost(b.intrinsics, b.rotation, b.translation, b.xyz, seen.camera, point, seen.xy, scale, residual)
    squared = (residual**2).sum(axis=1)
    variance = float((squared / (1 + squared / scale**2)).sum()) / max(2 * num_obs - 3 * num_points - len(use), 1)
    independent = float(direction[0]) * variance
    observation_pulls(b.intrinsics, b.rotation, b.translation, b.xyz, seen.first, seen.camera, seen.xy, scale, direction, cross, inverse, pulls)
    # What fitting a point took out of its own residuals.
    count = np.maximum(np.diff(seen.first), 2)
    pulls *= np.sqrt(2 * count / (2 * count - 3))[point]

    columns, rows = options.place_cells
    birth = seen.xy[seen.first[:-1]] / image_size * options.place_cells
    cell = np.clip(birth[:, 0].astype(np.intp), 0, columns - 1) * rows + np.clip(birth[:, 1].astype(np.intp), 0, rows - 1)
    stretch = seen.camera * min(options.stretches, len(b.rotation)) // len(b.rotation)
    clustered, clusters = max(_clustered(pulls, of) for of in (point, cell[point], stretch))
    quantile = float(scipy.special.stdtrit(max(clusters - 1, 1), 0.975))
    return _Spread(independent=independent, inflation=max(clustered / independent, 1.0), residual=variance, quantile=quantile)


def _clustered(pulls: Float[np.ndarray, "obs"], clusters: Int[np.ndarray, "obs"]) -> tuple[float, int]:
    """Variance of the sum of pulls when only different clusters are independent, and how many clusters there are."""
    present = int((np.bincount(clusters) > 0).sum())
    return float((np.bincount(clusters, pulls) ** 2).sum()) * present / max(present - 1, 1), present


def _gauge_fixed(b: Bundle, radial_terms: int) -> Int[np.ndarray, "unknowns"]:
    """The unknowns without the first camera's, and without the coordinate that moves the camera farthest from it most."""
    centres = -np.einsum("kji,kj->ki", b.rotation, b.translation)
    far = int(np.argmax(np.linalg.norm(centres - centres[0], axis=1)))
    baseline = b.translation[far] - b.rotation[far] @ b.rotation[0].T @ b.translation[0]
    active = np.ones(SHARED + 6 * len(b.rotation), bool)
    active[1:SHARED] = [radial_terms >= 1, radial_terms >= 2, False]
    active[SHARED : SHARED + 6] = False
    if far:
        active[SHARED + 6 * far + 3 + int(np.argmax(np.abs(baseline)))] = False
    return np.nonzero(active)[0]


def _centre_variance(
    b: Bundle,
    cost: float,
    seen: Observations,
    scale: float,
    radial_terms: int,
    spread: _Spread,
    image_size: tuple[int, int],
    prior: FocalPrior | None,
    options: FocalOptions,
) -> float:
    """Variance of log focal from the principal point, which is assumed to be in the centre: its own variance (prior and views) times the slope squared."""
    sigma = options.principal_point_sigma * max(image_size)
    total = 0.0
    for axis in (0, 1):
        logs, costs = np.zeros(2), np.zeros(2)
        for k, shift in enumerate((-sigma, sigma)):
            values = b.intrinsics.copy()
            values[1 + axis] += shift
            # A turn of the cameras makes up for most of the shift, so a few iterations settle the rest.
            omega = np.array([0.0, -shift, 0.0] if axis == 0 else [shift, 0.0, 0.0]) / b.intrinsics[0]
            turn = rotations_from_vectors(omega[None])[0]
            start = Bundle(values, turn @ b.rotation, b.translation @ turn.T, b.xyz)
            moved = adjust(start, seen, scale=scale, radial_terms=radial_terms, prior=prior, max_iterations=options.max_iterations, tolerance=1e-5)
            logs[k], costs[k] = np.log(moved.bundle.intrinsics[0]), moved.cost
        curvature = max(float(costs.sum()) - 2 * cost, 0.0) / sigma**2
        known = curvature / (spread.residual * spread.inflation)
        total += ((logs[1] - logs[0]) / (2 * sigma)) ** 2 / (known + 1 / sigma**2)
    return float(total)
