"""One mark, obeyed: in space where that explains it, in the image where nothing does."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from threadpoolctl import threadpool_limits

from planewright.arrays import Bool, Float, Int
from planewright.corrections.bridge import BridgeOptions, bridged, bridged_at_once, bridges, followed, replaced
from planewright.corrections.carry import (
    CarryOptions,
    Placed,
    carry_tracks,
    contradicted,
    fused_with_mark,
    joined,
    sure,
    taken,
    typical_sigma,
    unhidden_frames,
    with_a_mark,
)
from planewright.corrections.explanations import ExplainOptions, Explanation, alone_at, explain, present_price, reach, resting_on, with_lines, with_marks
from planewright.corrections.relook import RelookOptions, lines_again, look_again, place_by_marks
from planewright.corrections.said import Said, what_frames_said
from planewright.corrections.session import Mark, Model, Session, with_mark
from planewright.errors import UsageError
from planewright.planes.basis import Basis
from planewright.planes.evidence import CornerMarks, CornerPriors
from planewright.planes.planar_scene import PlanarScene
from planewright.progress import Progress, silent
from planewright.sfm.cameras import Cameras
from planewright.sketch.graph import PointId
from planewright.tracking.edges import Anchor, EdgeLine, corner_lines
from planewright.tracking.follow import follow_corners
from planewright.tracking.tracks import State, Tracks

Kind = Literal["agreed", "moved", "solved", "bridged", "noted"]


@dataclass(frozen=True, kw_only=True)
class CorrectionOptions:
    """How a mark is obeyed."""

    mark_sigma: float = 1.0
    """Standard deviation of a correction an axis, pixels: chosen, as that of a click."""
    sure: float = 1.0
    """A mark that a track agrees with changes nothing but that track where the track is at least this sure (standard deviation, pixels)."""
    certain: float = 0.5
    """A track that is this sure (median standard deviation, pixels) stays although a face that it lies on is called wrong. Chosen: on four clips
    eight corners that were over 5 px off claimed .65 to 2.65, and the ridges that were right .23 to .54."""
    contradiction: float = 13.8
    """A mark that the best explanation still misses by more than this (chi-square with two degrees of freedom, 0.1 %) contradicts the model."""
    price_of_model: float = 60.0
    """And so does one whose best explanation adds more than this to twice the cost: the mark would have to outweigh half a dozen things that agree. Chosen."""
    other_line: float = 1.5
    """An edge that is found further than this from where a corner is (pixels in a view that sees it well) is another line there: a line's own error is
    .3 pixels, that of a click 1."""
    first_frames: int = 30
    """Frames around the mark that are shown first."""
    explain: ExplainOptions = field(default_factory=ExplainOptions)
    """What may give way."""
    carry: CarryOptions = field(default_factory=CarryOptions)
    """How tracks follow the model."""
    relook: RelookOptions = field(default_factory=RelookOptions)
    """How the edges at the corner are measured again."""
    bridge: BridgeOptions = field(default_factory=BridgeOptions)
    """How a mark acts in the image alone."""


@dataclass(frozen=True, eq=False)
class Corrected:
    """What a mark changed."""

    session: Session
    kind: Kind
    """`agreed`: the track was right, and takes the mark in; `moved`: the corner by itself, in all frames; `solved`: with its faces; `bridged`: in the image,
    between this mark and its neighbours; `noted`: the point has no track that could follow."""
    points: tuple[PointId, ...]
    """Whose tracks changed."""
    frames: Int[np.ndarray, "frames"]
    """In which frames, increasing."""
    sentences: tuple[str, ...]
    """What was done, and what contradicts, for the person."""


@runtime_checkable
class Preview(Protocol):
    """Called with tracks of the corrected point in some frames as soon as they are known."""

    def __call__(self, tracks: Tracks) -> None:
        """Provisional rows; the final ones come with the result."""
        ...


def unseen(tracks: Tracks) -> None:
    """Show nothing."""
    del tracks


def correct(
    session: Session, mark: Mark, options: CorrectionOptions = CorrectionOptions(), *, preview: Preview = unseen, progress: Progress = silent
) -> Corrected:
    """The session after one mark.

    The mark becomes part of the drawing. Where a model explains it, corner, faces and relations are solved again with it (incidences and enforced relations
    stay exact), and the tracks of what moved are carried along in all frames. Where nothing in the model explains it, or there is no model, it is obeyed
    in the image alone. What shares neither a face nor an enforced relation with the corner's faces keeps its tracks bit by bit.

    Raises:
        UsageError: no such point, or no such frame.
        Cancelled: `progress` said so.
    """
    corner = session.row(mark.point)
    if mark.frame not in session.frames.numbers:
        raise UsageError(f"Frame {mark.frame} does not take part. Choose one of {session.frames.numbers[0]} to {session.frames.numbers[-1]}.")
    if not np.isfinite(mark.xy).all():
        raise UsageError("A mark needs two finite coordinates.")
    marked = replace(session, sketch=with_mark(session.sketch, mark), marks=(*session.marks, mark))
    model = session.model
    if model is not None:
        structure = replace(model.structure, scene=replace(model.structure.scene, sketch=marked.sketch))
        marked = replace(marked, model=replace(model, structure=structure))
    # Small dense matrices: with two threads on busy cores one explanation took 4 s in place of 40 ms.
    with threadpool_limits(limits=1, user_api="blas"):
        if marked.model is None or marked.model.structure.basis is None or marked.model.cameras.row(mark.frame) is None:
            return _in_image(marked, corner, mark, options, preview, progress)
        return _in_space(marked, marked.model, corner, mark, options, preview, progress)


def settle(session: Session, *, progress: Progress = silent) -> Session:
    """The session with all tracks followed again in all frames, as a run does it: a little more exact, and seconds of work. For when nobody waits.

    Tracks that were bridged keep what the person said.
    """
    if session.model is None:
        return session
    model = session.model
    fresh = follow_corners(session.frames, model.structure.scene, model.cameras, model.corners, progress=progress)
    kept = taken(session.tracks, session.tracks.state == int(State.BRIDGED))
    return replace(session, tracks=replaced(fresh, kept) if len(kept.frame) else fresh)


def _in_space(session: Session, model: Model, corner: int, mark: Mark, options: CorrectionOptions, preview: Preview, progress: Progress) -> Corrected:
    structure, cameras = model.structure, model.cameras
    row = cameras.row(mark.frame)
    assert structure.basis is not None and row is not None
    pose = np.column_stack([cameras.rotation[row], cameras.translation[row]])
    term = CornerMarks(
        np.array([corner]),
        (cameras.intrinsics.pinhole().matrix @ pose)[None],
        session.straight(mark.frame, mark.xy)[None],
        np.array([options.mark_sigma]),
        np.ones(1, dtype=bool),
    )
    scene, carry = structure.scene, replace(options.carry, fusion=model.corners.fusion, common_sigma=model.corners.common_sigma)
    place = np.array(mark.xy)
    near = np.flatnonzero(~reach(scene, structure.basis, structure.relations, corner).points & scene.point_known)
    said = what_frames_said(session.tracks, scene, cameras, near, carry.fusion)
    wrong = contradicted(session.tracks, corner, mark.frame, place, options.mark_sigma, carry.contradiction)
    at = np.flatnonzero((near == corner) & said.spoke)
    told = None if wrong or len(at) == 0 else with_a_mark(Placed(corner, said.place[at[0]], said.covariance[at[0]]), term)
    if told is not None and sure(session.tracks, corner, mark.frame) <= options.sure:
        return _agreed(session, scene, cameras, corner, mark, told, options, carry, preview)
    if preview is not unseen:
        guess = alone_at(scene, structure.basis, structure.lines, corner, term, options.explain)
        if guess is not None:
            around = replace(cameras, posed=cameras.posed & (np.abs(cameras.frame - mark.frame) <= options.first_frames // 2))
            only = np.arange(len(scene.points)) == corner
            preview(carry_tracks(session.tracks, scene, _scene_after(scene, guess, corner)[0], around, only, carry, doubted=only & wrong))
    progress("Correcting", 0, 2)
    held = _holding(said, scene, near, corner, wrong)
    # Earlier marks that were obeyed in the image alone: two marks together may say what one could not.
    basis = with_marks(structure.basis, _earlier(session, model, corner, mark.frame, options))
    certain = frozenset(int(c) for c in near if c != corner and typical_sigma(session.tracks, int(c)) <= options.certain)
    best, explained = None, False
    before = present_price(scene, structure.basis, options.explain)
    # What agrees with the track accuses nothing, unless the model cannot follow it otherwise.
    for accused in (False, True) if told is not None else (True,):
        ranked = explain(scene, basis, structure.lines, structure.relations, corner, term, options.explain, said=held, accused=accused, sure=certain)
        best = ranked[0] if ranked else None
        explained = best is not None and best.off**2 <= options.contradiction * options.mark_sigma**2 and best.price - before <= options.price_of_model
        if explained:
            break
    progress("Correcting", 1, 2)
    if best is None or not explained:
        both = _joined_marks(_earlier(session, model, corner, mark.frame, options), term)
        alone = None if not scene.point_known[corner] else place_by_marks(both, scene.points[corner], _normals_at(scene, structure.basis, corner))
        if alone is not None:
            return _by_itself(session, model, corner, mark, Placed(corner, *alone), options, carry)
        return _in_image(session, corner, mark, options, preview, progress, against=best)
    seen = _seen_rows(session.tracks, cameras, corner)
    others: tuple[int, ...] = ()
    lines = tuple(line for line in structure.lines if line.edge not in best.edges)
    if best.edges:
        found = _edges_found(session, model, best, corner, held, seen, options)
        if found is not None:
            best, new_lines, others = found
            lines = (*lines, *new_lines)
    after, moved = _scene_after(scene, best, corner)
    unseated = np.isin(np.arange(len(scene.points)), [*resting_on(best.basis, structure.lines, best.faces, certain), *others])
    unseated[corner] = wrong
    if told is None and after.point_known[corner]:
        points = scene.points.copy()
        points[near] = said.place
        points[list(others)] = after.points[list(others)]
        again = look_again(session.frames, after, cameras, points, corner, seen, model.corners, options.relook)
        told = Placed(corner, again.place, again.covariance) if again.edges else None
    rows = carry_tracks(session.tracks, scene, after, cameras, moved, carry, doubted=unseated, placed=told)
    tracks = joined([taken(session.tracks, ~moved[session.tracks.point_index]), rows])
    tracks = _as_marked(tracks, session.tracks, after, cameras, corner, mark, options, carry)
    changed = replace(structure, scene=after, basis=best.basis, lines=lines)
    overruled = tuple(session.sketch.points[point].id for _, point in best.incidences)
    final = replace(session, tracks=tracks, model=replace(model, structure=changed), overruled=(*session.overruled, *overruled))
    progress("Correcting", 2, 2)
    points_moved = tuple(session.sketch.points[i].id for i in np.flatnonzero(moved))
    return Corrected(final, "moved" if best.alone else "solved", points_moved, np.unique(rows.frame), _told(session, best, corner))


def _edges_found(
    session: Session, model: Model, best: Explanation, corner: int, said: CornerPriors, seen: Int[np.ndarray, "seen"], options: CorrectionOptions
) -> tuple[Explanation, tuple[EdgeLine, ...], tuple[int, ...]] | None:
    """The explanation with the lines that its edges are now found to be, solved with them: the other ends of these edges follow. Also these lines, and the
    other ends whose frames looked along the wrong line as well. None where no line is found that the mark agrees with.
    """
    structure = model.structure
    scene = _scene_after(structure.scene, best, corner)[0]
    known = structure.anchor if structure.anchor is not None else Anchor(structure.scene.points, structure.scene.point_covariance)
    only = np.arange(len(scene.points)) == corner
    anchor = Anchor(np.where(only[:, None], scene.points, known.points), np.where(only[:, None, None], scene.point_covariance, known.covariance))
    lines = lines_again(session.frames, scene, model.cameras, anchor, best.edges, seen, options.relook)
    lines = tuple(line for line in lines if abs(line.offset[line.edge.index(corner)]) <= options.other_line * line.pixel)
    if not lines:
        return None
    others = {
        line.edge[1 - end]
        for line in lines
        for end in (line.edge.index(corner),)
        if abs(line.offset[1 - end]) > options.other_line * line.pixel + 3.0 * line.sigma[1 - end]
    }
    solved = with_lines(structure.scene, best, corner_lines(lines, scene.points), said, sorted(others), structure.relations, corner, options.explain)
    if solved is None or solved.off**2 > options.contradiction * options.mark_sigma**2:
        return None
    moved = _scene_after(structure.scene, solved, corner)[0].points - scene.points
    told = tuple(_from(line, moved) for line in lines)
    return solved, told, tuple(sorted(others))


def _from(line: EdgeLine, moved: Float[np.ndarray, "points 3"]) -> EdgeLine:
    """A line with its offsets told from where its corners have moved to."""
    first, second = (float(line.offset[end] - line.across @ moved[line.edge[end]]) for end in (0, 1))
    return replace(line, offset=(first, second))


def _by_itself(session: Session, model: Model, corner: int, mark: Mark, told: Placed, options: CorrectionOptions, carry: CarryOptions) -> Corrected:
    """Marks that contradict the model and agree with each other: the corner's track goes through them in all frames, and leaves the model's corner."""
    scene, cameras = model.structure.scene, model.cameras
    only = np.arange(len(scene.points)) == corner
    there = replace(scene, points=np.where(only[:, None], told.place, scene.points))
    rows = carry_tracks(session.tracks, scene, there, cameras, only, carry, doubted=only, placed=told)
    tracks = joined([taken(session.tracks, ~only[session.tracks.point_index]), rows])
    for known in (*(m for m in session.marks[:-1] if m.point == mark.point), mark):
        # What hides the corner where the model has it says nothing about where the marks have it.
        tracks = _as_marked(tracks, rows, there, cameras, corner, known, options, carry)
    mine = tracks.point_index == corner
    name = session.sketch.points[corner].id
    said = (
        _contradiction(session, model, corner, mark, None),
        f"Your marks of {name} are off by the same, so its track was moved in all frames. The model's corner stays where its faces meet.",
    )
    return Corrected(replace(session, tracks=tracks), "moved", (name,), tracks.frame[mine], said)


def _normals_at(scene: PlanarScene, basis: Basis, corner: int) -> Float[np.ndarray, "faces 3"]:
    faces = np.unique(basis.incidences[basis.incidences[:, 1] == corner, 0])
    return scene.normals[faces[scene.face_known[faces]]]


def _joined_marks(first: CornerMarks, second: CornerMarks) -> CornerMarks:
    return CornerMarks(
        np.concatenate([first.corner, second.corner]),
        np.concatenate([first.projection, second.projection]),
        np.concatenate([first.xy, second.xy]),
        np.concatenate([first.sigma, second.sigma]),
        np.ones(len(first.corner) + len(second.corner), dtype=bool),
    )


def _earlier(session: Session, model: Model, corner: int, frame: int, options: CorrectionOptions) -> CornerMarks:
    """Corrections of a corner in other frames that the model does not rest on yet."""
    assert model.structure.basis is not None
    cameras, known = model.cameras, model.structure.basis.evidence.marks
    there = {tuple(xy) for xy in known.xy[known.corner == corner].tolist()}
    projections: list[Float[np.ndarray, "3 4"]] = []
    places: list[Float[np.ndarray, "2"]] = []
    for mark in session.marks[:-1]:
        row = cameras.row(mark.frame)
        xy = session.straight(mark.frame, mark.xy)
        if mark.point == session.sketch.points[corner].id and mark.frame != frame and row is not None and tuple(xy.tolist()) not in there:
            pose = np.column_stack([cameras.rotation[row], cameras.translation[row]])
            projections.append(cameras.intrinsics.pinhole().matrix @ pose)
            places.append(xy)
    count = len(places)
    return CornerMarks(
        np.full(count, corner),
        np.array(projections).reshape(-1, 3, 4),
        np.array(places).reshape(-1, 2),
        np.full(count, options.mark_sigma),
        np.ones(count, dtype=bool),
    )


def _agreed(
    session: Session,
    scene: PlanarScene,
    cameras: Cameras,
    corner: int,
    mark: Mark,
    told: Placed,
    options: CorrectionOptions,
    carry: CarryOptions,
    preview: Preview,
) -> Corrected:
    """A mark where the track is anyway, and sure of it: the corner's track takes it in as one more observation; nothing else changes."""
    only = np.arange(len(scene.points)) == corner
    rows = carry_tracks(session.tracks, scene, scene, cameras, only, carry, placed=told)
    tracks = joined([taken(session.tracks, ~only[session.tracks.point_index]), rows])
    tracks = _as_marked(tracks, session.tracks, scene, cameras, corner, mark, options, carry)
    mine = tracks.point_index == corner
    if preview is not unseen:
        preview(taken(tracks, mine))
    here = np.flatnonzero((session.tracks.point_index == corner) & (session.tracks.frame == mark.frame))
    off = float(np.linalg.norm(session.tracks.xy[here[0]] - np.array(mark.xy)))
    name = session.sketch.points[corner].id
    said = f"Your mark of {name} agrees with its track, which is {off:.1f} px beside it; the model stays as it is."
    return Corrected(replace(session, tracks=tracks), "agreed", (name,), tracks.frame[mine], (said,))


