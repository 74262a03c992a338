"""Where the faces go in the atlas: an upright rectangle around each, and a place for each rectangle."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Bool, Float, Vec3
from planewright.model.atlas import FaceChart


@dataclass(frozen=True, eq=False)
class FaceRectangle:
    """A rectangle on a plane around a face."""

    origin: Vec3
    """World: its top-left corner."""
    axis_u: Vec3
    axis_v: Vec3
    """World, unit: to the right and down, seen from the front."""
    size: tuple[float, float]
    """Along the axes, world units."""


def face_rectangle(normal: Vec3, border: Float[np.ndarray, "corners 3"], up: Vec3) -> FaceRectangle | None:
    """The smallest rectangle around a face that has a side along one of its edges, turned so that `up` is up; None for a face without area.

    A face with right angles fills its rectangle, and its edges then run along rows and columns of texels.
    """
    edges = np.roll(border, -1, axis=0) - border
    edges -= np.outer(edges @ normal, normal)
    lengths = np.linalg.norm(edges, axis=1)
    best: FaceRectangle | None = None
    smallest = np.inf
    for edge, length in zip(edges, lengths, strict=True):
        if length <= 1e-9 * lengths.max():
            continue
        axis = edge / length
        side = np.cross(normal, axis)
        # Of the four ways round, the one whose "down" is farthest from `up`.
        axis_v = min((axis, -axis, side, -side), key=lambda way: float(way @ up))
        axis_u = np.cross(axis_v, -normal)
        u, v = border @ axis_u, border @ axis_v
        size = (float(np.ptp(u)), float(np.ptp(v)))
        # A later edge wins only when it is clearly better, so that rounding does not decide among the sides of a rectangle.
        if size[0] * size[1] < (1 - 1e-6) * smallest:
            smallest = size[0] * size[1]
            on_plane = normal * float(np.mean(border @ normal))
            best = FaceRectangle(on_plane + u.min() * axis_u + v.min() * axis_v, axis_u, axis_v, size)
    if best is None or min(best.size) <= 1e-9 * max(best.size):
        return None
    return best


def lay_charts(rectangles: dict[int, FaceRectangle], texels: dict[int, float], max_side: int, gutter: int) -> tuple[tuple[FaceChart, ...], tuple[int, int]]:
    """Charts of the given texel size (world units) for the faces by row, placed in an atlas, and the atlas's width and height.

    Where they do not fit into `max_side`, all texels grow by the same factor. `gutter` texels around each chart are kept free.
    """
    factor = 1.0
    while True:
        charts = [_chart(face, rectangles[face], texels[face] * factor, max_side - 2 * gutter) for face in sorted(rectangles)]
        sizes = [(chart.width + 2 * gutter, chart.height + 2 * gutter) for chart in charts]
        placed = pack(sizes, max_side)
        if placed is not None:
            places, size = placed
            return tuple(
                FaceChart(c.face, c.origin, c.axis_u, c.axis_v, c.texel, c.width, c.height, x + gutter, y + gutter)
                for c, (x, y) in zip(charts, places, strict=True)
            ), size
        factor *= 1.1


def _chart(face: int, rectangle: FaceRectangle, texel: float, max_side: int) -> FaceChart:
    texel = max(texel, max(rectangle.size) / max_side)
    # The rectangle is centred on whole texels.
    width, height = (max(1, int(np.ceil(side / texel - 1e-6))) for side in rectangle.size)
    slack_u, slack_v = width * texel - rectangle.size[0], height * texel - rectangle.size[1]
    origin = rectangle.origin - 0.5 * (slack_u * rectangle.axis_u + slack_v * rectangle.axis_v)
    return FaceChart(face, origin, rectangle.axis_u, rectangle.axis_v, texel, width, height)


def pack(sizes: Sequence[tuple[int, int]], max_side: int) -> tuple[list[tuple[int, int]], tuple[int, int]] | None:
    """Places (left, top) of rectangles (width, height) without overlap, and the size of the whole; None where they do not fit into `max_side`.

    Bottom-left on a skyline, the tallest first (Jylanki 2010, "A thousand ways to pack the bin"), for several widths; the smallest result wins.
    """
    if not sizes:
        return [], (1, 1)
    order = sorted(range(len(sizes)), key=lambda i: (-sizes[i][1], -sizes[i][0], i))
    widest = max(width for width, _ in sizes)
    side = max(widest, int(np.ceil(np.sqrt(sum(width * height for width, height in sizes)))))
    best: tuple[list[tuple[int, int]], tuple[int, int]] | None = None
    for stretch in (1.0, 1.05, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 0.8):
        room = min(max_side, max(widest, int(side * stretch)))
        places, size = _skyline(sizes, order, room)
        if max(size) <= max_side and (best is None or size[0] * size[1] < best[1][0] * best[1][1]):
            best = places, size
    return best


def _skyline(sizes: Sequence[tuple[int, int]], order: Sequence[int], room: int) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    skyline = [(0, 0, room)]  # left, top, width of each step
    places = [(0, 0)] * len(sizes)
    for i in order:
        width, height = sizes[i]
        best = (np.inf, 0)
        for start, (left, _, _) in enumerate(skyline):
            if left + width > room:
                break
            top, reach, step = 0, left, start
            while reach < left + width:
                top = max(top, skyline[step][1])
                reach += skyline[step][2]
                step += 1
            best = min(best, (top, left))
        top, left = int(best[0]), best[1]
        places[i] = (left, top)
        skyline = _raised(skyline, left, width, top + height)
    used = [(x + w, y + h) for (x, y), (w, h) in zip(places, sizes, strict=True)]
    return places, (max(x for x, _ in used), max(y for _, y in used))


def _raised(skyline: list[tuple[int, int, int]], left: int, width: int, top: int) -> list[tuple[int, int, int]]:
    right = left + width
    pieces: list[tuple[int, int, int]] = [(left, top, width)]
    for x, y, w in skyline:
        if x < left:
            pieces.append((x, y, min(w, left - x)))
        if x + w > right:
            start = max(x, right)
            pieces.append((start, y, x + w - start))
    return sorted(piece for piece in pieces if piece[2] > 0)


def chart_mask(chart: FaceChart, loops: Sequence[Float[np.ndarray, "... 3"]]) -> Bool[np.ndarray, "height width"]:
    """True at the texels of a chart that belong to the face: inside its border and outside its holes, the texels on the line included."""
    mask = np.zeros((chart.height, chart.width), dtype=np.uint8)
    # OpenCV puts whole numbers at the centres of texels; 4 bits of fraction.
    cv2.fillPoly(mask, [np.rint((chart.to_texels(loop) - 0.5) * 16).astype(np.int32) for loop in loops], 1, shift=4)
    return mask.astype(bool)
