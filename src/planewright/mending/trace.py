"""A point followed from one frame on, as far as it can be told from its surroundings."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Bool, Float, GrayImage
from planewright.video.frames import Frames

BLOCK = 24
"""Frames read at a time, and in memory."""


@dataclass(frozen=True, kw_only=True)
class TraceOptions:
    """How a point is followed, and when it counts as lost."""

    window: int = 21
    """Side of the patch that is followed from a frame to the next, pixels."""
    levels: int = 3
    """Halvings of the image."""
    there_and_back: float = 1.0
    """A step that does not come back to within this (pixels) is none."""
    least_like: float = 0.7
    """A place whose patch correlates less with the one before it (ZNCC) is another."""


def trace(
    frames: Frames, numbers: Sequence[int], start: Float[np.ndarray, "2"], options: TraceOptions = TraceOptions()
) -> tuple[Float[np.ndarray, "frames 2"], Bool[np.ndarray, "frames"]]:
    """Where the point is in each of some frames, by pyramidal Lucas-Kanade (Bouguet 2001) forwards and back; and whether it was followed so far.

    Args:
        numbers: frames in the order in which they are walked, up or down; the first is the one of `start`.
        start: pixels.

    Returns:
        Places, the last good one repeated where the point was lost; and which were followed, a first part of them.
    """
    path = np.tile(np.asarray(start, dtype=np.float64), (len(numbers), 1))
    known = np.zeros(len(numbers), dtype=bool)
    known[:1] = True
    before: GrayImage | None = None
    for k, image in enumerate(_images(frames, numbers)):
        if before is not None:
            moved = _step(before, image, path[k - 1], options)
            if moved is None:
                path[k:] = path[k - 1]
                break
            path[k], known[k] = moved, True
        before = image
    return path, known


def _images(frames: Frames, numbers: Sequence[int]) -> Iterator[GrayImage]:
    """One after the other, read in blocks and in the clip's direction: a decoder only goes forwards."""
    for first in range(0, len(numbers), BLOCK):
        block = [int(number) for number in numbers[first : first + BLOCK]]
        images = dict(frames.gray(sorted(block)))
        yield from (images[number] for number in block)


def _step(before: GrayImage, image: GrayImage, place: Float[np.ndarray, "2"], options: TraceOptions) -> Float[np.ndarray, "2"] | None:
    side = (options.window, options.window)
    here = (place - 0.5).astype(np.float32).reshape(1, 1, 2)
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, image, here, np.empty_like(here), winSize=side, maxLevel=options.levels)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(image, before, there, np.empty_like(here), winSize=side, maxLevel=options.levels)
    height, width = image.shape
    x, y = (float(v) for v in there.ravel())
    if not (found.all() and found_back.all()) or not (0 <= x < width and 0 <= y < height):
        return None
    if float(np.linalg.norm(back - here)) > options.there_and_back:
        return None
    old, new = (
        cv2.getRectSubPix(picture, side, (float(at[0, 0, 0]), float(at[0, 0, 1]))).astype(np.float64).ravel()
        for picture, at in ((before, here), (image, there))
    )
    old, new = old - old.mean(), new - new.mean()
    size = float(np.linalg.norm(old) * np.linalg.norm(new))
    if size > 0.0 and float(old @ new) < options.least_like * size:
        return None
    return np.array([x, y]) + 0.5