def _holding(said: Said, scene: PlanarScene, near: Int[np.ndarray, "near"], corner: int, wrong: bool) -> CornerPriors:
    """What the frames said, as evidence against moving the corners: where the model has them; the marked one where its track has it, unless the mark
    contradicts that.
    """
    use = np.flatnonzero(said.spoke & ((near != corner) | (not wrong)))
    values, axes = np.linalg.eigh(said.information[use])
    whitening = np.sqrt(np.maximum(values, 0.0))[:, :, None] * axes.transpose(0, 2, 1)
    mean = np.where((near[use] == corner)[:, None], said.place[use], scene.points[near[use]])
    return CornerPriors(near[use], mean, whitening)


def _seen_rows(tracks: Tracks, cameras: Cameras, corner: int) -> Int[np.ndarray, "seen"]:
    """Rows of the cameras whose frames are thought to show the corner."""
    mine = (tracks.point_index == corner) & np.isin(tracks.state, (int(State.TRACKED), int(State.MARKED), int(State.BRIDGED)))
    return np.flatnonzero(cameras.posed & np.isin(cameras.frame, tracks.frame[mine]))


def _as_marked(
    tracks: Tracks,
    old: Tracks,
    scene: PlanarScene,
    cameras: Cameras,
    corner: int,
    mark: Mark,
    options: CorrectionOptions,
    carry: CarryOptions,
) -> Tracks:
    """The marked frame drawn to its mark; and where the corner was called hidden, it is called seen around the frame in which a person saw it."""
    tracks = fused_with_mark(tracks, corner, mark.frame, np.array(mark.xy), options.mark_sigma)
    mine = np.flatnonzero(tracks.point_index == corner)
    hidden = tracks.state[mine] == int(State.HIDDEN)
    near = np.flatnonzero(np.abs(tracks.frame[mine] - mark.frame) == 1)
    here = np.flatnonzero((old.point_index == corner) & (old.frame == mark.frame))
    was_hidden = len(here) > 0 and old.state[here[0]] == int(State.HIDDEN)
    if not was_hidden and not (len(near) and hidden[near].all()):
        return tracks
    free = unhidden_frames(scene, cameras, corner, tracks.frame[mine], carry)
    at = int(np.searchsorted(tracks.frame[mine], mark.frame))
    # Where the model sees nothing before the marked corner, the run of frames ends where it does; otherwise the model is wrong here, and it is all of the run.
    again = hidden & free if free[at] else hidden
    first = last = at
    while first > 0 and again[first - 1]:
        first -= 1
    while last + 1 < len(mine) and again[last + 1]:
        last += 1
    run = (np.arange(len(mine)) >= first) & (np.arange(len(mine)) <= last)
    # Where that run is most of what looked covered, the looks were at fault: the other frames in which nothing is before it are believed no more.
    if free[at] and 2 * run.sum() >= (hidden & free).sum():
        run = hidden & free
    said = scene.sketch.points[corner].hidden
    state = tracks.state.copy()
    for k in np.flatnonzero(run).tolist():
        frame = int(tracks.frame[mine[k]])
        if state[mine[k]] == int(State.HIDDEN) and not any(a <= frame <= b for a, b in said):
            state[mine[k]] = int(State.TRACKED)
    return replace(tracks, state=state)


