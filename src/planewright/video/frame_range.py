"""Which frames of a clip take part: `--frames A:B[:STEP]`."""

import re
from dataclasses import dataclass

from planewright.errors import UsageError


@dataclass(frozen=True)
class FrameRange:
    """Frames start, start + step, ... below stop, as Python slices count them."""

    start: int = 0
    stop: int | None = None
    """First frame that is left out; None: to the end of the clip."""
    step: int = 1

    def __post_init__(self) -> None:
        if self.start < 0 or self.step < 1 or (self.stop is not None and self.stop <= self.start):
            raise UsageError(f"The frame range {self} names no frames. Frames count from 0; write START:STOP or START:STOP:STEP with STOP above START.")

    def __str__(self) -> str:
        stop = "" if self.stop is None else str(self.stop)
        return f"{self.start}:{stop}" + (f":{self.step}" if self.step != 1 else "")

    @staticmethod
    def parse(text: str) -> "FrameRange":
        """The range of "A:B" or "A:B:STEP"; A and B may be left out. Raises UsageError."""
        match = re.fullmatch(r"\s*(\d{0,9}):(\d{0,9})(?::(\d{1,9}))?\s*", text, flags=re.ASCII)
        if match is None:
            shown = text if len(text) <= 40 else text[:37] + "..."
            raise UsageError(f"{shown!r} is not a range of frames. Write START:STOP or START:STOP:STEP, such as 0:200 or 0:200:2; frames count from 0.")
        start, stop, step = match.groups()
        return FrameRange(int(start or 0), int(stop) if stop else None, int(step) if step else 1)

    def of(self, num_frames: int) -> range:
        """The frame numbers of a clip with `num_frames` frames. Raises UsageError where none is left."""
        chosen = range(self.start, num_frames if self.stop is None else min(self.stop, num_frames), self.step)
        if not chosen:
            raise UsageError(f"The range {self} leaves no frame: the clip has {num_frames} (0 to {num_frames - 1}).")
        return chosen
