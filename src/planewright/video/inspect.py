"""A look at a clip before the work starts: shot cuts, repeated and frozen frames, black bars, darkness; told in sentences.

Frames are compared at 64 pixels a side or so, which costs well under a millisecond a frame beside decoding.
"""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from planewright.arrays import Float, GrayImage, Int, UInt8
from planewright.progress import Progress, silent, steps
from planewright.video.frames import Frames


@dataclass(frozen=True, kw_only=True)
class InspectOptions:
    """When something counts."""

    thumbnail_side: int = 96
    """Longer side of the pictures that are compared, in pixels."""
    same: float = 0.05
    """Two frames are the same when their thumbnails differ by no more than this on average, in grey values. A camera at rest still differs by
    its noise: 0.3 and more on the real clips looked at, of which thumbnails keep a tenth."""
    frozen_frames: int = 4
    """So many frames alike in a row are frozen; fewer are repeats (a 24 to 30 conversion repeats every fifth)."""
    cut_correlation: float = 0.75
    """A cut needs neighbours whose thumbnails, best shifted, agree less than this (normalized correlation). Measured on five clips: 0.89 to 1.0
    between neighbours, -0.1 to 0.66 between clips."""
    cut_contrast: float = 4.0
    """... and a step so many times the median step of the frames around it."""
    bar_level: float = 24.0
    """A row or column is part of a black bar when no pixel of it is ever brighter than this (compression lifts black a little) ..."""
    bar_range: float = 8.0
    """... and its pixels never differ by more than this: a dark wall has noise, a bar has none."""
    dark_level: float = 20.0
    """Mean grey value below which a frame is too dark to follow."""


@dataclass(frozen=True)
class ClipFindings:
    """What was seen. Nothing here stops the work; a person may want to know before it starts."""

    cuts: tuple[int, ...]
    """Frames that begin another shot."""
    repeats: tuple[int, ...]
    """Frames equal to the one before, outside frozen spans."""
    frozen: tuple[tuple[int, int], ...]
    """Spans (first, last) of frames that are all alike."""
    content: tuple[int, int, int, int] | None
    """Left, top, right, bottom of the picture inside black bars, in pixels (right and bottom outside); None without bars."""
    sentences: tuple[str, ...]


def inspect_clip(frames: Frames, options: InspectOptions = InspectOptions(), *, progress: Progress = silent) -> ClipFindings:
    """Cuts, repeats, frozen spans and black bars among the frames that take part. Reads each frame once and keeps thumbnails only."""
    numbers = list(frames.numbers)
    size = _thumbnail_size(frames.image_size, options.thumbnail_side)
    previous: UInt8[np.ndarray, "h w"] | None = None
    differences, correlations = [0.0], [1.0]
    means: list[float] = []
    bars = _Bars(frames.image_size, options)
    for _, image in steps(frames.gray(numbers), "Looking at the clip", progress, len(numbers)):
        small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
        means.append(float(small.mean()))
        bars.see(image)
        if previous is not None:
            differences.append(float(np.mean(cv2.absdiff(small, previous))))
            correlations.append(_shifted_correlation(previous, small))
        previous = small
    alike = [index > 0 and difference <= options.same for index, difference in enumerate(differences)]
    frozen, repeats = _spans(numbers, alike, options.frozen_frames)
    cuts = _cuts(numbers, np.array(differences), np.array(correlations), options)
    content = bars.content()
    dark = [number for number, mean in zip(numbers, means, strict=True) if mean < options.dark_level]
    return ClipFindings(cuts, repeats, frozen, content, tuple(_sentences(numbers, cuts, repeats, frozen, content, frames.image_size, dark)))


def _thumbnail_size(image_size: tuple[int, int], side: int) -> tuple[int, int]:
    scale = min(1.0, side / max(image_size))
    return max(8, round(image_size[0] * scale)), max(8, round(image_size[1] * scale))


def _shifted_correlation(a: UInt8[np.ndarray, "h w"], b: UInt8[np.ndarray, "h w"]) -> float:
    """Best normalized correlation of the middle of `a` within `b`: a fast pan shifts the picture, a cut replaces it. 1 for flat pictures."""
    height, width = a.shape
    dy, dx = height // 6, width // 6
    middle = a[dy : height - dy, dx : width - dx]
    # A flat picture correlates with nothing; a fade through black is not a cut.
    if middle.std() < 2.0 or b.std() < 2.0:
        return 1.0
    return float(cv2.matchTemplate(b, middle, cv2.TM_CCOEFF_NORMED).max())


