"""What a face looks like in one frame: chosen pixels on a few pyramid levels, ready to be found again in another frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Bool, Float, GrayImage, Int, Mat3
from planewright.registration.homography import apply_homography, point_jacobian

Level = Float[np.ndarray, "_rows _columns"]
"""A grey image, smoothed. Level l + 1 has half the size of level l."""


@dataclass(frozen=True, kw_only=True)
class TemplateOptions:
    """How pixels are chosen."""

    levels: int = 4
    """Of the pyramid; the coarsest reaches about 30 pixels of motion."""
    smoothing: float = 1.0
    """Of the image, pixels; it takes out the pull of interpolation towards whole pixels, and most of the noise."""
    level_smoothing: float = 0.7
    """Of each coarser level, its own pixels."""
    erosion: float = 3.0
    """Pixels left free along the face's border: marks are a pixel or two beside it, and smoothing lets the other side shine in.

    With 2, 3 and 4 the corners of a bare carton are within 2 px in 18, 90 and 76 % of their frames; clips with texture differ by a point.
    """
    level_erosion: int = 1
    """Likewise on the coarser levels, their own pixels, besides."""
    shading: float = 12.0
    """What changes over more than about this many pixels of the frame counts as shading."""
    max_pixels: tuple[int, ...] = (1400, 700, 350, 200)
    """At each level, the finest first."""
    min_pixels: int = 60
    """A level on which the face has fewer is not used."""
    cells: int = 8
    """The pixels are spread over this many by this many cells of the face's square; the steepest of each are taken."""


@dataclass(frozen=True, eq=False)
class TemplateLevel:
    """Pixels of one pyramid level."""

    q: Float[np.ndarray, "pixels 2"]
    """Face coordinates."""
    values: Float[np.ndarray, "pixels"]
    """Grey values."""
    steepest: Float[np.ndarray, "pixels 8"]
    """Derivative by the change of the homography (homography.py)."""
    share: float
    """Of the face's pixels that were chosen."""
    slope: float
    """Mean square of the gradient over all of the face's pixels, grey levels per pixel of this level."""
    detail: float
    """The same without what changes slowly over the face: shading, which does not move with it, is no detail."""


@dataclass(frozen=True, eq=False)
class Template:
    """A face in one frame."""

    frame: int
    h: Mat3
    """Face coordinates -> pixels of that frame."""
    covariance: Float[np.ndarray, "8 8"]
    """Of `h`; zero in the frame in which the face was drawn."""
    levels: tuple[TemplateLevel | None, ...]
    """The finest first; None where the face is too small."""


def pyramid(gray: GrayImage, options: TemplateOptions) -> list[Level]:
    """Smoothed levels, the finest first."""
    levels = [np.asarray(cv2.GaussianBlur(gray.astype(np.float32), (0, 0), options.smoothing))]
    while len(levels) < options.levels and min(levels[-1].shape) >= 32:
        rows, columns = levels[-1].shape[0] // 2, levels[-1].shape[1] // 2
        # Halving by areas keeps "x + 0.5" proportional between the levels.
        half = cv2.resize(levels[-1][: 2 * rows, : 2 * columns], (columns, rows), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(cv2.GaussianBlur(half, (0, 0), options.level_smoothing)))
    return levels


def to_level(level: int) -> Mat3:
    """Pixels of the frame -> pixels of a pyramid level; both have centres at integers."""
    s = 0.5**level
    return np.array([[s, 0.0, 0.5 * s - 0.5], [0.0, s, 0.5 * s - 0.5], [0.0, 0.0, 1.0]])


