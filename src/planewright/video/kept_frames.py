"""Grey frames kept in memory, so that looking at them again does not decode them again."""

from collections.abc import Iterator, Sequence

from planewright.arrays import ColorImage, GrayImage
from planewright.video.frames import Frames


class KeptFrames:
    """The frames of another source (the `Frames` protocol). Each grey frame is kept when it is first asked for, as long as there is room.

    300 frames of 960x540 take 156 MB; decoding them again takes half a second, looking at them in memory nothing.
    """

    def __init__(self, frames: Frames, max_bytes: int = 400_000_000) -> None:
        self.frames = frames
        self.max_bytes = max_bytes
        self._kept: dict[int, GrayImage] = {}
        self._bytes = 0

    @property
    def image_size(self) -> tuple[int, int]:
        """Width, height."""
        return self.frames.image_size

    @property
    def numbers(self) -> Sequence[int]:
        """The frames that take part, increasing."""
        return self.frames.numbers

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, GrayImage]]:
        """The named frames in grey. Do not write into them: they are shared."""
        missing = [number for number in numbers if number not in self._kept]
        decoded = self.frames.gray(missing)
        for number in numbers:
            image = self._kept.get(number)
            if image is None:
                found, image = next(decoded)
                assert found == number
                if self._bytes + image.nbytes <= self.max_bytes:
                    self._kept[number] = image
                    self._bytes += image.nbytes
            yield number, image

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, ColorImage]]:
        """The named frames in colour; these are not kept."""
        return self.frames.color(numbers)
