"""Cameras first: from followed features to the focal length, every frame's pose, and a cloud of points."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from threadpoolctl import threadpool_limits

from planewright.arrays import Bool, Float, Int
from planewright.features.features import Features
from planewright.geometry.lens import RollingShutter
from planewright.geometry.rigid import Rigid, rotations_from_vectors
from planewright.progress import Progress, silent, steps
from planewright.sfm.bundle import Adjusted, Bundle, FocalPrior, Observations, adjust, observations, robust_scale
from planewright.sfm.cameras import Cameras, ScenePoints
from planewright.sfm.degeneracy import GateOptions, Refused, check_features, check_parallax, measure_parallax
from planewright.sfm.focal import FocalOptions, FocalUncertainty, focal_uncertainty, settle_focal
from planewright.sfm.frame_table import FrameTable, frame_table, seen_between, select_keyframes, static_tracks
from planewright.sfm.growth import Growth, GrowthOptions, KeyframeTable, grow_pieces, keyframe_table, restrict
from planewright.sfm.initialize import StartOptions, find_start
from planewright.sfm.resection import Posed, ResectionOptions, resect
from planewright.sfm.shutter import Poses, ShutterOptions, depth_surfaces, motion_within_frames, straighten
from planewright.sfm.triangulate import intrinsics_value, triangulate
from planewright.sketch.graph import KnownCamera


@dataclass(frozen=True, kw_only=True)
class SfmOptions:
    """How cameras are solved."""

    keyframe_motion: float = 14.0
    """Median travel between keyframes, pixels at 960 wide."""
    keyframe_shared: float = 0.5
    """Share of the features that two keyframes in a row must have in common."""
    min_keyframes_in_all: int = 24
    """Aimed at by closer spacing."""
    max_keyframes: int = 40
    """12 to 65 keyframes gave the same accuracy, and the time grows with their square."""
    max_keyframes_long: int = 80
    """For clips in which 40 would share too little with each other."""
    points: int = 1500
    """Longest tracks in the last adjustment; 300 lose a third of the accuracy."""
    min_angle_deg: float = 2.0
    """Between two rays of a point in the last adjustment."""
    output_angle_deg: float = 1.0
    """Between two rays of a point that is handed out."""
    min_keyframes: int = 3
    """In which such a point must be seen."""
    independent: float = 10.0
    """Observations that count as one when radial terms are weighed (errors are correlated along a track and over the image)."""
    max_sigma: float = 1.2
    """Standard deviation of a residual's coordinate, pixels at 960 wide, above which nothing rigid was found: good clips have 0.1, phone clips 0.25."""
    min_explained: float = 0.25
    """Share of the observations that the scene's points must account for; good clips reach 0.9 and more."""
    near_affine: float = 0.3
    """Width of the focal's interval, relative to it, at which the clip is called nearly affine."""
    gates: GateOptions = field(default_factory=GateOptions)
    growth: GrowthOptions = field(default_factory=GrowthOptions)
    start: StartOptions = field(default_factory=StartOptions)
    focal: FocalOptions = field(default_factory=FocalOptions)
    resection: ResectionOptions = field(default_factory=ResectionOptions)
    shutter: ShutterOptions = field(default_factory=ShutterOptions)


@dataclass(frozen=True)
class SfmSummary:
    """What a person may want to know of the solve."""

    median_residual: float
    """Length of the residual over all frames, pixels."""
    sigma: float
    """Of one pixel coordinate, by the median absolute deviation."""
    keyframes: tuple[int, ...]
    """Frame numbers."""
    radial_terms: int
    """0, 1 or 2, by the Bayesian information criterion."""
    focal_inflation: float
    """Variance of the focal length over that of independent errors."""
    parallax: float
    """Pixels by which the best pair of keyframes leaves a homography (70th percentile)."""
    frames_posed: int
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Solved:
    """Cameras, and the points that say so."""

    cameras: Cameras
    points: ScenePoints
    summary: SfmSummary


