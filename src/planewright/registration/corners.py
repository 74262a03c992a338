"""Corner tracks from registered faces: the faces of a corner fused in every frame, visibility, and one smooth path over the clip."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.registration.follow import loop_ends
from planewright.registration.homography import apply_homography, change_jacobian, point_jacobian
from planewright.registration.registered import CELLS, Registered
from planewright.registration.smooth import SmoothOptions, smooth_path
from planewright.registration.strands import Strand
from planewright.registration.templates import cell_of
from planewright.sketch.graph import Sketch
from planewright.tracking.tracks import State, Tracks


@dataclass(frozen=True, kw_only=True)
class CornerTrackOptions:
    """How corners are read off the faces."""

    click_sigma: float = 1.0
    """Standard deviation of a mark along an axis, pixels."""
    line_sigma: float = 0.55
    """Least standard deviation of where an edge runs against the face's pixels, pixels: a parallel line beside it is a bias that no frame takes away."""
    floor: float = 0.2
    """Error of a registration that its own covariance does not know, pixels."""
    gate: float = 13.8
    """Square of the distance, in sigmas, beyond which a second face of a corner is not believed: one in a thousand is further by chance."""
    min_support: float = 0.5
    """Share of a face's pixels around a corner that must agree with its template where the corner is visible."""
    stay: float = 0.98
    """Probability that a corner stays visible, or hidden, from a frame to the next."""
    right: float = 0.85
    """Probability that one frame's evidence for that is right."""
    min_lines: int = 5
    """Frames in which an edge must be found to say where the corner is."""
    predicted_sigma: float = 4.0
    """Corners of faces that were not found are predicted when they are known this well, pixels, and else hidden."""
    margin: float = 0.25
    """Positions outside the image are given up to this share of its size away."""
    smooth: SmoothOptions = field(default_factory=SmoothOptions)
    """Of the path."""


@dataclass(frozen=True, eq=False)
class PlacedCorners:
    """Corners of a strand in its face coordinates."""

    point: Int[np.ndarray, "corners"]
    """Rows of the sketch's points."""
    q: Float[np.ndarray, "corners 2"]
    covariance: Float[np.ndarray, "corners 2 2"]


def corner_tracks(registered: Registered, sketch: Sketch, options: CornerTrackOptions = CornerTrackOptions()) -> Tracks:
    """Positions, covariances and states of all corners wherever a face of theirs was followed.

    A corner lies where its faces' homographies put it; where it is on a face comes from its marks and from the lines found at its edges in all frames.
    Hidden corners are where the motion of the faces around predicts them.
    """
    num_points, num_frames = len(sketch.points), len(registered.frame)
    weight = np.zeros((num_points, num_frames, 2, 2))
    pull = np.zeros((num_points, num_frames, 2))
    common = np.zeros((num_points, num_frames, 2, 2))
    single = np.zeros((num_points, num_frames, 2, 2))
    share = np.zeros((num_points, num_frames))
    support = np.full((num_points, num_frames), -1.0)
    guess = np.full((num_points, num_frames, 2), np.nan)
    guess_covariance = np.full((num_points, num_frames, 2, 2), np.nan)
    every = place_corners(registered, sketch, options)
    for s in _by_trust(registered):
        placed = every[s]
        h, p = registered.homography[s], registered.covariance[s]
        known = np.isfinite(h[:, 2, 2])
        if not known.any() or not len(placed.point):
            continue
        xy = np.full((num_frames, len(placed.point), 2), np.nan)
        own, click = np.full((*xy.shape, 2), np.nan), np.full((*xy.shape, 2), np.nan)
        xy[known] = apply_homography(h[known], np.broadcast_to(placed.q, (int(known.sum()), *placed.q.shape)))
        d = change_jacobian(h[known], np.broadcast_to(placed.q, (int(known.sum()), *placed.q.shape)))
        own[known] = np.einsum("kcij,kjl,kcml->kcim", d, p[known], d) + options.floor**2 * np.eye(2)
        j = point_jacobian(h[known], np.broadcast_to(placed.q, (int(known.sum()), *placed.q.shape)))
        click[known] = np.einsum("kcij,cjl,kcml->kcim", j, placed.covariance, j)
        cells = cell_of(placed.q, CELLS)
        for c, i in enumerate(placed.point):
            fine = registered.found[s] & np.isfinite(xy[:, c]).all(axis=1) & np.isfinite(own[:, c]).all(axis=(1, 2))
            if share[i].any():
                # Believed only where it agrees with the faces before it.
                both = np.nonzero(fine & (share[i] > 0))[0]
                other = np.linalg.solve(weight[i, both], pull[i, both][..., None])[..., 0]
                away = xy[both, c] - other
                spread = np.linalg.inv(weight[i, both]) + own[both, c] + click[both, c] + common[i, both] / share[i, both, None, None]
                fine[both[np.einsum("ki,kij,kj->k", away, np.linalg.inv(spread), away) > options.gate]] = False
            info = np.linalg.inv(own[fine, c] + click[fine, c])
            trust = np.trace(info, axis1=1, axis2=2)
            weight[i, fine] += info
            pull[i, fine] += np.einsum("kij,kj->ki", info, xy[fine, c])
            common[i, fine] += trust[:, None, None] * click[fine, c]
            single[i, fine] += np.linalg.inv(own[fine, c])
            share[i, fine] += trust
            near = _local_support(registered.support[s], int(cells[c]))
            support[i, fine] = np.maximum(support[i, fine], near[fine])
            loose = ~registered.found[s] & np.isfinite(xy[:, c]).all(axis=1)
            better = loose & ~(np.trace(guess_covariance[i], axis1=1, axis2=2) < np.trace(own[:, c], axis1=1, axis2=2))
            guess[i, better] = xy[better, c]
            guess_covariance[i, better] = own[better, c] + click[better, c]
    return _table(registered, sketch, weight, pull, single, common, share, support, guess, guess_covariance, options)


