"""New corners for a frame: the strongest in each grid cell, away from those already followed."""

from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Bool, Float, GrayImage


@dataclass(frozen=True, kw_only=True)
class DetectOptions:
    """How corners are chosen."""

    max_corners: int = 700
    """Corners alive at the same time; the camera solve gains nothing measurable beyond (500 lose 15 % in rotation)."""
    cells: int = 160
    """Cells of the grid that spreads the corners over the image."""
    min_distance: int = 10
    """Pixels between corners, at the working resolution."""
    quality: float = 2e-3
    """Smallest eigenvalue of the structure tensor, as a fraction of the 90th percentile over the cells' best (a few overlaid letters cannot raise it)."""
    margin: int = 10
    """Pixels kept free along the border: half a patch and its smoothing."""


def detect_corners(
    gray: GrayImage, alive: Float[np.ndarray, "alive 2"], options: DetectOptions = DetectOptions(), *, allowed: Bool[np.ndarray, "height width"] | None = None
) -> Float[np.ndarray, "new 2"]:
    """New corners (whole pixels, centres at integers), strongest first, so that each cell holds its share together with those `alive`.

    Shi and Tomasi, "Good features to track" (1994): the smaller eigenvalue of the structure tensor. `allowed` confines the new corners.
    """
    height, width = gray.shape
    cell = max(float(np.sqrt(width * height / options.cells)), 2.0 * options.min_distance)
    columns, rows = int(np.ceil(width / cell)), int(np.ceil(height / cell))
    capacity = int(np.ceil(options.max_corners / (columns * rows)))
    margin = options.margin
    if min(height, width) <= 2 * margin + 2:
        return np.zeros((0, 2))

    strength = np.asarray(cv2.cornerMinEigenVal(gray, 5))
    peak = (strength >= np.asarray(cv2.dilate(strength, np.ones((3, 3), np.uint8)))) & (strength > 0)
    peak[:margin] = peak[-margin:] = False
    peak[:, :margin] = peak[:, -margin:] = False
    ys, xs = np.nonzero(peak)
    values = strength[ys, xs]
    cell_of = (ys / cell).astype(np.intp) * columns + (xs / cell).astype(np.intp)
    best = np.zeros(columns * rows)
    np.maximum.at(best, cell_of, values)
    threshold = options.quality * np.percentile(best, 90)

    taken = np.zeros((height, width), bool)
    held = np.zeros(columns * rows, np.intp)
    r = options.min_distance
    for x, y in np.round(alive).astype(np.intp):
        taken[max(y - r, 0) : y + r + 1, max(x - r, 0) : x + r + 1] = True
        held[min(max(int(y / cell), 0), rows - 1) * columns + min(max(int(x / cell), 0), columns - 1)] += 1
    usable = (values > threshold) & ~taken[ys, xs] & (held[cell_of] < capacity)
    if allowed is not None:
        usable &= allowed[ys, xs]
    candidates = np.nonzero(usable)[0]
    candidates = candidates[np.argsort(-values[candidates], kind="stable")]

    room = options.max_corners - len(alive)
    chosen: list[tuple[int, int]] = []
    for k in candidates:
        x, y, c = int(xs[k]), int(ys[k]), int(cell_of[k])
        if len(chosen) >= room:
            break
        if held[c] >= capacity or taken[y, x]:
            continue
        taken[max(y - r, 0) : y + r + 1, max(x - r, 0) : x + r + 1] = True
        held[c] += 1
        chosen.append((x, y))
    return np.array(chosen, float).reshape(-1, 2)
