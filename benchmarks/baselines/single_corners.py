"""Each corner by itself: pyramidal Lucas-Kanade from frame to frame."""

import cv2
import numpy as np

from benchmarks.baselines.sweep import Step
from planewright.arrays import Float, GrayImage
from planewright.sketch.graph import Sketch
from planewright.synthetic.difficulty import FollowOptions


def single_corners(sketch: Sketch, options: FollowOptions = FollowOptions()) -> Step:
    """Bouguet's pyramidal Lucas-Kanade (2001), no check and no restart: the figure that `planewright.synthetic.clip_difficulty` reports."""
    del sketch
    side = (options.window, options.window)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01)

    def step(old: GrayImage, new: GrayImage, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
        moved = np.full_like(points, np.nan)
        known = np.flatnonzero(np.isfinite(points[:, 0]))
        if len(known):
            start = points[known].astype(np.float32)[:, None] - np.float32(0.5)
            end, ok, _ = cv2.calcOpticalFlowPyrLK(old, new, start, np.empty_like(start), winSize=side, maxLevel=options.levels, criteria=stop)
            good = ok.ravel() > 0
            moved[known[good]] = end.reshape(-1, 2)[good] + 0.5
        return moved

    return step