def _by_trust(registered: Registered) -> Sequence[int]:
    """Strands that were found in most frames first: they decide whom others must agree with."""
    return [int(s) for s in np.argsort(-registered.found.sum(axis=1), kind="stable")]


def _local_support(support: Float[np.ndarray, "frames cells"], cell: int) -> Float[np.ndarray, "frames"]:
    """Mean support of the cells around a corner's, as far as they hold pixels; -1 where none do."""
    row, column = divmod(cell, CELLS)
    grid = support.reshape(-1, CELLS, CELLS)[:, max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].reshape(len(support), -1)
    count = np.isfinite(grid).sum(axis=1)
    return np.where(count > 0, np.nansum(grid, axis=1) / np.maximum(count, 1), -1.0)


def place_corners(registered: Registered, sketch: Sketch, options: CornerTrackOptions = CornerTrackOptions()) -> tuple[PlacedCorners, ...]:
    """Where the corners of each strand's face are on it, from the marks and from the lines at the drawn edges.

    In the frame in which it was marked a corner is one place for all its faces: its mark and the lines of all of them meet there.
    """
    row = {point.id: i for i, point in enumerate(sketch.points)}
    column = {int(n): k for k, n in enumerate(registered.frame)}
    lines = _lines_at_corners(registered, options)
    placed: list[PlacedCorners] = []
    for s, strand in enumerate(registered.strands):
        points: list[int] = []
        places: list[Float[np.ndarray, "2"]] = []
        spreads: list[Float[np.ndarray, "2 2"]] = []
        for corner in sketch.faces[strand.face].corners:
            i = row[corner]
            information, pull = np.zeros((2, 2)), np.zeros(2)
            for frame, mark in sorted(sketch.points[i].marks.items()):
                k = column.get(frame)
                if k is None or not registered.found[s, k]:
                    continue
                h, p = registered.homography[s, k], registered.covariance[s, k]
                at = np.array(mark, dtype=np.float64) - 0.5
                q = apply_homography(np.linalg.inv(h), at[None])
                j, d = point_jacobian(h, q)[0], change_jacobian(h, q)[0]
                if not np.isfinite(j).all():
                    continue
                seen, away = np.linalg.inv(options.click_sigma**2 * np.eye(2) + d @ p @ d.T), np.zeros(2)
                if frame == strand.frame:
                    for normal, offset, sigma in lines.get((frame, i), ()):
                        seen = seen + np.outer(normal, normal) / sigma**2
                        away = away + normal * offset / sigma**2
                information += j.T @ seen @ j
                pull += j.T @ (seen @ j @ q[0] + away)
            if information.any():
                points.append(i)
                spreads.append(np.linalg.inv(information))
                places.append(spreads[-1] @ pull)
        count = len(points)
        placed.append(PlacedCorners(np.array(points, dtype=np.int64), np.array(places).reshape(count, 2), np.array(spreads).reshape(count, 2, 2)))
    return tuple(placed)


