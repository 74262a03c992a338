"""Damaged and hostile files: every one is read as far as it goes, or refused in words; nothing else may come out."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from planewright.errors import VideoError
from planewright.video.clip import open_clip
from planewright.video.limits import VideoLimits

SEEDS = [
    ("a.mp4", "libx264", "yuv420p"),
    ("a.mp4", "libx265", "yuv420p"),
    ("a.webm", "libvpx-vp9", "yuv420p"),
    ("a.avi", "mjpeg", "yuvj420p"),
    ("a.mov", "mpeg4", "yuv420p"),
    ("a.mkv", "libx264", "yuv420p"),
    ("a.gif", "gif", "gray"),
    ("a.ts", "libx264", "yuv420p"),
]
LIMITS = VideoLimits(max_pixels=4_000_000, max_frames=2_000)


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """One of seven ways to spoil a file."""
    spoilt = bytearray(data)
    length = len(spoilt)
    a, b = sorted(int(place) for place in rng.integers(0, length, 2))
    match int(rng.integers(7)):
        case 0:
            for place in rng.integers(0, length, int(rng.integers(1, 60))):
                spoilt[place] = int(rng.integers(256))
        case 1:
            for place in rng.integers(0, min(length, 2_000), int(rng.integers(1, 12))):
                spoilt[place] ^= 1 << int(rng.integers(8))
        case 2:
            del spoilt[a:]
        case 3:
            del spoilt[a : a + int(rng.integers(1, 400))]
        case 4:
            spoilt[a:a] = rng.integers(0, 256, int(rng.integers(1, 400)), dtype=np.uint8).tobytes()
        case 5:
            spoilt[a : a + 4] = int(rng.choice([0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000])).to_bytes(4, "big")
        case _:
            spoilt[a:b] = spoilt[a:b][::-1]
    return bytes(spoilt)


@pytest.mark.parametrize(("name", "codec", "pix_fmt"), SEEDS)
def test_spoilt_files_are_read_or_refused(write_video: Callable[..., Path], name: str, codec: str, pix_fmt: str) -> None:
    options = {"x265-params": "log-level=none:pools=1:frame-threads=1"} if codec == "libx265" else {}
    path = write_video(name, 12, codec=codec, pix_fmt=pix_fmt, options=options)
    data = path.read_bytes()
    rng = np.random.default_rng(sum(map(ord, name + codec)))
    outcomes = {"read": 0, "refused": 0}
    for _ in range(25):
        path.write_bytes(mutated(data, rng))
        try:
            clip = open_clip(path, limits=LIMITS)
            images = [image for _, image in clip.gray(list(clip.numbers)[-3:])]
            next(clip.color([0]))
        except VideoError as error:
            outcomes["refused"] += 1
            assert 20 < len(str(error)) < 600
            assert "\n" not in str(error)
        else:
            outcomes["read"] += 1
            assert all(image.dtype == np.uint8 and image.shape == clip.image_size[::-1] for image in images)
    assert outcomes["read"] > 0
