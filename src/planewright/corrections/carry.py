"""Tracks carried along when the model under them moves, without a look at any frame.

A tracked position is a fusion: of the model's projection, as sure as the model was, and of what the frames said. Both are Gaussians, so how much of a
move of the model reaches the track follows from their covariances. Following 300 frames anew takes seconds, this takes hundredths of one.
"""

from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.planes.planar_scene import PlanarScene
from planewright.sfm.cameras import Cameras
from planewright.tracking.tracks import State, Tracks
from planewright.tracking.visibility import corner_visibility


@dataclass(frozen=True, kw_only=True)
class CarryOptions:
    """How tracks are carried."""

    common_sigma: float = 0.3
    """Error that the model and the frames have in common, pixels; it is in every covariance and takes no part in the fusion. As in `CornerOptions`."""
    alone_sigma: float = 0.6
    """Standard deviation of what a frame may add to the model's projection where no frame is believed, pixels."""
    contradiction: float = 9.2
    """Where the frames are off the new projection by more than this on average (chi-square with two degrees of freedom, 1 %), they looked at something
    else, and are not believed."""
    slack: float = 1.0
    """Standard deviation (pixels) granted to the new projection in that. Its own covariance would grant too much: after a wrong face is given up it is
    wide, and frames that looked along the wrong face would be believed (desktop: 91 % within 2 px in place of 97.6)."""
    far: float = 5.0
    """A corner that moves by more than this (pixels) may be hidden by something else than before: what hides it is worked out anew."""
    occluder_tolerance: float = 0.004
    """A face hides a corner when it is nearer by this share of the scene's diagonal."""
    margin: float = 0.25
    """Positions outside the image are given up to this share of its size away."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """One model in every frame with a pose."""

    xy: Float[np.ndarray, "frames chosen 2"]
    """As displayed; NaN behind the camera."""
    covariance: Float[np.ndarray, "frames chosen 2 2"]


def carry_tracks(
    old: Tracks,
    before: PlanarScene,
    after: PlanarScene,
    cameras: Cameras,
    moved: Bool[np.ndarray, "points"],
    options: CarryOptions = CarryOptions(),
    *,
    doubted: Bool[np.ndarray, "points"] | None = None,
) -> Tracks:
    """The tracks of the moved corners in all frames with a pose.

    Args:
        old: tracks that go with `before`.
        after: with the sketch in which the marks are up to date.
        moved: the corners to be carried; those that `after` does not know have no rows but their marks.
        doubted: corners whose old tracks are not believed, because a mark contradicts them.
    """
    rows = np.flatnonzero(cameras.posed)
    chosen = np.flatnonzero(moved & after.point_known)
    new = _project(after, cameras, rows, chosen)
    past = _project(before, cameras, rows, chosen)
    xy, covariance, state = _table(old, cameras.frame[rows], chosen)
    usable = np.isfinite(past.xy).all(axis=2) & np.isfinite(xy).all(axis=2) & before.point_known[chosen] & np.isin(state, (State.TRACKED, State.BRIDGED))
    eye = np.eye(2)
    own = options.common_sigma**2 * eye
    covariance = np.where(usable[..., None, None], covariance, eye)
    model = new.covariance + 1e-6 * eye
    believed = usable & _believed(xy - new.xy, covariance + options.slack**2 * eye, usable & np.isfinite(new.xy).all(axis=2), options)
    if doubted is not None:
        believed &= ~doubted[chosen]
    # With information M^-1 of the model and L of the frames, a move of the model moves the fusion by (M^-1 + L)^-1 M^-1 of it.
    prior = np.linalg.inv(model)
    before_it = np.linalg.inv(past.covariance + 1e-6 * eye)
    said = _positive(np.linalg.inv(_positive(covariance - own, 1e-4)) - before_it, 0.0)
    fused = np.linalg.inv(prior + said)
    step = np.where(believed[..., None], new.xy - past.xy, 0.0)
    moved_xy = np.where(believed[..., None], xy + np.einsum("kpij,kpjl,kpl->kpi", fused, prior, step), new.xy)
    carried = _positive(covariance + fused - np.linalg.inv(before_it + said), options.common_sigma**2)
    spread = np.where(believed[..., None, None], carried, model + (options.common_sigma**2 + options.alone_sigma**2) * eye)
    motion = _frame_motion(moved_xy - new.xy, believed)
    moved_xy = moved_xy + np.where(believed[..., None], 0.0, motion[:, None])
    moved_xy = np.where(np.isfinite(new.xy), moved_xy, np.nan)
    states = _states(moved_xy, xy, state, after, cameras, rows, chosen, options)
    return _rows(moved_xy, spread, states, after, cameras, rows, chosen, moved, options)


def _project(scene: PlanarScene, cameras: Cameras, rows: Int[np.ndarray, "frames"], chosen: Int[np.ndarray, "chosen"]) -> _Seen:
    points = np.where(scene.point_known[chosen, None], scene.points[chosen], 0.0)
    rotation = cameras.rotation[rows]
    in_cam = np.einsum("kij,pj->kpi", rotation, points) + cameras.translation[rows][:, None]
    depth = np.where(in_cam[..., 2] > 1e-9, in_cam[..., 2], np.nan)
    normalized = in_cam[..., :2] / depth[..., None]
    pinhole, lens = cameras.intrinsics.pinhole(), cameras.lens
    xy = pinhole.principal_point + pinhole.focal * normalized
    if not lens.straight:
        for k, row in enumerate(rows.tolist()):
            front = np.isfinite(depth[k])
            xy[k, front] = lens.to_displayed(int(cameras.frame[row]), xy[k, front], depth[k, front])
    jacobian = pinhole.focal / depth[..., None, None] * (rotation[:, None, :2] - normalized[..., None] * rotation[:, None, 2:])
    jacobian = np.where(np.isfinite(jacobian), jacobian, 0.0)
    spread = np.where(np.isfinite(scene.point_covariance[chosen]), scene.point_covariance[chosen], 0.0)
    return _Seen(np.where(scene.point_known[chosen, None], xy, np.nan), np.einsum("kpij,pjl,kpml->kpim", jacobian, spread, jacobian))


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


def _believed(
    off: Float[np.ndarray, "frames chosen 2"],
    spread: Float[np.ndarray, "frames chosen 2 2"],
    measured: Bool[np.ndarray, "frames chosen"],
    options: CarryOptions,
) -> Bool[np.ndarray, "chosen"]:
    """Corners whose tracks agree with the new model."""
    away = np.where(measured[..., None], off, 0.0)
    square = np.einsum("kpi,kpij,kpj->kp", away, np.linalg.inv(spread), away)
    return square.sum(axis=0) / np.maximum(measured.sum(axis=0), 1) < options.contradiction


def _frame_motion(away: Float[np.ndarray, "frames chosen 2"], believed: Bool[np.ndarray, "frames chosen"]) -> Float[np.ndarray, "frames 2"]:
    """What each frame adds to the whole picture, from three corners at least whose frames are believed."""
    values = np.where(believed[..., None], away, np.nan)
    enough = np.isfinite(values).all(axis=2).sum(axis=1) >= 3
    out = np.zeros((len(away), 2))
    if enough.any():
        # What a corner has in all frames is its own.
        out[enough] = np.nanmedian((values - _usual(values))[enough], axis=1)
    return np.where(np.isfinite(out), out, 0.0)


def _usual(values: Float[np.ndarray, "frames chosen 2"]) -> Float[np.ndarray, "chosen 2"]:
    out = np.zeros(values.shape[1:])
    some = np.isfinite(values).any(axis=(0, 2))
    out[some] = np.nanmedian(values[:, some], axis=0)
    return out


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
    size = float(np.linalg.norm(np.ptp(scene.points[scene.point_known], axis=0)))
    face_known = scene.face_known[:, None]
    free = corner_visibility(
        scene.sketch,
        np.where(scene.point_known[:, None], scene.points, np.nan),
        np.where(face_known, scene.normals, np.nan),
        np.where(scene.face_known, scene.offsets, np.nan),
        cameras.centers[rows],
        options.occluder_tolerance * size,
    )[:, chosen]
    near = np.linalg.norm(np.where(np.isfinite(xy), xy, 1e9) - old_xy, axis=2) <= options.far
    seen = np.where(near & np.isin(old, (State.TRACKED, State.BRIDGED, State.HIDDEN)), old != int(State.HIDDEN), free)
    inside = (xy >= 0).all(axis=2) & (xy[..., 0] < width) & (xy[..., 1] < height)
    return np.where(inside, np.where(seen, int(State.TRACKED), int(State.HIDDEN)), int(State.PREDICTED))


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
