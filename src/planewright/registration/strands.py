"""The faces to follow: one strand for each face and frame in which enough of its corners are marked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Float, Int, Mat3
from planewright.sketch.graph import Sketch


@dataclass(frozen=True, eq=False)
class Strand:
    """A face as it was drawn in one frame, to be followed through the clip."""

    face: int
    """Row of the sketch's `faces`."""
    frame: int
    """In which it was drawn."""
    h: Mat3
    """Face coordinates -> pixels of that frame, centres at integers."""
    corners: Int[np.ndarray, "marked"]
    """Rows of the sketch's `points`: the corners marked in that frame, the loop's first."""
    q: Float[np.ndarray, "marked 2"]
    """Their face coordinates."""
    loop_length: int
    """How many of them belong to the loop."""
    edges: Int[np.ndarray, "edges 2"]
    """Rows of `corners`: drawn edges with both ends marked there."""
    others: tuple[Float[np.ndarray, "_corners 2"], ...]
    """Polygons in face coordinates that lie on it or before it in that frame: its holes, and smaller faces drawn over it."""


def find_strands(sketch: Sketch, frames: Sequence[int], *, max_per_face: int = 3, least_free: float = 0.5) -> tuple[Strand, ...]:
    """Every face from each frame in which three of its loop's corners are marked, the frames with most corners first (at most `max_per_face`).

    Where one of its corners is not marked, and faces beside it leave less than `least_free` of its outline free, the face is taken to be hidden there.
    """
    row = {point.id: i for i, point in enumerate(sketch.points)}
    marks = [point.marks for point in sketch.points]
    taking_part = set(frames)
    loops = [[row[c] for c in face.loop] for face in sketch.faces]
    found: list[Strand] = []
    for f, face in enumerate(sketch.faces):
        count = {k: sum(k in marks[i] for i in loops[f]) for i0 in loops[f] for k in marks[i0] if k in taking_part}
        chosen = sorted((k for k in count if count[k] >= 3), key=lambda k: (-count[k], k))[:max_per_face]
        for k in sorted(chosen):
            loop = [i for i in loops[f] if k in marks[i]]
            holes = [[row[c] for c in hole] for hole in face.holes]
            inner = [i for hole in holes for i in hole if k in marks[i]]
            xy = np.array([marks[i][k] for i in (*loop, *inner)], dtype=np.float64) - 0.5
            outline = xy[: len(loop)]
            if _area(outline) < 30.0:
                continue
            centre = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
            half = 0.5 * float(np.ptp(outline, axis=0).max())
            h = np.array([[half, 0.0, centre[0]], [0.0, half, centre[1]], [0.0, 0.0, 1.0]])
            place = {i: at for at, i in enumerate((*loop, *inner))}
            rings = [(loops[f], face.open), *((hole, False) for hole in holes)]
            edges = [(place[a], place[b]) for ring, is_open in rings for a, b in _pairs(ring, is_open) if a in place and b in place]
            covers = [np.array([marks[i][k] for i in hole]) - 0.5 for hole in holes if all(k in marks[i] for i in hole)]
            whole = [np.array([marks[i][k] for i in other]) - 0.5 for g, other in enumerate(loops) if g != f and _before(loops[f], other, marks, k)]
            beside = []
            if len(loop) < len(loops[f]):
                # A corner that cannot be seen there often means that the face is turned away: then what is seen inside its outline are its neighbours.
                beside = [
                    np.array([marks[i][k] for i in other]) - 0.5
                    for g, other in enumerate(loops)
                    if g != f and set(other) & set(loops[f]) and all(k in marks[i] for i in other)
                ]
                if _free_share(outline, beside) < least_free:
                    continue
            covers += [*whole, *beside]
            found.append(
                Strand(
                    face=f,
                    frame=k,
                    h=h,
                    corners=np.array([*loop, *inner]),
                    q=(xy - centre) / half,
                    loop_length=len(loop),
                    edges=np.array(edges, dtype=np.int64).reshape(-1, 2),
                    others=tuple((cover - centre) / half for cover in covers),
                )
            )
    return tuple(found)


def _pairs(ring: list[int], is_open: bool) -> list[tuple[int, int]]:
    pairs = list(zip(ring, [*ring[1:], ring[0]], strict=True))
    return pairs[:-1] if is_open else pairs


def _area(polygon: Float[np.ndarray, "corners 2"]) -> float:
    x, y = polygon.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def _free_share(outline: Float[np.ndarray, "corners 2"], covers: Sequence[Float[np.ndarray, "_corners 2"]], side: int = 48) -> float:
    """Share of an outline that no other polygon covers."""
    low, span = outline.min(axis=0), float(np.ptp(outline, axis=0).max())
    masks: list[Int[np.ndarray, "side side"]] = []
    for polygons in ([outline], covers):
        mask = np.zeros((side, side), np.uint8)
        for polygon in polygons:
            cv2.fillPoly(mask, [np.round(np.clip((polygon - low) / span, -50, 50) * (side - 1) * 16).astype(np.int32)[:, None]], 1, shift=4)
        masks.append(mask)
    mine, theirs = masks
    return float((mine & (1 - theirs)).sum() / max(int(mine.sum()), 1))


def _before(loop: list[int], other: list[int], marks: Sequence[Mapping[int, tuple[float, float]]], frame: int) -> bool:
    """Whether the other face is taken to lie before this one: it is drawn there in full and clearly smaller. Where they do not meet it does no harm."""
    if not all(frame in marks[i] for i in other):
        return False
    mine = np.array([marks[i][frame] for i in loop if frame in marks[i]], dtype=np.float64)
    return _area(np.array([marks[i][frame] for i in other], dtype=np.float64)) < 0.6 * _area(mine)
