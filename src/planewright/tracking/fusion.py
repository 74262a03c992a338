"""Corners moved by what lines say: in space by the lines of the whole clip, then in every frame by what is left in that frame.

The structure is exact: its corners lie on shared planes and obey relations, and were found in some views of reduced size. The lines of
all frames at full size show by how much each corner is beside that. A displacement in space serves near and far frames alike, where one
number in pixels would not (a hall that is walked through shows the same centimetre as 1 pixel and as 6).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from planewright.arrays import Bool, Float, Int

CLEAR_END = 0.3
"""Weight at an edge's end (`FrameLines.end_weight`) from which its scatter is that of the line, and not of where it is extended to."""
FEW_LINES = 50
"""Below so many offsets nothing is said of their scatter."""
TOGETHER = 1.5
"""Robust standard deviations from the place that most frames of an edge agree on at which a frame has half its say. Of 19 clips' corners the negative
log-likelihood is -1.64 with it, -1.62 with 3: in a quarter of the frames of some edges another line is the steeper one."""
TOGETHER_FLOOR = 0.3
"""At least so far, pixels."""
TOGETHER_PRIOR = 1e-2
"""Share of the model's information that keeps that place where the frames leave it open."""
LEAST_SCALE = 0.1
"""Pictures without any noise still have pixels."""


@dataclass(frozen=True, kw_only=True)
class FusionOptions:
    """How lines move corners.

    Measured on 19 clips, 18 of them with exact truth, by the negative log-likelihood of each corner's mean offset from the truth under its
    covariance: -1.71 with these; -1.05 with one prior, least squares about all lines, and a corner's own residuals as its scale. The optimum is flat:
    twice or half the chances, reaches and factors, one at a time, cost up to .08.
    """

    line_sigma: float = 0.35
    """Standard deviation of a line at the end of an edge that is seen whole, in one frame, pixels, before `frame_scale`."""
    corner_sigma: float = 0.15
    """Standard deviation of what a frame may add to a corner by itself, pixels, before `frame_scale`."""
    frame_sigma: float = 0.6
    """Standard deviation of the motion a frame may add to the whole picture, pixels, before `frame_scale`."""
    edge_sigma: float = 0.25
    """Error that an edge's line has in common in all frames (shading, a rounded edge), pixels: more frames do not make it smaller."""
    other_line: float = 0.15
    """Chance that what is found near an edge is another line in all frames. Of 1150 edge ends 11 % were beside the true edge by more than a pixel. Of
    lines more than a pixel from a model that is sure to half a pixel none was right."""
    other_reach: float = 2.0
    """Standard deviation of another line's place beside the edge, pixels of a typical frame: about even over the reach of the search."""
    mark_sigma: float = 1.2
    """Standard deviation of a mark on each axis, pixels."""
    model_wrong: float = 0.2
    """Chance that a corner of the model is off by more than it knows (a relation that does not hold, an edge that is another line)."""
    wrong_factor: float = 3.0
    """What its standard deviations are multiplied by then."""
    model_floor: float = 0.03
    """Standard deviation of a corner in the model that is always allowed for, pixels of a typical frame."""
    usual_misfit: float = 0.72
    """What lines are beside the model in the median over clips (robust standard deviation), over what both allow for: both have looked at the
    same pictures. It was .4 on boxes with sharp edges, 1.1 under a rolling shutter and on a model house seen from afar."""
    clip_weight: float = 0.8
    """How much a clip's own misfit says of its scale, as a share of the variance, when many edges speak."""
    few_ends: int = 15
    """Edge ends at which it says half of that."""
    doubt: float = 0.8
    """What is left of the standard deviation of a corner's doubt about which line its edge is, as a factor: frames cannot lift it, for they look where
    the model is, and find again what it chose."""
    doubt_above: float = 0.4
    """Standard deviation of a corner in the model, pixels, from which half or more of its variance is that doubt."""
    most_edges: int = 6
    """Edges of a corner that are heard, those that are seen best; their combinations double with each."""

    @property
    def model_inflation(self) -> float:
        """What the model's standard deviations are multiplied by, all in all, before lines move a corner."""
        return float(np.sqrt(1.0 - self.model_wrong + self.model_wrong * self.wrong_factor**2))


