"""What is wrong with a sketch, what is doubtful, and what is only worth knowing. Errors keep a reconstruction from starting."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from typing import Literal

import numpy as np
import shapely

from planewright.arrays import Float
from planewright.sketch.faces import find_faces
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace
from planewright.sketch.json_values import shown
from planewright.sketch.relation_checks import contradictions

Severity = Literal["error", "warning", "info"]

_ON_A_LINE = 0.75
"""Pixels: corners this close to one line are on it, whatever the clicks (which scatter by about 1 px) say."""
_THIN = 3.0
"""Pixels: a face thinner than this is seen edge on; its plane must come from other frames."""
_CLICKS = 4.0
"""Pixels: where the part that an outline cuts off by crossing itself is thinner, two clicks may just have been a little off."""
_SAME_PLACE = 0.5
"""Pixels: two clicks closer than this were meant for one spot."""


class FindingCode(StrEnum):
    """Why a finding is made."""

    NO_POINTS = "no_points"
    NO_FACES = "no_faces"
    IMAGE_SIZE = "image_size"
    MARK_OUTSIDE_CLIP = "mark_outside_clip"
    MARK_OUTSIDE_IMAGE = "mark_outside_image"
    MARK_WHERE_HIDDEN = "mark_where_hidden"
    POINT_UNMARKED = "point_unmarked"
    POINT_ALONE = "point_alone"
    POINTS_COINCIDE = "points_coincide"
    EDGE_WITHOUT_LENGTH = "edge_without_length"
    FACE_UNMARKED = "face_unmarked"
    FACE_SPREAD = "face_spread"
    FACE_ON_A_LINE = "face_on_a_line"
    FACE_THIN = "face_thin"
    FACE_CROSSES_ITSELF = "face_crosses_itself"
    FACE_TWICE = "face_twice"
    HOLE_OUTSIDE = "hole_outside"
    UNKNOWN_FACE = "unknown_face"
    RELATIONS_CONTRADICT = "relations_contradict"
    LENGTHS_CONTRADICT = "lengths_contradict"


@dataclass(frozen=True)
class Finding:
    """One thing about the sketch."""

    severity: Severity
    code: FindingCode
    sentence: str
    """What, where, and what to do."""
    where: str
    """The key of `sketch.json` with the id in it, such as `faces["f3"]`."""


def check_sketch(sketch: Sketch, *, image_size: tuple[int, int] | None = None, num_frames: int | None = None) -> tuple[Finding, ...]:
    """What is to be said about a sketch that the reader accepts, errors first. Raises nothing.

    Args:
        sketch: as read; where it has no faces, those found in its edges are looked at.
        image_size: width and height of the clip as displayed, where it is known.
        num_frames: frames of the clip, where it is known.
    """
    sketch = sketch if sketch.faces else find_faces(sketch)
    marks = {point.id: point.marks for point in sketch.points}
    findings = [
        *_check_whole(sketch, image_size),
        *_check_marks(sketch, image_size or sketch.image_size, num_frames),
        *_check_points(sketch),
        *_check_edges(sketch, marks),
        *(finding for face in sketch.faces for finding in _check_face(face, marks, _elsewhere(sketch, face))),
        *_check_face_pairs(sketch),
        *_check_statements(sketch),
    ]
    order = {"error": 0, "warning": 1, "info": 2}
    return tuple(sorted(findings, key=lambda finding: order[finding.severity]))


def _check_whole(sketch: Sketch, image_size: tuple[int, int] | None) -> Iterator[Finding]:
    if not sketch.points:
        yield Finding("error", FindingCode.NO_POINTS, "The sketch has no points. Mark the corners of the faces you want.", "points")
    elif not sketch.faces:
        sentence = "The sketch has no face, and its edges close no loop. Draw at least one face: three corners or more, joined all around."
        yield Finding("error", FindingCode.NO_FACES, sentence, "faces")
    if image_size is not None and sketch.image_size is not None and sketch.image_size != image_size:
        drawn, actual = "{}x{}".format(*sketch.image_size), "{}x{}".format(*image_size)
        cure = "Is it the clip turned by 90 degrees?" if sketch.image_size == image_size[::-1] else "Is it another clip, or a scaled copy?"
        sentence = f"The sketch was drawn on pictures of {drawn} pixels, the clip has {actual}. {cure} Draw on this clip, or give the clip it was drawn on."
        yield Finding("error", FindingCode.IMAGE_SIZE, sentence, "image_size")


def _check_marks(sketch: Sketch, image_size: tuple[int, int] | None, num_frames: int | None) -> Iterator[Finding]:
    for point in sketch.points:
        where = f"points[{shown(point.id)}]"
        for frame, (x, y) in point.marks.items():
            if num_frames is not None and frame >= num_frames:
                length = f"frames 0 to {num_frames - 1}" if num_frames != 1 else "one frame, frame 0,"
                sentence = (
                    f"Point {shown(point.id)} is marked in frame {frame}; the clip has {length} only. Take the mark out, or give the clip it was drawn on."
                )
                yield Finding("error", FindingCode.MARK_OUTSIDE_CLIP, sentence, where)
            if any(first <= frame <= last for first, last in point.hidden):
                sentence = f"Point {shown(point.id)} is marked in frame {frame}, where it is said to be hidden. Shorten the hidden span, or remove the mark."
                yield Finding("warning", FindingCode.MARK_WHERE_HIDDEN, sentence, where)
            if image_size is None:
                continue
            beyond = max(-x, -y, x - image_size[0], y - image_size[1])
            if beyond > 0:
                # A corner just outside may be where two visible edges meet; one further out than the picture is wide is a slip.
                severity: Severity = "error" if beyond > max(image_size) else "warning"
                size = f"{image_size[0]}x{image_size[1]}"
                sentence = f"Point {shown(point.id)} is marked at ({x:g}, {y:g}) in frame {frame}, {beyond:g} pixels outside the picture of {size}."
                sentence += " Move the mark." if severity == "error" else ""
                yield Finding(severity, FindingCode.MARK_OUTSIDE_IMAGE, sentence, where)


def _check_points(sketch: Sketch) -> Iterator[Finding]:
    used = {end for edge in sketch.edges for end in edge} | {corner for face in sketch.faces for corner in face.corners}
    places: dict[tuple[int, int, int], list[PointId]] = {}
    for point in sketch.points:
        where = f"points[{shown(point.id)}]"
        if not point.marks:
            sentence = f"Point {shown(point.id)} is marked in no frame. Mark it where it can be seen, or delete it."
            yield Finding("warning", FindingCode.POINT_UNMARKED, sentence, where)
        elif point.id not in used:
            sentence = f"Point {shown(point.id)} belongs to no edge and no face: it is tracked as a patch of its own."
            yield Finding("info", FindingCode.POINT_ALONE, sentence, where)
        for frame, (x, y) in point.marks.items():
            places.setdefault((frame, round(x / _SAME_PLACE), round(y / _SAME_PLACE)), []).append(point.id)
    for (frame, *_), ids in places.items():
        if len(ids) > 1:
            names = " and ".join(shown(identity) for identity in ids[:3])
            sentence = f"Points {names} are marked at the same place in frame {frame}. If they are one corner, use one point for it."
            yield Finding("warning", FindingCode.POINTS_COINCIDE, sentence, f"points[{shown(ids[1])}]")


def _check_edges(sketch: Sketch, marks: Mapping[PointId, Mapping[int, tuple[float, float]]]) -> Iterator[Finding]:
    for a, b in sketch.edges:
        common = sorted(marks[a].keys() & marks[b].keys())
        short = [frame for frame in common if np.hypot(marks[a][frame][0] - marks[b][frame][0], marks[a][frame][1] - marks[b][frame][1]) < _SAME_PLACE]
        if short and len(short) == len(common):
            sentence = f"The edge from {shown(a)} to {shown(b)} has no length where it is marked (frame {short[0]}). Move one end, or delete the edge."
            yield Finding("warning", FindingCode.EDGE_WITHOUT_LENGTH, sentence, f"edges[{shown(a)}, {shown(b)}]")


def _elsewhere(sketch: Sketch, face: SketchFace) -> int:
    """How many corners of a face's loop are corners of other faces too."""
    others = {corner for other in sketch.faces if other is not face for corner in other.corners}
    return len(set(face.loop) & others)


