"""A clip: a video file or a folder of numbered images, its frames by number, read as they are asked for."""

import hashlib
import stat
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from planewright.arrays import ColorImage, GrayImage
from planewright.errors import VideoError
from planewright.progress import Progress, silent
from planewright.video.frame_range import FrameRange
from planewright.video.image_folder import ImageFolder, read_images, scan_images
from planewright.video.limits import VideoLimits
from planewright.video.pixels import color_pixels, gray_pixels
from planewright.video.video_file import VideoIndex, read_video, scan_video


@dataclass(frozen=True)
class ClipInfo:
    """What is known of a clip without looking at its pictures."""

    name: str
    """File or folder name without its path."""
    sha256: str
    """Of the file; of a folder: of its image names and contents in order."""
    image_size: tuple[int, int]
    """Width, height, as displayed."""
    num_frames: int
    """All frames of the clip, also those left out by a frame range."""
    fps: float
    """Frames a second, on average."""
    times: tuple[float, ...]
    """Seconds of every frame since the first."""
    warnings: tuple[str, ...] = ()
    """What is wrong with the file but does not stop the work, as sentences."""


class Clip:
    """Frames by number (the `Frames` protocol). Holds no picture; every call of `gray` and `color` opens the source anew."""

    def __init__(self, path: Path, info: ClipInfo, numbers: range, source: VideoIndex | ImageFolder, limits: VideoLimits) -> None:
        self.path = path
        self.info = info
        self._numbers = numbers
        self._source = source
        self._limits = limits

    @property
    def image_size(self) -> tuple[int, int]:
        """Width, height, as displayed."""
        return self.info.image_size

    @property
    def numbers(self) -> Sequence[int]:
        """The frames that take part, increasing."""
        return self._numbers

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, GrayImage]]:
        """The named frames (increasing) in grey. Raises VideoError."""
        wanted = self._checked(numbers)
        if isinstance(self._source, ImageFolder):
            for number, image in read_images(self._source, wanted, self._limits):
                yield number, image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
        else:
            for number, frame in read_video(self.path, self._source, wanted, self._limits):
                yield number, self._source.orientation.apply(gray_pixels(frame))

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, ColorImage]]:
        """The named frames (increasing) in RGB. Raises VideoError."""
        wanted = self._checked(numbers)
        if isinstance(self._source, ImageFolder):
            for number, image in read_images(self._source, wanted, self._limits):
                yield number, image if image.ndim == 3 else np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2RGB))
        else:
            for number, frame in read_video(self.path, self._source, wanted, self._limits):
                yield number, self._source.orientation.apply(color_pixels(frame))

    def _checked(self, numbers: Sequence[int]) -> list[int]:
        wanted = [int(number) for number in numbers]
        if any(a >= b for a, b in pairwise(wanted)):
            raise ValueError("Frame numbers must increase.")
        if wanted and (wanted[0] < 0 or wanted[-1] >= self.info.num_frames):
            outside = wanted[0] if wanted[0] < 0 else wanted[-1]
            raise VideoError(f"{self.info.name} has no frame {outside}; its frames are 0 to {self.info.num_frames - 1}.")
        return wanted


def open_clip(path: Path | str, frames: FrameRange | None = None, limits: VideoLimits = VideoLimits(), *, progress: Progress = silent) -> Clip:
    """The clip of a video file or a folder of numbered images.

    The file is decoded once, which tells its frames, their times and any damage for certain (about 0.3 s for 250 frames of 960x540).

    Args:
        path: video file or folder.
        frames: the frames that take part; all by default.
        limits: what is refused.
        progress: called while the file is read.

    Raises:
        VideoError: nothing usable is there; the message says what to do.
        UsageError: `frames` leaves none.
    """
    path = Path(path)
    try:
        status = path.stat()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise VideoError(f"{path.name or path} cannot be found or opened: {reason}. Check the path.") from error
    if stat.S_ISDIR(status.st_mode):
        folder = scan_images(path, limits, progress)
        count, seconds = len(folder.files), tuple(number / folder.fps for number in range(len(folder.files)))
        info = ClipInfo(path.resolve().name, folder.sha256, folder.image_size, count, folder.fps, seconds, folder.warnings)
        return Clip(path, info, (frames or FrameRange()).of(count), folder, limits)
    if not stat.S_ISREG(status.st_mode):
        raise VideoError(f"{path.name} is neither a file nor a folder. Give a video file or a folder of numbered images.")
    if status.st_size == 0:
        raise VideoError(f"{path.name} is empty (0 bytes). Copy it again from its source.")
    if status.st_size > limits.max_bytes:
        raise VideoError(f"{path.name} has {status.st_size} bytes; the limit is {limits.max_bytes}. Cut it to the part that shows the scene.")
    index = scan_video(path, limits, progress)
    count = len(index.pts)
    size = index.orientation.displayed_size(index.stored_size)
    info = ClipInfo(path.name, _sha256(path), size, count, index.fps, index.seconds, index.warnings)
    return Clip(path, info, (frames or FrameRange()).of(count), index, limits)


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise VideoError(f"{path.name} cannot be read: {error.strerror or error}.") from error
