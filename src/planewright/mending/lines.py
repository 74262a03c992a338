"""The edges at a point in some frames, as the images show them: what guides a path besides the look of its surroundings."""

from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Float, GrayImage


@dataclass(frozen=True, kw_only=True)
class LineOptions:
    """How edges are looked for at a point."""

    reach: float = 40.0
    """An edge is looked at up to this far from the point, pixels, and never beyond its middle."""
    least: float = 12.0
    """Shorter pieces say nothing."""
    aside: float = 8.0
    """Half the width of the strip across it, pixels: half of a path's largest window."""
    spacing: float = 2.0
    """Of the samples along it, pixels."""
    near: float = 4.0
    """Standard deviation of where the edge is thought to be, pixels."""
    stands_out: float = 2.0
    """The steepest line must be this many times as steep as the strip's median."""


def lines_at(
    image: GrayImage, place: Float[np.ndarray, "2"], ends: Float[np.ndarray, "edges 2"], options: LineOptions = LineOptions()
) -> Float[np.ndarray, "edges 4"]:
    """Lines along the edges from a point to some others: unit normal, offset (normal . x = offset, pixels) and weight; weight 0 where none is found.

    A line is looked for that runs to the other end, from somewhere beside `place`: the strip narrows towards the end, where nothing is open. (Parallel to
    the edge as it is thought to run, a line 4 px beside the point of an edge of 90 px was read 1 px too near.)

    Args:
        place: where the point is thought to be, pixels.
        ends: the other ends of its edges; NaN where one is not known.
    """
    out = np.zeros((len(ends), 4))
    aside = np.arange(-options.aside, options.aside + 0.5, 0.5)
    for e, end in enumerate(ends):
        along = end - place
        length = float(np.linalg.norm(along))
        reach = min(options.reach, 0.5 * length)
        if not np.isfinite(length) or reach < options.least:
            continue
        along = along / length
        normal = np.array([-along[1], along[0]])
        # Not right at the point: other edges meet there.
        steps = np.arange(3.0, reach, options.spacing)
        fan = aside[None, :] * (1.0 - steps[:, None] / length)
        at = (place - 0.5)[None, None] + steps[:, None, None] * along + fan[..., None] * normal
        strip = cv2.remap(image, at[..., 0].astype(np.float32), at[..., 1].astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(
            np.float64
        )
        height, width = image.shape
        inside = (at[..., 0] >= 0) & (at[..., 0] <= width - 1) & (at[..., 1] >= 0) & (at[..., 1] <= height - 1)
        if inside.mean() < 0.8:
            continue
        # Averaged along the edge first: what is not a line cancels.
        mean = cv2.GaussianBlur(strip.mean(axis=0)[None], (0, 0), 1.5).ravel()
        steep = np.abs(np.gradient(mean))
        usual = max(float(np.median(steep)), 0.2)
        score = np.where(steep > options.stands_out * usual, np.log(np.maximum(steep, 1e-9) / usual) - 0.5 * (aside / options.near) ** 2, -np.inf)
        k = int(np.argmax(score))
        if not np.isfinite(score[k]) or k in (0, len(aside) - 1):
            continue
        bend = steep[k - 1] - 2.0 * steep[k] + steep[k + 1]
        top = 0.5 * (steep[k - 1] - steep[k + 1]) / bend if bend < 0 else 0.0
        start = place + (aside[k] + 0.5 * float(np.clip(top, -0.5, 0.5))) * normal
        across = np.array([start[1] - end[1], end[0] - start[0]])
        across /= np.linalg.norm(across)
        out[e] = *across, float(across @ end), 1.0 - options.stands_out * usual / float(steep[k])
    return out
