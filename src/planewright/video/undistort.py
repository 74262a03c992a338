"""Frames as a pinhole camera with all rows exposed at once would have seen them."""

from collections.abc import Iterator, Sequence
from functools import cached_property

import cv2
import numpy as np

from planewright.arrays import ColorImage, Float, GrayImage, UInt8
from planewright.geometry.lens import Lens
from planewright.video.frames import Frames

CELL = 8
"""Pixels between the places at which a rolling shutter's map is worked out; it bends by less than 0.01 pixels between them."""


class UndistortedFrames:
    """The straight frames of another source, resampled (bicubic): `lens` says where each of their pixels is displayed. The same images where it does nothing.

    Borders repeat the outermost pixels where the lens did not look.
    """

    def __init__(self, frames: Frames, lens: Lens) -> None:
        if frames.image_size != lens.intrinsics.image_size:
            raise ValueError(f"The camera is for {lens.intrinsics.image_size} pixels, the frames have {frames.image_size}.")
        self.frames = frames
        self.lens = lens

    @property
    def image_size(self) -> tuple[int, int]:
        """Width, height."""
        return self.frames.image_size

    @property
    def numbers(self) -> Sequence[int]:
        """The frames that take part, increasing."""
        return self.frames.numbers

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, GrayImage]]:
        """The named frames in grey, straight."""
        for number, image in self.frames.gray(numbers):
            yield number, self._resampled(number, image)

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, ColorImage]]:
        """The named frames in RGB, straight."""
        for number, image in self.frames.color(numbers):
            yield number, self._resampled(number, image)

    def _resampled(self, number: int, image: UInt8[np.ndarray, "height width *channels"]) -> UInt8[np.ndarray, "height width *channels"]:
        if self.lens.straight:
            return image
        map_x, map_y = self._lens_map if self.lens.shutter is None else self._shutter_map(number)
        return np.asarray(cv2.remap(image, map_x, map_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))

    @cached_property
    def _lens_map(self) -> tuple[Float[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
        """Where each straight pixel lies in the displayed image, in OpenCV's pixels (its first centre is 0, ours 0.5); the same for all frames."""
        width, height = self.image_size
        return self._map(self.lens, 0, np.arange(width) + 0.5, np.arange(height) + 0.5)

    def _shutter_map(self, number: int) -> tuple[Float[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
        """Likewise for one frame: worked out at every eighth pixel and interpolated, which takes 10 ms instead of half a second."""
        width, height = self.image_size
        columns, rows = (np.arange(-(-size // CELL) + 1) for size in (width, height))
        coarse = self._map(self.lens, number, columns * CELL + 0.5, rows * CELL + 0.5)
        # A stretch of the coarse map by warpAffine puts its nodes exactly on every eighth pixel; resize would shift them by half a cell.
        stretch = np.array([[1 / CELL, 0.0, 0.0], [0.0, 1 / CELL, 0.0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        x, y = (np.asarray(cv2.warpAffine(part, stretch, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)) for part in coarse)
        return x, y

    def _map(
        self, lens: Lens, number: int, columns: Float[np.ndarray, "width"], rows: Float[np.ndarray, "height"]
    ) -> tuple[Float[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
        places = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        xy = lens.to_displayed(number, places) - 0.5
        x, y = xy.reshape(len(rows), len(columns), 2).astype(np.float32).transpose(2, 0, 1)
        return np.ascontiguousarray(x), np.ascontiguousarray(y)
