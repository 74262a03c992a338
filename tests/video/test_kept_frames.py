"""Kept frames are the same frames, decoded once while there is room."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.testing import assert_array_equal

from planewright.video.frames import Frames
from planewright.video.kept_frames import KeptFrames


@dataclass
class Counted:
    """Frames that say how often they were asked for."""

    asked: list[int] = field(default_factory=list)

    @property
    def image_size(self) -> tuple[int, int]:
        return (8, 6)

    @property
    def numbers(self) -> Sequence[int]:
        return range(10)

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for number in numbers:
            self.asked.append(number)
            yield number, np.full((6, 8), number, np.uint8)

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for number in numbers:
            yield number, np.full((6, 8, 3), number, np.uint8)


def test_each_frame_is_decoded_once_and_comes_in_order() -> None:
    source = Counted()
    kept = KeptFrames(source)
    assert isinstance(kept, Frames)
    list(kept.gray([2, 5]))
    for number, image in kept.gray([1, 2, 3, 5, 7]):
        assert_array_equal(image, np.full((6, 8), number))
    assert source.asked == [2, 5, 1, 3, 7]


def test_what_finds_no_room_is_decoded_again() -> None:
    source = Counted()
    kept = KeptFrames(source, max_bytes=2 * 48)
    for _ in range(2):
        assert [(number, int(image[0, 0])) for number, image in kept.gray([0, 1, 2, 3])] == [(k, k) for k in range(4)]
    assert source.asked == [0, 1, 2, 3, 2, 3]
