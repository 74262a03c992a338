"""A video file: which frames it holds, and the decoded pictures of some of them.

Frames are numbered in the order in which they are shown, and a frame is found again by its time stamp. Where the stamps or the stream cannot be
trusted (stamps that are missing or do not increase, damage), reading starts at the first frame and counts, which is slower and never wrong.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import cast

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.sidedata.sidedata import SideData, Type
from av.video.stream import VideoStream

from planewright.errors import VideoError
from planewright.progress import Progress
from planewright.video.container import BrokenOff, check_picture_size, decoded_packets, opened_video
from planewright.video.limits import VideoLimits
from planewright.video.pixels import Orientation

_WORTH_A_SEEK = 8
"""A seek costs about as much as decoding this many frames of 960x540."""
_FIXED_RATE = 0.02
"""A clip whose mean rate is this close to the rate in its header has that rate; beyond, its rate varies and the mean is told."""

_CUT_SHORT_SECONDS = 0.5
"""A container's length counts its sound as well, which may go on a little longer than the pictures."""


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
    """Every packet decoded."""
    warnings: tuple[str, ...]


@dataclass(eq=False)
class _Scan:
    """What one pass over the file finds."""

    pts: list[int | None] = field(default_factory=list[int | None])
    keys: list[int] = field(default_factory=list[int])
    size: tuple[int, int] = (0, 0)
    orientation: Orientation = field(default_factory=Orientation)
    packets: int = 0
    damaged: int = 0
    interlaced: int = 0
    broken_off: str | None = None


def scan_video(path: Path, limits: VideoLimits, progress: Progress) -> VideoIndex:
    """The index of a file, found by decoding it once (or, beyond `limits.scan_pixels`, from its packet table). Raises VideoError."""
    with opened_video(path, limits, threads=1, draft=True) as (container, stream):
        context = stream.codec_context
        if context.width and context.height:
            check_picture_size(path.name, (context.width, context.height), limits)
        if stream.frames > limits.max_frames:
            raise VideoError(_too_many(path, limits))
        expected = stream.frames or _expected_frames(container, stream)
        scan = None
        if expected * context.width * context.height > limits.scan_pixels:
            scan = _scan_packets(path, container, stream, limits, progress)
        if scan is not None:
            return _index(path, stream, scan, limits, _promised_seconds(container))
    with opened_video(path, limits, threads=1, draft=True) as (container, stream):
        return _index(path, stream, _scan_frames(path, container, stream, limits, progress), limits, _promised_seconds(container))


def read_video(path: Path, index: VideoIndex, numbers: Sequence[int], limits: VideoLimits) -> Iterator[tuple[int, av.VideoFrame]]:
    """The numbered frames (increasing). Jumps ahead where a key frame lies between. Raises VideoError."""
    if not len(numbers):
        return
    done = 0
    # Frame threads give the same pictures as one thread on an intact stream; on a damaged one the concealment may differ.
    with opened_video(path, limits, threads=2 if index.intact else 1) as (container, stream):
        number_of = {stamp: number for number, stamp in enumerate(index.pts)} if index.keys else None
        position = 0
        while done < len(numbers):
            key = _key_before(index, numbers[done])
            if key > position + _WORTH_A_SEEK:
                stamp = index.pts[key]
                assert stamp is not None
                try:
                    container.seek(stamp, backward=True, any_frame=False, stream=stream)
                except (FFmpegError, OSError):
                    break
            for number, frame in _numbered(container, stream, number_of):
                position = number + 1
                if number > numbers[done]:
                    # The seek landed too late: this container's own index is off.
                    position = -1
                    break
                if number == numbers[done]:
                    yield number, frame
                    done += 1
                    if done == len(numbers):
                        return
                    if _key_before(index, numbers[done]) > number + _WORTH_A_SEEK:
                        break
            else:
                position = -1
            if position < 0:
                break
    with opened_video(path, limits, threads=1) as (container, stream):
        for number, (_, frame) in enumerate(_numbered(container, stream, None)):
            if number == numbers[done]:
                yield number, frame
                done += 1
                if done == len(numbers):
                    return
    raise VideoError(f"{path.name}: frame {numbers[done]} was there when the clip was opened, and is gone. Was the file changed meanwhile? Start again.")


