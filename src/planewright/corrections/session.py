"""What a correction starts from and ends in: the drawing, the tracks, and the model where there is one."""

from dataclasses import dataclass, field, replace

import numpy as np

from planewright.arrays import Float
from planewright.errors import UsageError
from planewright.refine.rounds import Structure
from planewright.sfm.cameras import Cameras
from planewright.sketch.graph import PointId, Sketch
from planewright.tracking.follow import CornerOptions
from planewright.tracking.tracks import State, Tracks
from planewright.video.frames import Frames


@dataclass(frozen=True)
class Mark:
    """A person says where a point is in a frame."""

    point: PointId
    frame: int
    xy: tuple[float, float]
    """Pixels of the frame as displayed."""


@dataclass(frozen=True)
class Look:
    """A person looked at a point in a frame and saw nothing wrong there."""

    point: PointId
    frame: int
    xy: tuple[float, float] | None
    """Where the track had it then, as displayed; None where it was said to be hidden, or nothing was said."""


@dataclass(frozen=True, eq=False)
class Model:
    """What was found in space."""

    cameras: Cameras
    structure: Structure
    """Its sketch has its marks in the frames as displayed, corrections included."""
    corners: CornerOptions = field(default_factory=CornerOptions)
    """How corners are located in every frame; those of the run, so that what a correction does not touch comes out as it was."""


@dataclass(frozen=True, eq=False)
class Session:
    """The state between corrections. Immutable: a correction makes a new one, and undo is the previous one."""

    frames: Frames
    """Without lens distortion where there is a model, as displayed otherwise; best kept in memory (`video.kept_frames`)."""
    sketch: Sketch
    """With its faces and all marks, as displayed."""
    tracks: Tracks
    model: Model | None
    """None where the tracks come from the images alone."""
    marks: tuple[Mark, ...] = ()
    """The corrections made so far, in their order."""
    looks: tuple[Look, ...] = ()
    """Where a person looked and saw nothing wrong, in their order."""
    overruled: tuple[PointId, ...] = ()
    """Corners that were wrongly found to lie on faces of which they were not drawn a corner, as marks told."""

    def row(self, point: PointId) -> int:
        """The sketch's row of a point. Raises UsageError."""
        for i, candidate in enumerate(self.sketch.points):
            if candidate.id == point:
                return i
        raise UsageError(f"The sketch has no point {point}. Its points are {', '.join(p.id for p in self.sketch.points[:20])}.")

    def looked(self, point: PointId, frame: int) -> "Session":
        """After a person looked at a point in a frame and saw nothing wrong: it is asked for later than before. Raises UsageError."""
        here = np.flatnonzero((self.tracks.point_index == self.row(point)) & (self.tracks.frame == frame))
        shown = len(here) > 0 and self.tracks.state[here[0]] != int(State.HIDDEN)
        xy = (float(self.tracks.xy[here[0], 0]), float(self.tracks.xy[here[0], 1])) if shown else None
        return replace(self, looks=(*self.looks, Look(point, frame, xy)))

    def straight(self, frame: int, xy: tuple[float, float]) -> Float[np.ndarray, "2"]:
        """A displayed position in the pixels of `frames`."""
        place = np.array([xy], dtype=np.float64)
        return place[0] if self.model is None else self.model.cameras.lens.to_straight(frame, place)[0]


def with_mark(sketch: Sketch, mark: Mark) -> Sketch:
    """The sketch with one more mark; a mark of the same point in the same frame is replaced, and spans in which it was said to be hidden part there."""
    points = tuple(
        replace(
            point,
            marks=dict(sorted({**point.marks, mark.frame: mark.xy}.items())),
            hidden=tuple(part for span in point.hidden for part in _without(span, mark.frame)),
        )
        if point.id == mark.point
        else point
        for point in sketch.points
    )
    return replace(sketch, points=points)


def _without(span: tuple[int, int], frame: int) -> list[tuple[int, int]]:
    first, last = span
    if not first <= frame <= last:
        return [span]
    return [part for part in ((first, frame - 1), (frame + 1, last)) if part[0] <= part[1]]