def _in_image(
    session: Session, corner: int, mark: Mark, options: CorrectionOptions, preview: Preview, progress: Progress, against: Explanation | None = None
) -> Corrected:
    found = bridges(session, corner, mark, options.bridge)
    if preview is not unseen:
        preview(bridged_at_once(session, corner, mark, found, options.bridge))
    rows = bridged(session, corner, mark, found, options.bridge, progress=progress) if found else followed(session, corner, mark, options.bridge)
    after = replace(session, tracks=replaced(session.tracks, rows))
    name = session.sketch.points[corner].id
    frames = np.unique(rows.frame)
    span = f"From frame {frames[0]} to {frames[-1]} the track follows your mark." if len(frames) > 1 else "Only this frame shows your mark."
    sentences = [span]
    if session.model is not None and session.model.structure.basis is not None:
        sentences.insert(0, _contradiction(session, session.model, corner, mark, against))
    kind: Kind = "bridged" if len(frames) > 1 else "noted"
    return Corrected(after, kind, (name,), frames, tuple(sentences))


def _scene_after(scene: PlanarScene, best: Explanation, corner: int) -> tuple[PlanarScene, Bool[np.ndarray, "points"]]:
    """The scene with what an explanation moved; everything else keeps its bits. And which corners moved."""
    solution, held = best.solution, best.held
    # What was not known before is free in every solution, and becomes known only where the mark is about it.
    free, faces = ~held.points & scene.point_known, ~held.faces & scene.face_known
    free[corner] = True
    point_known = np.where(free, solution.point_known, scene.point_known)
    face_known = np.where(faces, solution.face_known, scene.face_known)
    columns = np.repeat(faces, 3)
    return (
        replace(
            scene,
            points=np.where((free & point_known)[:, None], solution.points, np.where(free[:, None], np.nan, scene.points)),
            point_known=point_known,
            point_covariance=np.where(free[:, None, None], solution.point_covariance, scene.point_covariance),
            normals=np.where((faces & face_known)[:, None], solution.normals, scene.normals),
            offsets=np.where(faces & face_known, solution.offsets, scene.offsets),
            face_known=face_known,
            plane_covariance=np.where(columns[:, None] | columns[None, :], solution.plane_covariance, scene.plane_covariance),
        ),
        free,
    )


