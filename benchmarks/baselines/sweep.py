"""From marks to whole tracks, for any way of stepping from one frame to its neighbour."""

from collections.abc import Callable, Sequence

import numpy as np

from planewright.arrays import Float, GrayImage
from planewright.sketch.graph import Sketch

Step = Callable[[GrayImage, GrayImage, Float[np.ndarray, "points 2"]], Float[np.ndarray, "points 2"]]
"""(a frame, its neighbour, where the sketch's points are in the first) -> where they are in the second. NaN where a point is not known, or is lost."""

Paths = Float[np.ndarray, "points frames 2"]
"""Pixels of each of the sketch's points in each frame, NaN where nothing is claimed; the centre of the top-left pixel is (0.5, 0.5)."""


def sweep(images: Sequence[GrayImage], sketch: Sketch, step: Step, *, together: bool = False) -> Paths:
    """Every point followed from each of its marks both ways; where two marks compete the nearer one counts.

    Args:
        images: all frames in order. A mark puts its point right, so that what lies behind it starts anew from there.
        step: carries points over by one frame.
        together: points help each other. A point that is marked in frame 90 then stands, from its first frame on, beside neighbours that were marked in
            frame 0: the clip is swept a second time with all points in place.
    """
    marks: list[dict[int, tuple[float, float]]] = [dict(point.marks) for point in sketch.points]
    nobody = np.full((len(marks), len(images), 2), np.nan)
    paths = _both_ways(images, marks, step, nobody)
    if together and len({frame for at in marks for frame in at}) > 1:
        paths = _both_ways(images, marks, step, paths)
    return paths


def _both_ways(images: Sequence[GrayImage], marks: Sequence[dict[int, tuple[float, float]]], step: Step, others: Paths) -> Paths:
    forwards, backwards = (_one_way(images, marks, step, others, way) for way in (1, -1))
    frames = np.arange(len(images))
    for p, at in enumerate(marks):
        if at:
            known = np.array(sorted(at))
            since = np.array([(k - known[known <= k]).min(initial=len(images)) for k in frames])
            until = np.array([(known[known >= k] - k).min(initial=len(images)) for k in frames])
            take = until < since
            forwards[p, take] = backwards[p, take]
    return forwards


def _one_way(images: Sequence[GrayImage], marks: Sequence[dict[int, tuple[float, float]]], step: Step, others: Paths, way: int) -> Paths:
    paths = np.full((len(marks), len(images), 2), np.nan)
    here = np.full((len(marks), 2), np.nan)
    order = range(len(images)) if way == 1 else range(len(images) - 1, -1, -1)
    for done, k in enumerate(order):
        known = np.isfinite(here[:, 0])
        if done and known.any():
            moved = step(images[k - way], images[k], np.where(known[:, None], here, others[:, k - way]))
            here = np.where(known[:, None], moved, np.nan)
        for p, at in enumerate(marks):
            if k in at:
                here[p] = at[k]
        paths[:, k] = here
    return paths
