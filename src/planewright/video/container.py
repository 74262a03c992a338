"""A video file: which frames it holds, and the decoded pictures of some of them. Everything that FFmpeg may say is turned into `VideoError`."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

import av
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream

from planewright.errors import VideoError
from planewright.progress import Progress
from planewright.video.limits import DECODERS, DEMUXERS, VideoLimits
from planewright.video.pixels import Orientation

_WORTH_A_SEEK = 8
"""A seek opens the file anew and costs about as much as decoding this many frames of 960x540."""


@dataclass(frozen=True, eq=False)
class VideoIndex:
    """The frames of a video file in presentation order."""

    pts: tuple[int | None, ...]
    """Time stamps in units of the stream."""
    seconds: tuple[float, ...]
    """Since the first frame."""
    keys: tuple[int, ...]
    """Numbers of the frames at which decoding can start, increasing; empty where only reading from the start is exact."""
    fps: float
    stored_size: tuple[int, int]
    orientation: Orientation
    intact: bool
    """Nothing failed to decode."""
    warnings: tuple[str, ...]


def scan_video(path: Path, limits: VideoLimits, progress: Progress) -> VideoIndex:
    """The index of a file, found by decoding it once (or, beyond `limits.scan_pixels`, from its packet table). Raises VideoError."""
    with _opened(path, limits, threads=1, draft=True) as (container, stream):
        _check_header(path, stream, limits)
        size = (stream.codec_context.width, stream.codec_context.height)
        pts: list[int | None] = []
        keys: list[int] = []
        orientation: Orientation | None = None
        packets = bad = odd_size = interlaced = 0
        trouble: str | None = None
        frames = _decoded(container, stream)
        for event in frames:
            if isinstance(event, _Trouble):
                trouble = event.reason
                break
            packets += 1
            bad += event.failed
            for frame in event.frames:
                if len(pts) >= limits.max_frames:
                    raise VideoError(f"{path.name} has more than {limits.max_frames} frames, the limit. Cut it, for example to the part that shows the scene.")
                if not pts:
                    size = (frame.width, frame.height)
                    _check_size(path, size, limits)
                    orientation = _orientation(frame, stream)
                odd_size += (frame.width, frame.height) != size
                if odd_size:
                    raise VideoError(
                        f"{path.name}: the picture changes from {size[0]}x{size[1]} to {frame.width}x{frame.height} at frame {len(pts)}. "
                        f"A clip has one size: cut it there, or take the frames before it with --frames 0:{len(pts)} after cutting."
                    )
                if frame.key_frame:
                    keys.append(len(pts))
                bad += frame.is_corrupt
                interlaced += frame.interlaced_frame
                pts.append(frame.pts)
                if len(pts) % 16 == 0:
                    progress("Reading the clip", len(pts), stream.frames or None)
        return _indexed(path, stream, limits, pts, keys, size, orientation or Orientation(), packets, bad, interlaced, trouble)


def read_video(path: Path, index: VideoIndex, numbers: Sequence[int], limits: VideoLimits) -> Iterator[tuple[int, av.VideoFrame]]:
    """The numbered frames (increasing). Jumps ahead where a key frame lies between. Raises VideoError."""
    wanted = iter(numbers)
    target = next(wanted, None)
    if target is None:
        return
    # Frame threads give the same pictures as one thread on an intact stream; on a damaged one the concealment may differ.
    with _opened(path, limits, threads=2 if index.intact else 1, draft=False) as (container, stream):
        number_of = {stamp: number for number, stamp in enumerate(index.pts)} if index.keys else {}
        while target is not None:
            position = _jump(container, stream, index, target)
            for event in _decoded(container, stream):
                if isinstance(event, _Trouble):
                    break
                jump = False
                for frame in event.frames:
                    number = position if not index.keys else number_of.get(frame.pts, -1)
                    position += 1
                    if number != target:
                        if number > target:
                            raise VideoError(_changed(path, target))
                        continue
                    yield target, frame
                    target = next(wanted, None)
                    if target is None:
                        return
                    if _key_before(index, target) > number + _WORTH_A_SEEK:
                        jump = True
                        break
                if jump:
                    break
            else:
                raise VideoError(_changed(path, target))


@dataclass(frozen=True, eq=False)
class _Decoded:
    frames: list[av.VideoFrame]
    failed: bool


@dataclass(frozen=True)
class _Trouble:
    reason: str


@contextmanager
def _opened(path: Path, limits: VideoLimits, threads: int, draft: bool) -> Iterator[tuple[InputContainer, VideoStream]]:
    """The file's container and its first video stream. FFmpeg reads through our own handle: it can open nothing else, and any path is legal."""
    options = {"protocol_whitelist": "file", "format_whitelist": ",".join(sorted(DEMUXERS)), "codec_whitelist": ",".join(sorted(DECODERS))}
    try:
        handle: IO[bytes] = path.open("rb")
    except OSError as error:
        raise VideoError(f"{path.name} cannot be opened: {error.strerror or error}. Check the path and the rights to read it.") from error
    with handle:
        try:
            container = cast(InputContainer, av.open(handle, mode="r", options=options, metadata_errors="replace"))
        except (av.FFmpegError, OSError, ValueError) as error:
            raise VideoError(
                f"{path.name} is not a video that can be read (mp4, mov, mkv, webm, avi, ts and gif are), or it is damaged at its start: "
                f"{_reason(error)}. Play it in a video player; convert it to H.264 in mp4 if it plays."
            ) from error
        with container:
            if not DEMUXERS & set(container.format.name.split(",")):
                raise VideoError(f"{path.name} is a {container.format.name} file; mp4, mov, mkv, webm, avi, ts and gif are read. Convert it to one of these.")
            if not container.streams.video:
                raise VideoError(f"{path.name} holds no pictures, only {_other_streams(container)}. Choose a file with video in it.")
            stream = container.streams.video[0]
            context = cast("av.VideoCodecContext | None", stream.codec_context)
            if context is None or context.name not in DECODERS:
                name = "an unknown codec" if context is None else f"the codec {context.name}"
                raise VideoError(f"{path.name} uses {name}, which is not read. Convert it to H.264 in mp4.")
            context.options = {"max_pixels": str(limits.max_pixels), **({"skip_loop_filter": "all"} if draft else {})}
            context.thread_count = threads
            context.thread_type = "FRAME" if threads > 1 else "NONE"
            yield container, stream


