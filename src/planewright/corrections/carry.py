"""Tracks carried along when the model under them moves, without a look at any frame.

A track has its corner at a point in space: the model's, moved by what the lines of all frames say (`said`). Both are Gaussians, so how much of a move of
the model reaches the track follows from their covariances. Following 300 frames anew takes seconds, this takes hundredths of one.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.corrections.said import Said, Shown, show, what_frames_said, widened
from planewright.planes.evidence import CornerMarks
from planewright.planes.planar_scene import PlanarScene
from planewright.sfm.cameras import Cameras
from planewright.tracking.fusion import FusionOptions
from planewright.tracking.tracks import State, Tracks
from planewright.tracking.visibility import corner_visibility


@dataclass(frozen=True, kw_only=True)
class CarryOptions:
    """How tracks are carried."""

    fusion: FusionOptions = field(default_factory=FusionOptions)
    """How far the model's corners were allowed to be moved by lines; as in `CornerOptions`."""
    common_sigma: float = 0.05
    """Error that all corners have in common, pixels; in every covariance. As in `CornerOptions`."""
    alone_sigma: float = 0.6
    """Standard deviation of what a frame may add to the model's projection where no frame is believed, pixels."""
    contradiction: float = 9.2
    """A mark that is further off a track than both allow (chi-square with two degrees of freedom, 1 %) says that its frames looked at something else.
    So does the new model, of corners whose face was measured on something else."""
    slack: float = 1.0
    """Standard deviation (pixels) granted to the new model in that. Its own covariance would grant too much: after a wrong face is given up it is wide,
    and frames that looked along the wrong face would be believed."""
    far: float = 5.0
    """A corner that moves by more than this (pixels) may be hidden by something else than before: what hides it is worked out anew."""
    occluder_tolerance: float = 0.004
    """A face hides a corner when it is nearer by this share of the scene's diagonal."""
    margin: float = 0.25
    """Positions outside the image are given up to this share of its size away."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A corner whose place is known better than the model and its track have it."""

    point: int
    """Row of the sketch's points."""
    place: Float[np.ndarray, "3"]
    """World."""
    covariance: Float[np.ndarray, "3 3"]


def carry_tracks(
    old: Tracks,
    before: PlanarScene,
    after: PlanarScene,
    cameras: Cameras,
    moved: Bool[np.ndarray, "points"],
    options: CarryOptions = CarryOptions(),
    *,
    doubted: Bool[np.ndarray, "points"] | None = None,
    placed: Placed | None = None,
) -> Tracks:
    """The tracks of the moved corners in all frames with a pose.

    Args:
        old: tracks that go with `before`.
        after: with the sketch in which the marks are up to date.
        moved: the corners to be carried; those that `after` does not know have no rows but their marks.
        doubted: corners whose frames are not believed where they contradict the new model: what they looked at turned out to be something else.
        placed: a corner that goes where this says, whatever the model says.
    """
    rows = np.flatnonzero(cameras.posed)
    chosen = np.flatnonzero(moved & after.point_known)
    xy, covariance, state = _table(old, cameras.frame[rows], chosen)
    anew = np.zeros(len(chosen), dtype=bool) if doubted is None else doubted[chosen].copy()
    if placed is not None:
        anew |= chosen == placed.point
    # A bridged stretch has left the model; only what is said of its corner itself moves it.
    bridged = (state == int(State.BRIDGED)) & ~anew
    said = what_frames_said(old, before, cameras, chosen, options.fusion)
    known = before.point_known[chosen]
    spoke = said.spoke & known
    if doubted is not None:
        spoke &= ~doubted[chosen] | _agrees(said, after, cameras, rows, chosen, options)
    place, spread = _carried(said, before, after, cameras, rows, chosen, spoke, options)
    if placed is not None:
        mine = chosen == placed.point
        place[mine], spread[mine] = placed.place, placed.covariance
    past, new = show(said.place, cameras, rows), show(place, cameras, rows)
    seen_past, seen_new = _displayed(past, cameras, rows), _displayed(new, cameras, rows)
    has_row: Bool[np.ndarray, "frames chosen"] = np.logical_and(np.isfinite(xy).all(axis=2), np.isfinite(seen_past).all(axis=2))
    follows = np.asarray(has_row & spoke)
    eye = np.eye(2)
    motion = _frame_motion(np.where((follows & ~bridged)[..., None], xy - seen_past, np.nan))
    moved_xy = np.where(follows[..., None], np.where(has_row[..., None], xy, 0.0) + seen_new - seen_past, seen_new + motion[:, None])
    change = np.einsum("kpij,pjl,kpml->kpim", new.jacobian, spread, new.jacobian) - np.einsum(
        "kpij,pjl,kpml->kpim", past.jacobian, said.covariance, past.jacobian
    )
    own = np.einsum("kpij,pjl,kpml->kpim", new.jacobian, spread, new.jacobian)
    carried = _positive(np.where(follows[..., None, None], covariance, eye) + change, options.common_sigma**2)
    alone = own + (options.common_sigma**2 + options.alone_sigma**2) * eye
    spread_xy = np.where(follows[..., None, None], carried, alone)
    unmoved = np.asarray(bridged | (follows & (place == said.place).all(axis=1) & (spread == said.covariance).all(axis=(1, 2))))
    moved_xy, spread_xy = np.where(unmoved[..., None], xy, moved_xy), np.where(unmoved[..., None, None], covariance, spread_xy)
    states = _states(moved_xy, xy, state, after, cameras, rows, chosen, options)
    return _rows(moved_xy, spread_xy, states, after, cameras, rows, chosen, moved, options)