def solve_cameras(
    features: Features,
    frame_numbers: Int[np.ndarray, "frames"],
    image_size: tuple[int, int],
    *,
    known: KnownCamera | None = None,
    options: SfmOptions = SfmOptions(),
    rng: np.random.Generator,
    progress: Progress = silent,
) -> Solved | Refused:
    """Structure from motion with one unknown focal length and the principal point in the image's centre.

    Gates first (degeneracy.py), then a profile over focal lengths on a pair and a few keyframes, growth over the keyframes, adjustment with the points
    eliminated, radial terms by BIC, and every frame by resection. `known` is a Gaussian prior on the focal length. Scale: the median distance of the
    points from the first keyframe's camera is 10 units; the world is that camera's frame.
    """
    # The systems are small (a few hundred unknowns): threads of the linear algebra cost more than they bring, 7.8 s against 0.33 s on busy cores.
    with threadpool_limits(1):
        return _solve(features, np.asarray(frame_numbers), image_size, known, options, int(rng.integers(2**31 - 1)), progress)


def _solve(
    features: Features,
    frame_numbers: Int[np.ndarray, "frames"],
    image_size: tuple[int, int],
    known: KnownCamera | None,
    options: SfmOptions,
    seed: int,
    progress: Progress,
) -> Solved | Refused:
    unit = max(image_size) / 960.0
    table = frame_table(features, frame_numbers)
    static = static_tracks(table)
    if len(static):
        table = frame_table(features, frame_numbers, without=static)
    keyframes = _keyframes(table, unit, options)
    refused = check_features(table, keyframes, image_size, options.gates)
    if refused:
        return refused
    parallax = measure_parallax(table, keyframes, progress=progress)
    refused, warnings = check_parallax(parallax, image_size, options.gates, focal_known=known is not None)
    if refused or parallax is None:
        return refused or Refused("no-start", "No two keyframes share enough features.")

    prior = None if known is None else FocalPrior(float(np.log(known.focal)), (0.15 * unit) ** 2 * 10.0 / (known.sigma / known.focal) ** 2)
    keyed = keyframe_table(table, keyframes)
    growth_options = replace(options.growth, start_scale=options.growth.start_scale * unit)
    start = find_start(keyed, parallax.ranked, image_size, growth_options, prior=prior, options=options.start, seed=seed, progress=progress)
    if start is None:
        return Refused("no-start", "No pair of frames gives a first pair of cameras. Film a static scene, walking around it slowly.")
    progress("Posing keyframes", 0, None)
    growth = grow_pieces(start.growth, keyed, parallax.ranked, growth_options, prior=prior, seed=seed)
    adjusted, seen, kept, radial_terms, scale = _final_adjustment(growth, keyed, image_size, options, prior, progress)
    growth = _put_back(growth, adjusted, kept)
    poses, xyz = _pose_all(table, keyframes, growth, keyed, scale, seed, options, progress)

    found = _Rolled(table, table, growth, poses, xyz, adjusted, seen, kept, radial_terms, scale)
    found = _without_shutter(found, keyframes, image_size, options, prior, seed, progress)
    bundle, seen, scale, radial_terms = found.adjusted.bundle, found.seen, found.scale, found.radial_terms

    progress("Weighing the focal length", 0, None)
    focal = focal_uncertainty(bundle, seen, scale=scale, radial_terms=radial_terms, image_size=image_size, prior=prior, options=options.focal)
    return _result(
        found.straight, keyframes, found.growth, found.poses, found.shutter, radial_terms, scale, focal, image_size, parallax.residual, warnings, options
    )


def _keyframes(table: FrameTable, unit: float, options: SfmOptions) -> Int[np.ndarray, "keyframes"]:
    wanted, motion, shared = options.min_keyframes_in_all, options.keyframe_motion * unit, options.keyframe_shared
    keyframes = select_keyframes(table, motion=motion, min_shared=shared, min_keyframes=wanted, max_keyframes=options.max_keyframes)
    pairs = pairwise(keyframes)
    thin = any(len(table.shared(int(a), int(b))[0]) < 0.25 * (table.start[a + 1] - table.start[a]) for a, b in pairs)
    if thin and len(keyframes) >= options.max_keyframes // 2:
        return select_keyframes(table, motion=motion, min_shared=shared, min_keyframes=wanted, max_keyframes=options.max_keyframes_long)
    return keyframes


