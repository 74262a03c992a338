"""A bounded set of frames, held in memory together with their cameras: what the sketch is lifted and measured with.

The clip is streamed once; memory depends on `max_views` and the image size, not on the clip's length.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Float, Int, Mat3, UInt8
from planewright.progress import Progress, silent, steps
from planewright.sfm.cameras import Cameras, ScenePoints
from planewright.video.frames import Frames


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """Which frames are kept, and how."""

    max_views: int = 110
    """Frames kept besides those with marks. Edges averaged over 100 frames gained nothing from more."""
    max_bytes: int = 260_000_000
    """Memory for the kept frames in grey, half as much again goes to their colour; fewer are kept where they are large."""
    max_pixels: int = 1_600_000
    """Larger frames are reduced to this many pixels (bilinear over areas)."""
    blur: float = 0.7
    """Gaussian blur of the kept frames against sensor and coding noise, pixels (sigma)."""


@dataclass(frozen=True, eq=False)
class Views:
    """Grey frames (reduced by `scale`) and their pinhole cameras. Pixels here are working pixels: `scale` times the clip's."""

    frame: Int[np.ndarray, "views"]
    """Frame numbers, increasing."""
    images: UInt8[np.ndarray, "views height width"]
    chroma: UInt8[np.ndarray, "views 2 half_height half_width"]
    """Red and blue differences (Cr, Cb) at half the resolution, which is all that video stores of them."""
    scale: float
    calibration: Mat3
    """K in working pixels; the centre of the top-left pixel is (0.5, 0.5)."""
    rotation: Float[np.ndarray, "views 3 3"]
    translation: Float[np.ndarray, "views 3"]
    depth_per_pixel: float
    """Relative change of depth that moves what the views look at by one working pixel, in the view that shows it moved most.

    Tolerances on depths are given in such pixels: a long lens far away sees a whole house in 6 % of the depth, a phone on a desk
    in 60 %, so a share of the depth means nothing by itself.
    """

    @property
    def projections(self) -> Float[np.ndarray, "views 3 4"]:
        """K [R | t] of each view, working pixels."""
        return self.calibration @ np.concatenate([self.rotation, self.translation[:, :, None]], axis=2)

    @property
    def centers(self) -> Float[np.ndarray, "views 3"]:
        """Camera centres in the world."""
        return -np.einsum("kji,kj->ki", self.rotation, self.translation)

    def index(self, frame: int) -> int | None:
        """Position of a frame number, or None."""
        k = int(np.searchsorted(self.frame, frame))
        return k if k < len(self.frame) and self.frame[k] == frame else None


def load_views(
    frames: Frames, cameras: Cameras, scene: ScenePoints, needed: Iterable[int], options: ViewOptions = ViewOptions(), *, progress: Progress = silent
) -> Views:
    """Evenly spread posed frames, and the `needed` ones (those with marks) that have a pose.

    `frames` and the cameras' pinhole part must belong together: lens distortion is removed already.
    """
    width, height = frames.image_size
    scale = min(1.0, float(np.sqrt(options.max_pixels / (width * height))))
    size = (round(width * scale), round(height * scale))
    room = max(24, min(options.max_views, options.max_bytes // (size[0] * size[1])))
    posed = cameras.frame[cameras.posed]
    spread = posed[np.unique(np.linspace(0, len(posed) - 1, min(room, len(posed))).round().astype(int))]
    wanted = sorted({*spread.tolist(), *(f for f in needed if cameras.row(f) is not None)})
    rows = np.array([cameras.row(f) for f in wanted])
    images = np.empty((len(wanted), size[1], size[0]), np.uint8)
    chroma = np.empty((len(wanted), 2, max(size[1] // 2, 1), max(size[0] // 2, 1)), np.uint8)
    for k, (_, image) in enumerate(steps(frames.color(wanted), "Loading views", progress, total=len(wanted))):
        half = cv2.resize(image, chroma.shape[:1:-1], interpolation=cv2.INTER_AREA)
        chroma[k] = cv2.cvtColor(half, cv2.COLOR_RGB2YCrCb)[:, :, 1:].transpose(2, 0, 1)
    for k, (_, image) in enumerate(steps(frames.gray(wanted), "Loading views", progress, total=len(wanted))):
        if scale < 1.0:
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        images[k] = cv2.GaussianBlur(image, (0, 0), options.blur) if options.blur > 0 else image
    stretch = np.diag([size[0] / width, size[1] / height, 1.0])
    calibration = stretch @ cameras.intrinsics.pinhole().matrix
    rotation, translation = cameras.rotation[rows], cameras.translation[rows]
    return Views(
        np.array(wanted), images, chroma, size[0] / width, calibration, rotation, translation, _depth_per_pixel(calibration, rotation, translation, scene, size)
    )


def _depth_per_pixel(
    calibration: Mat3,
    rotation: Float[np.ndarray, "views 3 3"],
    translation: Float[np.ndarray, "views 3"],
    scene: ScenePoints,
    size: tuple[int, int],
) -> float:
    """For a point amid each view, at the median depth of the scene features: one over the largest motion per relative change of its depth."""
    reach: list[float] = []
    for view in np.unique(np.linspace(0, len(rotation) - 1, 12).round().astype(int)):
        z = scene.xyz @ rotation[view][2] + translation[view][2]
        if not (z > 0).any():
            continue
        depth = float(np.median(z[z > 0]))
        turn = rotation @ rotation[view].T
        shift = translation - turn @ translation[view]
        p = (turn[:, :, 2] * depth + shift) @ calibration.T
        along = (turn[:, :, 2] * depth) @ calibration.T
        ahead = p[:, 2] > 1e-9
        xy = p[:, :2] / np.where(ahead, p[:, 2], 1.0)[:, None]
        inside = ahead & (xy > 0).all(axis=1) & (xy < size).all(axis=1)
        move = (along[:, :2] - xy * along[:, 2:]) / np.where(ahead, p[:, 2], 1.0)[:, None]
        if inside.any():
            reach.append(float(np.linalg.norm(move[inside], axis=1).max()))
    return 1.0 / max(float(np.median(reach)), 1.0) if reach else 0.01
