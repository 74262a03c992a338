"""Where every corner is in every frame: the projected model, moved by what that frame's own lines say.

The model carries what all frames have in common. What a single frame adds is how it differs from the others: an error of its
camera, a rolling shutter, a lens that breathes. So each edge's line is measured in every frame, its offset over the clip (an
error of the model or a line beside the edge, already weighed in the adjustment) is taken out, and the rest moves the corners:
one affine motion of the whole picture, and a little of each corner's own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.planes.planar_scene import PlanarScene
from planewright.progress import Progress, silent, steps
from planewright.sfm.cameras import Cameras
from planewright.tracking.edges import drawn_edges
from planewright.tracking.kernels import frame_edges
from planewright.tracking.tracks import State, Tracks
from planewright.tracking.visibility import corner_visibility
from planewright.video.frames import Frames


@dataclass(frozen=True, kw_only=True)
class CornerOptions:
    """How corners are located in every frame."""

    search: float = 3.5
    """Edges are looked for this far from where the model shows them, pixels."""
    spacing: float = 3.0
    """Spacing of the samples along an edge, pixels."""
    min_step: float = 3.0
    """Weakest step across an edge that counts, grey levels over one pixel."""
    min_share: float = 0.5
    """Share of an edge's samples that must lie on one line."""
    line_sigma: float = 0.35
    """Standard deviation of a line's offset in one frame, pixels."""
    frame_sigma: float = 0.6
    """Standard deviation of the motion a frame may add to the whole picture, pixels."""
    corner_sigma: float = 0.15
    """Standard deviation of what it may add to a corner by itself, pixels."""
    common_sigma: float = 0.3
    """Error that cameras and edges have in common over frames, pixels: not in the model's covariance, always in the sigmas."""
    occluder_tolerance: float = 0.004
    """A face hides a corner when it is nearer by this share of the scene's diagonal."""
    margin: float = 0.25
    """Positions outside the image are given up to this share of its size away."""


def follow_corners(frames: Frames, scene: PlanarScene, cameras: Cameras, options: CornerOptions = CornerOptions(), *, progress: Progress = silent) -> Tracks:
    """Positions of all corners in all posed frames, with covariances and states.

    frames: without lens distortion (`video.undistort`). The tracks are in pixels as displayed, with it.
    """
    rows = np.nonzero(cameras.posed)[0]
    predicted, depth = _project(scene.points, cameras, rows)
    centers = cameras.centers[rows]
    size = float(np.linalg.norm(np.ptp(scene.points[scene.point_known], axis=0))) if scene.point_known.any() else 1.0
    normals = np.where(scene.face_known[:, None], scene.normals, np.nan)
    offsets = np.where(scene.face_known, scene.offsets, np.nan)
    points = np.where(scene.point_known[:, None], scene.points, np.nan)
    unhidden = corner_visibility(scene.sketch, points, normals, offsets, centers, options.occluder_tolerance * size)
    width, height = frames.image_size
    inside = (predicted >= 0).all(axis=2) & (predicted[..., 0] < width) & (predicted[..., 1] < height) & (depth > 0)
    visible = unhidden & inside
    edges = _known_edges(scene)
    lines = _measure(frames, cameras.frame[rows], predicted, visible, edges, options, progress)
    moved, spread = _fuse(predicted, lines, edges, (width, height), options)
    covariance = _covariance(scene, cameras, rows, depth, spread, options)
    return _table(scene, cameras, rows, moved, covariance, visible, depth, (width, height), options)


def _project(
    points: Float[np.ndarray, "points 3"], cameras: Cameras, rows: Int[np.ndarray, "rows"]
) -> tuple[Float[np.ndarray, "rows points 2"], Float[np.ndarray, "rows points"]]:
    in_cam = np.einsum("kij,pj->kpi", cameras.rotation[rows], points) + cameras.translation[rows][:, None]
    z = in_cam[..., 2]
    safe = np.where(np.abs(z) > 1e-12, z, 1e-12)
    pinhole = cameras.intrinsics.pinhole()
    return pinhole.principal_point + pinhole.focal * in_cam[..., :2] / safe[..., None], z


def _known_edges(scene: PlanarScene) -> Int[np.ndarray, "edges 2"]:
    """Edges of known faces that the person drew, each once."""
    known, face_known = scene.point_known, scene.face_known
    chosen = {(min(a, b), max(a, b)) for f, a, b in drawn_edges(scene.sketch) if face_known[f] and known[a] and known[b]}
    return np.array(sorted(chosen), dtype=np.int64).reshape(-1, 2)


