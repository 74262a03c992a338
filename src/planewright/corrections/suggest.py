"""The next correction worth making: which corner, in which frame, and what it would gain.

What a mark gains is told in corner-frames: frames in which the corner is seen and expected to come from more than 5 px off, or from being called hidden, to
within. That is the count by which a person judges a track; expected squared errors would be ruled by single corners that are lost altogether.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaincc

from planewright.arrays import Bool, Float, Int
from planewright.corrections.carry import CarryOptions, unhidden_frames
from planewright.corrections.session import Look, Model, Session
from planewright.sketch.graph import PointId, Sketch, SketchPoint
from planewright.tracking.tracks import State, Tracks


@dataclass(frozen=True, kw_only=True)
class SuggestOptions:
    """How far a corner may be off besides what its sigma says.

    Sigmas know nothing of a face that was measured on what stands before it, of a line beside an edge, or of a corner that is seen though it is said to
    be hidden. The chances were counted over 582 corners of eighteen clips with truth; each is that of (lost + 1/2) in (all + 1). Only five were lost in more
    than a tenth of their frames, so they are known to a factor of two at best, and the order is what counts.
    """

    unmeasured: float = 0.2
    """No face of the corner was measured in more than its first view (2 of 9)."""
    no_line: float = 0.13
    """No edge of the corner was found in the images (1 of 10)."""
    one_line: float = 0.05
    """One line alone was found at the corner (2 of 44)."""
    guessed: float = 0.08
    """The shape of a face had to say where the corner is (3 of 42)."""
    found: float = 0.02
    """It is taken to lie on a face of which it was not drawn a corner (2 of 106)."""
    overruled: float = 0.5
    """The same, of a corner that shares a face with one for which a mark said that this was wrong: such mistakes come together. Chosen."""
    one_face: float = 0.005
    """One face alone holds the corner (none of 104)."""
    ambiguous: float = 0.025
    """A second line runs beside one of its edges (none of 18)."""
    contradicted: float = 0.5
    """A mark on the corner contradicted the model, and was obeyed in the image around it alone: a second one tells whether it holds in all frames."""
    otherwise: float = 0.003
    """None of these (1 of 354)."""
    gross: float = 0.7
    """Share of frames in which such a corner is more than 5 px off."""
    covered: tuple[float, float, float] = (0.6, 0.25, 0.09)
    """Nothing in the model hides the corner, and it is called hidden because the picture there looks different: it is seen nevertheless. By the length of
    the run of frames: one or two, up to 24, and more (counted: 62 % of 111 frames, 25 % of 400, 8 % of 3100)."""
    behind: float = 0.006
    """The model hides the corner in a frame, and it is seen nevertheless (.6 % of 15,000 frames)."""
    corrected: float = 0.2
    """Share of the doubt that a mark leaves."""
    looked: float = 0.1
    """Share of the doubt that a look leaves in which nothing wrong was seen, as long as the track is where it was then."""
    unsure: float = 0.3
    """The same share of what its sigma says: where a track is known to be unsure, one frame in which it is right says less of the others."""
    same: float = 2.0
    """Pixels by which a track must move before such a look says nothing about it any more."""
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
    """Frames in which the corner is seen and expected to come from more than 5 px off, or from being called hidden, to within."""
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
    return rank_corrections(session.sketch, session.tracks, session.model, count, options, session.looks, session.overruled)


def rank_corrections(
    sketch: Sketch,
    tracks: Tracks,
    model: Model | None,
    count: int = 5,
    options: SuggestOptions = SuggestOptions(),
    looks: Sequence[Look] = (),
    overruled: Sequence[PointId] = (),
) -> tuple[Suggestion, ...]:
    """The same from the parts of a session that it needs; no frame is looked at."""
    hopes = [hope for i in range(len(sketch.points)) if (hope := _hope(sketch, tracks, model, i, options, looks, frozenset(overruled))) is not None]
    settled = {point.id for point in sketch.points if len(point.marks) > 1} | {look.point for look in looks}
    ranked: list[Suggestion] = []
    for hope in hopes:
        others = 0.0
        if hope.faces and hope.suggestion.point not in settled:
            others = sum(other.doubt for other in hopes if other is not hope and other.faces & hope.faces)
        ranked.append(replace(hope.suggestion, gain=hope.suggestion.gain + others))
    return tuple(sorted(ranked, key=lambda suggestion: -suggestion.gain)[:count])


def _hope(
    sketch: Sketch, tracks: Tracks, model: Model | None, point: int, options: SuggestOptions, looks: Sequence[Look], overruled: frozenset[PointId]
) -> _Hope | None:
    drawn = sketch.points[point]
    mine = np.flatnonzero(tracks.point_index == point)
    seen = mine[np.isin(tracks.state[mine], (int(State.TRACKED), int(State.BRIDGED)))]
    own = [look for look in looks if look.point == drawn.id]
    if model is not None and not model.structure.scene.point_known[point]:
        asked = _unplaced(sketch, model, point, options)
        return _Hope(replace(asked, gain=options.looked ** len(own) * asked.gain), 0.0, frozenset())
    hidden = _called_hidden(drawn, tracks, model, point, mine, own, options)
    seen = seen[np.isfinite(tracks.covariance[seen]).all(axis=(1, 2))]
    if len(seen) == 0:
        return None if hidden is None else _Hope(hidden, 0.0, frozenset())
    smaller, variance = np.linalg.eigvalsh(tracks.covariance[seen]).T
    off, marked_at = _off_its_marks(drawn, tracks, mine)
    spread = variance + (0.5 * off**2 if off > 3.0 * options.click_sigma else 0.0)
    lost = chance_beyond(spread, smaller, options.limit)
    share, lack, faces = (options.otherwise, "", frozenset[int]()) if model is None else _doubt(model, point, overruled, options)
    right = [look.frame for look in own if _still(look, tracks, mine, options)]
    # What a mark was obeyed in leaves little to gain by the next one, and so does what a person found right.
    obeyed = max(len(drawn.marks) - 1, 0)
    if model is not None and obeyed > 0 and (tracks.state[mine] == int(State.BRIDGED)).any():
        share, lack, obeyed = (
            max(share, options.contradicted),
            "Your mark contradicts the model; a second one tells whether it holds in all frames.",
            obeyed - 1,
        )
    left = options.corrected**obeyed
    doubt = left * options.looked ** len(right) * share * options.gross * len(seen)
    gain = left * options.unsure ** len(right) * float((1.0 - share) * lost.sum()) + doubt
    if off > 3.0 * options.click_sigma:
        reason = f"Its track is {off:.1f} px off its mark in frame {marked_at}."
    elif lack and doubt > 0.5 * gain:
        reason = lack
    else:
        reason = f"Its place is sure to {float(np.sqrt(np.median(spread))):.1f} px only."
    frame = _frame(tracks.frame[seen], variance, np.array(sorted({*drawn.marks, *right}), dtype=np.int64))
    asked = Suggestion(drawn.id, frame, gain, reason)
    if hidden is not None:
        better = hidden if hidden.gain > gain else asked
        asked = replace(better, gain=gain + hidden.gain)
    return _Hope(asked, doubt, faces)


def chance_beyond(first: Float[np.ndarray, "rows"], second: Float[np.ndarray, "rows"], limit: float) -> Float[np.ndarray, "rows"]:
    """Chances that a Gaussian with these variances along its axes lies further than `limit` from its middle.

    The squared distance is taken for gamma distributed with its own mean and variance, which is exact where the axes are alike and where one vanishes.
    """
    mean, variance = first + second, 2.0 * (first**2 + second**2)
    scale = variance / np.maximum(mean, 1e-12)
    return np.asarray(gammaincc(mean**2 / np.maximum(variance, 1e-24), limit**2 / np.maximum(scale, 1e-12)))


def _still(look: Look, tracks: Tracks, mine: Int[np.ndarray, "rows"], options: SuggestOptions) -> bool:
    """Whether the track is where it was when somebody looked at it."""
    here = mine[tracks.frame[mine] == look.frame]
    return look.xy is not None and len(here) > 0 and float(np.linalg.norm(tracks.xy[here[0]] - np.array(look.xy))) <= options.same


def _called_hidden(
    drawn: SketchPoint, tracks: Tracks, model: Model | None, point: int, mine: Int[np.ndarray, "rows"], own: Sequence[Look], options: SuggestOptions
) -> Suggestion | None:
    """A frame in which the corner may be seen although it is called hidden: amid the longest run of those, its ends left out where the person said so."""
    hidden = mine[tracks.state[mine] == int(State.HIDDEN)]
    hidden = hidden[[not any(a <= int(f) <= b for a, b in drawn.hidden) for f in tracks.frame[hidden]]] if len(hidden) else hidden
    if len(hidden) == 0:
        return None
    frames = tracks.frame[hidden]
    free = np.ones(len(hidden), dtype=bool) if model is None else unhidden_frames(model.structure.scene, model.cameras, point, frames, CarryOptions())
    # A run that was looked at and found hidden says much about itself, and something about the others.
    run = np.concatenate([[0], np.cumsum((np.diff(frames) > 1) | (free[1:] != free[:-1]))])
    length = np.bincount(run)[run]
    chance = np.where(free, np.select([length < 3, length < 25], options.covered[:2], options.covered[2]), options.behind)
    looked = [look.frame for look in own if look.xy is None]
    weight = options.corrected ** max(len(drawn.marks) - 1, 0) * chance * options.looked ** np.isin(run, run[np.isin(frames, looked)]) * 0.5 ** len(looked)
    totals = np.bincount(run, weights=weight)
    best = np.flatnonzero(run == int(np.argmax(totals)))
    unsure = best if not looked else best[~np.isin(frames[best], looked)]
    if len(unsure) == 0:
        return None
    why = "nothing in the model is before it" if free[best[0]] else "a face is before it in the model"
    frame = int(frames[unsure[len(unsure) // 2]])
    return Suggestion(
        drawn.id,
        frame,
        float(totals.max()),
        f"It is called hidden in {len(best)} frames in a row, though {why}."
        if free[best[0]]
        else f"It is called hidden in {len(best)} frames in a row, because {why}.",
    )


def _off_its_marks(drawn: SketchPoint, tracks: Tracks, rows: Int[np.ndarray, "rows"]) -> tuple[float, int]:
    """How far the track is off the person's marks (root mean square, pixels), and in which frame most: a click that a later mark overruled counts less."""
    marks = drawn.marks
    at = rows[np.isin(tracks.frame[rows], list(marks))]
    if len(at) == 0:
        return 0.0, -1
    off = np.array([np.linalg.norm(tracks.xy[k] - np.array(marks[int(tracks.frame[k])])) for k in at])
    return float(np.sqrt((off**2).mean())), int(tracks.frame[at[int(np.argmax(off))]])