def _decoded(container: InputContainer, stream: VideoStream) -> Iterator[_Decoded | _Trouble]:
    """What each packet gives; ends with a `_Trouble` where the file itself breaks off."""
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
        except (av.FFmpegError, OSError, ValueError) as error:
            yield _Trouble(_reason(error))
            return
        if packet is None:
            return
        try:
            yield _Decoded(cast("list[av.VideoFrame]", packet.decode()), packet.is_corrupt)
        except (av.FFmpegError, OSError, ValueError):
            yield _Decoded([], True)


def _jump(container: InputContainer, stream: VideoStream, index: VideoIndex, target: int) -> int:
    """Move to the last key frame at or before the target; the number of the next frame (0 without an index)."""
    key = _key_before(index, target)
    if not index.keys:
        return 0
    stamp = index.pts[key]
    assert stamp is not None
    container.seek(stamp, backward=True, any_frame=False, stream=stream)
    return key


def _key_before(index: VideoIndex, target: int) -> int:
    place = int(np.searchsorted(index.keys, target, side="right")) - 1
    return index.keys[place] if place >= 0 else 0


def _indexed(
    path: Path,
    stream: VideoStream,
    limits: VideoLimits,
    pts: list[int | None],
    keys: list[int],
    size: tuple[int, int],
    orientation: Orientation,
    packets: int,
    bad: int,
    interlaced: int,
    trouble: str | None,
) -> VideoIndex:
    if not pts:
        raise VideoError(
            f"{path.name}: not one frame could be decoded{f' ({trouble})' if trouble else ''}. The file is empty or damaged; copy it again from its source."
        )
    share = bad / max(packets, 1)
    if share > limits.max_bad_share:
        raise VideoError(f"{path.name}: {bad} of {packets} packets are damaged; too little is left. Copy the file again from its source.")
    warnings: list[str] = []
    if trouble:
        warnings.append(f"The file breaks off after {len(pts)} frames ({trouble}); those are used.")
    elif stream.frames > len(pts) and stream.frames - len(pts) > 0.05 * stream.frames:
        warnings.append(f"The file promises {stream.frames} frames; {len(pts)} could be decoded. It may be cut short.")
    if bad:
        some = "More than 5 % of" if share > 0.05 else "Some of"
        warnings.append(f"{some} the clip is damaged: {bad} of {packets} packets. Frames there may repeat or show blocks.")
    if interlaced:
        warnings.append(f"{interlaced} frames are interlaced; moving edges are torn into combs there. Deinterlace the clip for better tracks.")
    ordered = all(a is not None for a in pts) and all(a < b for a, b in zip(pts, pts[1:], strict=False))  # pyright: ignore[reportOperatorIssue, reportUnknownArgumentType, reportUnknownVariableType]
    seconds, fps = _times(cast("list[int]", pts) if ordered else None, len(pts), stream)
    if not ordered:
        warnings.append(f"The time stamps do not increase; {fps:g} frames a second are assumed.")
    intact = not bad and trouble is None
    seekable = ordered and intact and bool(keys) and keys[0] == 0
    return VideoIndex(tuple(pts), seconds, tuple(keys) if seekable else (), fps, size, orientation, intact, tuple(warnings))


