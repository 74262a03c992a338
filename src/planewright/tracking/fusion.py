"""Corners moved by what lines say: in space by the lines of the whole clip, then in every frame by what is left in that frame.

The structure is exact: its corners lie on shared planes and obey relations, and were found in some views of reduced size. The lines of
all frames at full size show by how much each corner is beside that. A displacement in space serves near and far frames alike, where one
number in pixels would not (a hall that is walked through shows the same centimetre as 1 pixel and as 6).
"""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Int


@dataclass(frozen=True, kw_only=True)
class FusionOptions:
    """How lines move corners."""

    line_sigma: float = 0.35
    """Standard deviation of a line at the end of an edge that is seen whole, in one frame, pixels."""
    edge_sigma: float = 0.4
    """Error that an edge's line has in common in all frames (shading, a rounded edge, a line beside it), pixels: more frames do not make it smaller."""
    mark_sigma: float = 1.2
    """Standard deviation of a mark on each axis, pixels."""
    mark_gate: float = 4.0
    """Mean square of a corner's distances from its marks, over their variance, above which the model is not believed there. Below, the marks have had
    their say in the model, and would draw a corner that is seen well from near to a click that was made from afar."""
    model_inflation: float = 2.0
    """What the model's standard deviations are multiplied by before the lines of the clip move a corner: with 1 the walk through a hall keeps a
    root mean square of 1.3 pixels, with 2 of 0.9, and clips with good models do not change."""
    model_floor: float = 0.3
    """Standard deviation of a corner in the model that is always allowed for, pixels of a typical frame."""
    agreement: float = 0.1
    """Squared misfit of an edge, over what is allowed for, where nothing is known of a corner's edges yet."""
    most_misfit: float = 16.0
    """Squared misfit that an edge counts with at most: one farther off is another line."""
    frame_sigma: float = 0.6
    """Standard deviation of the motion a frame may add to the whole picture, pixels."""
    corner_sigma: float = 0.15
    """Standard deviation of what it may add to a corner by itself, pixels."""


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


