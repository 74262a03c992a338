"""What the frames said of corners, as Gaussians in space: where each track has its corner, how sure, and how much of that the model did not know.

A track is the model's corner, moved by the lines of all frames. Its displacement is one for the whole clip, so it is a point in space that the track's
positions show from all sides, and so is its covariance.
"""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.planes.planar_scene import PlanarScene
from planewright.sfm.cameras import Cameras
from planewright.tracking.fusion import FusionOptions
from planewright.tracking.tracks import State, Tracks

LEAST_FRAMES = 5
"""Frames in which a corner must have been tracked."""
MODEL_FLOOR = 0.3
"""Standard deviation of a corner in the model that is always allowed for, pixels of a typical frame."""


@dataclass(frozen=True, eq=False)
class Said:
    """Some corners by their tracks."""

    place: Float[np.ndarray, "chosen 3"]
    """World; where the model has the corner, if nothing was said."""
    covariance: Float[np.ndarray, "chosen 3 3"]
    """Of `place`, scene units squared."""
    information: Float[np.ndarray, "chosen 3 3"]
    """What the frames added to the model; positive semidefinite, zero where nothing was said."""
    spoke: Bool[np.ndarray, "chosen"]
    """Whether the corner was tracked in enough frames."""


@dataclass(frozen=True, eq=False)
class Shown:
    """Corners in some frames, straight pixels."""

    xy: Float[np.ndarray, "frames chosen 2"]
    """NaN behind the camera."""
    depth: Float[np.ndarray, "frames chosen"]
    """NaN there as well."""
    jacobian: Float[np.ndarray, "frames chosen 2 3"]
    """Pixels per world unit; zero behind the camera."""


def show(points: Float[np.ndarray, "chosen 3"], cameras: Cameras, rows: Int[np.ndarray, "frames"]) -> Shown:
    """Points as the cameras in `rows` see them."""
    rotation = cameras.rotation[rows]
    in_cam = np.einsum("kij,pj->kpi", rotation, points) + cameras.translation[rows][:, None]
    depth = np.where(in_cam[..., 2] > 1e-9, in_cam[..., 2], np.nan)
    normalized = in_cam[..., :2] / depth[..., None]
    pinhole = cameras.intrinsics.pinhole()
    jacobian = pinhole.focal / depth[..., None, None] * (rotation[:, None, :2] - normalized[..., None] * rotation[:, None, 2:])
    return Shown(pinhole.principal_point + pinhole.focal * normalized, depth, np.where(np.isfinite(jacobian), jacobian, 0.0))


def widened(covariance: Float[np.ndarray, "chosen 3 3"], shown: Shown, options: FusionOptions) -> Float[np.ndarray, "chosen 3 3"]:
    """The model's covariances as lines are allowed to move corners from it (`fusion.refit_corners`)."""
    size = np.linalg.norm(shown.jacobian, axis=(2, 3)) / np.sqrt(2.0)
    typical = np.median(size, axis=0) if len(size) else np.ones(len(covariance))
    return options.model_inflation**2 * covariance + (MODEL_FLOOR / np.maximum(typical, 1e-12))[:, None, None] ** 2 * np.eye(3)


def what_frames_said(tracks: Tracks, scene: PlanarScene, cameras: Cameras, chosen: Int[np.ndarray, "chosen"], options: FusionOptions = FusionOptions()) -> Said:
    """The tracks of known corners as points in space.

    Bridged positions take no part: they are where they are because the model was not believed.
    """
    rows = np.flatnonzero(cameras.posed)
    known = scene.point_known[chosen]
    model = np.where(known[:, None], scene.points[chosen], 0.0)
    finite = np.isfinite(scene.point_covariance[chosen]).all(axis=(1, 2)) & known
    spread = np.where(finite[:, None, None], scene.point_covariance[chosen], np.eye(3))
    wide = widened(spread, show(model, cameras, rows), options)
    xy, covariance = _measured(tracks, cameras, rows, chosen)
    place, own, spoke = model.copy(), wide.copy(), np.zeros(len(chosen), dtype=bool)
    for p in np.flatnonzero(finite):
        here = np.flatnonzero(np.isfinite(xy[:, p, 0]))
        if len(here) >= LEAST_FRAMES:
            place[p] = _met(xy[here, p], model[p], wide[p], cameras, rows[here])
            jacobian = show(place[p : p + 1], cameras, rows[here]).jacobian[:, 0]
            own[p] = _covariance_in_space(covariance[here, p], jacobian, wide[p])
            spoke[p] = True
    prior = np.linalg.inv(wide)
    information = np.where(spoke[:, None, None], _positive(np.linalg.inv(own) - prior), 0.0)
    return Said(place, np.linalg.inv(prior + information), information, spoke)


