"""From a finished run to corrections and back: nothing is measured again to begin with."""

from pathlib import Path

from planewright.corrections.session import Model, Session
from planewright.pipeline.result import Result
from planewright.tracking.follow import CornerOptions
from planewright.video.clip import Clip, open_clip
from planewright.video.frame_range import FrameRange
from planewright.video.kept_frames import KeptFrames
from planewright.video.undistort import UndistortedFrames


def open_session(
    clip: Clip | Path | str, result: Result, corners: CornerOptions = CornerOptions(), *, frames: FrameRange | None = None, max_bytes: int = 400_000_000
) -> Session:
    """The session that corrections of a result start from.

    Args:
        clip: the clip of the run, opened or by its path.
        corners: how corners were located in the run.
        frames: those that took part in the run, where `clip` is a path.
        max_bytes: memory for frames that are kept once they were looked at.

    Raises:
        VideoError: the clip cannot be read.
    """
    opened = clip if isinstance(clip, Clip) else open_clip(clip, frames)
    straight = KeptFrames(UndistortedFrames(opened, result.cameras.lens), max_bytes)
    return Session(straight, result.scene.sketch, result.tracks, Model(result.cameras, result.structure, corners))