def _check_face(face: SketchFace, marks: Mapping[PointId, Mapping[int, tuple[float, float]]], elsewhere: int) -> Iterator[Finding]:
    where, name, it = f"faces[{shown(face.id)}]", f"Face {shown(face.id)}", f"face {shown(face.id)}"
    marked = [corner for corner in face.loop if marks[corner]]
    if len(marked) < 3:
        sentence = f"{name} has {len(marked)} corners that are marked anywhere; a plane needs 3. Mark more of its corners."
        yield Finding("error", FindingCode.FACE_UNMARKED, sentence, where)
        return
    frames = sorted({frame for corner in face.loop for frame in marks[corner]})
    seen = {frame: np.array([marks[corner][frame] for corner in face.loop if frame in marks[corner]]) for frame in frames}
    thickness = {frame: _thickness(xy) if len(xy) >= 3 else 0.0 for frame, xy in seen.items()}
    best = max(frames, key=lambda frame: (len(seen[frame]), thickness[frame], -frame))
    if len(seen[best]) < 3:
        sentence = f"{name} has no frame in which three of its corners are marked; its shape must come from the cameras alone. Mark more corners in one frame."
        yield Finding("warning", FindingCode.FACE_SPREAD, sentence, where)
        return
    if len(seen[best]) == len(face.loop) and max(thickness.values()) < _ON_A_LINE:
        if elsewhere >= 3:
            sentence = f"The corners of {it} lie on a line in frame {best}: its plane must come from the faces beside it. Mark it in a frame that shows it."
            yield Finding("warning", FindingCode.FACE_ON_A_LINE, sentence, where)
            return
        sentence = f"The corners of {it} lie on a line in frame {best}; a line fixes no plane. Add a corner off the line, or delete the face."
        yield Finding("error", FindingCode.FACE_ON_A_LINE, sentence, where)
        return
    if max(thickness.values()) < _THIN:
        sentence = f"{name} is only {max(thickness.values()):.1f} pixels thick in frame {best}: it is seen edge on. Mark it in a frame that shows it better."
        yield Finding("warning", FindingCode.FACE_THIN, sentence, where)
    elif len(seen[best]) == len(face.loop) and not face.open and not shapely.Polygon(seen[best]).is_valid:
        if _least_lobe(seen[best]) < _CLICKS:
            sentence = f"The outline of {it} crosses itself by a click's width in frame {best}. If its corners are in order, nothing is wrong."
            yield Finding("warning", FindingCode.FACE_CROSSES_ITSELF, sentence, where)
        else:
            sentence = f"The outline of {it} crosses itself in frame {best}. Put its corners in order around the face."
            yield Finding("error", FindingCode.FACE_CROSSES_ITSELF, sentence, where)
    yield from _check_holes(face, marks)


