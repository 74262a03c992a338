"""What the steps ask of a clip: some of its frames, in order, one at a time. Nobody holds a whole clip in memory."""

from collections.abc import Iterator, Sequence
from typing import Protocol, runtime_checkable

from planewright.arrays import ColorImage, GrayImage


@runtime_checkable
class Frames(Protocol):
    """Frames by their number in the clip."""

    @property
    def image_size(self) -> tuple[int, int]:
        """Width, height, as displayed."""
        ...

    @property
    def numbers(self) -> Sequence[int]:
        """The frame numbers of the clip that take part, increasing (`--frames A:B:STEP` leaves some out)."""
        ...

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, GrayImage]]:
        """The named frames (increasing numbers), decoded as they are asked for. The image may be kept by the caller."""
        ...

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, ColorImage]]:
        """The same in colour (RGB)."""
        ...