def face_mask(
    shape: tuple[int, int],
    loop: Float[np.ndarray, "corners 2"],
    holes: Sequence[Float[np.ndarray, "_corners 2"]],
    others: Sequence[Float[np.ndarray, "_corners 2"]],
    erosion: float,
) -> Bool[np.ndarray, "height width"]:
    """Pixels inside the loop, away from its border, and outside holes and other polygons (pixels with centres at integers)."""
    mask = _filled(shape, [loop])
    size = 2 * round(erosion) + 1
    if erosion > 0:
        mask = np.asarray(cv2.erode(mask, np.ones((size, size), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=1))
    mask &= 1 - _filled(shape, holes)
    if others:
        mask &= 1 - np.asarray(cv2.dilate(_filled(shape, others), np.ones((size, size), np.uint8)))
    return mask.astype(bool)


def _filled(shape: tuple[int, int], polygons: Sequence[Float[np.ndarray, "_corners 2"]]) -> np.ndarray:
    mask = np.zeros(shape, np.uint8)
    for polygon in polygons:
        # 4 binary digits of a pixel
        cv2.fillPoly(mask, [np.round(np.clip(polygon, -3e4, 3e4) * 16).astype(np.int32)[:, None]], 1, shift=4)
    return mask


def make_template(
    levels: Sequence[Level], mask: Bool[np.ndarray, "height width"], frame: int, h: Mat3, covariance: Float[np.ndarray, "8 8"], options: TemplateOptions
) -> Template | None:
    """The template of the masked pixels, or None where even the finest level has too few."""
    made: list[TemplateLevel | None] = []
    share = mask.astype(np.float32)
    for k, image in enumerate(levels):
        if k:
            share = cv2.resize(share[: 2 * image.shape[0], : 2 * image.shape[1]], (image.shape[1], image.shape[0]), interpolation=cv2.INTER_AREA)
        inside = (np.asarray(share) > 0.75).astype(np.uint8)
        if k and options.level_erosion:
            side = 2 * options.level_erosion + 1
            inside = np.asarray(cv2.erode(inside, np.ones((side, side), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=1))
        made.append(_level(image, inside.astype(bool), k, h, options))
    return None if made[0] is None else Template(frame, h, covariance, tuple(made))


def _level(image: Level, mask: Bool[np.ndarray, "height width"], level: int, h: Mat3, options: TemplateOptions) -> TemplateLevel | None:
    ys, xs = np.nonzero(mask)
    free = (xs > 0) & (ys > 0) & (xs < image.shape[1] - 1) & (ys < image.shape[0] - 1)
    ys, xs = ys[free], xs[free]
    if len(xs) < options.min_pixels:
        return None
    h, most = to_level(level) @ h, options.max_pixels[min(level, len(options.max_pixels) - 1)]
    q = apply_homography(np.linalg.inv(h), np.column_stack([xs, ys]).astype(np.float64))
    gx = (image[ys, xs + 1] - image[ys, xs - 1]) / 2
    gy = (image[ys + 1, xs] - image[ys - 1, xs]) / 2
    keep = _spread(cell_of(q, options.cells), np.hypot(gx, gy), most)
    share, slope = len(keep) / len(xs), float((gx**2 + gy**2).mean())
    detail = _detail(image, mask, xs, ys, max(options.shading * 0.5**level, 2.0))
    xs, ys, q, gx, gy = xs[keep], ys[keep], q[keep], gx[keep], gy[keep]
    g = np.einsum("ni,nij->nj", np.column_stack([gx, gy]), point_jacobian(h, q))
    x, y = q.T
    outward = g[:, 0] * x + g[:, 1] * y
    steepest = np.column_stack([g[:, 0] * x, g[:, 0] * y, g[:, 0], g[:, 1] * x, g[:, 1] * y, g[:, 1], -outward * x, -outward * y])
    return TemplateLevel(np.ascontiguousarray(q), image[ys, xs], np.ascontiguousarray(steepest, dtype=np.float32), share, slope, detail)


def clear_share(t: TemplateLevel, residual: float) -> float:
    """Share of a template's slope that is neither shading nor its noise, whose variance is taken to be half of that of the residual.

    Central differences of noise smoothed by a Gaussian of one pixel have (1 - 1 / e) / 2 of its variance, along each axis.
    """
    return float(np.clip((t.detail - 2 * 0.316 * 0.5 * residual**2) / max(t.slope, 1e-9), 0.02, 1.0))


def _detail(image: Level, mask: Bool[np.ndarray, "height width"], xs: Int[np.ndarray, "n"], ys: Int[np.ndarray, "n"], sigma: float) -> float:
    """Mean square of the gradient at the masked pixels after their local mean, over the mask alone, is taken away."""
    x0, y0 = max(int(xs.min()) - 2, 0), max(int(ys.min()) - 2, 0)
    part = (slice(y0, int(ys.max()) + 3), slice(x0, int(xs.max()) + 3))
    inside = mask[part].astype(np.float32)
    total = np.asarray(cv2.GaussianBlur(inside, (0, 0), sigma))
    mean = np.asarray(cv2.GaussianBlur(inside * image[part], (0, 0), sigma)) / np.maximum(total, 1e-6)
    rest, x, y = image[part] - mean, xs - x0, ys - y0
    gx, gy = (rest[y, x + 1] - rest[y, x - 1]) / 2, (rest[y + 1, x] - rest[y - 1, x]) / 2
    return float((gx**2 + gy**2).mean())


def cell_of(q: Float[np.ndarray, "n 2"], cells: int) -> Int[np.ndarray, "n"]:
    """Which cell of the square from -1 to 1 each point lies in; points outside belong to the nearest."""
    column, row = np.clip(((q + 1.0) * 0.5 * cells).astype(np.int64), 0, cells - 1).T
    return row * cells + column


def _spread(cell: Int[np.ndarray, "n"], strength: Float[np.ndarray, "n"], most: int) -> Int[np.ndarray, "kept"]:
    """At most `most` rows, the strongest of every cell, as evenly as the cells allow."""
    if len(cell) <= most:
        return np.arange(len(cell))
    order = np.lexsort((-strength, cell))
    count = np.bincount(cell)
    rank = np.empty(len(cell), np.int64)
    rank[order] = np.arange(len(cell)) - np.repeat(np.cumsum(count) - count, count)
    # The largest quota a cell that does not take more than `most` in all.
    used = np.sort(count[count > 0])
    quota = next(t for t in range(int(used[-1]), -1, -1) if np.minimum(used, t).sum() <= most)
    return np.sort(np.nonzero(rank < quota)[0])
