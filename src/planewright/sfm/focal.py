"""How sure the focal length is: the cost along it, measured against errors that are not independent."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from planewright.sfm.bundle import Bundle, FocalPrior, Observations, adjust, robust_scale
from planewright.sfm.kernels import reduced_system


@dataclass(frozen=True, kw_only=True)
class FocalOptions:
    """How the interval is found."""

    max_ratio: float = 8.0
    """Focal lengths beyond this multiple of the image's longer side are not told from infinity: the upper end is then open."""
    max_iterations: int = 8
    """Of the adjustment at each focal tried."""
    min_inflation: float = 1.0
    """Errors are never believed better than independent."""


@dataclass(frozen=True, eq=False)
class FocalUncertainty:
    """What the views say of the focal length."""

    sigma: float
    """Pixels."""
    interval: tuple[float, float | None]
    """95 %, pixels; None where nothing bounds it from above."""
    inflation: float
    """Variance of the focal with errors as correlated as they are, over that with independent ones."""


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
    """Standard deviation and 95 % interval of the focal length at the optimum `bundle`."""
    variance, inflation, residual_variance = _log_focal_variance(bundle, seen, scale, radial_terms, prior)
    inflation = max(inflation, options.min_inflation)
    sigma = float(np.sqrt(variance * inflation))
    focal = float(bundle.intrinsics[0])
    best = adjust(bundle, seen, scale=scale, radial_terms=radial_terms, prior=prior, max_iterations=options.max_iterations)
    # 95 %: twice the rise of the cost over the variance of a residual reaches 3.84 (Wilks), with the errors' correlation in the variance.
    limit = best.cost + 0.5 * 3.84 * residual_variance * inflation

    def end(direction: float) -> float | None:
        reached, held, cost_held = 0.0, best.bundle, best.cost
        step = float(np.clip(1.96 * sigma, 1e-4, 0.35))
        farthest = np.log(options.max_ratio * max(image_size) / focal) if direction > 0 else np.log(focal / (0.1 * max(image_size)))
        for _ in range(24):
            if reached >= farthest:
                return None
            at = min(reached + step, max(farthest, step))
            moved = _scale_focal(held, focal * np.exp(direction * at))
            tried = adjust(moved, seen, scale=scale, free_focal=False, radial_terms=radial_terms, prior=prior, max_iterations=options.max_iterations)
            if tried.cost >= limit:
                # The rise is nearly quadratic in the logarithm: the root of a parabola through the last two.
                low, high = np.sqrt(max(cost_held - best.cost, 0.0)), np.sqrt(tried.cost - best.cost)
                part = (np.sqrt(limit - best.cost) - low) / max(high - low, 1e-300)
                return float(focal * np.exp(direction * (reached + part * (at - reached))))
            held, cost_held, reached = tried.bundle, tried.cost, at
            step = min(step, 0.2) if sigma > 0.05 else step * 0.5
        return float(focal * np.exp(direction * reached))

    lower, upper = end(-1.0), end(1.0)
    return FocalUncertainty(sigma=focal * sigma, interval=(lower if lower is not None else 0.0, upper), inflation=inflation)


def _scale_focal(bundle: Bundle, focal: float) -> Bundle:
    values = bundle.intrinsics.copy()
    values[0] = focal
    return Bundle(values, bundle.rotation, bundle.translation, bundle.xyz)


def _log_focal_variance(bundle: Bundle, seen: Observations, scale: float, radial_terms: int, prior: FocalPrior | None) -> tuple[float, float, float]:
    """Variance of log focal with independent errors, its inflation by correlated ones, and the variance of a residual (pixels squared).

    The inflation is that of the sandwich covariance with a cluster a track (Liang and Zeger 1986): a track's errors may be as correlated as they like,
    which they are, since the error of its birth patch is common to all its frames.
    """
    cameras, n = len(bundle.rotation), 3 + 6 * len(bundle.rotation)
    num_points = len(bundle.xyz)
    system, gradient, scores = np.empty((n, n)), np.empty(n), np.zeros((num_points, n))
    b = bundle
    reduced_system(
        b.intrinsics, b.rotation, b.translation, b.xyz, seen.first, seen.camera, seen.xy, scale, 0.0, system, gradient,
        np.empty((len(seen.camera), 9, 3)), np.empty((num_points, 3, 3)), np.empty((num_points, 3)), scores,
    )  # fmt: skip
    if prior:
        system[0, 0] += prior.precision
    # The gauge: the first camera stands still, and so does the largest coordinate of the camera farthest from it.
    centres = -np.einsum("kji,kj->ki", b.rotation, b.translation)
    far = int(np.argmax(np.linalg.norm(centres - centres[0], axis=1)))
    active = np.ones(n, bool)
    active[:3] = [True, radial_terms >= 1, radial_terms >= 2]
    active[3:9] = False
    active[3 + 6 * far + 3 + int(np.argmax(np.abs(b.translation[far] - b.translation[0])))] = far == 0
    del cameras
    use = np.nonzero(active)[0]
    s = system[np.ix_(use, use)]
    s[np.diag_indices_from(s)] += 1e-12 * np.diag(s).max()
    unit = np.zeros(len(use))
    unit[0] = 1.0
    row = scipy.linalg.solve(s, unit, assume_a="sym", check_finite=False)
    x = np.einsum("oij,oj->oi", b.rotation[seen.camera], b.xyz[seen.point]) + b.translation[seen.camera]
    uv = x[:, :2] / x[:, 2:]
    r2 = (uv**2).sum(axis=1, keepdims=True)
    residual = b.intrinsics[1:3] + b.intrinsics[0] * (1 + b.intrinsics[3] * r2 + b.intrinsics[4] * r2**2) * uv - seen.xy
    weight = 1.0 / (1.0 + (residual**2).sum(axis=1) / scale**2)
    freedom = max(2 * len(seen.camera) - 3 * num_points - len(use), 1)
    variance = float((weight * (residual**2).sum(axis=1)).sum() / freedom)
    count = np.maximum(np.diff(seen.first), 2).astype(float)
    # What fitting the point took out of its own residuals.
    pull = (scores[:, use] @ row) * np.sqrt(2 * count / (2 * count - 3))
    naive = float(row[0]) * max(variance, robust_scale(residual) ** 2 * 1e-3)
    return naive, float((pull**2).sum() / naive), variance