def _final_adjustment(
    growth: Growth, keyed: KeyframeTable, image_size: tuple[int, int], options: SfmOptions, prior: FocalPrior | None, progress: Progress
) -> tuple[Adjusted, Observations, Int[np.ndarray, "kept"], int, float]:
    """The longest well-opened tracks over all posed keyframes; radial terms by BIC. Also the rows of the points used, the number of terms, the scale."""
    seen, kept = restrict(keyed.seen, np.isfinite(growth.xyz[:, 0]), growth.posed)
    found = triangulate(growth.values, growth.rotation[growth.posed], growth.translation[growth.posed], seen, scale=growth.scale, start=growth.xyz[kept])
    count = np.diff(seen.first)
    good = found.in_front & (count >= options.min_keyframes) & (found.angle > np.deg2rad(options.min_angle_deg)) & (found.rms < 4 * growth.scale)
    if good.sum() < 50:
        good = found.in_front & (count >= 2)
    order = np.argsort(-np.where(good, count, 0), kind="stable")[: options.points]
    use = np.zeros(len(keyed.track), bool)
    use[kept[order[good[order]]]] = True
    xyz = growth.xyz.copy()
    xyz[kept] = found.xyz
    seen, kept = restrict(keyed.seen, use, growth.posed)
    bundle = Bundle(growth.values, growth.rotation[growth.posed], growth.translation[growth.posed], xyz[kept])
    scale = growth.scale
    best = adjust(bundle, seen, scale=scale, prior=prior, max_iterations=10, tolerance=1e-4)
    scale = max(options.growth.scale_sigmas * robust_scale(best.residual), 0.02)
    limit = options.focal.max_ratio * 2 * max(image_size)

    def settle(start: Bundle, terms: int) -> Adjusted:
        done = adjust(start, seen, scale=scale, radial_terms=terms, prior=prior, max_iterations=25, tolerance=1e-7)
        return settle_focal(done, seen, scale=scale, radial_terms=terms, prior=prior, limit=limit) if done.iterations == 25 else done

    best, terms = settle(best.bundle, 0), 0
    num = len(seen.camera) / options.independent
    for candidate in (1, 2):
        progress("Weighing lens distortion", candidate, 2)
        tried = settle(best.bundle, candidate)
        variance = robust_scale(tried.residual) ** 2
        # BIC: twice the rise of the log-likelihood must beat log(n) a term, with n the observations that are independent.
        if 2 * (best.cost - tried.cost) / variance / options.independent > (candidate - terms) * np.log(num):
            best, terms = tried, candidate
    if terms:
        scale = max(options.growth.scale_sigmas * robust_scale(best.residual), 0.02)
        best = settle(best.bundle, terms)
    return best, seen, kept, terms, scale


def _put_back(growth: Growth, adjusted: Adjusted, kept: Int[np.ndarray, "kept"]) -> Growth:
    rotation, translation = growth.rotation.copy(), growth.translation.copy()
    rotation[growth.posed], translation[growth.posed] = adjusted.bundle.rotation, adjusted.bundle.translation
    xyz = growth.xyz.copy()
    xyz[kept] = adjusted.bundle.xyz
    return replace(growth, values=adjusted.bundle.intrinsics, rotation=rotation, translation=translation, xyz=xyz)


