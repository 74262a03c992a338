"""A reconstruction that grows from two keyframes to all of them."""

from dataclasses import dataclass, field, replace

import numpy as np
import poselib

from planewright.arrays import Bool, Float, Int, Mat3, Vec3
from planewright.geometry.rigid import Rigid
from planewright.sfm.bundle import Bundle, FocalPrior, Observations, adjust, observations, robust_scale
from planewright.sfm.frame_table import FrameTable
from planewright.sfm.resection import Posed, ResectionOptions, resect
from planewright.sfm.triangulate import normalize, triangulate


@dataclass(frozen=True, kw_only=True)
class GrowthOptions:
    """How keyframes join."""

    adjust_every: int = 3
    """Keyframes between two adjustments."""
    start_scale: float = 0.5
    """Cauchy scale in pixels (at 960 wide) until the residuals tell."""
    scale_sigmas: float = 2.4
    """Cauchy scale afterwards, in standard deviations by MAD: 2 to 2.5 was best on rendered clips; real residuals are twice as large, so it is not fixed."""
    min_angle_deg: float = 0.25
    """Between two rays of a point that helps to pose the next keyframe. Depths are then known to a few percent, which is enough to pose by; with one
    degree a forward motion keeps a tenth of its points and loses its way."""
    max_points: int = 800
    """Longest tracks used in the adjustments along the way."""
    resection: ResectionOptions = field(default_factory=ResectionOptions)


@dataclass(frozen=True, eq=False)
class KeyframeTable:
    """The observations in the keyframes, of tracks seen in at least two of them."""

    seen: Observations
    """`camera` is the row of the keyframe, points are the tracks of `track`."""
    track: Int[np.ndarray, "points"]
    num_keyframes: int


@dataclass(frozen=True, eq=False)
class Growth:
    """Keyframes posed so far."""

    values: Float[np.ndarray, "5"]
    rotation: Float[np.ndarray, "keyframes 3 3"]
    translation: Float[np.ndarray, "keyframes 3"]
    posed: Bool[np.ndarray, "keyframes"]
    xyz: Float[np.ndarray, "points 3"]
    """NaN where a track has no point."""
    scale: float
    """Cauchy scale, pixels."""


def keyframe_table(table: FrameTable, keyframes: Int[np.ndarray, "keyframes"]) -> KeyframeTable:
    """Cut the keyframes out of the table."""
    rows = np.concatenate([np.arange(int(table.start[k]), int(table.start[k + 1])) for k in keyframes])
    camera = np.repeat(np.arange(len(keyframes)), [table.start[k + 1] - table.start[k] for k in keyframes])
    counts = np.bincount(table.track[rows], minlength=table.num_tracks)
    keep = counts[table.track[rows]] >= 2
    track, point = np.unique(table.track[rows][keep], return_inverse=True)
    return KeyframeTable(seen=observations(point, camera[keep], table.xy[rows][keep], len(track)), track=track, num_keyframes=len(keyframes))


def restrict(seen: Observations, points: Bool[np.ndarray, "points"], cameras: Bool[np.ndarray, "cameras"]) -> tuple[Observations, Int[np.ndarray, "kept"]]:
    """Observations of some points in some cameras (cameras renumbered in order), and the rows of those points."""
    point = seen.point
    rows = np.nonzero(points[point] & cameras[seen.camera])[0]
    new_point, new_camera = np.cumsum(points) - 1, np.cumsum(cameras) - 1
    first = np.concatenate([[0], np.cumsum(np.bincount(new_point[point[rows]], minlength=int(points.sum())))]).astype(np.int64)
    return Observations(first=first, camera=new_camera[seen.camera[rows]].astype(np.int64), xy=seen.xy[rows]), np.nonzero(points)[0]


def start_pair(table: KeyframeTable, a: int, b: int, values: Float[np.ndarray, "5"], options: GrowthOptions, seed: int) -> Growth | None:
    """Two keyframes posed by their essential matrix (five points, LO-RANSAC), and the points they share; None where fewer than 16 agree."""
    point, camera = table.seen.point, table.seen.camera
    rows_a, rows_b = np.nonzero(camera == a)[0], np.nonzero(camera == b)[0]
    _, ia, ib = np.intersect1d(point[rows_a], point[rows_b], assume_unique=True, return_indices=True)
    xa, xb = (normalize(values, table.seen.xy[rows]) * values[0] for rows in (rows_a[ia], rows_b[ib]))
    pinhole = {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [float(values[0]), 0.0, 0.0]}
    pose, _ = poselib.estimate_relative_pose(xa, xb, pinhole, pinhole, {"max_epipolar_error": 1.0, "max_iterations": 2000, "seed": seed}, {})
    rotation, translation = np.tile(np.eye(3), (table.num_keyframes, 1, 1)), np.zeros((table.num_keyframes, 3))
    rotation[b], translation[b] = pose.R, pose.t
    posed = np.zeros(table.num_keyframes, bool)
    posed[[a, b]] = True
    growth = Growth(values, rotation, translation, posed, np.full((len(table.track), 3), np.nan), options.start_scale)
    growth = add_points(growth, table, options)
    return growth if np.isfinite(growth.xyz[:, 0]).sum() >= 16 else None