_Line = tuple[Float[np.ndarray, "2"], float, float]
"""Normal in the image, offset from the mark along it and its sigma, pixels."""


def _lines_at_corners(registered: Registered, options: CornerTrackOptions) -> dict[tuple[int, int], list[_Line]]:
    """(Frame, point) -> the lines of all faces drawn in that frame at that point; an edge of two faces counts once, by the mean of both."""
    found: dict[tuple[int, int, int], list[_Line]] = {}
    for s, strand in enumerate(registered.strands):
        offset, sigma = edge_lines(registered, s, options)
        for e in np.nonzero(np.isfinite(sigma))[0]:
            for end in (0, 1):
                here, there = (int(strand.corners[strand.edges[e, side]]) for side in (end, 1 - end))
                a, b = strand.q[strand.edges[e]]
                # One sense for the edge, whichever way a face's loop runs.
                sense = 1.0 if strand.corners[strand.edges[e, 0]] < strand.corners[strand.edges[e, 1]] else -1.0
                normal = sense * np.array([-(b - a)[1], (b - a)[0]]) / np.linalg.norm(b - a)
                found.setdefault((strand.frame, here, there), []).append((normal, sense * float(offset[e, end]), float(sigma[e])))
    lines: dict[tuple[int, int], list[_Line]] = {}
    for (frame, here, _), some in sorted(found.items(), key=lambda item: item[0]):
        weight = np.array([1.0 / sigma**2 for _, _, sigma in some])
        offset = float(np.average([o for _, o, _ in some], weights=weight))
        apart = max(abs(o - offset) for _, o, _ in some)
        lines.setdefault((frame, here), []).append((some[0][0], offset, float(np.hypot(1.0 / np.sqrt(weight.max()), apart))))
    return lines


def edge_lines(registered: Registered, s: int, options: CornerTrackOptions) -> tuple[Float[np.ndarray, "edges 2"], Float[np.ndarray, "edges"]]:
    """Where the image's lines run beside the drawn edges: offsets of both ends in pixels of the first frame, medians over the frames, and their sigma.

    The sigma is NaN where an edge was found too seldom, or where its offsets do not agree.
    """
    strand = registered.strands[s]
    count = len(strand.edges)
    offset, sigma = np.zeros((count, 2)), np.full(count, np.nan)
    use = np.nonzero(registered.found[s])[0]
    if not count or not len(use):
        return offset, sigma
    h = registered.homography[s, use]
    q = np.broadcast_to(strand.q[strand.edges], (len(use), count, 2, 2))
    scales = _across(strand, h, q)
    values = registered.lines[s, use, :count, :2].astype(np.float64) / scales
    # A line seen foreshortened to half tells little about where it is.
    values[scales < 0.4] = np.nan
    values[~np.isfinite(values).all(axis=2)] = np.nan
    for e in range(count):
        good = values[np.isfinite(values[:, e, 0]), e]
        if len(good) < options.min_lines:
            continue
        middle = np.median(good, axis=0)
        spread = 1.4826 * np.median(np.abs(good - middle), axis=0)
        if spread.max() < 1.0:
            offset[e], sigma[e] = middle, np.hypot(options.line_sigma, spread.max() / np.sqrt(min(len(good), 20) / 4))
    return offset, sigma


def _across(strand: Strand, h: Float[np.ndarray, "k 3 3"], q: Float[np.ndarray, "k edges ends 2"]) -> Float[np.ndarray, "k edges ends"]:
    """Pixels of the frames across an edge for one in the first frame."""
    count, edges = q.shape[:2]
    flat = q.reshape(count, -1, 2)
    ends = loop_ends(strand, strand.h).reshape(-1, 2, 2)
    direction = ends[:, 1] - ends[:, 0]
    n = np.stack([-direction[:, 1], direction[:, 0]], axis=1) / np.linalg.norm(direction, axis=1, keepdims=True)
    turn = point_jacobian(h, flat) / strand.h[0, 0]
    along, normal = (turn @ np.repeat(v, 2, axis=0)[None, ..., None] for v in (direction, n))
    here = np.stack([-along[..., 1, 0], along[..., 0, 0]], axis=-1)
    here /= np.linalg.norm(here, axis=-1, keepdims=True)
    return np.einsum("kci,kci->kc", here, normal[..., 0]).reshape(count, edges, 2)


