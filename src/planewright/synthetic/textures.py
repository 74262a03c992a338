"""Procedural textures: what bricks, planks, tiles, plaster and print look like, with detail at several scales.

A painter maps (width, height, density, rng) to an image of `density` texels a scene unit; u runs to the right, v down.
"""

from collections.abc import Callable

import cv2
import numpy as np

from planewright.arrays import Float

Color = tuple[int, int, int]
"""Red, green, blue, 0 to 255."""
Image = Float[np.ndarray, "rows columns 3"]
Plane = Float[np.ndarray, "rows columns"]
Painter = Callable[[float, float, float, np.random.Generator], Image]


def octaves(shape: tuple[int, int], cell: tuple[float, float], rng: np.random.Generator, persistence: float = 0.65) -> Plane:
    """Smooth noise of about unit deviation: cells of `cell` texels (rows, columns), then half as large, down to two texels."""
    total = np.zeros(shape, np.float32)
    weight, power = 1.0, 0.0
    rows, columns = max(cell[0], 1.0), max(cell[1], 1.0)
    while True:
        grid = rng.standard_normal((int(shape[0] / rows) + 3, int(shape[1] / columns) + 3), np.float32)
        wide = cv2.resize(grid, (int(grid.shape[1] * columns) + 1, int(grid.shape[0] * rows) + 1), interpolation=cv2.INTER_CUBIC)
        total += np.float32(weight) * wide[: shape[0], : shape[1]]
        power += 0.5 * weight**2  # smoothing by the cubic halves the variance of the grid
        if max(rows, columns) <= 2.5:
            return total / np.float32(np.sqrt(power))
        rows, columns, weight = max(rows / 2, 1.0), max(columns / 2, 1.0), weight * persistence


def _grid(width: float, height: float, density: float) -> tuple[Plane, Plane]:
    """Plane coordinates (u, v) of the texels, scene units."""
    rows, columns = max(4, round(height * density)), max(4, round(width * density))
    u, v = np.meshgrid((np.arange(columns) + 0.5) / density, (np.arange(rows) + 0.5) / density)
    return u.astype(np.float32), v.astype(np.float32)


def _tone(color: Color, tone: Plane) -> Image:
    """The colour, lighter or darker by the tone (0: as it is, 0.1: a tenth lighter)."""
    return np.asarray(color, np.float32) * (1.0 + tone[..., None])


def _cells(row: Plane, column: Plane, rng: np.random.Generator) -> Plane:
    """One random number of unit deviation for each cell."""
    table = rng.standard_normal((257, 263)).astype(np.float32)
    return table[row.astype(np.int64) % 257, column.astype(np.int64) % 263]


def plaster(color: Color, contrast: float = 0.05, cell: float = 0.35) -> Painter:
    """Plaster, paper, bare wall: blotches, and grain down to the texel; `contrast` is the deviation of its tone."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, _ = _grid(width, height, density)
        blotches = octaves(u.shape, (cell * density, cell * density), rng, 0.7)
        return _tone(color, contrast * blotches)

    return paint


def speckled(color: Color, other: Color, cell: float = 0.06) -> Painter:
    """Two colours in spots: carpet, stone, grass seen from above."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, _ = _grid(width, height, density)
        spots = octaves(u.shape, (cell * density, cell * density), rng, 0.8)
        wide = octaves(u.shape, (12 * cell * density, 12 * cell * density), rng, 0.5)
        share = np.clip(0.5 + 0.45 * spots + 0.25 * wide, 0, 1)[..., None]
        return _tone(color, 0.06 * wide) * (1 - share) + _tone(other, 0.06 * wide) * share

    return paint