def _doubt(model: Model, point: int, overruled: frozenset[PointId], options: SuggestOptions) -> tuple[float, str, frozenset[int]]:
    """How likely the corner is lost for a reason that its sigma does not know, the reason, and its faces where none of them was measured."""
    structure = model.structure
    if structure.basis is None:
        return options.otherwise, "", frozenset()
    evidence, incidences = structure.basis.evidence, structure.basis.incidences
    faces = np.unique(incidences[incidences[:, 1] == point, 0])
    measured: list[bool] = [int((evidence.plane_points.face == face).sum()) > 3 for face in faces]
    unmeasured = bool(len(faces)) and not any(measured)
    own = {f for f, face in enumerate(structure.scene.sketch.faces) if structure.scene.sketch.points[point].id in face.corners}
    found = bool(set(faces.tolist()) - own)
    beside = {corner for f in own for corner in structure.scene.sketch.faces[f].corners}
    num_lines = len({line.edge for line in structure.lines if point in line.edge})
    share, lack = options.otherwise, ""
    for holds, value, sentence in (
        (unmeasured, options.unmeasured, "None of its faces could be measured again in other views."),
        (num_lines == 0, options.no_line, "None of its edges was found in the images; it rests on its marks and faces."),
        (found and bool(beside & overruled), options.overruled, "A corner beside it was wrongly taken to lie on a face, and so may this one be."),
        (bool((evidence.priors.corner == point).any()), options.guessed, "The shape of a face says where it is, for its marks and faces do not."),
        (num_lines == 1, options.one_line, "One of its edges alone was found in the images."),
        (any(line.ambiguous and point in line.edge for line in structure.lines), options.ambiguous, "A second line runs beside one of its edges."),
        (found, options.found, "It is taken to lie on a face of which it was not drawn a corner."),
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