@dataclass(frozen=True, eq=False)
class FrameLines:
    """Where the lines of edges lie in frames, beside where the model shows the edges."""

    edges: Int[np.ndarray, "edges 2"]
    """Rows of their points."""
    normal: Float[np.ndarray, "rows edges 2"]
    """Unit, in the image, at right angles to the projected edge."""
    place: Float[np.ndarray, "rows edges 2 2"]
    """Pixels: where each end is looked at; the corner, or for an edge that passes the camera a place in front of it."""
    at_corner: Bool[np.ndarray, "rows edges 2"]
    """Whether `place` is the corner."""
    offset: Float[np.ndarray, "rows edges 2"]
    """Of the line from the model's edge along `normal`, pixels, at both ends."""
    information: Float[np.ndarray, "rows edges 2 2"]
    """Of `offset`, for samples that make a standard deviation of 1 at the ends of an edge that is seen whole; zero where no line was found."""

    @property
    def found(self) -> Bool[np.ndarray, "rows edges"]:
        """Where there is a line."""
        return self.information[..., 0, 0] + self.information[..., 1, 1] > 0

    def end_weight(self) -> Float[np.ndarray, "rows edges 2"]:
        """One over the variance of each end by itself, in the units of `information`: 1 for an edge that is seen whole, less at an end that is not seen."""
        aa, bb, ab = self.information[..., 0, 0], self.information[..., 1, 1], self.information[..., 0, 1]
        det = np.maximum(aa * bb - ab * ab, 0.0)
        safe = np.where(self.found, np.stack([bb, aa]), 1.0)
        return np.where(self.found, det / np.maximum(safe, 1e-12), 0.0).transpose(1, 2, 0)


@dataclass(frozen=True, eq=False)
class MarkOffsets:
    """How far the person's marks are from where the model shows the corners."""

    point: Int[np.ndarray, "marks"]
    row: Int[np.ndarray, "marks"]
    """Of the frame."""
    offset: Float[np.ndarray, "marks 2"]
    """Pixels, from the model to the mark."""


@dataclass(frozen=True, eq=False)
class _EdgeEnd:
    """What one edge says of one of its corners, all frames together."""

    slopes: Float[np.ndarray, "frames 3"]
    """Of its offset by the corner's place, pixels per world unit."""
    offsets: Float[np.ndarray, "frames"]
    shares: Float[np.ndarray, "frames"]
    """Sum to 1."""
    weight: float
    """One over the variance, in units of the variance of an edge that is seen whole."""

    @property
    def offset(self) -> float:
        """Mean, pixels."""
        return float(self.shares @ self.offsets)

    def variance(self, covariance: Float[np.ndarray, "3 3"]) -> float:
        """Of the corner along the normal, pixels squared, mean over the frames."""
        return float(self.shares @ np.einsum("ki,ij,kj->k", self.slopes, covariance, self.slopes))