def add_points(growth: Growth, table: KeyframeTable, options: GrowthOptions) -> Growth:
    """Every track triangulated afresh from the posed keyframes; kept where rays open far enough and it reprojects."""
    seen, kept = restrict(table.seen, np.ones(len(table.track), bool), growth.posed)
    found = triangulate(
        growth.values, growth.rotation[growth.posed], growth.translation[growth.posed], seen, scale=4 * growth.scale, start=growth.xyz, iterations=6
    )
    good = found.in_front & (found.rms < 6 * growth.scale) & (found.angle > np.deg2rad(options.min_angle_deg)) & (np.diff(seen.first) >= 2)
    xyz = np.full_like(growth.xyz, np.nan)
    xyz[kept[good]] = found.xyz[good]
    return replace(growth, xyz=xyz)


def adjust_growth(
    growth: Growth,
    table: KeyframeTable,
    options: GrowthOptions,
    *,
    free_focal: bool,
    radial_terms: int = 0,
    prior: FocalPrior | None = None,
    max_iterations: int = 8,
    tolerance: float = 1e-4,
    update_scale: bool = True,
) -> Growth:
    """Adjust what is posed, with the longest tracks; then take the scale from the residuals."""
    seen, kept = restrict(table.seen, _longest(growth, table, options.max_points), growth.posed)
    bundle = Bundle(growth.values, growth.rotation[growth.posed], growth.translation[growth.posed], growth.xyz[kept])
    done = adjust(
        bundle, seen, scale=growth.scale, free_focal=free_focal, radial_terms=radial_terms, prior=prior, max_iterations=max_iterations, tolerance=tolerance
    )
    rotation, translation, xyz = growth.rotation.copy(), growth.translation.copy(), growth.xyz.copy()
    rotation[growth.posed], translation[growth.posed] = done.bundle.rotation, done.bundle.translation
    xyz[kept] = done.bundle.xyz
    scale = max(options.scale_sigmas * robust_scale(done.residual), 0.02) if update_scale else growth.scale
    return replace(growth, values=done.bundle.intrinsics, rotation=rotation, translation=translation, xyz=xyz, scale=scale)


def _longest(growth: Growth, table: KeyframeTable, max_points: int) -> Bool[np.ndarray, "points"]:
    count = np.zeros(len(table.track), np.intp)
    np.add.at(count, table.seen.point[growth.posed[table.seen.camera]], 1)
    count[~np.isfinite(growth.xyz[:, 0])] = 0
    order = np.argsort(-count, kind="stable")[:max_points]
    use = np.zeros(len(count), bool)
    use[order[count[order] >= 2]] = True
    return use


def next_keyframe(growth: Growth, table: KeyframeTable, tried: set[int]) -> tuple[int, int]:
    """The unposed keyframe that sees most known points, and how many; (-1, 0) where none is left."""
    known = np.isfinite(growth.xyz[:, 0])[table.seen.point]
    counts = np.bincount(table.seen.camera[known], minlength=table.num_keyframes)
    counts[growth.posed] = 0
    counts[sorted(tried)] = 0
    best = int(np.argmax(counts))
    return (best, int(counts[best])) if counts[best] else (-1, 0)


def pose_keyframe(growth: Growth, table: KeyframeTable, keyframe: int, options: GrowthOptions, seed: int) -> Growth | None:
    """The keyframe posed against the known points; None where they do not support one."""
    rows = np.nonzero((table.seen.camera == keyframe) & np.isfinite(growth.xyz[:, 0])[table.seen.point])[0]
    posed = np.nonzero(growth.posed)[0]
    near = posed[np.argmin(np.abs(posed - keyframe))]
    guess = Rigid(growth.rotation[near], growth.translation[near])
    outcome = resect(
        growth.values, growth.xyz[table.seen.point[rows]], table.seen.xy[rows], scale=growth.scale, guesses=(guess,), seed=seed, options=options.resection
    )
    if not isinstance(outcome, Posed):
        return None
    rotation, translation, flags = growth.rotation.copy(), growth.translation.copy(), growth.posed.copy()
    rotation[keyframe], translation[keyframe], flags[keyframe] = outcome.cam_from_world.rotation, outcome.cam_from_world.translation, True
    return replace(growth, rotation=rotation, translation=translation, posed=flags)