def _measured(
    tracks: Tracks, cameras: Cameras, rows: Int[np.ndarray, "frames"], chosen: Int[np.ndarray, "chosen"]
) -> tuple[Float[np.ndarray, "frames chosen 2"], Float[np.ndarray, "frames chosen 2 2"]]:
    """Tracked positions, straight, and their covariances; NaN where there are none."""
    xy = np.full((len(rows), len(chosen), 2), np.nan)
    covariance = np.full((len(rows), len(chosen), 2, 2), np.nan)
    frames = cameras.frame[rows]
    for p, point in enumerate(chosen.tolist()):
        mine = np.flatnonzero((tracks.point_index == point) & (tracks.state == int(State.TRACKED)) & np.isfinite(tracks.covariance).all(axis=(1, 2)))
        at = np.minimum(np.searchsorted(frames, tracks.frame[mine]), max(len(frames) - 1, 0))
        there = frames[at] == tracks.frame[mine] if len(frames) else np.zeros(len(mine), dtype=bool)
        mine, at = mine[there], at[there]
        if len(mine):
            xy[at, p] = tracks.xy[mine] if cameras.lens.straight else cameras.lens.to_straight(tracks.frame[mine], tracks.xy[mine])
            covariance[at, p] = tracks.covariance[mine]
    return xy, covariance


def _met(
    xy: Float[np.ndarray, "frames 2"], start: Float[np.ndarray, "3"], wide: Float[np.ndarray, "3 3"], cameras: Cameras, rows: Int[np.ndarray, "frames"]
) -> Float[np.ndarray, "3"]:
    """The point that is seen at `xy`, in least squares; where a short arc leaves its depth open, the model's."""
    point, prior = start.copy(), 1e-3 * np.linalg.inv(wide)
    for _ in range(4):
        shown = show(point[None], cameras, rows)
        front = np.isfinite(shown.xy[:, 0, 0])
        j, off = shown.jacobian[front, 0], (xy - shown.xy[:, 0])[front]
        system = np.einsum("kia,kib->ab", j, j) + prior
        point = point + np.linalg.solve(system, np.einsum("kia,ki->a", j, off) + prior @ (start - point))
    return point


def _covariance_in_space(
    seen: Float[np.ndarray, "frames 2 2"], jacobian: Float[np.ndarray, "frames 2 3"], wide: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "3 3"]:
    """The covariance that projects to those of the track, in least squares; where they do not say, the model's. Never wider than that."""
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    columns = np.stack(
        [jacobian[:, :, a, None] * jacobian[:, None, :, b] + (a != b) * jacobian[:, :, b, None] * jacobian[:, None, :, a] for a, b in pairs], axis=-1
    )
    system = columns.reshape(-1, 6)
    scale = np.linalg.norm(system, axis=0).max()
    ridge = 1e-3 * scale * np.eye(6)
    values = np.array([wide[a, b] for a, b in pairs])
    found = np.linalg.lstsq(np.concatenate([system, ridge]), np.concatenate([seen.reshape(-1), ridge @ values]), rcond=None)[0]
    matrix = np.zeros((3, 3))
    for (a, b), value in zip(pairs, found, strict=True):
        matrix[a, b] = matrix[b, a] = value
    eigenvalues, axes = np.linalg.eigh(matrix)
    largest = float(np.linalg.eigvalsh(wide)[-1])
    return np.asarray((axes * np.clip(eigenvalues, 1e-4 * largest, largest)) @ axes.T)


def _positive(matrices: Float[np.ndarray, "chosen 3 3"]) -> Float[np.ndarray, "chosen 3 3"]:
    """Without negative eigenvalues."""
    values, axes = np.linalg.eigh(matrices)
    return np.einsum("pij,pj,pkj->pik", axes, np.maximum(values, 0.0), axes)