def _pose_all(
    table: FrameTable,
    keyframes: Int[np.ndarray, "keyframes"],
    growth: Growth,
    keyed: KeyframeTable,
    scale: float,
    seed: int,
    options: SfmOptions,
    progress: Progress,
    *,
    start: Poses | None = None,
) -> tuple[Poses, Float[np.ndarray, "tracks 3"]]:
    """Every frame against the keyframes' points, from poses interpolated between the posed frames on both sides. Also the points, NaN where there is none."""
    seen, kept = restrict(keyed.seen, np.ones(len(keyed.track), bool), growth.posed)
    found = triangulate(growth.values, growth.rotation[growth.posed], growth.translation[growth.posed], seen, scale=scale, start=growth.xyz[kept])
    good = found.in_front & (found.rms < 4 * scale) & (found.angle > np.deg2rad(options.growth.min_angle_deg)) & (np.diff(seen.first) >= 2)
    xyz = np.full((table.num_tracks, 3), np.nan)
    xyz[keyed.track[kept[good]]] = found.xyz[good]
    rotation, translation = np.tile(np.eye(3), (table.num_frames, 1, 1)), np.zeros((table.num_frames, 3))
    posed = np.zeros(table.num_frames, bool)
    if start is not None:
        rotation, translation, posed = start.rotation.copy(), start.translation.copy(), start.posed.copy()
    at = keyframes[growth.posed]
    rotation[at], translation[at], posed[at] = growth.rotation[growth.posed], growth.translation[growth.posed], True

    def pose(frames: Sequence[int], places: Float[np.ndarray, "tracks 3"]) -> None:
        for k in steps(frames, "Posing frames", progress):
            rows = np.arange(int(table.start[k]), int(table.start[k + 1]))
            rows = rows[np.isfinite(places[table.track[rows], 0])]
            guesses = (Rigid(rotation[k], translation[k]),) if posed[k] else _between(rotation, translation, posed, k)
            points, xy = places[table.track[rows]], table.xy[rows].astype(np.float64)
            outcome = resect(growth.values, points, xy, scale=scale, guesses=guesses, seed=seed, options=options.resection)
            if isinstance(outcome, Posed):
                rotation[k], translation[k], posed[k] = outcome.cam_from_world.rotation, outcome.cam_from_world.translation, True
            else:
                rotation[k], translation[k], posed[k] = np.eye(3), np.zeros(3), False

    pose(range(table.num_frames), xyz)
    missed = np.nonzero(~posed)[0].tolist()
    if missed and posed.any():
        # Tracks that lie between two keyframes have points now that the frames around have poses.
        track, found_xyz, _, _ = _all_points(table, growth.values, rotation, translation, posed, scale, options.growth.min_angle_deg)
        more = np.full_like(xyz, np.nan)
        more[track] = found_xyz
        pose(missed, np.where(np.isfinite(xyz), xyz, more))
    return Poses(rotation, translation, posed), xyz


@dataclass(frozen=True, eq=False)
class _Rolled:
    """A solve with the rolling shutter taken away; before that, one without."""

    table: FrameTable
    """As displayed."""
    straight: FrameTable
    """With all rows exposed at once."""
    growth: Growth
    poses: Poses
    xyz: Float[np.ndarray, "tracks 3"]
    adjusted: Adjusted
    seen: Observations
    kept: Int[np.ndarray, "kept"]
    radial_terms: int
    scale: float
    shutter: RollingShutter | None = None


