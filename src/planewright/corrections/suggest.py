"""The next correction worth making: which corner, in which frame, and what it would gain.

What a mark gains is told in corner-frames: frames in which the corner is seen and expected to come from more than 5 px off to within. That is the count
by which a person judges a track; expected squared errors would be ruled by single corners that are lost altogether.
"""

from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.corrections.session import Model, Session
from planewright.sketch.graph import PointId, Sketch, SketchPoint
from planewright.tracking.tracks import State, Tracks


@dataclass(frozen=True, kw_only=True)
class SuggestOptions:
    """How far a corner may be off besides what its sigma says.

    Sigmas know nothing of a face that was measured on what stands before it, or of a line beside an edge. The shares are those of corners with a lack
    whose median error is above 5 px, on six rendered clips; of all the others one in two hundred is.
    """

    unmeasured: float = 0.4
    """No face of the corner was measured in more than its first view: 5 of 11."""
    no_line: float = 0.3
    """No edge of the corner was found in the images: 2 of 4."""
    one_face: float = 0.04
    """One face alone holds the corner: 1 of 24."""
    ambiguous: float = 0.08
    """A second line runs beside one of its edges."""
    otherwise: float = 0.005
    """None of these."""
    gross: float = 0.7
    """Share of frames in which such a corner is more than 5 px off."""
    click_sigma: float = 1.0
    """Standard deviation of the person's marks an axis, pixels."""
    limit: float = 5.0
    """From how many pixels on a position counts as lost."""


@dataclass(frozen=True)
class Suggestion:
    """One mark that a person could make."""

    point: PointId
    frame: int
    gain: float
    """Frames in which the corner is seen and expected to come from more than 5 px off to within."""
    reason: str


@dataclass(frozen=True, eq=False)
class _Hope:
    """What a mark on one corner may gain."""

    suggestion: Suggestion
    doubt: float
    """The part of the gain that comes from what its sigma does not know."""
    faces: frozenset[int]
    """Its faces, where none of them was measured: a mark on one corner puts such a face right for all."""


def suggest(session: Session, count: int = 5, options: SuggestOptions = SuggestOptions()) -> tuple[Suggestion, ...]:
    """The marks that gain most, best first, one a point; none for what cannot gain a thing."""
    return rank_corrections(session.sketch, session.tracks, session.model, count, options)


def rank_corrections(sketch: Sketch, tracks: Tracks, model: Model | None, count: int = 5, options: SuggestOptions = SuggestOptions()) -> tuple[Suggestion, ...]:
    """The same from the parts of a session that it needs; no frame is looked at."""
    hopes = [hope for i in range(len(sketch.points)) if (hope := _hope(sketch, tracks, model, i, options)) is not None]
    corrected = {point.id for point in sketch.points if len(point.marks) > 1}
    ranked: list[Suggestion] = []
    for hope in hopes:
        others = 0.0
        if hope.faces and hope.suggestion.point not in corrected:
            others = sum(other.doubt for other in hopes if other is not hope and other.faces & hope.faces)
        ranked.append(replace(hope.suggestion, gain=hope.suggestion.gain + others))
    return tuple(sorted(ranked, key=lambda suggestion: -suggestion.gain)[:count])


def _hope(sketch: Sketch, tracks: Tracks, model: Model | None, point: int, options: SuggestOptions) -> _Hope | None:
    drawn = sketch.points[point]
    mine = np.flatnonzero(tracks.point_index == point)
    seen = mine[np.isin(tracks.state[mine], (int(State.TRACKED), int(State.BRIDGED)))]
    if model is not None and not model.structure.scene.point_known[point]:
        return _Hope(_unplaced(sketch, model, point, options), 0.0, frozenset())
    seen = seen[np.isfinite(tracks.covariance[seen]).all(axis=(1, 2))]
    if len(seen) == 0:
        return None
    variance = np.linalg.eigvalsh(tracks.covariance[seen])[:, -1]
    off, marked_at = _off_its_marks(drawn, tracks, mine)
    spread = variance + max(0.5 * off**2 - options.click_sigma**2, 0.0)
    lost = np.exp(-0.5 * options.limit**2 / np.maximum(spread, 1e-6))
    share, lack, faces = (options.otherwise, "", frozenset[int]()) if model is None else _doubt(model, point, options)
    # What a mark was obeyed in leaves little to gain by the next one.
    left = 0.2 ** max(len(drawn.marks) - 1, 0)
    doubt = left * share * options.gross * len(seen)
    gain = left * float((1.0 - share) * lost.sum()) + doubt
    if off > 3.0 * options.click_sigma:
        reason = f"Its track is {off:.1f} px off its mark in frame {marked_at}."
    elif lack and doubt > 0.5 * gain:
        reason = lack
    else:
        reason = f"Its place is sure to {float(np.sqrt(np.median(spread))):.1f} px only."
    frame = _frame(tracks.frame[seen], variance, np.array(sorted(drawn.marks), dtype=np.int64))
    return _Hope(Suggestion(drawn.id, frame, gain, reason), doubt, faces)


