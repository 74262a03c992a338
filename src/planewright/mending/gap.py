"""A stretch of frames between two anchors, in which a track went astray, and the windows in which it is looked for again."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Float, Int


@dataclass(frozen=True, eq=False)
class Gap:
    """Frames i to j of one point, both ends known."""

    frame: Int[np.ndarray, "frames"]
    """Frame numbers, increasing, at least two; the first and the last are the anchors'."""
    forward: Float[np.ndarray, "frames 2"]
    """Trace from the first anchor on, pixels; its first row is the anchor."""
    backward: Float[np.ndarray, "frames 2"]
    """Trace from the last anchor back; its last row is the anchor."""
    affine: Float[np.ndarray, "frames 2 2"] | None = None
    """How the surroundings of the point are turned and scaled against the first frame (2x2, applied to offsets in the first frame); None: not at all."""
    ends: Float[np.ndarray, "frames edges 2"] | None = None
    """Where the other ends of the point's edges are in each frame, pixels; NaN where one is not known. None: the edges are not looked for."""


@dataclass(frozen=True, kw_only=True)
class WindowOptions:
    """How large the windows are."""

    largest: int = 15
    """Side of the largest window, pixels."""
    tube_gap: float = 7.0
    """Where the two traces are further apart than this (pixels), each has a window of its own: half of the largest window reaches no further."""
    literal: bool = False
    """The side is max(2 (k - i) + 3, 15) about the forward trace, as the formula is printed. The text beside it describes the minimum; the printed windows
    have 360 000 nodes after 300 frames."""


def blend(gap: Gap) -> Float[np.ndarray, "frames 2"]:
    """The traces joined, linear in the frame number: each anchor keeps its own. Exact where the trace drifts evenly."""
    share = shares(gap)[:, None]
    return (1.0 - share) * gap.forward + share * gap.backward


def shares(gap: Gap) -> Float[np.ndarray, "frames"]:
    """Of the backward trace, from 0 to 1."""
    first, last = int(gap.frame[0]), int(gap.frame[-1])
    return (gap.frame - first) / (last - first)


@dataclass(frozen=True, eq=False)
class Layer:
    """The candidates of one frame."""

    nodes: Float[np.ndarray, "nodes 2"]
    """Pixels: centres are real numbers, candidates lie whole pixels from them."""
    side: Int[np.ndarray, "nodes"]
    """Which trace each candidate surrounds: 0 forward, 1 backward, 2 both."""


def layer(gap: Gap, k: int, options: WindowOptions) -> Layer:
    """The window of row k: its side is min(2 min(k - i, j - k) + 3, 15), small near both anchors; the anchors themselves are single nodes."""
    last = len(gap.frame) - 1
    if k in (0, last):
        return Layer((gap.forward[:1] if k == 0 else gap.backward[-1:]).copy(), np.array([2]))
    if options.literal:
        return Layer(gap.forward[k] + _square(max(2 * k + 3, options.largest)), np.zeros(max(2 * k + 3, options.largest) ** 2, dtype=np.int64))
    square = _square(min(2 * min(k, last - k) + 3, options.largest))
    if float(np.linalg.norm(gap.forward[k] - gap.backward[k])) <= options.tube_gap:
        return Layer(blend(gap)[k] + square, np.full(len(square), 2))
    return Layer(np.concatenate([gap.forward[k] + square, gap.backward[k] + square]), np.repeat([0, 1], len(square)))


def _square(side: int) -> Float[np.ndarray, "nodes 2"]:
    """Whole offsets of an odd-sided square about its middle, row by row."""
    reach = np.arange(side, dtype=np.float64) - side // 2
    x, y = np.meshgrid(reach, reach)
    return np.column_stack([x.ravel(), y.ravel()])