def _without_shutter(
    now: _Rolled,
    keyframes: Int[np.ndarray, "keyframes"],
    image_size: tuple[int, int],
    options: SfmOptions,
    prior: FocalPrior | None,
    seed: int,
    progress: Progress,
) -> _Rolled:
    """The rolling shutter found and taken away by turns: motion within a frame from the poses, straight features from the motion, poses from these.

    `now` comes back where the data do not ask for it, by the criterion of the radial terms: twice the rise of the log-likelihood against log(n).
    """
    if now.poses.posed.sum() < options.shutter.min_frames:
        return now
    first, readout, settled = now, 0.0, False
    for done in range(options.shutter.max_rounds):
        progress("Weighing a rolling shutter", done, options.shutter.max_rounds)
        # What the keyframes say needs no other frame straightened.
        rows = np.arange(now.table.num_frames) if done else keyframes
        shutter = _shutter(now, rows, readout, image_size, options)
        if done:
            straight = replace(now.table, xy=_straightened(now, rows, shutter, readout, image_size))
            keyed = keyframe_table(straight, keyframes)
            poses, xyz = _pose_all(straight, keyframes, now.growth, keyed, now.scale, seed, options, progress, start=now.poses)
            now = replace(now, straight=straight, poses=poses, xyz=xyz, shutter=shutter)
            if settled:
                break
            shutter = _shutter(now, keyframes, readout, image_size, options)
        seen, drift = _drift(now, keyframes, shutter, readout, image_size)
        bundle = replace(now.adjusted.bundle, readout=0.0)
        tried = adjust(bundle, seen, scale=now.scale, radial_terms=now.radial_terms, prior=prior, drift=drift, max_iterations=15 if done else 8, tolerance=1e-5)
        if not done:
            variance = robust_scale(tried.residual) ** 2
            if 2 * (now.adjusted.cost - tried.cost) / variance / options.independent <= np.log(len(seen.camera) / options.independent):
                return first
        readout += tried.bundle.readout
        settled = abs(tried.bundle.readout) < options.shutter.tolerance or done == options.shutter.max_rounds - 2
        scale = max(options.growth.scale_sigmas * robust_scale(tried.residual), 0.02)
        now = replace(now, growth=_put_back(now.growth, tried, now.kept), adjusted=tried, seen=seen, scale=scale)
    growth = replace(now.growth, values=np.array([*now.growth.values[:3], 0.0, 0.0]), scale=now.scale)
    keyed = keyframe_table(now.straight, keyframes)
    adjusted, seen, kept, radial_terms, scale = _final_adjustment(growth, keyed, image_size, options, prior, progress)
    growth = _put_back(growth, adjusted, kept)
    poses, xyz = _pose_all(now.straight, keyframes, growth, keyed, scale, seed, options, progress, start=now.poses)
    now = replace(now, growth=growth, poses=poses, xyz=xyz, adjusted=adjusted, seen=seen, kept=kept, radial_terms=radial_terms, scale=scale)
    return now if scale < first.scale and abs(readout) <= options.shutter.max_readout else first


def _shutter(now: _Rolled, rows: Int[np.ndarray, "rows"], readout: float, image_size: tuple[int, int], options: SfmOptions) -> RollingShutter:
    turn, shift = motion_within_frames(now.table.frame, now.poses)
    surface = depth_surfaces(_part(now.straight, rows), now.growth.values, image_size, now.poses.part(rows), now.xyz, options.shutter)
    return RollingShutter(readout=readout, frame=now.table.frame[rows], turn=turn[rows], shift=shift[rows], inverse_depth=surface)


def _straightened(
    now: _Rolled, rows: Int[np.ndarray, "rows"], shutter: RollingShutter, readout: float, image_size: tuple[int, int]
) -> Float[np.ndarray, "obs 2"]:
    part = _part(now.table, rows)
    return straighten(part, now.growth.values, image_size, now.poses.part(rows), now.xyz, replace(shutter, readout=readout))


def _drift(
    now: _Rolled, keyframes: Int[np.ndarray, "keyframes"], shutter: RollingShutter, readout: float, image_size: tuple[int, int], step: float = 0.05
) -> tuple[Observations, Float[np.ndarray, "obs 2"]]:
    """The adjustment's observations, straightened, and by how much they move as the readout grows by a frame."""
    use = np.zeros(len(now.growth.xyz), bool)
    use[now.kept] = True
    places: list[Observations] = []
    part = _part(now.table, keyframes)
    for at in (readout, readout - step, readout + step):
        moved = replace(part, xy=_straightened(now, keyframes, shutter, at, image_size))
        keyed = keyframe_table(moved, np.arange(len(keyframes)))
        places.append(restrict(keyed.seen, use, now.growth.posed)[0])
    return places[0], (places[2].xy - places[1].xy) / (2 * step)


def _part(table: FrameTable, rows: Int[np.ndarray, "rows"]) -> FrameTable:
    """Some of the frames."""
    if len(rows) == table.num_frames:
        return table
    picked = np.concatenate([np.arange(int(table.start[k]), int(table.start[k + 1])) for k in rows])
    start = np.concatenate([[0], np.cumsum(table.start[rows + 1] - table.start[rows])]).astype(np.intp)
    return FrameTable(track=table.track[picked], xy=table.xy[picked], start=start, frame=table.frame[rows], num_tracks=table.num_tracks)