def _table(
    registered: Registered,
    sketch: Sketch,
    weight: Float[np.ndarray, "points frames 2 2"],
    pull: Float[np.ndarray, "points frames 2"],
    single: Float[np.ndarray, "points frames 2 2"],
    common: Float[np.ndarray, "points frames 2 2"],
    share: Float[np.ndarray, "points frames"],
    support: Float[np.ndarray, "points frames"],
    guess: Float[np.ndarray, "points frames 2"],
    guess_covariance: Float[np.ndarray, "points frames 2 2"],
    options: CornerTrackOptions,
) -> Tracks:
    size = np.array(registered.image_size, dtype=np.float64)
    room = options.margin * size.max()
    rows: list[tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 2"], Int[np.ndarray, "n"]]] = []
    for i, point in enumerate(sketch.points):
        seen = share[i] > 0
        xy, covariance = guess[i].copy(), guess_covariance[i].copy()
        xy[seen] = np.linalg.solve(weight[i, seen], pull[i, seen][..., None])[..., 0]
        own = np.linalg.inv(single[i, seen])
        # What the marks and the edges' identity leave open is common to the faces of a corner: it is averaged, not reduced.
        covariance[seen] = own + common[i, seen] / share[i, seen, None, None]
        known = np.isfinite(xy).all(axis=1)
        if not known.any():
            continue
        apart = covariance.copy()
        apart[seen] = own
        moved = smooth_path(xy, apart, seen, options.smooth)
        shift = np.where(seen[:, None], moved - xy, 0.0)
        covariance += shift[:, :, None] * shift[:, None, :]
        xy = np.where(seen[:, None], moved, xy) + 0.5
        inside = known & (np.nan_to_num(xy, nan=-1.0) >= 0).all(axis=1) & (np.nan_to_num(xy, nan=1e9) < size).all(axis=1)
        visible = visible_frames(np.where(seen, np.where(support[i] < 0, options.min_support, support[i]), 0.0) >= options.min_support, options) & inside & seen
        # A face that was not found may be hidden, or only not recognised: while its corners are known well they are predicted.
        well = ~seen & (np.nan_to_num(np.trace(covariance, axis1=1, axis2=2), nan=np.inf) < 2 * options.predicted_sigma**2)
        state = np.where(visible, int(State.TRACKED), np.where(inside & ~well, int(State.HIDDEN), int(State.PREDICTED)))
        near = known & (np.nan_to_num(xy, nan=-1e9) > -room).all(axis=1) & (np.nan_to_num(xy, nan=1e9) < size + room).all(axis=1)
        for k, n in enumerate(registered.frame):
            if int(n) in point.marks and near[k] and inside[k]:
                state[k] = int(State.MARKED)
            if any(a <= n <= b for a, b in point.hidden):
                state[k] = int(State.HIDDEN)
        at = np.nonzero(near)[0]
        rows.append((np.full(len(at), i), registered.frame[at], xy[at], covariance[at], state[at]))
    point_index, frame, places, spreads, states = (
        (np.concatenate(c) for c in zip(*rows, strict=True))
        if rows
        else (np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, int))
    )
    return Tracks(point_index=point_index, frame=frame, xy=places, covariance=spreads, state=states)


def visible_frames(evidence: Bool[np.ndarray, "frames"], options: CornerTrackOptions = CornerTrackOptions()) -> Bool[np.ndarray, "frames"]:
    """The likeliest run of two states (visible, hidden) behind one piece of evidence a frame (Viterbi)."""
    stay, leave = np.log(options.stay), np.log(1 - options.stay)
    right, wrong = np.log(options.right), np.log(1 - options.right)
    score = np.zeros(2)
    came = np.zeros((len(evidence), 2), np.int64)
    for k, seen in enumerate(evidence):
        keep, change = score + stay, score[::-1] + leave
        came[k] = np.where(keep >= change, [0, 1], [1, 0])
        score = np.maximum(keep, change) + (np.array([wrong, right]) if seen else np.array([right, wrong]))
    out = np.zeros(len(evidence), bool)
    state = int(score[1] >= score[0])
    for k in range(len(evidence) - 1, -1, -1):
        out[k] = bool(state)
        state = int(came[k, state])
    return out