def refit_corners(
    lines: FrameLines | None,
    marks: MarkOffsets,
    jacobian: Float[np.ndarray, "rows points 2 3"],
    point_covariance: Float[np.ndarray, "points 3 3"],
    options: FusionOptions,
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3 3"]]:
    """Displacement of each corner in space by its marks and the lines of the clip, and its covariance; zero and the model's own where there are none.

    Each corner by itself: minimizes the model's prior plus, for each edge at it, the mean over the frames of the squared distance to that
    frame's line, over the edge's common error. Cauchy weights about that error, so that a line that is another one has little say. Where
    the marks are farther from the model than both allow, the model is wrong by more than it knows (a relation that does not hold, say):
    its prior is widened until they agree, and the marks' squared distances over their variance are added.

    lines: None while none were looked for. jacobian: pixels per world unit.
    """
    num_points = jacobian.shape[1]
    shift, covariance = np.zeros((num_points, 3)), point_covariance.copy()
    weight = None if lines is None else lines.end_weight()
    for i in range(num_points):
        if not np.isfinite(point_covariance[i]).all():
            continue
        mine = np.nonzero(marks.point == i)[0]
        a, b, share = jacobian[marks.row[mine], i].reshape(-1, 3), marks.offset[mine].reshape(-1), np.full(2 * len(mine), 1.0 / options.mark_sigma**2)
        wide = _widened(point_covariance[i], jacobian[:, i], options)
        misfit = float(b @ np.linalg.solve(a @ wide @ a.T + options.mark_sigma**2 * np.eye(len(b)), b)) / max(len(b), 1)
        at_marks = len(b) if misfit > options.mark_gate else 0
        a, b, share = a[:at_marks], b[:at_marks], share[:at_marks]
        wide = wide * (misfit if at_marks else 1.0)
        if lines is not None and weight is not None:
            for e, side in np.argwhere(lines.edges == i):
                k = np.nonzero(lines.found[:, e] & lines.at_corner[:, e, side])[0]
                if len(k) >= 5:
                    a = np.concatenate([a, np.einsum("ki,kij->kj", lines.normal[k, e], jacobian[k, i])])
                    b = np.concatenate([b, lines.offset[k, e, side]])
                    # Frames say the same thing again; below ten they are too few to be sure of even that.
                    share = np.concatenate([share, weight[k, e, side] / max(len(k), 10) / options.edge_sigma**2])
        if len(b) == 0:
            continue
        prior = np.linalg.inv(wide)
        x, robust = np.zeros(3), np.ones(len(b))
        for _ in range(10):
            w = robust * share
            x = np.linalg.solve(prior + (a * w[:, None]).T @ a, (a * w[:, None]).T @ b)
            robust = 1.0 / (1.0 + ((b - a @ x) / options.edge_sigma) ** 2)
            robust[:at_marks] = 1.0
        w = robust * share
        shift[i] = x
        covariance[i] = np.linalg.inv(prior + (a * w[:, None]).T @ a)
    return shift, covariance


def usual_offset(lines: FrameLines, offset: Float[np.ndarray, "rows edges 2"]) -> Float[np.ndarray, "edges 2"]:
    """Each edge's median offset over the frames, at both ends; 0 where it was found in fewer than five."""
    values = np.where(lines.found[..., None], offset, np.nan)
    enough = lines.found.sum(axis=0) >= 5
    usual = np.zeros(offset.shape[1:])
    if enough.any():
        usual[enough] = np.nanmedian(values[:, enough], axis=0)
    return usual


def disagreement(
    lines: FrameLines,
    usual: Float[np.ndarray, "edges 2"],
    shift: Float[np.ndarray, "points 3"],
    jacobian: Float[np.ndarray, "rows points 2 3"],
    point_covariance: Float[np.ndarray, "points 3 3"],
    options: FusionOptions,
) -> Float[np.ndarray, "points"]:
    """What each corner's covariance from `refit_corners` is to be multiplied by, from how well its edges and the model agree about it.

    Most edges lie within .1 pixels of where the others put their corner, and some, which are another line, 2 pixels off: one sigma for all is
    too wide for the many and too narrow for the few. The mean over the corner's edges and its model of their squared misfits over what
    was allowed for, together with one more that is `agreement` (a variance with an inverse gamma prior). 1 where fewer than two speak.

    usual: what is left of the edges' offsets after `shift`, the displacement of the corners.
    """
    factor = np.ones(len(shift))
    spoke = (lines.found[..., None] & lines.at_corner).sum(axis=0) >= 5
    for i in range(len(shift)):
        misfits = [min(float(usual[e, side] / options.edge_sigma) ** 2, options.most_misfit) for e, side in np.argwhere((lines.edges == i) & spoke)]
        if not misfits or not np.isfinite(point_covariance[i]).all():
            continue
        wide = _widened(point_covariance[i], jacobian[:, i], options)
        misfits.append(float(shift[i] @ np.linalg.solve(wide, shift[i])))
        factor[i] = (options.agreement + sum(misfits)) / (1 + len(misfits))
    return factor


def _widened(point_covariance: Float[np.ndarray, "3 3"], jacobian: Float[np.ndarray, "rows 2 3"], options: FusionOptions) -> Float[np.ndarray, "3 3"]:
    """The model's covariance as the lines of the clip are allowed to move a corner from it."""
    size = np.linalg.norm(jacobian, axis=(1, 2)) / np.sqrt(2.0)
    return options.model_inflation**2 * point_covariance + (options.model_floor / max(float(np.median(size)), 1e-12)) ** 2 * np.eye(3)


def fuse_frames(
    lines: FrameLines,
    base: Float[np.ndarray, "rows points 2"],
    offset: Float[np.ndarray, "rows edges 2"],
    image_size: tuple[int, int],
    options: FusionOptions,
) -> tuple[Float[np.ndarray, "rows points 2"], Float[np.ndarray, "rows points 2 2"]]:
    """Corners moved by an affine motion of each frame and their own part, both with priors, as that frame's lines say.

    With the corners' own parts independent, the affine part is solved by itself from lines whose variance includes them; each
    corner then takes its share of what is left at its own edges. Cauchy weights a line, so that lines that are wrong in one frame
    (a hand, a shadow) do not bend it.

    base: corners as the clip has them; offset: of the lines from there.
    """
    num_rows, num_points = base.shape[:2]
    moved = base.copy()
    own = options.corner_sigma**2
    spread = np.zeros((num_rows, num_points, 2, 2))
    spread[..., 0, 0] = spread[..., 1, 1] = own
    half = 0.5 * max(image_size)
    middle = 0.5 * np.array(image_size)
    prior = np.eye(6) / options.frame_sigma**2
    found, weights = lines.found, lines.end_weight()
    for k in range(num_rows):
        used = np.nonzero(found[k])[0]
        if len(used) == 0:
            spread[k, :, 0, 0] += options.frame_sigma**2
            spread[k, :, 1, 1] += options.frame_sigma**2
            continue
        share = weights[k, used].reshape(-1)
        n = np.repeat(lines.normal[k, used], 2, axis=0)
        value = offset[k, used].reshape(-1)
        corner = lines.edges[used].reshape(-1)
        at_corner = lines.at_corner[k, used].reshape(-1)
        q = np.clip((lines.place[k, used].reshape(-1, 2) - middle) / half, -3.0, 3.0)
        rows6 = np.concatenate([n * q[:, :1], n * q[:, 1:], n], axis=1)
        variance = options.line_sigma**2 / np.maximum(share, 1e-6) + own
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
        lw = robust * share / options.line_sigma**2 * at_corner
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