def _told(session: Session, best: Explanation, corner: int) -> tuple[str, ...]:
    """What was done, in words."""
    sketch = session.sketch
    name = sketch.points[corner].id
    out = [f"Corner {name} was moved by itself, in all frames." if best.alone else f"Corner {name} was solved again with its faces, in all frames."]
    if best.faces:
        out.append(f"What had been measured on {_listed([sketch.faces[f].id for f in best.faces])} did not agree with your marks and was left out.")
    if best.edges:
        ends = [f"{sketch.points[a].id}-{sketch.points[b].id}" for a, b in best.edges]
        out.append(f"The line that had been taken for {_listed(ends)} did not agree with your mark and was left out.")
    for face, point in best.incidences:
        out.append(f"{sketch.points[point].id} had been taken to lie on {sketch.faces[face].id} as well; that did not agree with your mark and was left out.")
    if best.click:
        out.append(f"The first mark of {name} did not agree with this one and was left out.")
    return tuple(out)


def _contradiction(session: Session, model: Model, corner: int, mark: Mark, against: Explanation | None) -> str:
    """What a mark is at odds with, in words."""
    name, scene = session.sketch.points[corner].id, model.structure.scene
    row = model.cameras.row(mark.frame)
    if row is None:
        return f"Frame {mark.frame} has no camera, so the model cannot tell where {name} is there."
    if not scene.point_known[corner]:
        return f"Corner {name} has no place in space yet. Mark it in one more frame that was filmed from elsewhere."
    in_cam = model.cameras.cam_from_world(row).apply(scene.points[corner][None])
    seen = model.cameras.intrinsics.pinhole().project(in_cam)[0]
    off = float(np.linalg.norm(seen - session.straight(mark.frame, mark.xy)))
    assert model.structure.basis is not None
    incidences = model.structure.basis.incidences
    faces = [session.sketch.faces[f].id for f in np.unique(incidences[incidences[:, 1] == corner, 0])]
    where = f"where {_listed(faces)} meet" if len(faces) > 1 else f"where the model has it on {faces[0]}" if faces else "where the model has it"
    cure = f"Move the mark, or take {name} out of one of them" if len(faces) > 1 else "Move the mark"
    del against
    return f"Corner {name} is not {where}: {off:.1f} px off in frame {mark.frame}. {cure}."


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
