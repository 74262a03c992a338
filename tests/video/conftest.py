"""Clips made on the spot: each frame carries its number as grey bars, so that a frame can be told by looking at it."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from av.video.stream import VideoStream


@pytest.fixture
def numbered() -> Callable[..., np.ndarray]:
    """Makes the RGB picture of a frame: eight vertical bars, bright where the number has a 1, and four corners of different colour."""

    def make(number: int, size: tuple[int, int] = (96, 64)) -> np.ndarray:
        width, height = size
        image = np.full((height, width, 3), 60, dtype=np.uint8)
        for bit in range(8):
            image[height // 4 : 3 * height // 4, bit * width // 8 : (bit + 1) * width // 8] = 210 if number >> bit & 1 else 40
        return image

    return make


@pytest.fixture
def number_in() -> Callable[[np.ndarray], int]:
    """Reads the number back from grey."""

    def read(gray: np.ndarray) -> int:
        height, width = gray.shape
        middle = gray[3 * height // 8 : 5 * height // 8]
        return sum(int(middle[:, bit * width // 8 : (bit + 1) * width // 8].mean() > 125) << bit for bit in range(8))

    return read


@pytest.fixture
def write_video(tmp_path: Path, numbered: Callable[..., np.ndarray]) -> Callable[..., Path]:
    """Writes a clip and gives its path. `images`: RGB pictures (default: numbered ones); `stamps`: time stamps in 1/600 s (default: 30 a second)."""

    def write(
        name: str = "clip.mp4",
        count: int = 20,
        *,
        size: tuple[int, int] = (96, 64),
        images: Sequence[np.ndarray] | None = None,
        stamps: Sequence[int] | None = None,
        codec: str = "libx264",
        pix_fmt: str = "yuv420p",
        options: dict[str, str] | None = None,
        prepare: Callable[[VideoStream], Any] | None = None,
        frame_of: Callable[[int], av.VideoFrame] | None = None,
    ) -> Path:
        path = tmp_path / name
        made = images if images is not None else [numbered(number, size) for number in range(count)]
        with av.open(str(path), "w") as container:
            stream = container.add_stream(codec, rate=30, options={"g": "6", **(options or {})})
            assert isinstance(stream, VideoStream)
            stream.width, stream.height, stream.pix_fmt = made[0].shape[1], made[0].shape[0], pix_fmt
            stream.thread_count = 1
            if stamps is not None:
                stream.codec_context.time_base = Fraction(1, 600)
            if prepare is not None:
                prepare(stream)
            for number, image in enumerate(made):
                frame = av.VideoFrame.from_ndarray(image, format="rgb24") if frame_of is None else frame_of(number)
                if stamps is not None:
                    frame.pts, frame.time_base = stamps[number], Fraction(1, 600)
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        return path

    return write
