"""Where points of one frame are in the next, and how far the way back misses them."""

import cv2
import numpy as np

from planewright.arrays import Float, GrayImage

ROUND_TRIP = 1.0
"""Pixels there and back beyond which a flow vector counts as wrong: the usual limit for features that are to be followed over many frames."""


def flow(old: GrayImage, new: GrayImage, points: Float[np.ndarray, "n 2"], window: int = 21) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
    """Pyramidal Lucas-Kanade (Bouguet 2001), three levels above the image: pixels in the new frame, and the round trip's error in pixels (inf where lost)."""
    if not len(points):
        return np.zeros((0, 2)), np.zeros(0)
    start = points.astype(np.float32)[:, None] - np.float32(0.5)  # OpenCV puts (0, 0) at the centre of the first pixel
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01)
    side = (window, window)
    there, ok, _ = cv2.calcOpticalFlowPyrLK(old, new, start, np.empty_like(start), winSize=side, maxLevel=3, criteria=stop)
    back, ok_back, _ = cv2.calcOpticalFlowPyrLK(new, old, there, np.empty_like(start), winSize=side, maxLevel=3, criteria=stop)
    error = np.linalg.norm((back - start).reshape(-1, 2).astype(np.float64), axis=1)
    good = (ok.ravel() > 0) & (ok_back.ravel() > 0) & np.isfinite(error)
    return there.reshape(-1, 2).astype(np.float64) + 0.5, np.where(good, error, np.inf)
