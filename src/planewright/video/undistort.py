"""Frames as a camera without lens distortion would have seen them."""

from collections.abc import Iterator, Sequence
from functools import cached_property

import cv2
import numpy as np

from planewright.arrays import ColorImage, Float, GrayImage, UInt8
from planewright.geometry.camera import Intrinsics
from planewright.video.frames import Frames


class UndistortedFrames:
    """The frames of another source, resampled (bicubic) to `intrinsics.pinhole()`; the same images where there is no distortion.

    Borders repeat the outermost pixels where the lens did not look.
    """

    def __init__(self, frames: Frames, intrinsics: Intrinsics) -> None:
        if frames.image_size != intrinsics.image_size:
            raise ValueError(f"The camera is for {intrinsics.image_size} pixels, the frames have {frames.image_size}.")
        self.frames = frames
        self.intrinsics = intrinsics

    @property
    def image_size(self) -> tuple[int, int]:
        """Width, height."""
        return self.frames.image_size

    @property
    def numbers(self) -> Sequence[int]:
        """The frames that take part, increasing."""
        return self.frames.numbers

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, GrayImage]]:
        """The named frames in grey, undistorted."""
        for number, image in self.frames.gray(numbers):
            yield number, self._resampled(image)

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, ColorImage]]:
        """The named frames in RGB, undistorted."""
        for number, image in self.frames.color(numbers):
            yield number, self._resampled(image)

    def _resampled(self, image: UInt8[np.ndarray, "height width *channels"]) -> UInt8[np.ndarray, "height width *channels"]:
        if not any(self.intrinsics.distortion):
            return image
        map_x, map_y = self._source_positions
        return np.asarray(cv2.remap(image, map_x, map_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))

    @cached_property
    def _source_positions(self) -> tuple[Float[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
        """Where each undistorted pixel lies in the distorted image, in OpenCV's pixels (its first centre is 0, ours 0.5)."""
        width, height = self.image_size
        centres = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1).reshape(-1, 2)
        xy = self.intrinsics.to_pixels(self.intrinsics.pinhole().normalize(centres)) - 0.5
        x, y = xy.reshape(height, width, 2).astype(np.float32).transpose(2, 0, 1)
        return np.ascontiguousarray(x), np.ascontiguousarray(y)