def _measure(
    frames: Frames,
    numbers: Int[np.ndarray, "rows"],
    predicted: Float[np.ndarray, "rows points 2"],
    visible: Bool[np.ndarray, "rows points"],
    edges: Int[np.ndarray, "edges 2"],
    options: CornerOptions,
    progress: Progress,
) -> Float[np.ndarray, "rows edges 4"]:
    """`frame_edges` of every frame for the edges with both ends visible."""
    lines = np.zeros((len(numbers), len(edges), 4))
    if len(edges) == 0:
        return lines
    wanted: Sequence[int] = [int(n) for n in numbers]
    for k, (_, image) in enumerate(steps(frames.gray(wanted), "Following corners", progress, total=len(wanted))):
        seen = visible[k, edges].all(axis=1)
        if seen.any():
            ends = predicted[k, edges[seen]].reshape(-1, 4) - 0.5
            out = np.zeros((len(ends), 4))
            frame_edges(cv2.GaussianBlur(image, (0, 0), 0.8), ends, options.search, options.spacing, options.min_step, out)
            lines[k, seen] = out
    lines[..., 3][lines[..., 3] < options.min_share] = 0.0
    lines[..., :2] -= _usual_offset(lines)[None]
    return lines


def _usual_offset(lines: Float[np.ndarray, "rows edges 4"]) -> Float[np.ndarray, "edges 2"]:
    """Median over the frames of each edge's offsets, where it was measured in at least five."""
    measured = lines[..., 3] > 0
    values = np.where(measured[..., None], lines[..., :2], np.nan)
    enough = measured.sum(axis=0) >= 5
    out = np.zeros((*lines.shape[1:2], 2))
    if enough.any():
        out[enough] = np.nanmedian(values[:, enough], axis=0)
    return out


def _fuse(
    predicted: Float[np.ndarray, "rows points 2"],
    lines: Float[np.ndarray, "rows edges 4"],
    edges: Int[np.ndarray, "edges 2"],
    image_size: tuple[int, int],
    options: CornerOptions,
) -> tuple[Float[np.ndarray, "rows points 2"], Float[np.ndarray, "rows points 2 2"]]:
    """Corners moved by an affine motion of the frame and their own part, both with priors, as the lines of the frame say.

    With the corners' own parts independent, the affine part is solved by itself from lines whose variance includes them; each
    corner then takes its share of what is left at its own edges.
    """
    num_rows, num_points = predicted.shape[:2]
    moved = predicted.copy()
    own = options.corner_sigma**2
    spread = np.zeros((num_rows, num_points, 2, 2))
    spread[..., 0, 0] = spread[..., 1, 1] = own
    half = 0.5 * max(image_size)
    middle = 0.5 * np.array(image_size)
    prior = np.eye(6) / options.frame_sigma**2
    for k in range(num_rows):
        used = np.nonzero(lines[k, :, 3] > 0)[0]
        if len(used) == 0:
            spread[k, :, 0, 0] += options.frame_sigma**2
            spread[k, :, 1, 1] += options.frame_sigma**2
            continue
        ends = predicted[k, edges[used]]
        direction = ends[:, 1] - ends[:, 0]
        normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1) / np.linalg.norm(direction, axis=1, keepdims=True)
        place = ends.reshape(-1, 2)
        n = np.repeat(normal, 2, axis=0)
        value = lines[k, used, :2].reshape(-1)
        corner = edges[used].reshape(-1)
        q = (place - middle) / half
        rows6 = np.concatenate([n * q[:, :1], n * q[:, 1:], n], axis=1)
        variance = options.line_sigma**2 + own
        weight = np.ones(len(value))
        motion = np.zeros(6)
        for _ in range(6):
            w = weight / variance
            motion = np.linalg.solve(prior + (rows6 * w[:, None]).T @ rows6, (rows6 * w[:, None]).T @ value)
            weight = 1.0 / (1.0 + ((value - rows6 @ motion) / (2.5 * np.sqrt(variance))) ** 2)
        w = weight / variance
        motion_covariance = np.linalg.inv(prior + (rows6 * w[:, None]).T @ rows6)
        left = value - rows6 @ motion
        information = np.tile(np.eye(2) / own, (num_points, 1, 1))
        pull = np.zeros((num_points, 2))
        lw = weight / options.line_sigma**2
        np.add.at(information, corner, lw[:, None, None] * n[:, :, None] * n[:, None, :])
        np.add.at(pull, corner, (lw * left)[:, None] * n)
        alone = np.linalg.inv(information)
        at = (predicted[k] - middle) / half
        x, y = np.clip(at[:, 0], -3, 3), np.clip(at[:, 1], -3, 3)
        moved[k, :, 0] += motion[0] * x + motion[2] * y + motion[4]
        moved[k, :, 1] += motion[1] * x + motion[3] * y + motion[5]
        moved[k] += np.einsum("pij,pj->pi", alone, pull)
        jac = np.zeros((num_points, 2, 6))
        jac[:, 0, 0], jac[:, 1, 1], jac[:, 0, 2], jac[:, 1, 3], jac[:, 0, 4], jac[:, 1, 5] = x, x, y, y, 1.0, 1.0
        spread[k] = alone + jac @ motion_covariance @ jac.transpose(0, 2, 1)
    return moved, spread


