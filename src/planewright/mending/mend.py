"""The layered shortest path between two anchors: which way the track went, then where exactly.

Each frame between the anchors has a window of candidates, and every candidate is joined to every one of the next frame. A joint costs little where it
follows the traced motion, and a candidate costs little where the image there looks like the anchors' surroundings and the point's edges run through it.
The cheapest path decides between ways (the forward trace until it jumped, the backward one from there on); settling then places it between pixels.
(Wang et al., Recovering 3D planar arrangements from videos, section on back tracing; the corrections to its formulas are explained at the options.)
"""

from dataclasses import dataclass, field

import cv2
import numpy as np

from planewright.arrays import Float, GrayImage, Int, UInt8
from planewright.mending.gap import Gap, Layer, WindowOptions, layer, shares
from planewright.mending.kernels import cut_patch, next_layer, node_costs
from planewright.mending.settle import SettleOptions, settle_path
from planewright.progress import Progress, silent, steps
from planewright.video.frames import Frames


@dataclass(frozen=True, kw_only=True)
class MendOptions:
    """What a path costs."""

    windows: WindowOptions = field(default_factory=WindowOptions)
    """Where candidates lie."""
    trace_sigma: float = 0.7
    """Standard deviation of a step of a well traced point, pixels."""
    least_trust: float = 0.02
    """A step that nothing confirms counts this much of a well traced one."""
    trust_scale: float = 0.2
    """The trust in a step falls by a factor of e where the patches at its ends correlate less by this much."""
    half_patch: int = 7
    """Patches have a side of twice this and one, pixels."""
    patch_weight: float = 2.0
    """Cost of a patch that has nothing in common with the anchors'."""
    line_weight: float = 1.0
    """Cost of a place far from all edges of the point."""
    blur: float = 0.8
    """Gaussian blur of the frames, pixels (sigma)."""
    common_sigma: float = 0.3
    """Error that all frames between two anchors have in common, pixels; always part of the sigmas."""
    literal_weight: bool = False
    """A joint costs its own squared length over the trust, as the formula is printed, and places cost nothing. The cheapest such path is the straight one:
    6 px off on average where doing nothing is 1.5 px off (60 frames on a curve). The text describes the distance from the traced place."""
    settle: SettleOptions | None = field(default_factory=SettleOptions)
    """How the path is placed between pixels; None leaves it on its candidates."""


@dataclass(frozen=True, eq=False)
class Mended:
    """A track between two anchors."""

    xy: Float[np.ndarray, "frames 2"]
    covariance: Float[np.ndarray, "frames 2 2"]
    side: Int[np.ndarray, "frames"]
    """Which trace it followed: 0 forward, 1 backward, 2 both."""


def mend(frames: Frames, gap: Gap, options: MendOptions = MendOptions(), *, progress: Progress = silent) -> Mended:
    """The track of a gap. Time and the frames looked at are linear in its length; one frame is in memory at a time.

    frames: the images in whose pixels the gap is told; they are asked for `gap.frame`.
    """
    numbers = [int(number) for number in gap.frame]
    search = _Search(gap, options)
    search.refer(next(iter(frames.gray(numbers[-1:])))[1])
    for k, (_, image) in enumerate(steps(frames.gray(numbers), "Mending a track", progress, total=len(numbers))):
        search.add(k, image)
    return search.path()


def _blurred(
    image: GrayImage, around: Float[np.ndarray, "places 2"], reach: float, sigma: float
) -> tuple[UInt8[np.ndarray, "rows columns"], Float[np.ndarray, "2"]]:
    """The part of an image within `reach` pixels of some places, blurred, and where its first pixel is in the image: blurring all of it takes as long as
    everything else together.
    """
    margin = reach + 4.0 * sigma + 2.0
    height, width = image.shape
    (x0, y0), (x1, y1) = np.floor(around.min(axis=0) - margin), np.ceil(around.max(axis=0) + margin)
    left, top = int(np.clip(x0, 0, width - 1)), int(np.clip(y0, 0, height - 1))
    part = image[top : int(np.clip(y1, top + 1, height)), left : int(np.clip(x1, left + 1, width))]
    blurred = cv2.GaussianBlur(part, (0, 0), sigma) if sigma > 0 else np.ascontiguousarray(part)
    return np.asarray(blurred, np.uint8), np.array([left, top], dtype=np.float64)