def _carried(
    said: Said,
    before: PlanarScene,
    after: PlanarScene,
    cameras: Cameras,
    rows: Int[np.ndarray, "frames"],
    chosen: Int[np.ndarray, "chosen"],
    spoke: Bool[np.ndarray, "chosen"],
    options: CarryOptions,
) -> tuple[Float[np.ndarray, "chosen 3"], Float[np.ndarray, "chosen 3 3"]]:
    """Where the new model and the frames together have the corners; the new model alone where the frames are not believed.

    With information M^-1 of the model and L of the frames, a move of the model moves the fusion by (M^-1 + L)^-1 M^-1 of it. M is that of before: a
    solution in which most things are held is surer than it should be, and would draw tracks to the model that no mark is about.
    """
    place, spread = after.points[chosen].copy(), after.point_covariance[chosen].copy()
    spread = np.where(np.isfinite(spread), spread, 0.0)
    use = np.flatnonzero(spoke)
    if len(use):
        corners = chosen[use]
        prior = np.linalg.inv(widened(before.point_covariance[corners], show(before.points[corners], cameras, rows), options.fusion))
        step = np.einsum("pij,pjk,pk->pi", said.covariance[use], prior, place[use] - before.points[corners])
        place[use], spread[use] = said.place[use] + step, said.covariance[use]
    return place, spread


def _agrees(
    said: Said, after: PlanarScene, cameras: Cameras, rows: Int[np.ndarray, "frames"], chosen: Int[np.ndarray, "chosen"], options: CarryOptions
) -> Bool[np.ndarray, "chosen"]:
    """Corners whose tracks are where the new model has them, or near enough, in the mean over the frames."""
    past, new = show(said.place, cameras, rows), show(after.points[chosen], cameras, rows)
    both: Bool[np.ndarray, "frames chosen"] = np.logical_and(np.isfinite(past.xy).all(axis=2), np.isfinite(new.xy).all(axis=2))
    away = np.where(both[..., None], past.xy - new.xy, 0.0)
    spread = np.einsum("kpij,pjl,kpml->kpim", past.jacobian, said.covariance, past.jacobian) + options.slack**2 * np.eye(2)
    square = np.einsum("kpi,kpij,kpj->kp", away, np.linalg.inv(spread), away)
    return square.sum(axis=0) / np.maximum(both.sum(axis=0), 1) < options.contradiction


def _displayed(shown: Shown, cameras: Cameras, rows: Int[np.ndarray, "frames"]) -> Float[np.ndarray, "frames chosen 2"]:
    if cameras.lens.straight:
        return shown.xy
    xy = shown.xy.copy()
    for k, row in enumerate(rows.tolist()):
        front = np.isfinite(shown.depth[k])
        xy[k, front] = cameras.lens.to_displayed(int(cameras.frame[row]), xy[k, front], shown.depth[k, front])
    return xy


def _table(
    tracks: Tracks, frames: Int[np.ndarray, "frames"], chosen: Int[np.ndarray, "chosen"]
) -> tuple[Float[np.ndarray, "frames chosen 2"], Float[np.ndarray, "frames chosen 2 2"], Int[np.ndarray, "frames chosen"]]:
    """The rows of some points as a table; NaN and -1 where there is none."""
    xy = np.full((len(frames), len(chosen), 2), np.nan)
    covariance = np.full((len(frames), len(chosen), 2, 2), np.nan)
    state = np.full((len(frames), len(chosen)), -1)
    column = np.full(int(tracks.point_index.max(initial=0)) + 1, -1)
    column[chosen[chosen < len(column)]] = np.flatnonzero(chosen < len(column))
    at = np.searchsorted(frames, tracks.frame)
    there = (at < len(frames)) & (column[tracks.point_index] >= 0)
    there[there] &= frames[at[there]] == tracks.frame[there]
    k, p = at[there], column[tracks.point_index[there]]
    xy[k, p], covariance[k, p], state[k, p] = tracks.xy[there], tracks.covariance[there], tracks.state[there]
    return xy, covariance, state