def _least_lobe(xy: Float[np.ndarray, "corners 2"]) -> float:
    """Width (diameter of the largest circle within) of the smallest part of an outline that crosses itself, pixels."""
    lobes = [part for part in shapely.get_parts(shapely.make_valid(shapely.Polygon(xy))) if isinstance(part, shapely.Polygon)]
    return min((2.0 * shapely.maximum_inscribed_circle(lobe).length for lobe in lobes), default=0.0)


def _check_holes(face: SketchFace, marks: Mapping[PointId, Mapping[int, tuple[float, float]]]) -> Iterator[Finding]:
    for number, hole in enumerate(face.holes):
        for frame in sorted({frame for corner in hole for frame in marks[corner]}):
            if not all(frame in marks[corner] for corner in (*hole, *face.loop)):
                continue
            outer, inner = (shapely.Polygon([marks[corner][frame] for corner in loop]) for loop in (face.loop, hole))
            if not outer.is_valid or not inner.is_valid or inner.area < 1.0:
                continue
            outside = inner.difference(outer).area / inner.area
            # Clicks scatter by a pixel, so a hole may stick out a little where it touches the border.
            if outside > 0.1:
                severity: Severity = "error" if outside > 0.5 else "warning"
                sentence = (
                    f"Hole {number} of face {shown(face.id)} lies {outside:.0%} outside the face in frame {frame}. Move its corners in, or make it a face."
                )
                yield Finding(severity, FindingCode.HOLE_OUTSIDE, sentence, f"faces[{shown(face.id)}].holes[{number}]")
                break


def _thickness(xy: Float[np.ndarray, "corners 2"]) -> float:
    """Extent of the corners across their longest direction, in pixels."""
    centred = xy - xy.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    return float(np.ptp(centred @ axes[1]))


def _check_face_pairs(sketch: Sketch) -> Iterator[Finding]:
    first: dict[frozenset[PointId], FaceId] = {}
    for face in sketch.faces:
        corners = frozenset(face.loop)
        if corners in first:
            sentence = f"Faces {shown(first[corners])} and {shown(face.id)} have the same corners. Delete one of them."
            yield Finding("warning", FindingCode.FACE_TWICE, sentence, f"faces[{shown(face.id)}]")
        first.setdefault(corners, face.id)


def _check_statements(sketch: Sketch) -> Iterator[Finding]:
    known = {face.id for face in sketch.faces}
    named: list[tuple[str, Sequence[FaceId]]] = [
        (f"relations[{number}]", (*relation.faces, *([relation.about] if relation.about is not None else [])))
        for number, relation in enumerate(sketch.relations)
    ]
    if sketch.up is not None and sketch.up.face is not None:
        named.append(("up.face", (sketch.up.face,)))
    for where, ids in named:
        for identity in ids:
            if identity not in known:
                sentence = f"{where} names the face {shown(identity)}, which is neither given nor found in the edges. Give the face, or take it out there."
                yield Finding("error", FindingCode.UNKNOWN_FACE, sentence, where)
    for sentence, number in contradictions(sketch):
        yield Finding("error", FindingCode.RELATIONS_CONTRADICT, sentence, f"relations[{number}]")
    for a, b in combinations(sketch.lengths[:200], 2):
        if frozenset(a.edge) == frozenset(b.edge) and abs(a.length - b.length) > 4 * np.hypot(a.sigma, b.sigma):
            sentence = f"The edge from {shown(a.edge[0])} to {shown(a.edge[1])} is said to be {a.length:g} long and {b.length:g} long. Keep one."
            yield Finding("error", FindingCode.LENGTHS_CONTRADICT, sentence, "lengths")
