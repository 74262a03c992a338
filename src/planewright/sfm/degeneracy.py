"""Gates before the camera solve: what kind of clip is this, and can cameras be had from it at all?"""

from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Float, Int, Mat3
from planewright.progress import Progress, silent, steps
from planewright.sfm.frame_table import FrameTable


@dataclass(frozen=True)
class Refused:
    """Why no cameras can be had, and what to film instead."""

    code: str
    """too-few-frames, too-few-features, static-camera, rotation-only, planar-scene, no-start, not-rigid or lost."""
    reason: str
    """Plain sentences."""


@dataclass(frozen=True, kw_only=True)
class GateOptions:
    """Where the gates stand."""

    min_features: int = 40
    """Features that two neighbouring keyframes must share somewhere; twelve fix a pose, and a homography takes its share of false ones."""
    min_motion: float = 0.008
    """Median travel between the farthest frames, as a fraction of the image's longer side (8 px of 960)."""
    parallax: float = 1.5
    """Pixels (at 960 wide) by which the 70th percentile of the features must leave the best homography: rotations and planes leave it by 0.1,
    scenes with depth by 26 to 165."""
    weak_parallax: float = 4.0
    """Likewise, below which a warning is given."""
    rotation_spread: float = 0.01
    """ln(s1 / s3) of K^-1 H K at its best focal: 0.004 for a rotation, 0.036 for a plane, 0.17 and more in general."""


@dataclass(frozen=True, eq=False)
class Parallax:
    """The pair of keyframes with the most depth in it."""

    pair: tuple[int, int]
    """Rows of the keyframe list."""
    shared: int
    residual: float
    """Pixels: 70th percentile of the distance from the pair's homography."""
    homography: Mat3
    ranked: tuple[tuple[int, int], ...]
    """Pairs, best first."""


def measure_parallax(table: FrameTable, keyframes: Int[np.ndarray, "keyframes"], *, max_pairs: int = 160, progress: Progress = silent) -> Parallax | None:
    """Every pair of keyframes (thinned evenly where there are many) scored by min(shared, 300) * min(residual from its homography, 25 px).

    None where no two keyframes share 16 features.
    """
    pairs = [(a, b) for a in range(len(keyframes)) for b in range(a + 1, len(keyframes))]
    sized = [(len(table.shared(int(keyframes[a]), int(keyframes[b]))[0]), a, b) for a, b in pairs]
    sized = [entry for entry in sized if entry[0] >= 16]
    if len(sized) > max_pairs:
        sized = [sized[i] for i in np.unique(np.linspace(0, len(sized) - 1, max_pairs).round().astype(int))]
    found: list[tuple[float, int, int, int, float, Mat3]] = []
    for count, a, b in steps(sized, "Looking for depth", progress):
        _, xa, xb = table.shared(int(keyframes[a]), int(keyframes[b]))
        h, residual = homography_residual(xa, xb)
        found.append((min(count, 300) * min(residual, 25.0), a, b, count, residual, h))
    if not found:
        return None
    found.sort(key=lambda entry: (-entry[0], entry[1], entry[2]))
    _, a, b, count, residual, h = found[0]
    return Parallax(pair=(a, b), shared=count, residual=residual, homography=h, ranked=tuple((entry[1], entry[2]) for entry in found))


def homography_residual(a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"]) -> tuple[Mat3, float]:
    """The homography that most of a -> b agrees with (RANSAC, 3 px), and the 70th percentile of the distances from it, in pixels."""
    found = np.asarray(cv2.findHomography(a.reshape(-1, 1, 2), b.reshape(-1, 1, 2), cv2.RANSAC, 3.0, maxIters=500)[0])
    if found.shape != (3, 3):  # None where no four points are in general position
        return np.eye(3), 0.0
    h = np.asarray(found, float)
    moved = np.c_[a, np.ones(len(a))] @ h.T
    residual = np.linalg.norm(moved[:, :2] / np.where(np.abs(moved[:, 2:]) > 1e-12, moved[:, 2:], 1e-12) - b, axis=1)
    return h, float(np.percentile(residual, 70))


def rotation_spread(h: Mat3, image_size: tuple[int, int]) -> tuple[float, float]:
    """How far a homography is from that of a turning camera: (smallest ln(s1 / s3) of K^-1 H K over focals, that focal in pixels)."""
    width, height = image_size

    def spread(focal: float) -> tuple[float, float]:
        k = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
        s = np.linalg.svd(np.linalg.solve(k, h @ k), compute_uv=False)
        return float(np.log(s[0] / s[2])), focal

    _, coarse = min(spread(float(focal)) for focal in np.geomspace(0.3, 6.0, 40) * max(image_size))
    # A rotation's spread falls to nothing at its own focal only: the coarse grid alone leaves .007 of it.
    return min(spread(float(focal)) for focal in coarse * np.geomspace(0.92, 1.08, 33))


def check_features(table: FrameTable, keyframes: Int[np.ndarray, "keyframes"], image_size: tuple[int, int], options: GateOptions) -> Refused | None:
    """Too few features, or a camera that stands still."""
    counts = np.diff(table.start)
    if table.num_frames < 3:
        return Refused(
            "too-few-frames",
            f"{table.num_frames} frame{'s do' if table.num_frames > 1 else ' does'} not tell where a camera was; 3 are the least and 30 a good start. "
            "Give a longer clip, or more frames of it.",
        )
    if np.sort(counts)[-3] < options.min_features:
        return Refused(
            "too-few-features",
            f"Hardly anything in this clip can be followed: its best frames hold {int(counts.max(initial=0))} features, and {options.min_features} are needed. "
            "Film in better light, with textured things in view, and move slowly enough that the picture stays sharp.",
        )
    farthest = 0.0
    for b in keyframes[1:]:
        for a in (0, int(keyframes[len(keyframes) // 2])):
            _, xa, xb = table.shared(a, int(b))
            if len(xa) >= 12:
                farthest = max(farthest, float(np.median(np.linalg.norm(xb - xa, axis=1))))
    if farthest < options.min_motion * max(image_size):
        return Refused(
            "static-camera",
            f"The camera hardly moves: the picture travels {farthest:.1f} pixels in the whole clip. "
            "Walk around the object while filming, so that it is seen from clearly different sides.",
        )
    return None


def check_parallax(
    parallax: Parallax | None, image_size: tuple[int, int], options: GateOptions, *, focal_known: bool
) -> tuple[Refused | None, tuple[str, ...]]:
    """A turning camera, or a scene that is one plane while the focal length is not known; and a warning where there is little depth."""
    if parallax is None:
        return Refused(
            "too-few-features",
            "No two parts of this clip show the same features for long enough. "
            "Film more slowly, so that most of what is seen in one frame is still there a second later.",
        ), ()
    unit = max(image_size) / 960.0
    if parallax.residual >= options.parallax * unit:
        if parallax.residual < options.weak_parallax * unit:
            return None, (
                f"There is little depth in this clip: features leave a flat picture by only {parallax.residual:.1f} pixels. "
                "Cameras are less certain than usual.",
            )
        return None, ()
    spread, _ = rotation_spread(parallax.homography, image_size)
    if spread < options.rotation_spread:
        return Refused(
            "rotation-only",
            "The camera only turns on the spot, and turning shows no depth. Film again while walking sideways or around the object, a step or more.",
        ), ()
    if focal_known:
        return None, ("All that is seen lies in one plane: the cameras rest on the focal length that was given.",)
    return Refused(
        "planar-scene",
        "All that is seen lies in one plane, from which neither the focal length nor the depth can be told. "
        "Film so that things at different depths are in view, or give the focal length in the sketch.",
    ), ()
