"""The pose of one frame from points that are known: robust refinement of a guess, or a search from nothing."""

from dataclasses import dataclass

import numpy as np
import poselib

from planewright.arrays import Float
from planewright.geometry.rigid import Rigid
from planewright.sfm.kernels import resect_pose
from planewright.sfm.triangulate import normalize


@dataclass(frozen=True, kw_only=True)
class ResectionOptions:
    """When a pose counts."""

    min_inliers: int = 12
    """Four times the three points that fix a pose."""
    min_inlier_share: float = 0.35
    """Of the points seen in the frame."""
    few_inliers: int = 8
    """Enough where nearly all points agree: what is left where a clip thins out for a moment."""
    few_inlier_share: float = 0.7
    """That "nearly all"."""
    inlier_scales: float = 8.0
    """Residual of an inlier in multiples of the Cauchy scale."""
    iterations: int = 30
    """Of Levenberg-Marquardt."""


@dataclass(frozen=True, eq=False)
class Posed:
    """A pose that its points support."""

    cam_from_world: Rigid
    residual: Float[np.ndarray, "points 2"]
    """Pixels."""
    inliers: int


@dataclass(frozen=True)
class NotPosed:
    """Why a frame has no pose."""

    reason: str


def resect(
    values: Float[np.ndarray, "5"],
    xyz: Float[np.ndarray, "points 3"],
    xy: Float[np.ndarray, "points 2"],
    *,
    scale: float,
    guesses: tuple[Rigid, ...] = (),
    seed: int | None = None,
    options: ResectionOptions = ResectionOptions(),
) -> Posed | NotPosed:
    """The pose that sees `xyz` at `xy`: the best refined guess, or by RANSAC over minimal solutions (with `seed`) where no guess is supported.

    `values` are focal, principal point, k1, k2; `scale` is the Cauchy scale in pixels.
    """
    if len(xyz) < options.few_inliers:
        return NotPosed(f"{len(xyz)} points are seen; {options.few_inliers} are needed")
    best: Posed | None = None
    for guess in guesses:
        found = _refine(values, xyz, xy, guess, scale, options)
        if best is None or found.inliers > best.inliers:
            best = found
        if _supported(best, len(xyz), options):
            return best
    if seed is not None:
        found = _refine(values, xyz, xy, _search(values, xyz, xy, max(options.inlier_scales * scale, 2.0), seed), scale, options)
        if best is None or found.inliers > best.inliers:
            best = found
    if best is not None and _supported(best, len(xyz), options):
        return best
    return NotPosed(f"{best.inliers if best else 0} of {len(xyz)} points agree; {options.min_inliers} and {options.min_inlier_share:.0%} are needed")


def _supported(found: Posed, count: int, options: ResectionOptions) -> bool:
    many = found.inliers >= options.min_inliers and found.inliers >= options.min_inlier_share * count
    return many or (found.inliers >= options.few_inliers and found.inliers >= options.few_inlier_share * count)


def _refine(
    values: Float[np.ndarray, "5"], xyz: Float[np.ndarray, "points 3"], xy: Float[np.ndarray, "points 2"], guess: Rigid, scale: float, options: ResectionOptions
) -> Posed:
    rotation, translation = guess.rotation.copy(), guess.translation.copy()
    # A wide kernel first: a guess from the neighbouring frame is tens of pixels off, where the narrow one is flat.
    for wide in (30.0 * scale, 5.0 * scale, scale):
        resect_pose(values, rotation, translation, xyz, xy, wide, options.iterations)
    in_cam = xyz @ rotation.T + translation
    ahead = in_cam[:, 2] > 1e-9
    uv = in_cam[:, :2] / np.where(ahead, in_cam[:, 2], 1.0)[:, None]
    r2 = (uv**2).sum(axis=1, keepdims=True)
    residual = np.where(ahead[:, None], values[1:3] + values[0] * (1 + values[3] * r2 + values[4] * r2**2) * uv - xy, 1e3)
    inliers = int((np.linalg.norm(residual, axis=1) < options.inlier_scales * scale).sum())
    return Posed(cam_from_world=Rigid(rotation, translation), residual=residual, inliers=inliers)


def _search(values: Float[np.ndarray, "5"], xyz: Float[np.ndarray, "points 3"], xy: Float[np.ndarray, "points 2"], threshold: float, seed: int) -> Rigid:
    """RANSAC over three-point poses (PoseLib), on undistorted pixels."""
    flat = normalize(values, xy) * values[0]
    camera = {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [float(values[0]), 0.0, 0.0]}
    options = {"max_reproj_error": threshold, "max_iterations": 1000, "seed": seed}
    pose, _ = poselib.estimate_absolute_pose(flat, xyz, camera, options, {})
    return Rigid(np.asarray(pose.R, float), np.asarray(pose.t, float))
