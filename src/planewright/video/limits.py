"""What a clip may ask of the machine, and which containers and codecs are read at all."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class VideoLimits:
    """A clip beyond a limit is refused before it is decoded, or at the frame that breaks it."""

    max_side: int = 16_384
    """Largest width and height, in pixels."""
    max_pixels: int = 67_108_864
    """Largest number of pixels of one frame."""
    max_frames: int = 216_000
    """Largest number of frames: an hour at 60 frames a second."""
    max_bytes: int = 64 * 1024**3
    """Largest file, in bytes."""
    max_bad_share: float = 0.5
    """Largest share of packets that may fail to decode; a clip beyond it is refused."""
    scan_pixels: float = 4e9
    """Clips with fewer pixels in all (frames x width x height) are decoded once when opened, which tells their frames for certain; of longer
    ones the packet table is believed. 4e9 is 1,900 frames of 1920x1080, about 10 s."""


DEMUXERS = frozenset({"mov", "mp4", "m4a", "3gp", "3g2", "mj2", "matroska", "webm", "avi", "mpegts", "gif"})
"""Containers that hold their own data. Playlists (concat, hls, dash) open other files and addresses: they stay out."""

DECODERS = frozenset(
    {
        "h264",
        "hevc",
        "av1",
        "libdav1d",
        "libaom-av1",
        "vp8",
        "vp9",
        "libvpx",
        "libvpx-vp9",
        "mpeg1video",
        "mpeg2video",
        "mpeg4",
        "mjpeg",
        "h263",
        "prores",
        "dnxhd",
        "cfhd",
        "ffv1",
        "huffyuv",
        "ffvhuff",
        "utvideo",
        "rawvideo",
        "png",
        "gif",
        "qtrle",
        "theora",
        "msmpeg4v2",
        "msmpeg4",
        "wmv2",
        "dvvideo",
    }
)
"""Decoders of what phones, cameras and editors write."""