def _numbered(container: InputContainer, stream: VideoStream, number_of: dict[int | None, int] | None) -> Iterator[tuple[int, av.VideoFrame]]:
    """Frames with their numbers, by time stamp or (None) counted; frames that the index does not know are left out."""
    count = 0
    for event in decoded_packets(container, stream):
        if isinstance(event, BrokenOff):
            return
        for frame in event.frames:
            number = count if number_of is None else number_of.get(frame.pts)
            count += 1
            if number is not None:
                yield number, frame


def _key_before(index: VideoIndex, target: int) -> int:
    place = int(np.searchsorted(np.asarray(index.keys, dtype=np.int64), target, side="right")) - 1
    return index.keys[place] if place >= 0 else 0


def _scan_frames(path: Path, container: InputContainer, stream: VideoStream, limits: VideoLimits, progress: Progress) -> _Scan:
    scan = _Scan()
    total = stream.frames or None
    for event in decoded_packets(container, stream):
        if isinstance(event, BrokenOff):
            scan.broken_off = event.reason
            break
        scan.packets += 1
        scan.damaged += event.damaged
        for frame in event.frames:
            number, size = len(scan.pts), (frame.width, frame.height)
            if number >= limits.max_frames:
                raise VideoError(_too_many(path, limits))
            if number == 0:
                check_picture_size(path.name, size, limits)
                scan.size, scan.orientation = size, _orientation(frame, stream)
            if size != scan.size:
                raise VideoError(
                    f"{path.name}: the picture changes from {scan.size[0]}x{scan.size[1]} to {size[0]}x{size[1]} at frame {number} "
                    f"({_clock(frame)}). A clip has one size: cut it there and use one part."
                )
            if frame.key_frame:
                scan.keys.append(number)
            scan.interlaced += frame.interlaced_frame
            scan.pts.append(frame.pts)
            if number % 16 == 0:
                progress("Reading the clip", number, total)
    progress("Reading the clip", len(scan.pts), len(scan.pts))
    return scan


def _scan_packets(path: Path, container: InputContainer, stream: VideoStream, limits: VideoLimits, progress: Progress) -> _Scan | None:
    """The frames by the stamps of their packets; None where packets and frames need not match one to one."""
    if not {"mov", "matroska"} & set(container.format.name.split(",")):
        return None
    scan = _Scan()
    keys: list[int] = []
    try:
        for packet in container.demux(stream):
            if packet.size == 0 or packet.is_discard:
                continue
            if packet.pts is None or packet.is_corrupt:
                return None
            if not scan.size[0]:
                for frame in packet.decode():
                    scan.size, scan.orientation = (frame.width, frame.height), _orientation(frame, stream)
            if packet.is_keyframe:
                keys.append(packet.pts)
            scan.pts.append(packet.pts)
            if len(scan.pts) > limits.max_frames:
                raise VideoError(_too_many(path, limits))
            if len(scan.pts) % 256 == 0:
                progress("Reading the clip", len(scan.pts), stream.frames or None)
    except (FFmpegError, OSError, ValueError):
        return None
    stamps = sorted(cast("list[int]", scan.pts))
    if not scan.size[0] or len(set(stamps)) != len(stamps):
        return None
    number_of = {stamp: number for number, stamp in enumerate(stamps)}
    scan.pts, scan.keys, scan.packets = list(stamps), sorted(number_of[stamp] for stamp in keys), len(stamps)
    check_picture_size(path.name, scan.size, limits)
    return scan