def bricks(color: Color, mortar: Color, length: float = 0.22, course: float = 0.09, variety: float = 0.13) -> Painter:
    """A running bond; lengths in scene units, `variety` is the deviation of tone from brick to brick."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, v = _grid(width, height, density)
        wobble = 0.02 * course * octaves(u.shape, (0.1 * density, 0.1 * density), rng)
        row = np.floor((v + wobble) / course)
        shifted = (u + wobble) / length + 0.5 * (row % 2) + 0.07 * np.sin(3.7 * row)
        column = np.floor(shifted)
        gap = np.minimum(
            np.minimum((v + wobble) / course - row, row + 1 - (v + wobble) / course) * course, np.minimum(shifted - column, column + 1 - shifted) * length
        )
        joint = np.clip((0.0075 - gap) * density + 0.5, 0, 1)[..., None]
        grain = octaves(u.shape, (0.05 * density, 0.05 * density), rng, 0.8)
        stain = octaves(u.shape, (0.9 * density, 0.9 * density), rng, 0.5)
        face = _tone(color, variety * _cells(row, column, rng) + 0.07 * grain + 0.05 * stain)
        return face * (1 - joint) + _tone(mortar, 0.05 * grain + 0.05 * stain) * joint

    return paint


def shingles(color: Color, length: float = 0.16, course: float = 0.11, variety: float = 0.16) -> Painter:
    """Roof tiles in courses: each casts a dark line on the next."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, v = _grid(width, height, density)
        row = np.floor(v / course)
        shifted = u / length + 0.5 * (row % 2) + 0.11 * np.sin(5.3 * row)
        column = np.floor(shifted)
        down = v / course - row
        side = np.minimum(shifted - column, column + 1 - shifted) * length
        grain = octaves(u.shape, (0.04 * density, 0.08 * density), rng, 0.8)
        tone = variety * _cells(row, column, rng) + 0.07 * grain + 0.16 * (down - 0.5)
        tone -= 0.5 * np.clip((0.010 - down * course) * density + 0.5, 0, 1)
        tone -= 0.35 * np.clip((0.004 - side) * density + 0.5, 0, 1)
        return _tone(color, tone)

    return paint


def planks(color: Color, board: float = 0.3, variety: float = 0.1, upright: bool = False) -> Painter:
    """Wooden boards along u (or along v when `upright`), with grain."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        if upright:
            return planks(color, board, variety)(height, width, density, rng).transpose(1, 0, 2)
        u, v = _grid(width, height, density)
        row = np.floor(v / board)
        column = np.floor(u / (9 * board) + 0.37 * row)
        grain = octaves(u.shape, (0.03 * density, 0.5 * density), rng, 0.85)
        rings = np.sin(2.5 * grain + 40 * v / (1 + 0.3 * np.sin(row)))
        across = np.minimum(v / board - row, row + 1 - v / board) * board
        along = (u / (9 * board) + 0.37 * row - column) * 9 * board
        seam = np.clip((0.006 - np.minimum(across, along)) * density + 0.5, 0, 1)
        return _tone(color, variety * _cells(row, column, rng) + 0.08 * grain + 0.06 * rings - 0.5 * seam)

    return paint


def siding(color: Color, board: float = 0.12) -> Painter:
    """Overlapping painted boards."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, v = _grid(width, height, density)
        row = np.floor(v / board)
        down = v / board - row
        grain = octaves(u.shape, (0.02 * density, 0.35 * density), rng, 0.8)
        shadow = np.clip((0.012 - down * board) * density + 0.5, 0, 1)
        return _tone(color, 0.03 * _cells(row, 0 * row, rng) + 0.04 * grain - 0.3 * shadow + 0.08 * (down - 0.5))

    return paint