def _covariance(
    scene: PlanarScene,
    cameras: Cameras,
    rows: Int[np.ndarray, "rows"],
    depth: Float[np.ndarray, "rows points"],
    spread: Float[np.ndarray, "rows points 2 2"],
    options: CornerOptions,
) -> Float[np.ndarray, "rows points 2 2"]:
    """Model, frame and common errors in pixels of each frame."""
    r = cameras.rotation[rows]
    in_cam = np.einsum("kij,pj->kpi", r, scene.points) + cameras.translation[rows][:, None]
    z = np.where(np.abs(depth) > 1e-12, depth, 1e-12)
    f = cameras.intrinsics.focal
    jac = np.zeros((*depth.shape, 2, 3))
    jac[..., 0, 0] = jac[..., 1, 1] = f / z
    jac[..., 0, 2] = -f * in_cam[..., 0] / z**2
    jac[..., 1, 2] = -f * in_cam[..., 1] / z**2
    jac = np.einsum("kpij,kjl->kpil", jac, r)
    model = np.einsum("kpij,pjl,kpml->kpim", jac, scene.point_covariance, jac)
    return model + spread + options.common_sigma**2 * np.eye(2)


def _table(
    scene: PlanarScene,
    cameras: Cameras,
    rows: Int[np.ndarray, "rows"],
    xy: Float[np.ndarray, "rows points 2"],
    covariance: Float[np.ndarray, "rows points 2 2"],
    visible: Bool[np.ndarray, "rows points"],
    depth: Float[np.ndarray, "rows points"],
    image_size: tuple[int, int],
    options: CornerOptions,
) -> Tracks:
    width, height = image_size
    intrinsics = cameras.intrinsics
    numbers = cameras.frame[rows]
    frame_row = {int(n): k for k, n in enumerate(numbers)}
    columns: list[
        tuple[Int[np.ndarray, "rows"], Int[np.ndarray, "rows"], Float[np.ndarray, "rows 2"], Float[np.ndarray, "rows 2 2"], Int[np.ndarray, "rows"]]
    ] = []
    for i, point in enumerate(scene.sketch.points):
        if scene.point_known[i]:
            shown = intrinsics.to_pixels((xy[:, i] - intrinsics.principal_point) / intrinsics.focal)
            room = options.margin * max(width, height)
            near = (shown > -room).all(axis=1) & (shown[:, 0] < width + room) & (shown[:, 1] < height + room) & (depth[:, i] > 0)
            state = np.where(visible[:, i], int(State.TRACKED), int(State.HIDDEN))
            outside = (shown < 0).any(axis=1) | (shown[:, 0] >= width) | (shown[:, 1] >= height)
            state[outside] = int(State.PREDICTED)
            for first, last in point.hidden:
                state[(numbers >= first) & (numbers <= last)] = int(State.HIDDEN)
            for frame in point.marks:
                if (k := frame_row.get(frame)) is not None:
                    state[k] = int(State.MARKED)
            k = np.nonzero(near)[0]
            columns.append((np.full(len(k), i), numbers[k], shown[k], covariance[k, i], state[k]))
        else:
            frames = np.array(sorted(point.marks), dtype=np.int64)
            clicked = np.array([point.marks[int(f)] for f in frames], dtype=np.float64).reshape(-1, 2)
            columns.append((np.full(len(frames), i), frames, clicked, np.tile(np.eye(2), (len(frames), 1, 1)), np.full(len(frames), int(State.MARKED))))
    parts = list(zip(*columns, strict=True)) or [[np.zeros(0, int)], [np.zeros(0, int)], [np.zeros((0, 2))], [np.zeros((0, 2, 2))], [np.zeros(0, int)]]
    return Tracks(*(np.concatenate(part) for part in parts))