def _between(
    rotation: Float[np.ndarray, "frames 3 3"], translation: Float[np.ndarray, "frames 3"], posed: Bool[np.ndarray, "frames"], k: int
) -> tuple[Rigid, ...]:
    """The pose interpolated between the posed frames around `k`, and theirs."""
    at = np.nonzero(posed)[0]
    before, after = at[at < k], at[at > k]
    if not len(before) or not len(after):
        near = before[-1] if len(before) else after[0]
        return (Rigid(rotation[near], translation[near]),)
    a, b = int(before[-1]), int(after[0])
    part = (k - a) / (b - a)
    turn = rotation[b] @ rotation[a].T
    vector = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    size = float(np.linalg.norm(vector))
    angle = float(np.arctan2(size, np.trace(turn) - 1.0))
    vector = vector / size * angle if size > 1e-12 else np.zeros(3)
    r = rotations_from_vectors((part * vector)[None])[0] @ rotation[a]
    centre = -(1 - part) * rotation[a].T @ translation[a] - part * rotation[b].T @ translation[b]
    return Rigid(r, -r @ centre), Rigid(rotation[a], translation[a]), Rigid(rotation[b], translation[b])


def _result(
    table: FrameTable,
    keyframes: Int[np.ndarray, "keyframes"],
    growth: Growth,
    poses: Poses,
    shutter: RollingShutter | None,
    radial_terms: int,
    scale: float,
    focal: FocalUncertainty,
    image_size: tuple[int, int],
    parallax: float,
    warnings: tuple[str, ...],
    options: SfmOptions,
) -> Solved | Refused:
    """All tracks triangulated from all posed frames, in the units and the frame that are handed out."""
    rotation, translation, posed = poses.rotation, poses.translation, poses.posed
    if not posed.any():
        return Refused("lost", "Not one frame could be posed. Film a static scene, walking around it slowly.")
    track, xyz, covariance, residual = _all_points(table, growth.values, rotation, translation, posed, scale, options.output_angle_deg)
    if len(track) < options.resection.min_inliers:
        return Refused("lost", "Hardly any point of the scene could be placed. Film a static scene, walking around it slowly.")
    sigma, median = robust_scale(residual), float(np.median(np.linalg.norm(residual, axis=1)))
    explained = _explained(table, posed, track)
    if sigma > options.max_sigma * max(image_size) / 960.0 or explained < options.min_explained:
        return Refused(
            "not-rigid",
            f"What is seen does not move as one rigid scene: its best points are off by {sigma:.1f} pixels "
            f"and account for {explained:.0%} of what was followed. "
            "Film a scene that stands still, or draw the faces of the object that moves.",
        )
    if explained < 2 * options.min_explained:
        warnings = (*warnings, f"Only {explained:.0%} of what was followed moves with the scene; the rest is taken for things that move on their own.")

    base = int(keyframes[np.nonzero(growth.posed)[0][0]])
    world = Rigid(rotation[base], translation[base])
    unit = 10.0 / float(np.median((xyz @ world.rotation.T + world.translation)[:, 2]))
    moved = Rigid(world.rotation.T, -world.rotation.T @ world.translation)
    new_rotation = np.where(posed[:, None, None], rotation @ moved.rotation, np.eye(3))
    new_translation = np.where(posed[:, None], unit * (rotation @ moved.translation + translation), 0.0)
    points = ScenePoints(
        xyz=unit * world.apply(xyz), track_index=track, covariance=unit**2 * sigma**2 * (world.rotation @ covariance @ world.rotation.T),
        seen=seen_between(table)[track],
    )  # fmt: skip
    lower, upper = focal.interval
    estimate = float(growth.values[0])
    if upper is None or (upper - lower) / estimate > options.near_affine:
        bound = "nothing bounds it from above" if upper is None else f"to {upper:.0f}"
        warnings = (*warnings, f"The clip is nearly affine: the focal length is hardly observable (95 % interval from {lower:.0f} pixels, {bound}). "
                    "Lengths in depth are uncertain; give the focal length if it is known, or film from closer and from more sides.")  # fmt: skip
    if not posed.all():
        warnings = (*warnings, f"{int((~posed).sum())} of {table.num_frames} frames have no camera: too few known features are seen there.")
    cameras = Cameras(
        intrinsics=intrinsics_value(growth.values, image_size, radial_terms),
        frame=table.frame, rotation=new_rotation, translation=new_translation, posed=posed,
        focal_sigma=focal.sigma, focal_interval=focal.interval,
        shutter=None if shutter is None else shutter.scaled(unit),
    )  # fmt: skip
    summary = SfmSummary(
        median_residual=median, sigma=sigma, keyframes=tuple(int(table.frame[k]) for k in keyframes[growth.posed]), radial_terms=radial_terms,
        focal_inflation=focal.inflation, parallax=parallax, frames_posed=int(posed.sum()), warnings=warnings,
    )  # fmt: skip
    return Solved(cameras=cameras, points=points, summary=summary)


