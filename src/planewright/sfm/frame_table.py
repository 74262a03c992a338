"""Feature observations by frame: what two frames share, and which frames are far enough apart to be keyframes."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Float, Int
from planewright.features.features import Features


@dataclass(frozen=True, eq=False)
class FrameTable:
    """The feature table cut into frames."""

    track: Int[np.ndarray, "obs"]
    """Sorted within each frame."""
    xy: Float[np.ndarray, "obs 2"]
    """As the feature table holds them (single precision): a clip of thousands of frames has millions."""
    start: Int[np.ndarray, "frames_plus_one"]
    """Row where each frame begins; the last entry is the number of rows."""
    frame: Int[np.ndarray, "frames"]
    """Frame numbers in the clip."""
    num_tracks: int

    @property
    def num_frames(self) -> int:
        """How many frames take part."""
        return len(self.frame)

    def rows(self, index: int) -> slice:
        """Rows of the frame at `index`."""
        return slice(int(self.start[index]), int(self.start[index + 1]))

    def shared(self, a: int, b: int) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """Tracks seen in both frames, and where."""
        rows_a, rows_b = self.rows(a), self.rows(b)
        tracks, ia, ib = np.intersect1d(self.track[rows_a], self.track[rows_b], assume_unique=True, return_indices=True)
        return tracks, self.xy[rows_a][ia].astype(np.float64), self.xy[rows_b][ib].astype(np.float64)


def frame_table(features: Features, frame_numbers: Int[np.ndarray, "frames"], *, without: Int[np.ndarray, "dropped"] | None = None) -> FrameTable:
    """The observations in the given frames (increasing), without the tracks named in `without`."""
    index = np.searchsorted(frame_numbers, features.frame)
    known = index < len(frame_numbers)
    known[known] = frame_numbers[index[known]] == features.frame[known]
    if without is not None:
        dropped = np.zeros(features.num_tracks, bool)
        dropped[without] = True
        known &= ~dropped[features.track_index]
    rows = np.nonzero(known)[0]
    counts = np.bincount(index[rows], minlength=len(frame_numbers))
    return FrameTable(
        track=features.track_index[rows],
        xy=features.xy[rows],
        start=np.concatenate([[0], np.cumsum(counts)]).astype(np.intp),
        frame=np.asarray(frame_numbers),
        num_tracks=features.num_tracks,
    )


def seen_between(table: FrameTable) -> Int[np.ndarray, "tracks 2"]:
    """Numbers of the first and the last frame of each track; (0, -1) of one that is nowhere seen."""
    frame = np.repeat(table.frame, np.diff(table.start))
    out = np.tile(np.array([0, -1]), (table.num_tracks, 1))
    out[table.track[::-1], 0] = frame[::-1]
    out[table.track, 1] = frame
    return out


def static_tracks(table: FrameTable, *, still: float = 1.0, moved: float = 10.0) -> Int[np.ndarray, "tracks"]:
    """Tracks that stay within `still` pixels while the median track of their frames travels more than `moved`: overlays and letterbox bars."""
    travel = np.zeros(table.num_frames)
    for k in range(1, table.num_frames):
        _, a, b = table.shared(k - 1, k)
        travel[k] = np.median(np.linalg.norm(b - a, axis=1)) if len(a) else 0.0
    path = np.cumsum(travel)
    low, high = np.full((table.num_tracks, 2), np.inf), np.full((table.num_tracks, 2), -np.inf)
    np.minimum.at(low, table.track, table.xy)
    np.maximum.at(high, table.track, table.xy)
    first, last = np.full(table.num_tracks, np.inf), np.full(table.num_tracks, -np.inf)
    at = path[np.repeat(np.arange(table.num_frames), np.diff(table.start))]
    np.minimum.at(first, table.track, at)
    np.maximum.at(last, table.track, at)
    seen = np.isfinite(first)
    extent = np.where(seen[:, None], high - low, np.inf).max(axis=1)
    return np.nonzero(seen & (extent < still) & (last - first > moved))[0]


def select_keyframes(
    table: FrameTable, *, motion: float, min_shared: float, min_keyframes: int, max_keyframes: int, min_features: int = 12
) -> Int[np.ndarray, "keyframes"]:
    """Indices of frames between which the median feature moved more than `motion` pixels or fewer than `min_shared` of the features lived on.

    Both thresholds are tightened together until there are `min_keyframes` (short tracks are seen in three keyframes only if these are close), and widened
    until there are no more than `max_keyframes`. Frames with fewer than `min_features` (a hand before the lens) are passed over.
    """
    usable = np.nonzero(np.diff(table.start) >= min_features)[0].tolist()
    for _ in range(6):
        keyframes = _spaced(table, usable, motion, min_shared)
        if len(keyframes) >= min_keyframes:
            break
        motion, min_shared = motion / 1.25, 1 - (1 - min_shared) / 1.2
    keyframes = _spaced(table, usable, motion, min_shared)
    while len(keyframes) > max(max_keyframes, 2):
        motion, min_shared = motion * 1.15, min_shared * 0.95 if min_shared > 0.01 else 0.0
        keyframes = _spaced(table, usable, motion, min_shared)
    return np.array(keyframes, np.intp)


def _spaced(table: FrameTable, usable: list[int], motion: float, min_shared: float) -> list[int]:
    """First and last usable frame, and between them each that is far enough from the one before."""
    keyframes = usable[:1]
    for k in usable[1:]:
        _, a, b = table.shared(keyframes[-1], k)
        held = int(table.start[keyframes[-1] + 1] - table.start[keyframes[-1]])
        if len(a) < min_shared * held or (len(a) and np.median(np.linalg.norm(b - a, axis=1)) > motion):
            keyframes.append(k)
    if usable and keyframes[-1] != usable[-1]:
        keyframes.append(usable[-1])
    return keyframes
