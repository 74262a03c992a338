"""Where every corner is in every frame: the projected model, moved by what the lines of the clip and of that frame say.

The model carries what all frames have in common. What the clip's lines at full size add is by how much each corner is beside it; what a
single frame adds is how it differs from the others: an error of its camera, a rolling shutter, a lens that breathes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.geometry.plane import tangent_basis
from planewright.geometry.raster import FaceBuffer, face_buffer
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.polygons import polygons_of
from planewright.progress import Progress, silent, steps
from planewright.sfm.cameras import Cameras
from planewright.tracking.appearance import AppearanceOptions, uncovered
from planewright.tracking.frame_lines import FrameLineOptions, frame_lines, measure_frame, view_edges
from planewright.tracking.fusion import FrameLines, FusionOptions, MarkOffsets, frame_scale, fuse_frames, refit_corners, usual_offset
from planewright.tracking.patches import Patches, PatchOptions, lay_patches, sample_frame
from planewright.tracking.tracks import State, Tracks
from planewright.tracking.visibility import corner_visibility
from planewright.video.frames import Frames


@dataclass(frozen=True, kw_only=True)
class CornerOptions:
    """How corners are located in every frame."""

    lines: FrameLineOptions = field(default_factory=FrameLineOptions)
    """How lines are looked for in a frame."""
    fusion: FusionOptions = field(default_factory=FusionOptions)
    """How lines move corners."""
    patches: PatchOptions = field(default_factory=PatchOptions)
    """Where faces are looked at near their corners."""
    appearance: AppearanceOptions = field(default_factory=AppearanceOptions)
    """How it is told that something unsketched covers a corner."""
    first_look: int = 100
    """Frames, besides those with marks, in which lines are looked for at first, to see where corners are over the whole clip."""
    common_sigma: float = 0.05
    """Error that all corners have in common, pixels: what is always in the sigmas besides the model, its edges and the frame."""
    occluder_tolerance: float = 0.004
    """A face hides a corner when it is nearer by this share of the scene's diagonal."""
    margin: float = 0.25
    """Positions outside the image are given up to this share of its size away."""