class _Search:
    """The layers so far: costs of getting there, and the way back."""

    def __init__(self, gap: Gap, options: MendOptions) -> None:
        self.gap, self.options = gap, options
        count = len(gap.frame)
        side = 2 * options.half_patch + 1
        self.references = np.zeros((2, side * side))
        self.affine = np.tile(np.eye(2), (count, 1, 1)) if gap.affine is None else gap.affine
        self.layers: list[Layer] = []
        self.costs: list[Float[np.ndarray, "nodes"]] = []
        self.own: list[Float[np.ndarray, "nodes"]] = []
        self.back: list[Int[np.ndarray, "nodes"]] = []
        self.trust = np.ones((count, 3))
        self.patches = np.zeros((2, side * side))
        self.last_patch: Float[np.ndarray, "traces samples"] | None = None

    def refer(self, image: GrayImage) -> None:
        """The frame of the last anchor, for its patch."""
        part, first = _blurred(image, self.gap.backward[-1:], self._reach(np.eye(2)), self.options.blur)
        x, y = self.gap.backward[-1] - 0.5 - first
        cut_patch(part, float(x), float(y), np.eye(2), self.options.half_patch, self.references[1])

    def add(self, k: int, image: GrayImage) -> None:
        """The next frame."""
        gap, options = self.gap, self.options
        here = layer(gap, k, options.windows)
        # The last anchor's patch is turned back from the first frame's: its own affine is the last one.
        affines = np.stack([self.affine[k], self.affine[k] @ np.linalg.inv(self.affine[-1])])
        places = np.concatenate([here.nodes, gap.forward[k : k + 1], gap.backward[k : k + 1]])
        part, first = _blurred(image, places, max(self._reach(affine) for affine in (np.eye(2), *affines)), options.blur)
        if k == 0:
            x, y = gap.forward[0] - 0.5 - first
            cut_patch(part, float(x), float(y), np.eye(2), options.half_patch, self.references[0])
        self._confirm(k, part, first)
        own = np.zeros(len(here.nodes))
        if not options.literal_weight and 0 < k < len(gap.frame) - 1:
            lines = np.zeros((0, 4)) if gap.lines is None else gap.lines[k].copy()
            if len(lines):
                lines[:, 2] -= lines[:, :2] @ (0.5 + first)
            node_costs(part, here.nodes - 0.5 - first, affines, self.references, options.half_patch, options.patch_weight, lines, options.line_weight, own)
        if k == 0:
            self.costs.append(own.copy())
            self.back.append(np.zeros(1, dtype=np.int64))
        else:
            before = self.layers[-1]
            traced = before.nodes if options.literal_weight else before.nodes + self._motion(k - 1)[before.side]
            trust = self.trust[k - 1][before.side]
            stiffness = (1.0 / trust if options.literal_weight else trust) / options.trace_sigma**2
            reached, came_from = np.empty(len(here.nodes)), np.empty(len(here.nodes), dtype=np.int64)
            next_layer(before.nodes, self.costs[-1], traced, stiffness, here.nodes, own, reached, came_from)
            self.costs.append(reached)
            self.back.append(came_from)
        self.layers.append(here)
        self.own.append(own)

    def _motion(self, k: int) -> Float[np.ndarray, "traces 2"]:
        """From frame k to the next by the forward trace, the backward one, and both together."""
        forward, backward = self.gap.forward[k + 1] - self.gap.forward[k], self.gap.backward[k + 1] - self.gap.backward[k]
        share = float(shares(self.gap)[k])
        return np.stack([forward, backward, (1.0 - share) * forward + share * backward])

    def _reach(self, affine: Float[np.ndarray, "2 2"]) -> float:
        """How far a patch reaches from its middle, pixels."""
        return float(np.sqrt(2.0) * self.options.half_patch * np.linalg.norm(affine, 2)) + 1.0

    def _confirm(self, k: int, image: UInt8[np.ndarray, "rows columns"], first: Float[np.ndarray, "2"]) -> None:
        """How well the patches at both ends of the last step agree, for each trace: a trace that jumps is not confirmed where it does."""
        options = self.options
        patches = np.zeros_like(self.patches)
        for side, trace in enumerate((self.gap.forward, self.gap.backward)):
            x, y = trace[k] - 0.5 - first
            if cut_patch(image, float(x), float(y), self.affine[k], options.half_patch, patches[side]) < 0.0:
                patches[side] = 0.0
        if k > 0 and self.last_patch is not None:
            agreement = np.clip((patches * self.last_patch).sum(axis=1), -1.0, 1.0)
            trust = np.maximum(np.exp(-(1.0 - agreement) / options.trust_scale), options.least_trust)
            share = float(shares(self.gap)[k])
            self.trust[k - 1] = [trust[0], trust[1], (1.0 - share) * trust[0] + share * trust[1]]
        self.last_patch = patches

    def path(self) -> Mended:
        """The cheapest way back from the last anchor, settled between pixels."""
        gap, options = self.gap, self.options
        count = len(gap.frame)
        chosen = np.zeros(count, dtype=np.int64)
        for k in range(count - 1, 0, -1):
            chosen[k - 1] = self.back[k][chosen[k]]
        places = np.array([self.layers[k].nodes[chosen[k]] for k in range(count)])
        side = np.array([int(self.layers[k].side[chosen[k]]) for k in range(count)])
        if options.settle is None:
            return Mended(places, np.tile(np.eye(2), (count, 1, 1)), side)
        for k in range(1, count - 1):
            places[k] += self._between(k, int(chosen[k]))
        motion = np.array([self._motion(k)[side[k]] for k in range(count - 1)])
        weight = np.array([self.trust[k, side[k]] if side[k] == side[k + 1] else 0.0 for k in range(count - 1)])
        xy, sigma = settle_path(places, motion, weight, options.settle)
        variance = sigma**2 + options.common_sigma**2
        return Mended(xy, variance[:, None, None] * np.eye(2), side)

    def _between(self, k: int, node: int) -> Float[np.ndarray, "2"]:
        """From the chosen candidate to the top of the parabola through its neighbours' costs, at most half a pixel each way."""
        here = self.layers[k]
        window = np.flatnonzero(here.side == here.side[node])
        width = round(float(np.sqrt(len(window))))
        at = node - int(window[0])
        own = self.own[k][window]
        row, column = divmod(at, width)
        out = np.zeros(2)
        for axis, (place, stride) in enumerate(((column, 1), (row, width))):
            if 0 < place < width - 1:
                before, middle, after = own[at - stride], own[at], own[at + stride]
                bend = before - 2.0 * middle + after
                if bend > 1e-6:
                    out[axis] = np.clip(0.5 * (before - after) / bend, -0.5, 0.5)
        return out
