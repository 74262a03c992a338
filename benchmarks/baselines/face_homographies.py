"""Each face by its homography, chained from frame to frame."""

from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.baselines.flow import ROUND_TRIP, flow
from benchmarks.baselines.single_corners import single_corners
from benchmarks.baselines.sweep import Step
from planewright.arrays import Float, GrayImage
from planewright.sketch.faces import find_faces
from planewright.sketch.graph import Sketch


@dataclass(frozen=True, kw_only=True)
class HomographyOptions:
    """How faces are followed."""

    features: int = 200
    """Corners of the image followed inside a face (Shi and Tomasi 1994), strongest first."""
    distance: int = 5
    """Pixels between them."""
    erode: int = 3
    """Pixels from the face's border that are left out: patches there see what lies behind."""
    inlier: float = 1.5
    """Pixels from the homography."""
    perspective: float = 0.01
    """How much a homography may differ from an affine map over the spread of the features, as a share: depth changes by about that from frame to frame."""
    min_inliers: int = 8
    """Twice what a homography needs; below, the face tells nothing in this frame."""


def face_homographies(sketch: Sketch, options: HomographyOptions = HomographyOptions()) -> Step:
    """Features inside each face from one frame to the next, a homography through them by MAGSAC++ (Barath et al. 2020), the corners carried by it.

    A corner of several faces is carried by all of them, each as sure as its features make it there: a homography of a small face says little about a corner
    outside its features. A corner without a face, or whose faces tell nothing, falls back to Lucas-Kanade on itself.
    """
    row = {point.id: k for k, point in enumerate(sketch.points)}
    faces = find_faces(sketch).faces
    loops = [np.array([row[c] for c in face.loop]) for face in faces]
    holes = [[np.array([row[c] for c in hole]) for hole in face.holes] for face in faces]
    corners = [np.array([row[c] for c in face.corners]) for face in faces]
    alone = single_corners(sketch)

    def step(old: GrayImage, new: GrayImage, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
        moved = alone(old, new, points)
        summed, weights = np.zeros_like(points), np.zeros(len(points))
        for loop, inner, all_corners in zip(loops, holes, corners, strict=True):
            known = loop[np.isfinite(points[loop, 0])]
            if len(known) < 3:
                continue
            found = _motion(old, new, points[known], [points[h] for h in inner if np.isfinite(points[h]).all()], options)
            if found is None:
                continue
            there = all_corners[np.isfinite(points[all_corners, 0])]
            xy, variance = found.carry(points[there])
            summed[there] += xy / variance[:, None]
            weights[there] += 1.0 / variance
        seen = weights > 0
        moved[seen] = summed[seen] / weights[seen, None]
        return moved

    return step


@dataclass(frozen=True, eq=False)
class _Motion:
    """A homography (its last entry 1) in coordinates around the face's features, and how sure it is."""

    middle: Float[np.ndarray, "2"]
    size: float
    entries: Float[np.ndarray, "8"]
    covariance: Float[np.ndarray, "8 8"]

    def carry(self, xy: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
        """Where points go, and the variance there (pixels squared, both axes together, the flow's own tenth of a pixel included)."""
        unit = (xy - self.middle) / self.size
        h = np.append(self.entries, 1.0).reshape(3, 3)
        x = np.column_stack([unit, np.ones(len(unit))]) @ h.T
        there = x[:, :2] / x[:, 2:]
        rows = _equations(unit, there).reshape(-1, 2, 8) * self.size
        return there * self.size + self.middle, 0.1**2 + np.einsum("nij,jk,nik->n", rows, self.covariance, rows)


def _equations(a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "rows 8"]:
    """Two rows a point, x then y, of the linear equations of a homography (Hartley and Zisserman, 2nd edition, section 4.1.2)."""
    one, none = np.ones(len(a)), np.zeros(len(a))
    x = np.stack([a[:, 0], a[:, 1], one, none, none, none, -b[:, 0] * a[:, 0], -b[:, 0] * a[:, 1]], axis=1)
    y = np.stack([none, none, none, a[:, 0], a[:, 1], one, -b[:, 1] * a[:, 0], -b[:, 1] * a[:, 1]], axis=1)
    return np.stack([x, y], axis=1).reshape(-1, 8)


def _motion(
    old: GrayImage, new: GrayImage, loop: Float[np.ndarray, "corners 2"], holes: list[Float[np.ndarray, "_corners 2"]], options: HomographyOptions
) -> _Motion | None:
    """The face's motion through the features that agree on one."""
    mask = np.zeros(old.shape, np.uint8)
    whole = np.clip(np.round(loop - 0.5), -20000, 20000).astype(np.int32)
    cv2.fillPoly(mask, [whole[:, None]], 255)
    for hole in holes:  # what stands in a hole may lie in another plane
        cv2.fillPoly(mask, [np.clip(np.round(hole - 0.5), -20000, 20000).astype(np.int32)[:, None]], 0)
    x, y, w, h = cv2.boundingRect(whole[:, None])
    x0, y0, x1, y1 = max(x - 12, 0), max(y - 12, 0), min(x + w + 12, old.shape[1]), min(y + h + 12, old.shape[0])
    if x1 - x0 < 8 or y1 - y0 < 8:
        return None
    part = cv2.erode(mask[y0:y1, x0:x1], np.ones((2 * options.erode + 1,) * 2, np.uint8), borderValue=0)
    seen = cv2.goodFeaturesToTrack(np.ascontiguousarray(old[y0:y1, x0:x1]), options.features, 0.01, options.distance, mask=part, blockSize=5)
    if seen is None or len(seen) < options.min_inliers:
        return None
    start = seen.reshape(-1, 2).astype(np.float64) + np.array([x0 + 0.5, y0 + 0.5])
    end, error = flow(old, new, start, window=15)
    good = error < ROUND_TRIP
    if good.sum() < options.min_inliers:
        return None
    cv2.setRNGSeed(0)
    found, inliers = cv2.findHomography(start[good], end[good], cv2.USAC_MAGSAC, options.inlier, maxIters=1000, confidence=0.999)
    if found is None or inliers.sum() < options.min_inliers or not np.isfinite(found).all():
        return None
    take = inliers.ravel() > 0
    start, end = start[good][take], end[good][take]
    middle = start.mean(axis=0)
    size = float(np.sqrt(((start - middle) ** 2).sum(axis=1).mean())) + 1e-6
    a, b = (start - middle) / size, (end - middle) / size
    rows, values = _equations(a, b), b.reshape(-1)
    sigma = max(0.1, options.inlier / 4) / size
    held = np.diag([0.0] * 6 + [(sigma / options.perspective) ** 2] * 2)
    normal = rows.T @ rows + held + 1e-12 * np.eye(8)
    return _Motion(middle, size, np.linalg.solve(normal, rows.T @ values), sigma**2 * np.linalg.inv(normal))