def follow_corners(frames: Frames, scene: PlanarScene, cameras: Cameras, options: CornerOptions = CornerOptions(), *, progress: Progress = silent) -> Tracks:
    """Positions of all corners in all posed frames, with covariances and states.

    frames: straight (`video.undistort`). The tracks are in pixels as displayed.
    """
    rows = np.nonzero(cameras.posed)[0]
    width, height = frames.image_size
    predicted, depth, jacobian = _project(scene.points, cameras, rows)
    tolerance = options.occluder_tolerance * (float(np.linalg.norm(np.ptp(scene.points[scene.point_known], axis=0))) if scene.point_known.any() else 1.0)
    normals = np.where(scene.face_known[:, None], scene.normals, np.nan)
    offsets = np.where(scene.face_known, scene.offsets, np.nan)
    points = np.where(scene.point_known[:, None], scene.points, np.nan)
    marked = _marked_rows(scene, cameras, rows)
    unhidden = corner_visibility(scene.sketch, points, normals, offsets, cameras.centers[rows], tolerance, marked)
    possible = unhidden & _in_image(predicted, depth, cameras, rows, frames.image_size, options.margin)
    wanted: Sequence[int] = [int(n) for n in cameras.frame[rows]]
    polygons = polygons_of(scene.sketch, points, normals, offsets)

    def buffer(k: int) -> FaceBuffer:
        return face_buffer(polygons, cameras.intrinsics, cameras.cam_from_world(int(rows[k])), scale=0.5)

    # The first look says where the corners are over the whole clip; the second one, there, what each frame shows.
    marks = _mark_offsets(scene, cameras, rows, predicted)
    shift, _ = refit_corners(None, marks, jacobian, scene.point_covariance, options.fusion)
    some = np.unique(np.concatenate([np.linspace(0, len(rows) - 1, min(len(rows), options.first_look)).round().astype(np.int64), np.unique(marks.row)]))
    view = view_edges(scene, scene.points + shift, cameras, rows[some], tolerance, options.lines)
    looked = steps(frames.gray([wanted[k] for k in some]), "Looking for edges", progress, total=len(some))
    lines = frame_lines(view, (measure_frame(image, view, k, buffer(int(some[k])), options.lines) for k, (_, image) in enumerate(looked)))
    base, _, _ = _project(scene.points + shift, cameras, rows[some])
    lines = replace(lines, offset=_beside(lines, predicted[some] - base))
    at_some = replace(marks, row=np.searchsorted(some, marks.row))
    shift, point_covariance = refit_corners(lines, at_some, jacobian[some], scene.point_covariance, options.fusion)

    beside = scene.points + shift
    view = view_edges(scene, beside, cameras, rows, tolerance, options.lines)
    patches = lay_patches(scene, beside, polygons, cameras, rows, possible, options.patches)
    facing = np.asarray(cameras.centers[rows] @ scene.normals[patches.face].T > scene.offsets[patches.face])
    usable: Bool[np.ndarray, "rows patches"] = np.logical_and(possible[:, patches.corner], facing)
    measured: list[Float[np.ndarray, "edges 6"]] = []
    values = np.empty((len(rows), len(patches.points), 3), np.float32)
    distance = np.empty((len(rows), len(patches.points)), np.float32)
    for k, (_, image) in enumerate(steps(frames.color(wanted), "Following corners", progress, total=len(wanted))):
        shown = buffer(k)
        measured.append(measure_frame(np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8), view, k, shown, options.lines))
        values[k], distance[k] = sample_frame(image, patches, cameras, int(rows[k]), usable[k], shown, tolerance)
    smallest = _smallest_scale(scene, patches, jacobian)
    sigma = _image_sigma(point_covariance, jacobian)
    turned = _turned(scene.points, cameras.centers[rows])
    clear = uncovered(values, distance, patches.radius, patches.start, patches.corner, smallest, sigma, turned, possible, marked, options.appearance) >= 0.5
    lines = _uncovered_lines(frame_lines(view, measured), clear)
    base, _, _ = _project(beside, cameras, rows)
    lines = replace(lines, offset=_beside(lines, predicted - base))
    shift, point_covariance = refit_corners(lines, marks, jacobian, scene.point_covariance, options.fusion)
    base, _, _ = _project(scene.points + shift, cameras, rows)
    left = _beside(lines, base - predicted)
    usual = usual_offset(lines, left)
    scale = frame_scale(lines, left - usual, options.fusion)
    moved, spread = fuse_frames(lines, base, left - usual, (width, height), options.fusion, scale)
    covariance = np.einsum("kpij,pjl,kpml->kpim", jacobian, point_covariance, jacobian) + spread + options.common_sigma**2 * np.eye(2)
    return _table(scene, cameras, rows, moved, covariance, possible & clear, depth, (width, height), options)


def _project(
    points: Float[np.ndarray, "points 3"], cameras: Cameras, rows: Int[np.ndarray, "rows"]
) -> tuple[Float[np.ndarray, "rows points 2"], Float[np.ndarray, "rows points"], Float[np.ndarray, "rows points 2 3"]]:
    """Straight pixels, distance along the axis, and pixels per world unit."""
    rotation = cameras.rotation[rows]
    in_cam = np.einsum("kij,pj->kpi", rotation, points) + cameras.translation[rows][:, None]
    z = in_cam[..., 2]
    safe = np.where(np.abs(z) > 1e-12, z, 1e-12)[..., None]
    pinhole = cameras.intrinsics.pinhole()
    normalized = in_cam[..., :2] / safe
    jacobian = pinhole.focal / safe[..., None] * (rotation[:, None, :2] - normalized[..., None] * rotation[:, None, 2:])
    return pinhole.principal_point + pinhole.focal * normalized, z, jacobian


def _in_image(
    straight: Float[np.ndarray, "rows points 2"],
    depth: Float[np.ndarray, "rows points"],
    cameras: Cameras,
    rows: Int[np.ndarray, "rows"],
    image_size: tuple[int, int],
    margin: float,
) -> Bool[np.ndarray, "rows points"]:
    """Whether the frame as displayed shows the place: a lens draws in what is beyond the border of the straight picture, or pushes out what is within it."""
    size = np.array(image_size, dtype=np.float64)
    # Far outside a lens of few terms folds back; nothing of what it says there is so.
    near: Bool[np.ndarray, "rows points"] = np.asarray((np.abs(straight / size - 0.5) < 0.5 + margin).all(axis=2) & (depth > 0))
    inside = np.zeros(near.shape, bool)
    numbers = cameras.frame[rows]
    for i in range(near.shape[1]):
        k = np.nonzero(near[:, i])[0]
        shown = cameras.lens.to_displayed(numbers[k], straight[k, i], depth[k, i])
        inside[k, i] = ((shown >= 0) & (shown < size)).all(axis=1)
    return inside