def _positive(matrices: Float[np.ndarray, "frames chosen 2 2"], least: float) -> Float[np.ndarray, "frames chosen 2 2"]:
    """With eigenvalues of at least this."""
    values, axes = np.linalg.eigh(matrices)
    return np.einsum("kpij,kpj,kplj->kpil", axes, np.maximum(values, least), axes)


def _frame_motion(away: Float[np.ndarray, "frames chosen 2"]) -> Float[np.ndarray, "frames 2"]:
    """What each frame adds to the whole picture, from three corners at least that are followed there. away: NaN elsewhere."""
    enough = np.isfinite(away).all(axis=2).sum(axis=1) >= 3
    out = np.zeros((len(away), 2))
    if enough.any():
        out[enough] = np.nanmedian(away[enough], axis=1)
    return out


def unhidden_frames(
    scene: PlanarScene, cameras: Cameras, corner: int, frames: Int[np.ndarray, "frames"], options: CarryOptions = CarryOptions()
) -> Bool[np.ndarray, "frames"]:
    """Whether the model has nothing before a corner, in some frames with a pose."""
    rows = np.searchsorted(cameras.frame, frames)
    return _free(scene, cameras, rows, options)[:, corner]


def _free(scene: PlanarScene, cameras: Cameras, rows: Int[np.ndarray, "frames"], options: CarryOptions) -> Bool[np.ndarray, "frames points"]:
    size = float(np.linalg.norm(np.ptp(scene.points[scene.point_known], axis=0)))
    face_known = scene.face_known[:, None]
    return corner_visibility(
        scene.sketch,
        np.where(scene.point_known[:, None], scene.points, np.nan),
        np.where(face_known, scene.normals, np.nan),
        np.where(scene.face_known, scene.offsets, np.nan),
        cameras.centers[rows],
        options.occluder_tolerance * size,
    )


def _states(
    xy: Float[np.ndarray, "frames chosen 2"],
    old_xy: Float[np.ndarray, "frames chosen 2"],
    old: Int[np.ndarray, "frames chosen"],
    scene: PlanarScene,
    cameras: Cameras,
    rows: Int[np.ndarray, "frames"],
    chosen: Int[np.ndarray, "chosen"],
    options: CarryOptions,
) -> Int[np.ndarray, "frames chosen"]:
    """Seen or hidden as before, unless the corner came from far off or was not there before."""
    width, height = cameras.intrinsics.image_size
    free = _free(scene, cameras, rows, options)[:, chosen]
    near = np.linalg.norm(np.where(np.isfinite(xy), xy, 1e9) - old_xy, axis=2) <= options.far
    seen = np.where(near & np.isin(old, (State.TRACKED, State.BRIDGED, State.HIDDEN)), old != int(State.HIDDEN), free)
    inside = (xy >= 0).all(axis=2) & (xy[..., 0] < width) & (xy[..., 1] < height)
    found = np.where(inside, np.where(seen, int(State.TRACKED), int(State.HIDDEN)), int(State.PREDICTED))
    return np.where((old == int(State.BRIDGED)) & (xy == old_xy).all(axis=2), int(State.BRIDGED), found)


def _rows(
    xy: Float[np.ndarray, "frames chosen 2"],
    covariance: Float[np.ndarray, "frames chosen 2 2"],
    state: Int[np.ndarray, "frames chosen"],
    scene: PlanarScene,
    cameras: Cameras,
    rows: Int[np.ndarray, "frames"],
    chosen: Int[np.ndarray, "chosen"],
    moved: Bool[np.ndarray, "points"],
    options: CarryOptions,
) -> Tracks:
    """The table as rows, with what the person said about marks and hidden spans."""
    width, height = cameras.intrinsics.image_size
    numbers, room = cameras.frame[rows], options.margin * max(width, height)
    column = {int(point): p for p, point in enumerate(chosen)}
    parts: list[Tracks] = []
    for i in np.flatnonzero(moved).tolist():
        point = scene.sketch.points[i]
        if i not in column:
            frames = np.array(sorted(point.marks), dtype=np.int64)
            clicked = np.array([point.marks[int(f)] for f in frames], dtype=np.float64).reshape(-1, 2)
            count = len(frames)
            parts.append(Tracks(np.full(count, i), frames, clicked, np.tile(np.eye(2), (count, 1, 1)), np.full(count, int(State.MARKED))))
            continue
        p = column[i]
        own = state[:, p].copy()
        for first, last in point.hidden:
            own[(numbers >= first) & (numbers <= last)] = int(State.HIDDEN)
        own[np.isin(numbers, list(point.marks))] = int(State.MARKED)
        place = np.where(np.isfinite(xy[:, p]), xy[:, p], 1e9)
        keep = (place > -room).all(axis=1) & (place[:, 0] < width + room) & (place[:, 1] < height + room)
        count = int(keep.sum())
        parts.append(Tracks(np.full(count, i), numbers[keep], place[keep], covariance[keep, p], own[keep]))
    return joined(parts)


