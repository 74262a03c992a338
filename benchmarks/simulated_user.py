"""A person who corrects tracks, simulated: how many marks until they would leave a clip alone."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from benchmarks.baselines.sweep import Step, sweep
from benchmarks.corners import CornerErrors, claims, corner_errors
from benchmarks.workloads.workload import ClipFiles
from planewright.arrays import GrayImage
from planewright.corrections import Mark, Session, correct, suggest
from planewright.corrections.session import with_mark
from planewright.errors import PlanewrightError
from planewright.pipeline.corrected import open_session
from planewright.pipeline.run import reconstruct
from planewright.sketch.graph import PointId, Sketch
from planewright.sketch.read import read_sketch
from planewright.video.clip import open_clip

SPOT = 2.0
"""Pixels: a corner whose median error is above this is a bad one."""

Policy = Literal["worst first", "list followed"]
Found = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class UserOptions:
    """What the person wants, and how carefully they click."""

    good: float = 5.0
    """Pixels within which a corner-frame is left alone."""
    share: float = 99.0
    """Percent of the visible corner-frames within `good` at which they stop."""
    click_sigma: float = 1.0
    """Of a click, pixels an axis."""
    patience: int = 20
    """Corrections after which they give up."""
    vain: int = 20
    """Looks in a row at what is right, after which they stop following the list."""
    from_scratch: bool = False
    """Each correction is a new mark in the sketch and a run from the beginning."""


class Corrector(Protocol):
    """What a person corrects. Immutable: `corrected` gives a new one."""

    def found(self) -> Found:
        """point -> frame -> entry, as in `reconstruction.json`."""
        ...

    def corrected(self, mark: Mark) -> "Corrector":
        """After one more mark."""
        ...

    def suggestion(self) -> tuple[str, int] | None:
        """Corner and frame of the mark that is said to be worth most; None where nothing is suggested."""
        ...

    def looked(self, corner: str, frame: int) -> "Corrector":
        """After the person looked there and saw nothing wrong."""
        ...


@dataclass(frozen=True)
class UserRecord:
    """What a simulated person did."""

    corrections: int
    satisfied: bool
    """The clip became good; otherwise they gave up, or nothing that they were shown was wrong."""
    looks: int
    """Corners looked at, those that were right included."""
    within: tuple[float, ...]
    """Percent of corner-frames within `good`, before the first mark and after each."""
    marks: tuple[tuple[str, int, float | None], ...]
    """Corner, frame, and the error there before; None where nothing was claimed."""
    seconds: tuple[float, ...]
    """Of each correction."""
    stopped_by: str | None = None
    """What the program said where it refused a mark."""


def correct_as_user(start: Corrector, truth: Mapping[str, Any], policy: Policy, rng: np.random.Generator, options: UserOptions = UserOptions()) -> UserRecord:
    """Correct until `options.share` of the visible corner-frames are good.

    `worst first` knows the truth and marks the worst corner-frame. `list followed` looks at what the program's own list names first, in the frame that is
    named there. They mark it where it is not good, say so where it is, and stop after `options.vain` looks in a row in vain.
    """
    at, looked = start, 0
    within: list[float] = []
    marks: list[tuple[str, int, float | None]] = []
    seconds: list[float] = []
    refused: str | None = None
    while True:
        errors = corner_errors(at.found(), truth)
        within.append(errors.within(options.good))
        if within[-1] >= options.share or len(marks) >= options.patience:
            break
        row: int | None = None
        if policy == "worst first":
            row = worst(errors)
        else:
            for _ in range(options.vain):
                place = at.suggestion()
                if place is None:
                    break
                looked += 1
                row = wrong_at(errors, *place, options.good)
                if row is not None:
                    break
                at = at.looked(*place)
        if row is None:
            break
        x, y = errors.true_xy[row] + rng.normal(0.0, options.click_sigma, 2)
        mark = Mark(PointId(errors.corner[row]), int(errors.frame[row]), (float(x), float(y)))
        began = time.perf_counter()
        try:
            at = at.corrected(mark)
        except PlanewrightError as error:
            refused = str(error)
            break
        seconds.append(round(time.perf_counter() - began, 3))
        away = float(errors.error[row])
        marks.append((mark.point, mark.frame, round(away, 2) if np.isfinite(away) else None))
    good = within[-1] >= options.share
    return UserRecord(len(marks), good, looked, tuple(round(w, 2) for w in within), tuple(marks), tuple(seconds), refused)


def worst(errors: CornerErrors) -> int:
    """The row with the largest error. Where rows are equally bad (nothing is claimed), that of the corner with most of them, in the middle of its frames."""
    rows = np.flatnonzero(errors.error == errors.error.max())
    ids = np.array(errors.corner)[rows]
    names, counts = np.unique(ids, return_counts=True)
    mine = rows[ids == names[int(counts.argmax())]]
    return int(mine[len(mine) // 2])


def wrong_at(errors: CornerErrors, corner: str, frame: int, good: float = 5.0) -> int | None:
    """The row of a corner in a frame where a person would not leave it alone; None where it is within `good` pixels, or cannot be seen."""
    rows = np.flatnonzero((np.array(errors.corner) == corner) & (errors.frame == frame) & (errors.error > good))
    return int(rows[0]) if len(rows) else None


@dataclass(frozen=True, eq=False)
class Interactive:
    """Corrections as they are made at the screen: what a mark touches is solved again, the rest stays."""

    session: Session

    def found(self) -> Found:
        return claims(self.session.tracks, self.session.sketch)

    def corrected(self, mark: Mark) -> "Interactive":
        return replace(self, session=correct(self.session, mark).session)

    def suggestion(self) -> tuple[str, int] | None:
        found = suggest(self.session, 1)
        return (found[0].point, found[0].frame) if found else None

    def looked(self, corner: str, frame: int) -> "Interactive":
        return replace(self, session=self.session.looked(PointId(corner), frame))


@dataclass(frozen=True, eq=False)
class FromScratch:
    """Each mark goes into the sketch, and everything is found again."""

    clip: Path
    sketch: Sketch
    tracks: Found

    def found(self) -> Found:
        return self.tracks

    def corrected(self, mark: Mark) -> "FromScratch":
        sketch = with_mark(self.sketch, mark)
        return from_scratch(self.clip, sketch)

    def suggestion(self) -> tuple[str, int] | None:
        return None

    def looked(self, corner: str, frame: int) -> "FromScratch":
        del corner, frame
        return self


def from_scratch(clip: Path, sketch: Sketch) -> FromScratch:
    """A first run."""
    result = reconstruct(clip, sketch)
    return FromScratch(clip, sketch, claims(result.tracks, result.scene.sketch))


@dataclass(frozen=True, eq=False)
class Followed:
    """A baseline with marks: each mark is a place from which its point is followed anew."""

    images: Sequence[GrayImage]
    sketch: Sketch
    step: Step
    together: bool = False

    def found(self) -> Found:
        paths = sweep(self.images, self.sketch, self.step, together=self.together)
        return {
            point.id: {str(k): {"xy": xy.tolist(), "state": "tracked"} for k, xy in enumerate(path) if np.isfinite(xy).all()}
            for point, path in zip(self.sketch.points, paths, strict=True)
        }

    def corrected(self, mark: Mark) -> "Followed":
        return replace(self, sketch=with_mark(self.sketch, mark))

    def suggestion(self) -> tuple[str, int] | None:
        return None

    def looked(self, corner: str, frame: int) -> "Followed":
        del corner, frame
        return self


def corrected_by_users(files: ClipFiles, truth: Mapping[str, Any], users: int, options: UserOptions) -> list[dict[str, Any]]:
    """What several people (seeds 0, 1, ...) do with one clip, each by both policies where there is a list to follow."""
    start: Corrector
    if options.from_scratch:
        start = from_scratch(files.clip, read_sketch(files.sketch))
    else:
        clip = open_clip(files.clip)
        start = Interactive(open_session(clip, reconstruct(files.clip, files.sketch)))
    return [dict(_policies(start, truth, seed, options)) for seed in range(users)]


def _policies(start: Corrector, truth: Mapping[str, Any], seed: int, options: UserOptions) -> Iterator[tuple[Policy, dict[str, Any]]]:
    policies: tuple[Policy, ...] = ("worst first",) if options.from_scratch else ("worst first", "list followed")
    for policy in policies:
        yield policy, asdict(correct_as_user(start, truth, policy, np.random.default_rng([seed, *policy.encode()]), options))