def _marked_rows(scene: PlanarScene, cameras: Cameras, rows: Int[np.ndarray, "rows"]) -> Bool[np.ndarray, "rows points"]:
    """Where the person marked a corner, and so saw it."""
    frame_row = {int(n): k for k, n in enumerate(cameras.frame[rows])}
    marked = np.zeros((len(rows), len(scene.sketch.points)), bool)
    for i, point in enumerate(scene.sketch.points):
        marked[[frame_row[frame] for frame in point.marks if frame in frame_row], i] = True
    return marked


def _smallest_scale(scene: PlanarScene, patches: Patches, jacobian: Float[np.ndarray, "rows points 2 3"]) -> Float[np.ndarray, "rows patches"]:
    """Pixels per world unit of each patch's face at its corner, in the direction in which the frame shows it smallest."""
    basis = tangent_basis(scene.normals[patches.face])
    in_plane = np.einsum("kpij,plj->kpil", jacobian[:, patches.corner], basis)
    return np.linalg.svd(in_plane, compute_uv=False)[..., 1]


def _image_sigma(covariance: Float[np.ndarray, "points 3 3"], jacobian: Float[np.ndarray, "rows points 2 3"]) -> Float[np.ndarray, "rows points"]:
    """Root mean square over the directions of the image, pixels; large where nothing is known."""
    variance = 0.5 * np.einsum("kpij,pjl,kpil->kp", jacobian, covariance, jacobian)
    return np.sqrt(np.where(np.isfinite(variance), np.clip(variance, 0.0, 1e6), 1e6))


def _turned(points: Float[np.ndarray, "points 3"], centers: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, "rows points"]:
    """Degrees between the directions in which a frame and the one before see each corner; 0 in the first."""
    ray = points - centers[:, None]
    ray = ray / np.maximum(np.linalg.norm(ray, axis=2, keepdims=True), 1e-12)
    angle = np.zeros(ray.shape[:2])
    angle[1:] = np.degrees(2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(ray[1:] - ray[:-1], axis=2), 0.0, 1.0)))
    return np.nan_to_num(angle)


def _uncovered_lines(lines: FrameLines, clear: Bool[np.ndarray, "rows points"]) -> FrameLines:
    """Without the lines of edges that are covered at both ends: what is there is the outline of something else."""
    covered = np.asarray((~clear[:, lines.edges] & lines.at_corner).all(axis=2))
    return replace(lines, information=np.where(covered[..., None, None], 0.0, lines.information))


def _mark_offsets(scene: PlanarScene, cameras: Cameras, rows: Int[np.ndarray, "rows"], predicted: Float[np.ndarray, "rows points 2"]) -> MarkOffsets:
    frame_row = {int(n): k for k, n in enumerate(cameras.frame[rows])}
    found = [
        (i, frame_row[frame], np.array(xy) - predicted[frame_row[frame], i])
        for i, point in enumerate(scene.sketch.points)
        for frame, xy in sorted(point.marks.items())
        if scene.point_known[i] and frame in frame_row
    ]
    return MarkOffsets(
        np.array([i for i, _, _ in found], np.int64), np.array([k for _, k, _ in found], np.int64), np.array([d for _, _, d in found], float).reshape(-1, 2)
    )


def _beside(lines: FrameLines, moved: Float[np.ndarray, "rows points 2"]) -> Float[np.ndarray, "rows edges 2"]:
    """Offsets of the lines from edges whose corners have moved in the image."""
    ends = np.where(lines.at_corner[..., None], moved[:, lines.edges], 0.0)
    return lines.offset - np.einsum("keai,kei->kea", ends, np.where(lines.found[..., None], lines.normal, 0.0))


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
    lens = cameras.lens
    numbers = cameras.frame[rows]
    frame_row = {int(n): k for k, n in enumerate(numbers)}
    columns: list[
        tuple[Int[np.ndarray, "rows"], Int[np.ndarray, "rows"], Float[np.ndarray, "rows 2"], Float[np.ndarray, "rows 2 2"], Int[np.ndarray, "rows"]]
    ] = []
    for i, point in enumerate(scene.sketch.points):
        if scene.point_known[i]:
            shown = lens.to_displayed(numbers, xy[:, i], depth[:, i])
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
