"""Robust losses of whitened residuals, in the form that reweighted least squares needs."""

import numpy as np

from planewright.arrays import Float

# Median of a chi-square variable with one, two and three degrees of freedom.
_CHI2_MEDIAN = (0.454936, 1.386294, 2.365974)


def cauchy(squared: Float[np.ndarray, "terms"], scale: float) -> tuple[Float[np.ndarray, "terms"], Float[np.ndarray, "terms"]]:
    """Loss and weight of squared residuals: scale^2 log(1 + s / scale^2) and its derivative by s.

    Near zero it is s; far out it grows like a logarithm, so that a gross error pulls less the farther it is off.
    With `scale` = infinity it is plain least squares.

    Args:
        squared: squared norms of whitened residuals.
        scale: where the loss bends, in standard deviations.
    """
    if np.isinf(scale):
        return squared, np.ones_like(squared)
    c2 = scale * scale
    ratio = squared / c2
    return c2 * np.log1p(ratio), 1.0 / (1.0 + ratio)


def robust_scale(squared: Float[np.ndarray, "terms"], freedom: Float[np.ndarray, "terms"], size: int) -> float:
    """How many times larger residuals are than they claim, from the median, which half of the terms cannot move.

    Args:
        squared: squared norms of whitened residuals.
        freedom: the share of each residual that the fit left free, 1 - leverage; at least a tenth, say.
        size: numbers in one residual: 1, 2 or 3.
    """
    return float(np.sqrt(np.median(squared / freedom) / _CHI2_MEDIAN[size - 1]))
