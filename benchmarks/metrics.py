"""What is measured: the key of a figure, its unit, which way is better, and how much may change before it counts as a change."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Metric:
    """One figure of a run."""

    key: str
    unit: str
    better: Literal["higher", "lower", "nearer zero"]
    tolerance: float
    """A change up to this much, in the figure's unit, is noise."""
    relative: float = 0.0
    """And so is a change up to this share of the baseline."""

    def worsening(self, baseline: float, now: float) -> float:
        """How much worse the figure is than the baseline, in its unit; negative where it is better."""
        if self.better == "higher":
            return baseline - now
        return now - baseline if self.better == "lower" else abs(now) - abs(baseline)

    def slack(self, baseline: float) -> float:
        """The worsening that is still noise."""
        return self.tolerance + self.relative * abs(baseline)


METRICS = (
    Metric("status_as_expected", "0 or 1", "higher", 0.0),
    Metric("within_2px_pct", "%", "higher", 0.5),
    Metric("within_5px_pct", "%", "higher", 0.5),
    Metric("rmse_px", "px", "lower", 0.05, 0.1),
    Metric("median_px", "px", "lower", 0.02, 0.05),
    Metric("visibility_f1", "", "higher", 0.003),
    Metric("hidden_f1", "", "higher", 0.01),
    Metric("coverage95_pct", "%", "higher", 1.0),
    Metric("without_sigma", "entries", "lower", 0.0),
    Metric("sigma_median_px", "px", "lower", 0.05, 0.1),
    Metric("focal_error_pct", "%", "nearer zero", 0.02, 0.2),
    Metric("cameras_pct", "%", "higher", 0.0),
    Metric("ate_pct", "% of the scene", "lower", 0.005, 0.2),
    Metric("rotation_median_deg", "degrees", "lower", 0.002, 0.2),
    Metric("rotation_max_deg", "degrees", "lower", 0.01, 0.2),
    Metric("points_pct", "%", "higher", 0.0),
    Metric("corner_rms_pct", "% of the scene", "lower", 0.02, 0.1),
    Metric("corner_max_pct", "% of the scene", "lower", 0.05, 0.2),
    Metric("faces_pct", "%", "higher", 0.0),
    Metric("faces_found_f1", "", "higher", 0.0),
    Metric("normal_mean_deg", "degrees", "lower", 0.02, 0.1),
    Metric("normal_max_deg", "degrees", "lower", 0.05, 0.2),
    Metric("offset_median_pct", "% of the scene", "lower", 0.01, 0.2),
    Metric("planarity_max", "of the scene", "lower", 1e-12),
    Metric("relation_residual_max", "rad", "lower", 1e-12),
    Metric("parallel_precision", "", "higher", 0.0),
    Metric("parallel_recall", "", "higher", 0.0),
    Metric("orthogonal_precision", "", "higher", 0.0),
    Metric("orthogonal_recall", "", "higher", 0.0),
    Metric("coplanar_precision", "", "higher", 0.0),
    Metric("coplanar_recall", "", "higher", 0.0),
    Metric("near_misses_enforced", "pairs", "lower", 0.0),
    Metric("angles_pct", "%", "higher", 0.0),
    Metric("angle_error_median_deg", "degrees", "lower", 0.1, 0.2),
    Metric("angle_error_max_deg", "degrees", "lower", 0.2, 0.2),
    Metric("length_error_median_pct", "%", "lower", 0.2, 0.2),
    Metric("length_error_max_pct", "%", "lower", 0.5, 0.2),
    # A shared machine runs up to 1.5 times as long from one day to the next.
    Metric("seconds", "s", "lower", 2.0, 0.5),
    Metric("peak_memory_mb", "MB", "lower", 50.0, 0.15),
)

BY_KEY = {metric.key: metric for metric in METRICS}


def number(value: object) -> float | None:
    """A figure as a number: counts written `2/15` are their first part; None where there is none."""
    if isinstance(value, str):
        head, slash, _ = value.partition("/")
        return float(head) if slash and head.isdigit() else None
    return float(value) if isinstance(value, int | float) else None