def refit_corners(
    lines: FrameLines | None,
    marks: MarkOffsets,
    jacobian: Float[np.ndarray, "rows points 2 3"],
    point_covariance: Float[np.ndarray, "points 3 3"],
    options: FusionOptions,
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3 3"]]:
    """Displacement of each corner in space by its marks and the lines of the clip, and its covariance; zero and the model's own where there are none.

    Each corner by itself. Either the model knows it as well as it says, or it is wrong; each of its edges' lines is the edge or another one, and
    which can be told by whether they fit together. All combinations are solved and weighed by how likely they make what was seen (a mixture of
    Gaussians; Bishop, Pattern Recognition and Machine Learning, 2006, ch. 9). Mean and covariance are those of the mixture: a corner whose lines,
    marks and model contradict each other says so. A frame says the same as the others, so an edge's line counts once. The marks had their say in
    the model and weigh only on whether it is believed; where it is not, they are heard again. Doubt about which line an edge is stays
    (`FusionOptions.doubt`). The model's and the lines' variances are scaled by what this clip shows of them (`clip_scale`).

    lines: None while none were looked for. jacobian: pixels per world unit.
    """
    num_points = jacobian.shape[1]
    shift, covariance = np.zeros((num_points, 3)), point_covariance.copy()
    placed: Bool[np.ndarray, "points"] = np.asarray(np.isfinite(point_covariance).all(axis=(1, 2)) & np.isfinite(jacobian).all(axis=(0, 2, 3)))
    ends = [_edge_ends(lines, jacobian, i, _floored(point_covariance[i], jacobian[:, i], options), options) if placed[i] else [] for i in range(num_points)]
    misfits = [(end.offset, end.variance(point_covariance[i]) + options.edge_sigma**2 / end.weight) for i in range(num_points) for end in ends[i]]
    scale = clip_scale(misfits, options)
    for i in np.nonzero(placed)[0]:
        mine = np.nonzero(marks.point == i)[0]
        if not ends[i] and len(mine) == 0:
            continue
        pixel = 1.0 / _pixels_per_unit(jacobian[:, i])
        model = scale**2 * _floored(point_covariance[i], jacobian[:, i], options)
        other = (options.other_reach * pixel) ** 2 * np.eye(3)
        slopes, offsets = jacobian[marks.row[mine], i].reshape(-1, 3), marks.offset[mine].reshape(-1)
        shift[i], joint = _mixed(model, other, ends[i], scale * options.edge_sigma, slopes, offsets, options)
        covariance[i] = joint + (_beyond(model, options.doubt_above * pixel) * options.doubt**2 if ends[i] else 0.0)
    return shift, covariance


def clip_scale(misfits: Sequence[tuple[float, float]], options: FusionOptions) -> float:
    """What the standard deviations of model and lines are to be multiplied by in this clip, from how far they are apart (Birge, Physical Review 40, 1932).

    The median tells: the many edges that are found, not the few that are another line. Few edges say little.

    misfits: of each edge end, its offset from the model and the variance that both allow for, pixels.
    """
    if not misfits:
        return 1.0
    offset, variance = np.array(misfits).T
    shown = 1.4826 * float(np.median(np.abs(offset) / np.sqrt(variance))) / options.usual_misfit
    weight = options.clip_weight * len(misfits) / (len(misfits) + options.few_ends)
    return float(np.sqrt(weight * shown**2 + 1.0 - weight))


def _together(
    slopes: Float[np.ndarray, "frames 3"], offsets: Float[np.ndarray, "frames"], weight: Float[np.ndarray, "frames"], model: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "frames"]:
    """Cauchy weights of an edge's frames about the one place in space that most of them agree on: near frames see the same displacement larger."""
    robust, weak = np.ones(len(offsets)), TOGETHER_PRIOR * np.linalg.inv(model)
    away = np.abs(offsets - np.median(offsets))
    for _ in range(6):
        robust = 1.0 / (1.0 + (away / max(TOGETHER * 1.4826 * float(np.median(away)), TOGETHER_FLOOR)) ** 2)
        w = weight * robust / max(float((weight * robust).sum()), 1e-12)
        place = np.linalg.solve((slopes * w[:, None]).T @ slopes + weak, (slopes * w[:, None]).T @ offsets)
        away = np.abs(offsets - slopes @ place)
    return robust


def _edge_ends(
    lines: FrameLines | None, jacobian: Float[np.ndarray, "rows points 2 3"], corner: int, model: Float[np.ndarray, "3 3"], options: FusionOptions
) -> list[_EdgeEnd]:
    """The edges at a corner that were found in five frames or more, those that are seen best."""
    found: list[_EdgeEnd] = []
    if lines is None:
        return found
    weight = lines.end_weight()
    for e, side in np.argwhere(lines.edges == corner):
        k = np.nonzero(lines.found[:, e] & lines.at_corner[:, e, side])[0]
        if len(k) < 5:
            continue
        offsets, slopes = lines.offset[k, e, side], np.einsum("ki,kij->kj", lines.normal[k, e], jacobian[k, corner])
        robust = _together(slopes, offsets, weight[k, e, side], model)
        w = weight[k, e, side] * robust
        # Frames say the same thing again; below ten they are too few to be sure of even that.
        total = float(w.sum()) / max(float(robust.sum()), 10.0)
        if total > 1e-6:
            found.append(_EdgeEnd(slopes, offsets, w / w.sum(), total))
    order = sorted(range(len(found)), key=lambda n: (-found[n].weight, n))[: options.most_edges]
    return [found[n] for n in sorted(order)]


def _mixed(
    model: Float[np.ndarray, "3 3"],
    other: Float[np.ndarray, "3 3"],
    ends: Sequence[_EdgeEnd],
    edge_sigma: float,
    slopes: Float[np.ndarray, "numbers 3"],
    offsets: Float[np.ndarray, "numbers"],
    options: FusionOptions,
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Mean and covariance of a corner's displacement over all answers to: is the model right, is each line the edge?

    other: covariance of another line's displacement from the edge. slopes, offsets: of the marks, by the corner's place and from the model, pixels.
    """
    is_edge = np.array(list(product((False, True), repeat=len(ends))), bool).reshape(2 ** len(ends), len(ends))
    shares = [end.shares * (end.weight / edge_sigma**2) for end in ends]
    own = [(end.slopes * share[:, None]).T @ end.slopes for end, share in zip(ends, shares, strict=True)]
    toward = [(end.slopes * share[:, None]).T @ end.offsets for end, share in zip(ends, shares, strict=True)]
    information, pull = np.zeros((len(is_edge), 3, 3)), np.zeros((len(is_edge), 3))
    for j in range(len(ends)):
        information[is_edge[:, j]] += own[j]
        pull[is_edge[:, j]] += toward[j]
    means, spreads, logs = [], [], []
    for factor, chance in ((1.0, 1.0 - options.model_wrong), (options.wrong_factor, options.model_wrong)):
        prior = factor**2 * model
        inverse = np.linalg.inv(prior)
        spread = np.linalg.inv(information + inverse)
        mean = np.einsum("cij,cj->ci", spread, pull)
        log = np.log(chance) + 0.5 * np.einsum("ci,ci->c", mean, pull) + 0.5 * np.linalg.slogdet(spread @ inverse)[1]
        for j in range(len(ends)):
            # Another line is as fixed in space as the edge, elsewhere: both explain what frames have in common, and differ by how far it is away.
            elsewhere = np.linalg.inv(prior + other)
            free = np.linalg.inv(own[j] + elsewhere)
            alone = 0.5 * float(toward[j] @ free @ toward[j]) + 0.5 * float(np.linalg.slogdet(free @ elsewhere)[1])
            log = log + np.where(is_edge[:, j], np.log1p(-options.other_line), np.log(options.other_line) + alone)
        if len(offsets):
            left = offsets - mean @ slopes.T
            both = slopes @ spread @ slopes.T + options.mark_sigma**2 * np.eye(len(offsets))
            log = log - 0.5 * np.einsum("cm,cm->c", left, np.linalg.solve(both, left[..., None])[..., 0]) - 0.5 * np.linalg.slogdet(both)[1]
            if factor > 1.0:
                gain = np.linalg.solve(both, slopes @ spread).transpose(0, 2, 1)
                mean = mean + np.einsum("cim,cm->ci", gain, left)
                spread = spread - gain @ slopes @ spread
        means.append(mean)
        spreads.append(spread)
        logs.append(log)
    mean, spread, log = np.concatenate(means), np.concatenate(spreads), np.concatenate(logs)
    share = np.exp(log - log.max())
    share /= share.sum()
    middle = share @ mean
    around = mean - middle
    joint = np.einsum("c,cij->ij", share, spread) + np.einsum("c,ci,cj->ij", share, around, around)
    return middle, 0.5 * (joint + joint.T)


def _pixels_per_unit(jacobian: Float[np.ndarray, "rows 2 3"]) -> float:
    """In a typical frame."""
    return max(float(np.median(np.linalg.norm(jacobian, axis=(1, 2)))) / np.sqrt(2.0), 1e-12)


def _floored(covariance: Float[np.ndarray, "3 3"], jacobian: Float[np.ndarray, "rows 2 3"], options: FusionOptions) -> Float[np.ndarray, "3 3"]:
    """Nothing is surer than `FusionOptions.model_floor`."""
    return covariance + (options.model_floor / _pixels_per_unit(jacobian)) ** 2 * np.eye(3)


def _beyond(covariance: Float[np.ndarray, "3 3"], size: float) -> Float[np.ndarray, "3 3"]:
    """The part of a covariance that exceeds a standard deviation, along each axis: v becomes v^2 / (v + size^2)."""
    values, axes = np.linalg.eigh(covariance)
    return np.asarray((axes * (values**2 / (np.abs(values) + size**2))) @ axes.T)


def usual_offset(lines: FrameLines, offset: Float[np.ndarray, "rows edges 2"]) -> Float[np.ndarray, "edges 2"]:
    """Each edge's median offset over the frames, at both ends; 0 where it was found in fewer than five."""
    values = np.where(lines.found[..., None], offset, np.nan)
    enough = lines.found.sum(axis=0) >= 5
    usual = np.zeros(offset.shape[1:])
    if enough.any():
        usual[enough] = np.nanmedian(values[:, enough], axis=0)
    return usual


def frame_scale(lines: FrameLines, left: Float[np.ndarray, "rows edges 2"], options: FusionOptions) -> float:
    """What the standard deviations of single frames are to be multiplied by, from how the lines of this clip scatter over its frames; 1 where few were found.

    Lines scatter by .12 pixels on a sharp clip and by .75 on one of few bits, and what corners are off besides their constant offsets is half of that.

    left: the lines' offsets less what each edge has in common in all frames, pixels.
    """
    clear = (lines.end_weight() > CLEAR_END) & lines.at_corner
    if np.count_nonzero(clear) < FEW_LINES:
        return 1.0
    return max(1.4826 * float(np.median(np.abs(left[clear]))) / float(np.hypot(options.line_sigma, options.corner_sigma)), LEAST_SCALE)


def fuse_frames(
    lines: FrameLines,
    base: Float[np.ndarray, "rows points 2"],
    offset: Float[np.ndarray, "rows edges 2"],
    image_size: tuple[int, int],
    options: FusionOptions,
    scale: float = 1.0,
) -> tuple[Float[np.ndarray, "rows points 2"], Float[np.ndarray, "rows points 2 2"]]:
    """Corners moved by an affine motion of each frame and their own part, both with priors, as that frame's lines say.

    With the corners' own parts independent, the affine part is solved by itself from lines whose variance includes them; each
    corner then takes its share of what is left at its own edges. Cauchy weights a line, so that lines that are wrong in one frame
    (a hand, a shadow) do not bend it.

    base: corners as the clip has them; offset: of the lines from there. scale: of all three standard deviations (`frame_scale`).
    """
    num_rows, num_points = base.shape[:2]
    moved = base.copy()
    own, line, frame = (scale * options.corner_sigma) ** 2, (scale * options.line_sigma) ** 2, (scale * options.frame_sigma) ** 2
    spread = np.zeros((num_rows, num_points, 2, 2))
    spread[..., 0, 0] = spread[..., 1, 1] = own
    half = 0.5 * max(image_size)
    middle = 0.5 * np.array(image_size)
    prior = np.eye(6) / frame
    found, weights = lines.found, lines.end_weight()
    for k in range(num_rows):
        used = np.nonzero(found[k])[0]
        if len(used) == 0:
            spread[k, :, 0, 0] += frame
            spread[k, :, 1, 1] += frame
            continue
        share = weights[k, used].reshape(-1)
        n = np.repeat(lines.normal[k, used], 2, axis=0)
        value = offset[k, used].reshape(-1)
        corner = lines.edges[used].reshape(-1)
        at_corner = lines.at_corner[k, used].reshape(-1)
        q = np.clip((lines.place[k, used].reshape(-1, 2) - middle) / half, -3.0, 3.0)
        rows6 = np.concatenate([n * q[:, :1], n * q[:, 1:], n], axis=1)
        variance = line / np.maximum(share, 1e-6) + own
        robust = np.ones(len(value))
        motion = np.zeros(6)
        for _ in range(6):
            w = robust / variance
            motion = np.linalg.solve(prior + (rows6 * w[:, None]).T @ rows6, (rows6 * w[:, None]).T @ value)
            robust = 1.0 / (1.0 + ((value - rows6 @ motion) / (2.5 * np.sqrt(variance))) ** 2)
        w = robust / variance
        motion_covariance = np.linalg.inv(prior + (rows6 * w[:, None]).T @ rows6)
        left = value - rows6 @ motion
        information = np.tile(np.eye(2) / own, (num_points, 1, 1))
        pull = np.zeros((num_points, 2))
        lw = robust * share / line * at_corner
        np.add.at(information, corner, lw[:, None, None] * n[:, :, None] * n[:, None, :])
        np.add.at(pull, corner, (lw * left)[:, None] * n)
        alone = np.linalg.inv(information)
        at = np.clip((base[k] - middle) / half, -3.0, 3.0)
        x, y = at[:, 0], at[:, 1]
        moved[k, :, 0] += motion[0] * x + motion[2] * y + motion[4]
        moved[k, :, 1] += motion[1] * x + motion[3] * y + motion[5]
        moved[k] += np.einsum("pij,pj->pi", alone, pull)
        jac = np.zeros((num_points, 2, 6))
        jac[:, 0, 0], jac[:, 1, 1], jac[:, 0, 2], jac[:, 1, 3], jac[:, 0, 4], jac[:, 1, 5] = x, x, y, y, 1.0, 1.0
        spread[k] = alone + jac @ motion_covariance @ jac.transpose(0, 2, 1)
    return moved, spread
