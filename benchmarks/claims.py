"""What planewright claims of its tracks: a figure, a limit for each group of clips, and how figures of several clips are judged together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Claim:
    """One row of the table."""

    key: str
    title: str
    judged: Literal["each clip", "all together", "median of clips", "largest of clips"]
    """What the limit is held to. `all together` pools the rows of all clips before the figure is taken."""
    at_most: Mapping[str, float]
    """Group -> limit; a group that is not named is shown and not judged."""
    at_least: Mapping[str, float]
    digits: int = 2

    def goal(self, group: str) -> str:
        """The limits of a group in words."""
        low, high = self.at_least.get(group), self.at_most.get(group)
        if low is not None and high is not None:
            return f"{low:g} to {high:g}"
        if low is not None:
            return f">= {low:g}"
        return "" if high is None else f"<= {high:g}"

    def holds(self, group: str, value: float | None) -> bool | None:
        """Whether a figure keeps the limits; None where nothing is claimed of it. A figure that should be there and is not does not hold."""
        low, high = self.at_least.get(group), self.at_most.get(group)
        if low is None and high is None:
            return None
        return value is not None and (low is None or value >= low) and (high is None or value <= high)

    def verdict(self, group: str, clips: Sequence[float | None], pooled: float | None) -> bool | None:
        """Whether the claim holds for a group: the figures of its clips, and of all their rows together."""
        known = [c for c in clips if c is not None]
        match self.judged:
            case "each clip":
                held = [self.holds(group, c) for c in clips]
                return None if None in held else all(held) and bool(clips)
            case "all together":
                return self.holds(group, pooled)
            case "median of clips":
                return self.holds(group, float(np.median(known)) if len(known) == len(clips) and known else None)
            case "largest of clips":
                return self.holds(group, max(known) if len(known) == len(clips) and known else None)


CLAIMS = (
    Claim("rmse_px", "corner RMSE, px", "each clip", {"twin": 0.9, "hard": 2.0}, {}),
    Claim("median_px", "median error, px", "each clip", {"twin": 0.4, "hard": 0.8, "recorded": 1.1}, {}),
    Claim("within_1px_pct", "within 1 px, %", "each clip", {}, {}, 1),
    Claim("within_2px_pct", "within 2 px, %", "each clip", {}, {"twin": 97.0, "hard": 90.0}, 1),
    Claim("within_3px_pct", "within 3 px, %", "each clip", {}, {"recorded": 97.0}, 1),
    Claim("within_5px_pct", "within 5 px, %", "each clip", {}, {"twin": 99.5, "hard": 97.0}, 1),
    Claim("good_corners_pct", "corners with median <= 2 px, %", "all together", {}, {"twin": 98.0, "hard": 92.0}, 1),
    Claim("corrections", "corrections, worst error first (median)", "median of clips", {"twin": 0.0, "hard": 3.0}, {}, 0),
    Claim("corrections_max", "the same (largest)", "largest of clips", {"twin": 2.0}, {}, 0),
    Claim("corrections_listed", "corrections, our list followed", "median of clips", {}, {}, 0),
    Claim("visibility_f1", "visibility F1", "each clip", {}, {"twin": 0.98, "hard": 0.93}, 3),
    Claim("hidden_f1", "hidden F1", "each clip", {}, {"twin": 0.85, "hard": 0.65}, 3),
    Claim("coverage95_pct", "inside the claimed 95 % circle, %", "each clip", {"twin": 99.0, "hard": 99.0}, {"twin": 88.0, "hard": 80.0}, 1),
    Claim("sigma_median_px", "median sigma, px", "each clip", {"twin": 0.8}, {}),
    Claim("without_sigma", "measured entries without sigma", "each clip", {"twin": 0.0, "hard": 0.0, "recorded": 0.0}, {}, 0),
    Claim("ms_per_frame", "clip to tracks, ms a frame", "all together", {"twin": 100.0}, {}, 0),
)
"""In the order of the table."""

BASELINE_ROWS = ("rmse_px", "median_px", "within_1px_pct", "within_2px_pct", "within_5px_pct", "good_corners_pct")
"""What is measured of the baselines: they say nothing of visibility or of their own errors."""
