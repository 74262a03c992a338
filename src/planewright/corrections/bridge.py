"""A mark obeyed in the image alone: the track between it and its neighbours is mended, the model stays."""

from dataclasses import dataclass, field

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.corrections.carry import joined, taken
from planewright.corrections.said import show
from planewright.corrections.session import Mark, Session
from planewright.geometry.plane import tangent_basis
from planewright.mending.gap import Gap, blend
from planewright.mending.mend import MendOptions, mend
from planewright.mending.trace import TraceOptions, trace
from planewright.progress import Progress, silent
from planewright.tracking.tracks import State, Tracks

LARGEST_SLANT = 8.0
"""Of a face whose view turns a patch: how many times shorter than wide it may appear."""


@dataclass(frozen=True, kw_only=True)
class BridgeOptions:
    """How far a mark acts, and how."""

    farthest: int = 60
    """Where the model has a corner, a mark acts on at most this many frames to each side: what contradicts the model passes."""
    first_sigma: float = 1.5
    """Standard deviation (pixels) claimed by a first answer, before any frame is looked at."""
    mark_sigma: float = 0.7
    """Standard deviation of the mark itself."""
    mend: MendOptions = field(default_factory=MendOptions)
    """How the way between two marks is found."""
    trace: TraceOptions = field(default_factory=TraceOptions)
    """How a point that has no track is followed from its marks."""
    drift: float = 0.15
    """Standard deviation (pixels) that each frame adds to such a trace. Drift has one sense, so it grows with the number of frames. Chosen."""


@dataclass(frozen=True, eq=False)
class Bridge:
    """Frames on one side of a mark, up to where another mark or the old track holds."""

    gap: Gap
    """In the pixels of the session's frames."""
    open: bool
    """There is no mark on the other side: the track is only moved along."""


def bridges(session: Session, corner: int, mark: Mark, options: BridgeOptions = BridgeOptions()) -> tuple[Bridge, ...]:
    """What lies before the mark and after it."""
    mine = np.flatnonzero(session.tracks.point_index == corner)
    frames = session.tracks.frame[mine]
    place = np.array([session.straight(int(f), (float(x), float(y))) for f, (x, y) in zip(frames, session.tracks.xy[mine], strict=True)]).reshape(-1, 2)
    marks = session.sketch.points[corner].marks
    at = int(np.searchsorted(frames, mark.frame))
    if at == len(frames) or frames[at] != mark.frame:
        return ()
    here = session.straight(mark.frame, mark.xy)
    out: list[Bridge] = []
    for step in (-1, 1):
        others = [k for k in (range(at - 1, -1, -1) if step < 0 else range(at + 1, len(frames))) if int(frames[k]) in marks]
        other = others[0] if others else (0 if step < 0 else len(frames) - 1)
        free = not others
        if session.model is not None and abs(other - at) > options.farthest:
            other, free = at + step * options.farthest, True
        if other == at:
            continue
        span = np.arange(min(at, other), max(at, other) + 1)
        from_mark = place[span] + (here - place[at])
        if free and session.model is None:
            from_other = from_mark  # nothing says where the track is right again
        else:
            end = place[other] if free else session.straight(int(frames[other]), marks[int(frames[other])])
            from_other = place[span] + (end - place[other])
        forward, backward = (from_mark, from_other) if step > 0 else (from_other, from_mark)
        out.append(
            Bridge(
                Gap(frames[span].astype(np.int64), forward, backward, _turned_patch(session, corner, frames[span]), _other_ends(session, corner, frames[span])),
                free,
            )
        )
    return tuple(out)


def _other_ends(session: Session, corner: int, frames: Int[np.ndarray, "frames"]) -> Float[np.ndarray, "frames edges 2"] | None:
    """Where the tracks have the other ends of the edges drawn at a corner, in the pixels of the session's frames; None where no edge is drawn there."""
    row = {point.id: i for i, point in enumerate(session.sketch.points)}
    name = session.sketch.points[corner].id
    pairs = {frozenset(edge) for edge in session.sketch.edges}
    if not pairs:
        pairs = {frozenset(pair) for face in session.sketch.faces for pair in zip(face.loop, (*face.loop[1:], face.loop[0]), strict=True)}
    others = sorted(row[end] for pair in pairs if name in pair for end in pair if end != name)
    if not others:
        return None
    ends = np.full((len(frames), len(others), 2), np.nan)
    tracks = session.tracks
    for e, other in enumerate(others):
        mine = np.flatnonzero((tracks.point_index == other) & np.isin(tracks.frame, frames))
        at = np.searchsorted(frames, tracks.frame[mine])
        ends[at, e] = [session.straight(int(f), (float(x), float(y))) for f, (x, y) in zip(tracks.frame[mine], tracks.xy[mine], strict=True)] or np.zeros(
            (0, 2)
        )
    return ends


def _turned_patch(session: Session, corner: int, frames: Int[np.ndarray, "frames"]) -> Float[np.ndarray, "frames 2 2"] | None:
    """How the surroundings of a corner are turned and scaled in each frame against the first one: as the model shows a face of the corner there, the one
    that is seen largest. The model may have the corner beside where it is; how its face is seen changes little with that. None where the model does not say.
    """
    model = session.model
    if model is None or model.structure.basis is None or not model.structure.scene.point_known[corner]:
        return None
    scene, cameras, incidences = model.structure.scene, model.cameras, model.structure.basis.incidences
    rows = [cameras.row(int(frame)) for frame in frames]
    faces = np.unique(incidences[incidences[:, 1] == corner, 0])
    faces = faces[scene.face_known[faces]]
    known = np.array([row for row in rows if row is not None], dtype=np.int64)
    if len(known) < len(rows) or len(faces) == 0:
        return None
    jacobian = show(scene.points[corner : corner + 1], cameras, known).jacobian[:, 0]
    seen = np.einsum("kij,flj->fkil", jacobian, tangent_basis(scene.normals[faces]))
    size = np.abs(np.linalg.det(seen))
    best = int(np.argmax(np.median(size, axis=1)))
    turned = seen[best]
    # Seen at a glance, a face says nothing about what is around its corner.
    if (np.linalg.cond(turned) > LARGEST_SLANT).any():
        return None
    return turned @ np.linalg.inv(turned[0])


