"""Where the views set no cameras: the corners followed in the image alone, so that a clip from a tripod still gives tracks."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planewright.corrections.session import Session
from planewright.pipeline.result import clip_entry, track_entries
from planewright.pipeline.stages import StageOptions, checked_sketch
from planewright.progress import Progress, silent
from planewright.registration.corners import CornerTrackOptions, corner_tracks
from planewright.registration.follow import follow_faces
from planewright.registration.registered import Registered
from planewright.sketch.graph import Sketch
from planewright.tracking.tracks import State, Tracks
from planewright.video.clip import Clip, ClipInfo, open_clip
from planewright.video.frame_range import FrameRange
from planewright.video.kept_frames import KeptFrames

TRACKS_FILE = "tracks.json"
"""Not `reconstruction.json`: a folder that holds that one holds a finished result, with cameras and planes."""


@dataclass(frozen=True, eq=False)
class ImageTracks:
    """Corners of a clip without cameras."""

    clip: ClipInfo
    sketch: Sketch
    """With its faces."""
    tracks: Tracks


def follow_in_image(
    clip: Clip | Path | str, sketch: Sketch, options: StageOptions = StageOptions(), *, frames: FrameRange | None = None, progress: Progress = silent
) -> ImageTracks:
    """Corner tracks for which no camera is needed: every drawn face is followed as a whole (`registration`).

    Args:
        clip: opened, or by its path.
        frames: those that take part, where `clip` is a path.

    Raises:
        VideoError, SketchError: the clip or the sketch cannot be used.
        Cancelled: `progress` said so.
    """
    opened = clip if isinstance(clip, Clip) else open_clip(clip, frames)
    drawing = checked_sketch(sketch, opened.info, opened.numbers)[0]
    registered = follow_faces(KeptFrames(opened), drawing, options.faces, progress=progress)
    return ImageTracks(opened.info, drawing, tracks_in_image(registered, drawing, opened.numbers))


def tracks_in_image(registered: Registered, sketch: Sketch, numbers: Sequence[int], options: CornerTrackOptions = CornerTrackOptions()) -> Tracks:
    """The corners of followed faces, and of the other points what the person marked: a track to begin corrections with.

    Args:
        numbers: the frames that take part.
    """
    tracks = corner_tracks(registered, sketch, options)
    followed = set(tracks.point_index.tolist())
    taking_part = set(numbers)
    marks = [(i, frame, xy) for i, point in enumerate(sketch.points) if i not in followed for frame, xy in sorted(point.marks.items()) if frame in taking_part]
    count = len(marks)
    index = np.concatenate([tracks.point_index, np.array([i for i, _, _ in marks], dtype=np.int64)])
    frame = np.concatenate([tracks.frame, np.array([k for _, k, _ in marks], dtype=np.int64)])
    order = np.lexsort((frame, index))
    return Tracks(
        index[order],
        frame[order],
        np.concatenate([tracks.xy, np.array([xy for _, _, xy in marks], dtype=np.float64).reshape(count, 2)])[order],
        np.concatenate([tracks.covariance, np.tile(options.click_sigma**2 * np.eye(2), (count, 1, 1))])[order],
        np.concatenate([tracks.state, np.full(count, int(State.MARKED))])[order],
    )


def open_image_session(clip: Clip | Path | str, found: ImageTracks, *, frames: FrameRange | None = None, max_bytes: int = 400_000_000) -> Session:
    """The session that corrections of such tracks start from. Raises VideoError."""
    opened = clip if isinstance(clip, Clip) else open_clip(clip, frames)
    return Session(KeptFrames(opened, max_bytes), found.sketch, found.tracks, None)


def tracks_document(found: ImageTracks, reason: str) -> dict[str, Any]:
    """The content of `tracks.json` (docs/file-format.md).

    Args:
        reason: why there are no cameras.
    """
    return {
        "format": "planewright-tracks",
        "version": 1,
        "clip": clip_entry(found.clip),
        "tracks": track_entries(found.tracks, found.sketch),
        "report": {"warnings": [reason]},
    }


def told(found: ImageTracks) -> str | None:
    """What there is instead of a model, for the person; None where nothing was followed."""
    measured = np.isin(found.tracks.state, (State.TRACKED, State.MARKED))
    frames = np.bincount(found.tracks.point_index[measured], minlength=len(found.sketch.points))
    followed = int((frames > 1).sum())
    if followed == 0:
        return None
    corners = "corner was" if followed == 1 else "corners were"
    return f"{followed} {corners} followed in the image alone all the same; their tracks are in {TRACKS_FILE}."
