"""FFmpeg behind one door: a file is opened with little trust, and everything FFmpeg may say comes out as `VideoError` or as damage that is counted."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

import av
from av.container import InputContainer
from av.error import FFmpegError
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream

from planewright.errors import VideoError
from planewright.video.limits import DECODERS, DEMUXERS, VideoLimits

_UNREADABLE = (FFmpegError, OSError, ValueError)
"""What PyAV raises on files that are damaged or no video."""


@dataclass(frozen=True, eq=False)
class Decoded:
    """What one packet gave."""

    frames: list[av.VideoFrame]
    damaged: bool


@dataclass(frozen=True)
class BrokenOff:
    """The file cannot be read beyond this place."""

    reason: str


@contextmanager
def opened_video(path: Path, limits: VideoLimits, *, threads: int, draft: bool = False) -> Generator[tuple[InputContainer, VideoStream]]:
    """The container and its first video stream. Raises VideoError.

    FFmpeg reads through our own handle, so it can open nothing else and any path is legal.

    Args:
        path: the file.
        limits: what is refused.
        threads: decoding threads.
        draft: leave out the loop filter: the same frames, less exact, in 4/5 of the time.
    """
    options = {"protocol_whitelist": "file", "format_whitelist": ",".join(sorted(DEMUXERS)), "codec_whitelist": ",".join(sorted(DECODERS))}
    try:
        handle: IO[bytes] = path.open("rb")
    except OSError as error:
        raise VideoError(f"{path.name} cannot be opened: {error.strerror or error}. Check the path and the rights to read it.") from error
    with handle:
        try:
            container = av.open(handle, mode="r", options=options, metadata_errors="replace")
        except _UNREADABLE as error:
            raise VideoError(
                f"{path.name} is not a video that can be read (mp4, mov, mkv, webm, avi, ts and gif are), or it is damaged at its start: "
                f"{_reason(error)}. Play it in a video player; if it plays, convert it to H.264 in mp4."
            ) from error
        with container:
            stream = _video_stream(path, container)
            context = cast("VideoCodecContext | None", stream.codec_context)
            if context is None or context.name not in DECODERS:
                name = "an unknown codec" if context is None else f"the codec {context.name}"
                raise VideoError(f"{path.name} uses {name}, which is not read. Convert it to H.264 in mp4.")
            context.options = {"max_pixels": str(limits.max_pixels), **({"skip_loop_filter": "all"} if draft else {})}
            context.thread_count = threads
            context.thread_type = "FRAME" if threads > 1 else "NONE"
            yield container, stream


def decoded_packets(container: InputContainer, stream: VideoStream) -> Iterator[Decoded | BrokenOff]:
    """The pictures of each packet from where the container stands; the last item is a `BrokenOff` where the file breaks off."""
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
        except _UNREADABLE as error:
            yield BrokenOff(_reason(error))
            return
        if packet is None:
            return
        try:
            frames = packet.decode()
            yield Decoded(frames, packet.is_corrupt or any(frame.is_corrupt for frame in frames))
        except _UNREADABLE:
            yield Decoded([], True)


def check_picture_size(name: str, size: tuple[int, int], limits: VideoLimits) -> None:
    """Raises VideoError for pictures that are too large to be sane or too small to show anything."""
    width, height = size
    if min(size) < 16:
        raise VideoError(f"{name}: a picture of {width}x{height} pixels shows nothing to follow; 16x16 is the least.")
    if max(size) > limits.max_side or width * height > limits.max_pixels:
        raise VideoError(f"{name}: {width}x{height} pixels are beyond the limit ({limits.max_side} a side, {limits.max_pixels} in all). Scale it down.")


def _video_stream(path: Path, container: InputContainer) -> VideoStream:
    if not DEMUXERS & set(container.format.name.split(",")):
        raise VideoError(f"{path.name} is a {container.format.name} file; mp4, mov, mkv, webm, avi, ts and gif are read. Convert it to one of these.")
    if not container.streams.video:
        kinds = sorted({stream.type or "unknown data" for stream in container.streams})
        instead = f", only {' and '.join(kinds)}" if kinds else ""
        raise VideoError(f"{path.name} holds no pictures{instead}. Choose a file with video in it.")
    # A phone may add a still cover picture as a second stream; the stream that plays longest is the clip.
    return max(container.streams.video, key=lambda stream: (stream.frames, -stream.index))


def _reason(error: Exception) -> str:
    text = str(getattr(error, "strerror", None) or error or type(error).__name__)
    return (text.splitlines() or [type(error).__name__])[0][:200]