def _spans(numbers: list[int], alike: list[bool], least: int) -> tuple[tuple[tuple[int, int], ...], tuple[int, ...]]:
    frozen: list[tuple[int, int]] = []
    repeats: list[int] = []
    start = 0
    for index in range(1, len(numbers) + 1):
        if index < len(numbers) and alike[index]:
            continue
        if index - start >= least:
            frozen.append((numbers[start], numbers[index - 1]))
        else:
            repeats += numbers[start + 1 : index]
        start = index
    return tuple(frozen), tuple(repeats)


def _cuts(numbers: list[int], differences: Float[np.ndarray, "frames"], correlations: Float[np.ndarray, "frames"], options: InspectOptions) -> tuple[int, ...]:
    cuts: list[int] = []
    for index in np.flatnonzero(correlations < options.cut_correlation):
        around = np.r_[differences[max(1, index - 8) : index], differences[index + 1 : index + 9]]
        usual = float(np.median(around)) if len(around) else 0.0
        if differences[index] > options.cut_contrast * max(usual, 1.0):
            cuts.append(numbers[index])
    return tuple(cuts)


class _Bars:
    """Which rows and columns have been black in every frame so far."""

    def __init__(self, image_size: tuple[int, int], options: InspectOptions) -> None:
        self.options = options
        self.brightest = np.zeros(image_size[::-1], dtype=np.uint8)
        self.darkest = np.full(image_size[::-1], 255, dtype=np.uint8)

    def see(self, image: GrayImage) -> None:
        """One more frame."""
        cv2.max(self.brightest, image, self.brightest)
        cv2.min(self.darkest, image, self.darkest)

    def content(self) -> tuple[int, int, int, int] | None:
        """The part of the picture that is ever lit; None when that is all of it, or nothing."""
        level, spread = self.options.bar_level, self.options.bar_range
        lit: list[Int[np.ndarray, "lit"]] = []
        for axis in (1, 0):
            high, low = self.brightest.max(axis=axis), self.darkest.min(axis=axis)
            lit.append(np.flatnonzero((high > level) | (high - low > spread)))
        rows, columns = lit
        if not len(rows) or not len(columns):
            return None
        box = (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
        height, width = self.brightest.shape
        # One dark line at the border is common in digitized video and harmless; a bar is wider than 1 % of the picture.
        margins = (box[0] / width, box[1] / height, 1 - box[2] / width, 1 - box[3] / height)
        return box if max(margins) > 0.01 else None


def _sentences(
    numbers: list[int],
    cuts: tuple[int, ...],
    repeats: tuple[int, ...],
    frozen: tuple[tuple[int, int], ...],
    content: tuple[int, int, int, int] | None,
    image_size: tuple[int, int],
    dark: list[int],
) -> list[str]:
    out: list[str] = []
    if cuts:
        ends = [numbers[0], *cuts, numbers[-1] + 1]
        first, last = max(pairwise(ends), key=lambda span: span[1] - span[0])
        where = _listed(cuts)
        out.append(f"The clip is cut at frame {where}. A scene is followed within one shot: use the longest with --frames {first}:{last}.")
    if frozen:
        out.append(f"The picture stands still in frames {_listed(tuple(f'{a}-{b}' for a, b in frozen))}: they add nothing new.")
    if repeats:
        out.append(f"{len(repeats)} frames repeat the one before ({_listed(repeats)}), as after a change of frame rate. They do no harm.")
    if content is not None:
        left, top, right, bottom = content
        out.append(f"Black bars surround the picture: it fills x {left} to {right} and y {top} to {bottom} of {image_size[0]}x{image_size[1]}.")
    if dark:
        out.append(f"{len(dark)} of {len(numbers)} frames are very dark ({_listed(tuple(dark))}): tracks will be poor there.")
    return out


def _listed(items: tuple[object, ...], most: int = 5) -> str:
    text = ", ".join(str(item) for item in items[:most])
    return text + (f" and {len(items) - most} more" if len(items) > most else "")