def followed(session: Session, corner: int, mark: Mark, options: BridgeOptions = BridgeOptions()) -> Tracks:
    """Rows of a point without a track: followed in the images from the mark to both sides, up to its next marks or until it is lost. Where the trace from
    the mark and the one from its neighbour pass each other, the way between them is mended.
    """
    numbers = np.array(session.frames.numbers, dtype=np.int64)
    marks = session.sketch.points[corner].marks
    at = int(np.searchsorted(numbers, mark.frame))
    here = session.straight(mark.frame, mark.xy)
    parts: list[Tracks] = []
    for step in (-1, 1):
        way = numbers[at::step]
        others = [k for k, number in enumerate(way.tolist()) if k and number in marks]
        count = others[0] + 1 if others else len(way)
        way = way[:count]
        if count < 2:
            continue
        out, known = trace(session.frames, way.tolist(), here, options.trace)
        spread = (options.drift * np.arange(count, dtype=np.float64)) ** 2
        if others:
            last = int(way[-1])
            back, known_back = trace(session.frames, way[::-1].tolist(), session.straight(last, marks[last]), options.trace)
            back, known_back = back[::-1], known_back[::-1]
            if known.sum() + known_back.sum() > count:
                order = slice(None) if step > 0 else slice(None, None, -1)
                meet = np.where(known[:, None], out, back), np.where(known_back[:, None], back, out)
                mended = mend(session.frames, Gap(way[order].copy(), *(m[order].copy() for m in (meet if step > 0 else meet[::-1]))), options.mend)
                parts.append(_rows(session, corner, way[order], mended.xy, mended.covariance))
                continue
            out, spread = np.where(known_back[:, None], back, out), np.where(known_back, spread[::-1], spread)
            known = known | known_back
        covariance = (options.mark_sigma**2 + spread)[:, None, None] * np.eye(2)
        parts.append(_rows(session, corner, way[known], out[known], covariance[known]))
    return _with_mark(session, corner, mark, parts, options)


def bridged_at_once(session: Session, corner: int, mark: Mark, found: tuple[Bridge, ...], options: BridgeOptions = BridgeOptions()) -> Tracks:
    """Rows of a first answer: both traces joined, no frame looked at."""
    parts = [_rows(session, corner, b.gap.frame, blend(b.gap), np.tile(options.first_sigma**2 * np.eye(2), (len(b.gap.frame), 1, 1))) for b in found]
    return _with_mark(session, corner, mark, parts, options)


def bridged(
    session: Session, corner: int, mark: Mark, found: tuple[Bridge, ...], options: BridgeOptions = BridgeOptions(), *, progress: Progress = silent
) -> Tracks:
    """Rows of the mended track."""
    parts: list[Tracks] = []
    for bridge in found:
        mended = mend(session.frames, bridge.gap, options.mend, progress=progress)
        parts.append(_rows(session, corner, bridge.gap.frame, mended.xy, mended.covariance))
    return _with_mark(session, corner, mark, parts, options)


def replaced(tracks: Tracks, rows: Tracks) -> Tracks:
    """The tracks with some rows in place of theirs."""
    key = {(int(p), int(f)) for p, f in zip(rows.point_index, rows.frame, strict=True)}
    stay: Bool[np.ndarray, "rows"] = np.array([(int(p), int(f)) not in key for p, f in zip(tracks.point_index, tracks.frame, strict=True)], dtype=bool)
    return joined([taken(tracks, stay), rows])


def _rows(
    session: Session, corner: int, frames: Int[np.ndarray, "frames"], xy: Float[np.ndarray, "frames 2"], covariance: Float[np.ndarray, "frames 2 2"]
) -> Tracks:
    shown = xy
    if session.model is not None and not session.model.cameras.lens.straight:
        lens = session.model.cameras.lens
        shown = np.concatenate([lens.to_displayed(int(frame), place[None]) for frame, place in zip(frames, xy, strict=True)])
    count = len(frames)
    return Tracks(np.full(count, corner), frames, shown, covariance, np.full(count, int(State.BRIDGED)))


def _with_mark(session: Session, corner: int, mark: Mark, parts: list[Tracks], options: BridgeOptions) -> Tracks:
    """The parts without the marked frames at their ends, and the mark; what was hidden stays hidden, unless the mark lies amid it."""
    marks = session.sketch.points[corner].marks
    before = session.tracks
    mine = before.point_index == corner
    hidden = before.frame[mine & (before.state == int(State.HIDDEN))]
    if mark.frame in hidden:
        run = np.concatenate([[0], np.cumsum(np.diff(hidden) > 1)])
        hidden = hidden[run != run[np.searchsorted(hidden, mark.frame)]]
    inner: list[Tracks] = []
    for part in parts:
        kept = taken(part, ~np.isin(part.frame, list(marks)))
        state = np.where(np.isin(kept.frame, hidden), int(State.HIDDEN), kept.state)
        inner.append(Tracks(kept.point_index, kept.frame, kept.xy, kept.covariance, state))
    own = Tracks(
        np.array([corner]),
        np.array([mark.frame]),
        np.array([mark.xy], dtype=np.float64),
        options.mark_sigma**2 * np.eye(2)[None],
        np.array([int(State.MARKED)]),
    )
    return joined([*inner, own])
