"""A folder of numbered images as a clip: natural order (2 before 10), one size, turned as their EXIF tag says."""

import hashlib
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image

from planewright.arrays import UInt8
from planewright.errors import VideoError
from planewright.progress import Progress, steps
from planewright.video.container import check_picture_size
from planewright.video.limits import VideoLimits

_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".bmp": "BMP", ".tif": "TIFF", ".tiff": "TIFF", ".webp": "WEBP", ".ppm": "PPM", ".pgm": "PPM"}
_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
"""EXIF orientation (tag 0x0112) -> what displays it upright."""
_TURNED = (5, 6, 7, 8)
"""Orientations that exchange width and height."""


@dataclass(frozen=True, eq=False)
class ImageFolder:
    """The images of a folder in order."""

    files: tuple[Path, ...]
    image_size: tuple[int, int]
    """Width, height, as displayed."""
    sha256: str
    fps: float
    """Assumed: a folder does not tell."""
    warnings: tuple[str, ...]


def scan_images(folder: Path, limits: VideoLimits, progress: Progress) -> ImageFolder:
    """The images of a folder; their headers are read, not their pixels. Raises VideoError."""
    try:
        files = sorted((entry for entry in folder.iterdir() if entry.suffix.lower() in _FORMATS and not entry.name.startswith(".")), key=_natural)
    except OSError as error:
        raise VideoError(f"The folder {folder.name} cannot be read: {error.strerror or error}.") from error
    if not files:
        raise VideoError(f"The folder {folder.name} holds no images ({', '.join(sorted(_FORMATS))}). Give a video file or a folder of numbered images.")
    if len(files) > limits.max_frames:
        raise VideoError(f"The folder {folder.name} holds {len(files)} images; the limit is {limits.max_frames}.")
    digest = hashlib.sha256()
    size: tuple[int, int] | None = None
    for number, file in enumerate(steps(files, "Reading the images", progress)):
        this = _displayed_size(file, limits)
        if size is not None and this != size:
            raise VideoError(
                f"{file.name} (frame {number}) has {this[0]}x{this[1]} pixels, the images before it {size[0]}x{size[1]}. "
                "All images of a clip have one size: remove the odd ones, or scale them."
            )
        size = this
        digest.update(file.name.encode("utf-8", "surrogateescape") + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    assert size is not None
    return ImageFolder(tuple(files), size, digest.hexdigest(), 30.0, _gaps(files))


def read_images(folder: ImageFolder, numbers: Sequence[int], limits: VideoLimits) -> Iterator[tuple[int, UInt8[np.ndarray, "..."]]]:
    """The numbered images: height x width where the file is grey, else height x width x 3 (RGB). Raises VideoError."""
    for number in numbers:
        file = folder.files[number]
        if _displayed_size(file, limits) != folder.image_size:
            raise VideoError(f"{file.name} changed its size while it was in use. Start again.")
        try:
            with _open(file) as image:
                yield number, _as_array(_as_displayed(image))
        except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
            raise VideoError(f"{file.name} (frame {number}) is damaged: {str(error)[:200]}. Replace it or remove it.") from error


def _turn_of(image: Image.Image) -> int:
    """The EXIF orientation. Of a PNG only an EXIF block before the pixels counts: looking further would decode it."""
    if image.format == "PNG" and "exif" not in image.info:
        return 1
    return int(image.getexif().get(0x0112, 1))


def _as_displayed(image: Image.Image) -> Image.Image:
    turn = _TURNS.get(_turn_of(image))
    return image if turn is None else image.transpose(turn)


def _as_array(image: Image.Image) -> UInt8[np.ndarray, "..."]:
    if image.mode.startswith("I"):
        # 16-bit grey: the upper byte, rounded as the limited-range rule rounds.
        codes = np.asarray(image).astype(np.float64)
        return np.floor(np.clip(codes / 65535.0, 0.0, 1.0) * 255 + 0.5).astype(np.uint8)
    return np.array(image if image.mode == "L" else image.convert("RGB"))


def _open(file: Path) -> Image.Image:
    with warnings.catch_warnings():
        # Pillow warns of odd EXIF blocks and of sizes below our own limit; neither changes the pixels.
        warnings.simplefilter("ignore")
        return Image.open(file, formats=sorted(set(_FORMATS.values())))


def _displayed_size(file: Path, limits: VideoLimits) -> tuple[int, int]:
    try:
        with _open(file) as image:
            width, height = image.size
            turned = _turn_of(image) in _TURNED
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
        raise VideoError(f"{file.name} is not an image that can be read: {str(error)[:200]}. Remove it from the folder, or replace it.") from error
    check_picture_size(file.name, (width, height), limits)
    return (height, width) if turned else (width, height)


def _natural(file: Path) -> tuple[list[tuple[int, int, str]], str]:
    parts = re.split(r"(\d+)", file.name)
    return [(0, int(part), "") if part.isascii() and part.isdigit() else (1, 0, part.lower()) for part in parts], file.name


def _gaps(files: list[Path]) -> tuple[str, ...]:
    """A sentence where the last number in the names skips some, which often means lost images."""
    found = [re.findall(r"\d+", file.stem) for file in files]
    if not all(found):
        return ("Not every image name holds a number; they are taken in the order of their names.",)
    numbers = [int(names[-1][-15:]) for names in found]
    steps_between = [b - a for a, b in pairwise(numbers)]
    if steps_between and len(set(steps_between)) > 1:
        usual = sorted(steps_between)[len(steps_between) // 2]
        odd = next(i for i, step in enumerate(steps_between) if step != usual)
        return (f"The image numbers skip between {files[odd].name} and {files[odd + 1].name}; the images are taken as they are.",)
    return ()