def _index(path: Path, stream: VideoStream, scan: _Scan, limits: VideoLimits, promised: float) -> VideoIndex:
    count = len(scan.pts)
    if not count:
        because = f" ({scan.broken_off})" if scan.broken_off else ""
        raise VideoError(f"{path.name}: not one frame could be decoded{because}. The file is empty or damaged; copy it again from its source.")
    share = scan.damaged / max(scan.packets, 1)
    if share > limits.max_bad_share:
        raise VideoError(f"{path.name}: {scan.damaged} of {scan.packets} packets are damaged; too little is left. Copy the file again from its source.")
    stamps = [stamp for stamp in scan.pts if stamp is not None]
    ordered = len(stamps) == count and all(a < b for a, b in pairwise(stamps))
    seconds, fps = _times(stamps if ordered else None, count, stream)
    warnings: list[str] = []
    if scan.broken_off:
        warnings.append(f"The file breaks off after {count} frames ({scan.broken_off}); those are used.")
    elif stream.frames > 1.02 * count + 1:
        warnings.append(f"The file promises {stream.frames} frames; {count} could be decoded and are used. It may be cut short.")
    elif not stream.frames and promised > seconds[-1] + 1 / fps + max(_CUT_SHORT_SECONDS, 0.05 * promised):
        warnings.append(f"The file promises {promised:.1f} seconds; its pictures end after {seconds[-1]:.1f} and are used so far. It may be cut short.")
    if scan.damaged:
        how_much = "More than 5 % of the clip is" if share > 0.05 else "Parts of the clip are"
        warnings.append(f"{how_much} damaged: {scan.damaged} of {scan.packets} packets. Pictures there may repeat or show blocks.")
    if scan.interlaced:
        warnings.append(f"{scan.interlaced} frames are interlaced: edges that move are torn into combs. Deinterlace the clip for better tracks.")
    if not ordered:
        warnings.append(f"The time stamps do not increase; {fps:g} frames a second are assumed.")
    intact = not scan.damaged and scan.broken_off is None
    seekable = ordered and intact and scan.keys[:1] == [0]
    return VideoIndex(tuple(scan.pts), seconds, tuple(scan.keys) if seekable else (), fps, scan.size, scan.orientation, intact, tuple(warnings))


def _times(stamps: list[int] | None, count: int, stream: VideoStream) -> tuple[tuple[float, ...], float]:
    nominal = float(stream.average_rate or stream.guessed_rate or 0)
    nominal = nominal if 0.01 <= nominal <= 1000 else 0.0
    if stamps is None or not stream.time_base:
        fps = nominal or 30.0
        return tuple(number / fps for number in range(count)), fps
    seconds = tuple(float((stamp - stamps[0]) * stream.time_base) for stamp in stamps)
    measured = (count - 1) / seconds[-1] if count > 1 else 0.0
    fps = nominal if nominal and (not measured or abs(measured / nominal - 1) < _FIXED_RATE) else measured or 30.0
    return seconds, fps


def _orientation(frame: av.VideoFrame, stream: VideoStream) -> Orientation:
    """From the display matrix (nearest quarter turn; a mirror where its determinant is negative) and the shape of the pixels."""
    ratio = float(stream.sample_aspect_ratio or 1)
    scale = ratio if 0.25 <= ratio <= 4 else 1.0
    side_data = cast("list[SideData]", list(frame.side_data))
    matrices = [bytes(data) for data in side_data if data.type == Type.DISPLAYMATRIX]  # pyright: ignore[reportArgumentType]
    if not matrices or len(matrices[0]) < 36:
        return Orientation(width_scale=scale)
    # A stored (x, y) is displayed at (a x + c y, b x + d y), y down.
    a, b, _, c, d = np.frombuffer(matrices[0], dtype=np.int32)[:5].astype(np.float64)
    mirrored = bool(a * d - b * c < 0)
    if mirrored:
        a, b = -a, -b
    return Orientation(int(np.rint(-np.arctan2(b, a) / (np.pi / 2))) % 4, mirrored, scale)


def _promised_seconds(container: InputContainer) -> float:
    return max(0.0, (container.duration or 0) / av.time_base)


def _expected_frames(container: InputContainer, stream: VideoStream) -> float:
    return _promised_seconds(container) * float(stream.average_rate or 0)


def _clock(frame: av.VideoFrame) -> str:
    return "time unknown" if frame.pts is None else f"{frame.time:.2f} s"


def _too_many(path: Path, limits: VideoLimits) -> str:
    return f"{path.name} has more than {limits.max_frames} frames, the limit. Cut it to the part that shows the scene."