def grow(
    growth: Growth,
    table: KeyframeTable,
    options: GrowthOptions,
    *,
    free_focal: bool,
    prior: FocalPrior | None = None,
    seed: int,
    max_new: int | None = None,
) -> Growth:
    """Pose one keyframe after the other, most visible points first, with an adjustment every few; keyframes that fail are tried again after others joined."""
    tried: set[int] = set()
    since, new, progressed = 0, 0, False
    while max_new is None or new < max_new:
        keyframe, count = next_keyframe(growth, table, tried)
        if count < options.resection.few_inliers:
            if not (tried and progressed):
                break
            tried, progressed = set(), False
            growth = adjust_growth(growth, table, options, free_focal=free_focal, prior=prior)
            growth = add_points(growth, table, options)
            continue
        grown = pose_keyframe(growth, table, keyframe, options, seed)
        if grown is None:
            tried.add(keyframe)
            continue
        growth, since, new, progressed = add_points(grown, table, options), since + 1, new + 1, True
        if since >= options.adjust_every:
            growth = adjust_growth(growth, table, options, free_focal=free_focal, prior=prior)
            growth, since = add_points(growth, table, options), 0
    growth = adjust_growth(growth, table, options, free_focal=free_focal, prior=prior)
    return add_points(growth, table, options)


def join(a: Growth, b: Growth, seed: int) -> Growth | None:
    """Piece `b` moved into the frame of `a` by the points both know (a similarity, RANSAC over three); None where fewer than six agree.

    Keyframes posed in both keep the pose of `a`, and points known in both their place in `a`.
    """
    common = np.nonzero(np.isfinite(a.xyz[:, 0]) & np.isfinite(b.xyz[:, 0]))[0]
    if len(common) < 6:
        return None
    rng = np.random.default_rng(seed)
    source, target = b.xyz[common], a.xyz[common]
    # Depth is the least certain direction of both: 3 % of the points' spread tells right matches from wrong ones.
    near = 0.03 * float(np.median(np.linalg.norm(target - np.median(target, axis=0), axis=1)))
    best = np.zeros(len(common), bool)
    for _ in range(300):
        pick = rng.choice(len(common), 3, replace=False)
        scale, turn, shift = similarity(source[pick], target[pick])
        agree = np.linalg.norm(scale * source @ turn.T + shift - target, axis=1) < near
        best = agree if agree.sum() > best.sum() else best
    if best.sum() < 6:
        return None
    scale, turn, shift = similarity(source[best], target[best])
    new = b.posed & ~a.posed
    rotation, translation, xyz = a.rotation.copy(), a.translation.copy(), a.xyz.copy()
    # x_cam = R x_b + t with x_b = turn^T (x_a - shift) / scale; the whole camera frame is scaled by `scale`.
    rotation[new] = b.rotation[new] @ turn.T
    translation[new] = scale * b.translation[new] - rotation[new] @ shift
    only = np.isfinite(b.xyz[:, 0]) & ~np.isfinite(xyz[:, 0])
    xyz[only] = scale * b.xyz[only] @ turn.T + shift
    return replace(a, rotation=rotation, translation=translation, xyz=xyz, posed=a.posed | b.posed)


def similarity(source: Float[np.ndarray, "n 3"], target: Float[np.ndarray, "n 3"]) -> tuple[float, Mat3, Vec3]:
    """Scale, rotation and shift with target = scale * rotation @ source + shift in the least squares sense (Umeyama 1991)."""
    mean_s, mean_t = source.mean(axis=0), target.mean(axis=0)
    u, s, vt = np.linalg.svd((target - mean_t).T @ (source - mean_s))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * signs) @ vt
    scale = float((s * signs).sum() / max(((source - mean_s) ** 2).sum(), 1e-300))
    return scale, rotation, mean_t - scale * rotation @ mean_s


def grow_pieces(
    growth: Growth,
    table: KeyframeTable,
    pairs: tuple[tuple[int, int], ...],
    options: GrowthOptions,
    *,
    prior: FocalPrior | None,
    seed: int,
    max_starts: int = 4,
) -> Growth:
    """Grow; where keyframes are left over, start again among them with the focal length known by now, and join the pieces.

    A piece that cannot be joined (nothing is seen in both) is dropped unless it is larger than what there was.
    """
    growth = grow(growth, table, options, free_focal=True, prior=prior, seed=seed)
    used: set[tuple[int, int]] = set()
    for _ in range(max_starts):
        left = [pair for pair in pairs if not growth.posed[pair[0]] and not growth.posed[pair[1]] and pair not in used]
        if not left:
            break
        used.update(pair for pair in pairs if pair[0] == left[0][0] or pair[1] == left[0][1])
        other = start_pair(table, *left[0], growth.values, replace(options, start_scale=max(growth.scale, 0.25 * options.start_scale)), seed)
        if other is None:
            continue
        other = grow(adjust_growth(other, table, options, free_focal=False), table, options, free_focal=False, seed=seed)
        joined = join(growth, other, seed)
        if joined is not None:
            joined = adjust_growth(add_points(joined, table, options), table, options, free_focal=True, prior=prior, max_iterations=15)
            growth = grow(add_points(joined, table, options), table, options, free_focal=True, prior=prior, seed=seed)
        elif other.posed.sum() > growth.posed.sum():
            growth = grow(other, table, options, free_focal=True, prior=prior, seed=seed)
    return growth