def joined(parts: list[Tracks]) -> Tracks:
    """All rows in the order of a table: by point, then frame."""
    index = np.concatenate([np.zeros(0, dtype=np.int64), *(part.point_index for part in parts)])
    frame = np.concatenate([np.zeros(0, dtype=np.int64), *(part.frame for part in parts)])
    order = np.lexsort((frame, index))
    return Tracks(
        index[order],
        frame[order],
        np.concatenate([np.zeros((0, 2)), *(part.xy for part in parts)])[order],
        np.concatenate([np.zeros((0, 2, 2)), *(part.covariance for part in parts)])[order],
        np.concatenate([np.zeros(0, dtype=np.int64), *(part.state for part in parts)])[order],
    )


def taken(tracks: Tracks, rows: Bool[np.ndarray, "rows"]) -> Tracks:
    """Some of the rows."""
    return Tracks(tracks.point_index[rows], tracks.frame[rows], tracks.xy[rows], tracks.covariance[rows], tracks.state[rows])


def contradicted(tracks: Tracks, point: int, frame: int, xy: Float[np.ndarray, "2"], sigma: float, limit: float) -> bool:
    """Whether a mark is further off the track than both allow: chi-square with two degrees of freedom above `limit`."""
    here = np.flatnonzero((tracks.point_index == point) & (tracks.frame == frame))
    if len(here) == 0:
        return True
    away = tracks.xy[here[0]] - xy
    return bool(away @ np.linalg.solve(tracks.covariance[here[0]] + sigma**2 * np.eye(2), away) > limit)


def fused_with_mark(tracks: Tracks, point: int, frame: int, xy: Float[np.ndarray, "2"], sigma: float) -> Tracks:
    """The row of a marked frame, drawn to the mark as far as both are sure."""
    here = (tracks.point_index == point) & (tracks.frame == frame)
    if not here.any():
        return tracks
    k = int(np.flatnonzero(here)[0])
    places, spreads = tracks.xy.copy(), tracks.covariance.copy()
    gain = spreads[k] @ np.linalg.inv(spreads[k] + sigma**2 * np.eye(2))
    places[k] = places[k] + gain @ (xy - places[k])
    spreads[k] = (np.eye(2) - gain) @ spreads[k]
    spreads[k] = 0.5 * (spreads[k] + spreads[k].T)
    return replace(tracks, xy=places, covariance=spreads)


def sure(tracks: Tracks, point: int, frame: int) -> float:
    """The larger standard deviation of a track in a frame, pixels; infinite where there is no row."""
    here = np.flatnonzero((tracks.point_index == point) & (tracks.frame == frame))
    return float(np.sqrt(np.linalg.eigvalsh(tracks.covariance[here[0]])[-1])) if len(here) else float("inf")


def typical_sigma(tracks: Tracks, point: int) -> float:
    """The median over the tracked frames of the larger standard deviation, pixels; infinite where there are none."""
    mine = (tracks.point_index == point) & (tracks.state == int(State.TRACKED)) & np.isfinite(tracks.covariance).all(axis=(1, 2))
    return float(np.sqrt(np.median(np.linalg.eigvalsh(tracks.covariance[mine])[:, -1]))) if mine.any() else float("inf")


def with_a_mark(known: Placed, mark: CornerMarks) -> Placed:
    """A corner after one more observation of it (the extended Kalman filter's update)."""
    projection, sigma = mark.projection[0], float(mark.sigma[0])
    seen = projection @ np.append(known.place, 1.0)
    if seen[2] <= 0:
        return known
    jacobian = (projection[:2, :3] - (seen[:2] / seen[2])[:, None] * projection[2:, :3]) / seen[2]
    gain = known.covariance @ jacobian.T @ np.linalg.inv(jacobian @ known.covariance @ jacobian.T + sigma**2 * np.eye(2))
    covariance = (np.eye(3) - gain @ jacobian) @ known.covariance
    return Placed(known.point, known.place + gain @ (mark.xy[0] - seen[:2] / seen[2]), 0.5 * (covariance + covariance.T))