def window(frame: Color = (225, 222, 214), glass: Color = (52, 74, 104), across: int = 3, down: int = 2) -> Painter:
    """A painted frame, bars, and panes that mirror a bright sky."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, v = _grid(width, height, density)
        border, bar = 0.08 * min(width, height), 0.035 * min(width, height)
        pane_u, pane_v = (u - border) / (width - 2 * border) * across, (v - border) / (height - 2 * border) * down
        near_u = np.abs(pane_u - np.round(pane_u)) * (width - 2 * border) / across
        near_v = np.abs(pane_v - np.round(pane_v)) * (height - 2 * border) / down
        outside = np.minimum(np.minimum(u, width - u), np.minimum(v, height - v))
        wood = np.clip((bar - np.minimum(near_u, near_v)) * density + 0.5, 0, 1)
        wood = np.maximum(wood, np.clip((border - outside) * density + 0.5, 0, 1))[..., None]
        grain = octaves(u.shape, (0.1 * density, 0.1 * density), rng, 0.8)
        mirror = 0.5 * np.clip(np.sin(9 * (u - 0.6 * v) / width), 0, 1) + 0.12 * octaves(u.shape, (0.5 * density, 0.5 * density), rng)
        return _tone(frame, 0.04 * grain) * wood + _tone(glass, mirror) * (1 - wood)

    return paint


def door(color: Color = (96, 34, 26)) -> Painter:
    """Two columns of three panels, a knob, wood grain."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, v = _grid(width, height, density)
        grain = octaves(u.shape, (0.4 * density, 0.02 * density), rng, 0.85)
        pu, pv = (u / width * 2) % 1 - 0.5, (v / height * 3) % 1 - 0.5
        inset = np.maximum(np.abs(pu), np.abs(pv))
        groove = np.clip(1 - np.abs(inset - 0.36) / 0.05, 0, 1)
        image = _tone(color, 0.11 * grain - 0.45 * groove + 0.1 * (inset < 0.3))
        knob = np.hypot(u - 0.88 * width, v - 0.52 * height) < 0.05 * width
        image[knob] = (206, 178, 96)
        return image

    return paint


def print_on(paper: Color, marks: int = 40, size: float = 0.12) -> Painter:
    """Printed matter: discs, bars, triangles and lines of text-like strokes, `marks` a square unit, about `size` units large."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, _ = _grid(width, height, density)
        image = np.ascontiguousarray(_tone(paper, 0.03 * octaves(u.shape, (0.2 * density, 0.2 * density), rng, 0.8)))
        for _ in range(max(3, round(marks * width * height))):
            color = tuple(float(c) for c in rng.uniform(20, 240, 3))
            x, y = (int(rng.uniform(0, n)) for n in (u.shape[1], u.shape[0]))
            r = size * density * float(rng.uniform(0.3, 1.0))
            kind = int(rng.integers(4))
            if kind == 0:
                cv2.circle(image, (x, y), max(1, int(0.5 * r)), color, -1, cv2.LINE_AA)
            elif kind == 3:
                for k in range(int(rng.integers(3, 9))):
                    at = int(x + 0.22 * k * r)
                    cv2.line(
                        image, (at, y), (at + int(rng.uniform(-0.1, 0.1) * r), y + int(rng.uniform(0.1, 0.3) * r)), color, max(1, int(0.06 * r)), cv2.LINE_AA
                    )
            else:
                angles = rng.uniform(0, 6.28) + np.arange(kind + 2) * 2 * np.pi / (kind + 2)
                corners = np.stack([x + 0.6 * r * np.cos(angles), y + 0.4 * r * np.sin(angles)], axis=1)
                cv2.fillPoly(image, [np.round(corners).astype(np.int32)], color, cv2.LINE_AA)
        return image

    return paint


def books(shelf: float = 0.7) -> Painter:
    """A bookcase seen from the front: spines of many colours, boards between the rows."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, v = _grid(width, height, density)
        image = np.empty((*u.shape, 3), np.float32)
        image[:] = (70, 48, 34)
        for top in np.arange(0.06, height - 0.2, shelf):
            at = 0.03
            while at < width - 0.05:
                thick, tall = float(rng.uniform(0.05, 0.14)), float(rng.uniform(0.65, 0.92)) * (shelf - 0.06)
                bottom = min(top + shelf - 0.06, height)
                inside = (u >= at) & (u < at + thick - 0.006) & (v < bottom) & (v >= bottom - tall)
                image[inside] = rng.uniform(40, 225, 3)
                label = inside & (np.abs(v - (bottom - tall * rng.uniform(0.3, 0.8))) < 0.04)
                image[label] = rng.uniform(30, 240, 3)
                at += thick
        return image * (1 + 0.06 * octaves(u.shape, (0.1 * density, 0.1 * density), rng, 0.8))[..., None]

    return paint