def _off_its_marks(drawn: SketchPoint, tracks: Tracks, rows: Int[np.ndarray, "rows"]) -> tuple[float, int]:
    """How far the track is off the person's marks at most, and in which frame."""
    worst, marks = (0.0, -1), drawn.marks
    for k in rows[np.isin(tracks.frame[rows], list(marks))].tolist():
        frame = int(tracks.frame[k])
        worst = max(worst, (float(np.linalg.norm(tracks.xy[k] - np.array(marks[frame]))), frame))
    return worst


def _doubt(model: Model, point: int, options: SuggestOptions) -> tuple[float, str, frozenset[int]]:
    """How likely the corner is lost for a reason that its sigma does not know, the reason, and its faces where none of them was measured."""
    structure = model.structure
    if structure.basis is None:
        return options.otherwise, "", frozenset()
    evidence, incidences = structure.basis.evidence, structure.basis.incidences
    faces = np.unique(incidences[incidences[:, 1] == point, 0])
    measured: list[bool] = [int((evidence.plane_points.face == face).sum()) > 3 for face in faces]
    unmeasured = bool(len(faces)) and not any(measured)
    share, lack = options.otherwise, ""
    for holds, value, sentence in (
        (unmeasured, options.unmeasured, "None of its faces could be measured again in other views."),
        (not (evidence.lines.corner == point).any(), options.no_line, "None of its edges was found in the images; it rests on its marks and faces."),
        (any(line.ambiguous and point in line.edge for line in structure.lines), options.ambiguous, "A second line runs beside one of its edges."),
        (len(faces) == 1, options.one_face, "It rests on one face alone."),
    ):
        if holds:
            share, lack = 1.0 - (1.0 - share) * (1.0 - value), lack or sentence
    return share, lack, frozenset(faces.tolist()) if unmeasured else frozenset()


def _unplaced(sketch: Sketch, model: Model, point: int, options: SuggestOptions) -> Suggestion:
    """A corner without a place: a mark as far from its others as the cameras allow, in the middle of what they see."""
    marks = np.array(sorted(sketch.points[point].marks), dtype=np.int64)
    posed = model.cameras.frame[model.cameras.posed]
    centers = model.cameras.centers[model.cameras.posed]
    from_marks = [model.cameras.row(int(frame)) for frame in marks]
    rows = [row for row in from_marks if row is not None]
    away = np.linalg.norm(centers[:, None] - model.cameras.centers[rows][None], axis=2).min(axis=1) if rows else np.ones(len(posed))
    # The farthest camera may no longer see it: half way there it mostly does.
    frame = int(posed[int(np.argmin(np.abs(away - 0.5 * away.max())))]) if len(posed) else int(marks[0])
    return Suggestion(sketch.points[point].id, frame, 0.5 * options.gross * len(posed), "It has no place in space yet.")


def _frame(frames: Int[np.ndarray, "seen"], variance: Float[np.ndarray, "seen"], marks: Int[np.ndarray, "marks"]) -> int:
    """Where the corner is seen and least sure, and not beside a mark; in the middle of those frames, where it is seen for some time."""
    far: Bool[np.ndarray, "seen"] = np.ones(len(frames), dtype=bool)
    if len(marks):
        distance = np.abs(frames[:, None] - marks[None]).min(axis=1)
        far = distance >= 0.5 * distance.max()
    worst = far & (variance >= 0.9 * variance[far].max())
    candidates = frames[worst]
    return int(candidates[len(candidates) // 2])