def _times(pts: list[int] | None, count: int, stream: VideoStream) -> tuple[tuple[float, ...], float]:
    nominal = float(stream.average_rate or stream.guessed_rate or 0)
    if not 0.01 <= nominal <= 1000:
        nominal = 0.0
    if pts is None or stream.time_base is None:
        fps = nominal or 30.0
        return tuple(number / fps for number in range(count)), fps
    base = float(stream.time_base)
    seconds = tuple((stamp - pts[0]) * base for stamp in pts)
    measured = (count - 1) / seconds[-1] if count > 1 and seconds[-1] > 0 else 0.0
    # The header's rate is exact where the clip has a fixed rate; 2 % tells it from a variable one.
    fps = nominal if nominal and (not measured or abs(measured / nominal - 1) < 0.02) else measured or 30.0
    return seconds, fps


def _orientation(frame: av.VideoFrame, stream: VideoStream) -> Orientation:
    """From the display matrix (nearest quarter turn; a mirror where its determinant is negative) and the shape of the pixels."""
    ratio = stream.sample_aspect_ratio
    scale = float(ratio) if ratio and 0.25 <= float(ratio) <= 4 else 1.0
    side = next((data for data in frame.side_data if data.type.name == "DISPLAYMATRIX"), None)
    if side is None:
        return Orientation(width_scale=scale)
    a, b, _, c, d = np.frombuffer(bytes(side), dtype=np.int32)[:5].astype(np.float64)
    mirrored = a * d - b * c < 0
    # The matrix maps a stored (x, y) to a displayed (a x + c y, b x + d y), y down. A mirror is taken off first: it flips the first column.
    turn = -np.arctan2(-b if mirrored else b, -a if mirrored else a)
    return Orientation(int(np.rint(turn / (np.pi / 2))) % 4, bool(mirrored), scale)


def _check_header(path: Path, stream: VideoStream, limits: VideoLimits) -> None:
    context = stream.codec_context
    if context.width and context.height:
        _check_size(path, (context.width, context.height), limits)
    if stream.frames > limits.max_frames:
        raise VideoError(f"{path.name} says it has {stream.frames} frames; the limit is {limits.max_frames}. Cut it to the part that shows the scene.")


def _check_size(path: Path, size: tuple[int, int], limits: VideoLimits) -> None:
    width, height = size
    if width < 16 or height < 16:
        raise VideoError(f"{path.name}: a picture of {width}x{height} pixels shows nothing to follow; 16x16 is the least.")
    if max(size) > limits.max_side or width * height > limits.max_pixels:
        raise VideoError(
            f"{path.name}: {width}x{height} pixels are beyond the limit ({limits.max_side} a side, {limits.max_pixels} in all). Scale the clip down."
        )


def _other_streams(container: InputContainer) -> str:
    kinds = sorted({stream.type or "unknown data" for stream in container.streams})
    return " and ".join(kinds) or "nothing"


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error or type(error).__name__).splitlines()[0][:200]


def _changed(path: Path, number: int) -> str:
    return f"{path.name}: frame {number} could be read when the clip was opened, and no longer. Was the file changed meanwhile? Start again."