def parcel(color: Color, tape: Color = (196, 168, 120), mirrored: bool = False) -> Painter:
    """Cardboard: fine ribs, a strip of tape along the middle, an address label, an arrow, and a line of print."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, v = _grid(width, height, density)
        ribs = np.sin(2 * np.pi * u / 0.03) if density > 100 else 0 * u
        board = 0.05 * octaves(u.shape, (0.25 * density, 0.25 * density), rng, 0.8) + 0.015 * ribs
        image = np.ascontiguousarray(_tone(color, board))
        scale = min(width, height)

        def at(x: float, y: float) -> tuple[int, int]:
            return round((1 - x if mirrored else x) * image.shape[1]), round(y * image.shape[0])

        strip = np.abs(v - 0.5 * height) < 0.06 * scale
        image[strip] = (0.25 * image + 0.75 * _tone(tape, 0.04 * octaves(u.shape, (0.05 * density, 0.4 * density), rng, 0.8)))[strip]
        cv2.rectangle(image, at(0.56, 0.1), at(0.92, 0.38), (236, 233, 226), -1)
        for k in range(4):
            y = 0.15 + 0.05 * k
            cv2.line(image, at(0.6, y), at(float(rng.uniform(0.72, 0.88)), y), (50, 48, 52), max(1, int(0.012 * scale * density)))
        for x in np.cumsum(rng.uniform(0.006, 0.02, 18)):
            cv2.line(image, at(0.6 + float(x), 0.33), at(0.6 + float(x), 0.37), (20, 20, 24), max(1, int(0.005 * scale * density)))
        arrow = np.array([at(0.12, 0.36), at(0.12, 0.22), at(0.08, 0.22), at(0.15, 0.1), at(0.22, 0.22), at(0.18, 0.22), at(0.18, 0.36)], np.int32)
        cv2.fillPoly(image, [arrow], (64, 44, 36))
        for k in range(9):
            height_of = float(rng.uniform(0.05, 0.11))
            cv2.rectangle(image, at(0.1 + 0.07 * k, 0.82 - height_of), at(0.14 + 0.07 * k, 0.82), tuple(float(c) for c in rng.uniform(20, 110, 3)), -1)
        return image

    return paint


def screen(color: Color = (30, 44, 66)) -> Painter:
    """A lit screen: windows with title bars and lines of text on a dark ground."""

    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Image:
        u, _ = _grid(width, height, density)
        image = np.ascontiguousarray(_tone(color, 0.2 * octaves(u.shape, (0.5 * density, 0.5 * density), rng, 0.6)))
        rows, columns = u.shape
        for _ in range(4):
            x, y = int(rng.uniform(0.03, 0.5) * columns), int(rng.uniform(0.05, 0.5) * rows)
            right, low = x + int(rng.uniform(0.25, 0.42) * columns), y + int(rng.uniform(0.25, 0.4) * rows)
            cv2.rectangle(image, (x, y), (right, low), (226, 228, 230), -1)
            cv2.rectangle(image, (x, y), (right, y + max(2, rows // 30)), tuple(float(c) for c in rng.uniform(40, 170, 3)), -1)
            for line in range(y + rows // 16, low - rows // 50, max(3, rows // 36)):
                start = x + columns // 60
                end = start + int(rng.uniform(0.3, 0.9) * (right - x - columns // 30))
                cv2.line(image, (start, line), (end, line), tuple(float(c) for c in rng.uniform(20, 120, 3)), max(1, rows // 110))
        return image

    return paint
