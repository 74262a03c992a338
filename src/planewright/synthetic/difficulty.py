"""How hard a clip is: the share of visible corner-frames that plain pyramidal Lucas-Kanade keeps."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from planewright.arrays import Bool, Float, GrayImage
from planewright.sketch.graph import Sketch
from planewright.video.frames import Frames


@dataclass(frozen=True)
class Difficulty:
    """What single corners reach when they are followed from their marks, in percent of all visible corner-frames."""

    within_2px_pct: float
    within_5px_pct: float
    visible: int
    """Visible corner-frames."""


@dataclass(frozen=True, kw_only=True)
class FollowOptions:
    """Pyramidal Lucas-Kanade as the textbook has it (Bouguet 2001)."""

    window: int = 21
    """Side of the window, pixels."""
    levels: int = 3
    """Pyramid levels above the image."""


def follow_corners(
    frames: Iterable[tuple[int, GrayImage]], marks: Mapping[int, tuple[int, tuple[float, float]]], num_frames: int, options: FollowOptions = FollowOptions()
) -> dict[int, Float[np.ndarray, "frames 2"]]:
    """Each marked corner followed from its mark to both ends of the clip, with no check and no restart.

    frames: all frames in order. marks: point -> (frame, pixels). Returns pixels in every frame, NaN once a corner is lost or has left the image.
    The frames are kept in memory, in grey: meant for short clips.
    """
    images = [image for _, image in frames]
    found = {p: np.full((num_frames, 2), np.nan) for p in marks}
    for p, (frame, xy) in marks.items():
        found[p][frame] = xy
    for way in (1, -1):
        order = range(num_frames - 1) if way == 1 else range(num_frames - 1, 0, -1)
        for k in order:
            moving = [p for p, (frame, _) in marks.items() if (k - frame) * way >= 0 and np.isfinite(found[p][k, 0])]
            if not moving:
                continue
            start = np.array([found[p][k] for p in moving], np.float32)[:, None] - np.float32(0.5)  # OpenCV puts (0, 0) at the centre of the first pixel
            side = (options.window, options.window)
            stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01)
            end, status, _ = cv2.calcOpticalFlowPyrLK(
                images[k], images[k + way], start, np.empty_like(start), winSize=side, maxLevel=options.levels, criteria=stop
            )
            for p, xy, good in zip(moving, end.reshape(-1, 2), status.ravel(), strict=True):
                if good:
                    found[p][k + way] = xy + 0.5
    return found


def clicked(sketch: Sketch, order: Sequence[str]) -> dict[int, tuple[int, tuple[float, float]]]:
    """The first mark of each point of a sketch, by its row in `order` (ids)."""
    row = {k: i for i, k in enumerate(order)}
    return {row[p.id]: min(p.marks.items()) for p in sketch.points if p.id in row and p.marks}


def difficulty(
    frames: Iterable[tuple[int, GrayImage]],
    marks: Mapping[int, tuple[int, tuple[float, float]]],
    xy: Float[np.ndarray, "points frames 2"],
    visible: Bool[np.ndarray, "points frames"],
    options: FollowOptions = FollowOptions(),
) -> Difficulty:
    """What Lucas-Kanade on the marked corners keeps, against the true pixels; unmarked corners and lost ones count as misses."""
    found = follow_corners(frames, marks, xy.shape[1], options)
    total = max(int(visible.sum()), 1)
    error = np.full(visible.shape, np.inf)
    for p, path in found.items():
        away = np.linalg.norm(path - xy[p], axis=1)
        error[p] = np.where(np.isfinite(away), away, np.inf)
    share = [100.0 * float((error[visible] <= limit).sum()) / total for limit in (2.0, 5.0)]
    return Difficulty(share[0], share[1], int(visible.sum()))


def clip_difficulty(frames: Frames, sketch: Sketch, truth: Mapping[str, Any], options: FollowOptions = FollowOptions()) -> Difficulty:
    """The same for a whole clip, its sketch and its truth (`planewright-truth` or `planewright-truth-tracks`)."""
    order = list(truth["tracks"])
    width = 1 + max(frames.numbers)
    xy = np.full((len(order), width, 2), np.nan)
    visible = np.zeros((len(order), width), np.bool_)
    for row, point in enumerate(order):
        known = truth["tracks"][point]
        if "xy" in known:
            xy[row], visible[row] = known["xy"], np.array(known["visible"], np.bool_)
        else:
            at = [int(k) for k in known]
            xy[row, at], visible[row, at] = list(known.values()), True
    return difficulty(frames.gray(frames.numbers), clicked(sketch, order), xy, visible, options)