def _explained(table: FrameTable, posed: Bool[np.ndarray, "frames"], track: Int[np.ndarray, "points"]) -> float:
    """Share of the observations in posed frames that belong to the points."""
    known = np.zeros(table.num_tracks, bool)
    known[track] = True
    rows = np.repeat(posed, np.diff(table.start))
    return float(known[table.track[rows]].mean())


def _all_points(
    table: FrameTable,
    values: Float[np.ndarray, "5"],
    rotation: Float[np.ndarray, "frames 3 3"],
    translation: Float[np.ndarray, "frames 3"],
    posed: Bool[np.ndarray, "frames"],
    scale: float,
    min_angle_deg: float,
    rows_at_once: int = 100_000,
) -> tuple[Int[np.ndarray, "points"], Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3 3"], Float[np.ndarray, "sampled 2"]]:
    """Tracks that make points over all posed frames, the points, their covariances for one pixel of noise, and a sample of the residuals.

    A slice of the tracks at a time, so that the memory does not grow with the clip.
    """
    frame_of = np.repeat(np.arange(table.num_frames, dtype=np.int32), np.diff(table.start))
    order = np.argsort(table.track, kind="stable")
    order = order[posed[frame_of[order]]]
    ends = np.searchsorted(table.track[order], np.arange(table.num_tracks + 1))
    cuts = [0]
    while cuts[-1] < table.num_tracks:
        cuts.append(max(int(np.searchsorted(ends, ends[cuts[-1]] + rows_at_once, side="right")) - 1, cuts[-1] + 1))
    camera_of = np.cumsum(posed) - 1
    every = len(order) // 200_000 + 1
    tracks: list[Int[np.ndarray, "some"]] = []
    points: list[Float[np.ndarray, "some 3"]] = []
    covariances: list[Float[np.ndarray, "some 3 3"]] = []
    residuals: list[Float[np.ndarray, "some 2"]] = []
    for low, high in pairwise(cuts):
        rows = order[ends[low] : ends[high]]
        seen = observations(table.track[rows] - low, camera_of[frame_of[rows]], table.xy[rows], high - low)
        found = triangulate(values, rotation[posed], translation[posed], seen, scale=scale)
        wide = found.angle > np.deg2rad(min_angle_deg)
        good = found.in_front & (found.rms < 4 * scale) & wide & (np.diff(seen.first) >= 3)
        tracks.append(np.nonzero(good)[0] + low)
        points.append(found.xyz[good])
        covariances.append(found.covariance[good])
        sample = np.nonzero(good[seen.point])[0][::every]
        camera = seen.camera[sample]
        x = np.einsum("oij,oj->oi", rotation[posed][camera], found.xyz[seen.point[sample]]) + translation[posed][camera]
        uv = x[:, :2] / x[:, 2:]
        r2 = (uv**2).sum(axis=1, keepdims=True)
        residuals.append(values[1:3] + values[0] * (1 + values[3] * r2 + values[4] * r2**2) * uv - seen.xy[sample])
    return np.concatenate(tracks), np.concatenate(points), np.concatenate(covariances), np.concatenate(residuals)
