"""One mark, obeyed: in space where that explains it, in the image where nothing does."""

from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from threadpoolctl import threadpool_limits

from planewright.arrays import Bool, Int
from planewright.corrections.explanations import ExplainOptions, Explanation, explain
from planewright.corrections.session import Mark, Model, Session, with_mark
from planewright.errors import UsageError
from planewright.planes.evidence import CornerMarks
from planewright.planes.planar_scene import PlanarScene
from planewright.progress import Progress, silent
from planewright.refine.rounds import Structure
from planewright.sketch.graph import PointId
from planewright.tracking.follow import follow_corners
from planewright.tracking.tracks import Tracks

Kind = Literal["moved", "solved", "bridged"]


@dataclass(frozen=True, kw_only=True)
class CorrectionOptions:
    """How a mark is obeyed."""

    mark_sigma: float = 0.7
    """Standard deviation of a correction an axis, pixels: people drag more carefully than they click."""
    contradiction: float = 13.8
    """A mark that the best explanation still misses by more than this (chi-square with two degrees of freedom, 0.1 %) contradicts the model."""
    first_frames: int = 30
    """Frames around the mark that are shown first."""
    explain: ExplainOptions = field(default_factory=ExplainOptions)
    """What may give way."""


@dataclass(frozen=True, eq=False)
class Corrected:
    """What a mark changed."""

    session: Session
    kind: Kind
    """`moved`: the corner by itself, in all frames; `solved`: with its faces; `bridged`: in the image, between this mark and its neighbours."""
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
    stay exact), and what moved is followed again in all frames. Where nothing in the model explains it, it is obeyed in the image alone.

    Raises:
        UsageError: no such point, or no such frame.
        Cancelled: `progress` said so.
    """
    corner = session.row(mark.point)
    if mark.frame not in session.frames.numbers:
        raise UsageError(f"Frame {mark.frame} does not take part.")
    if not np.isfinite(mark.xy).all():
        raise UsageError("A mark needs two finite coordinates.")
    marked = replace(session, sketch=with_mark(session.sketch, mark), marks=(*session.marks, mark))
    if session.model is None or session.model.structure.basis is None:
        raise UsageError("This kind of correction is not there yet.")
    # Small dense matrices: with two threads on busy cores one explanation took 4 s in place of 40 ms.
    with threadpool_limits(limits=1, user_api="blas"):
        return _in_space(marked, session.model, corner, mark, options, preview, progress)


def _in_space(session: Session, model: Model, corner: int, mark: Mark, options: CorrectionOptions, preview: Preview, progress: Progress) -> Corrected:
    structure, cameras = model.structure, model.cameras
    row = cameras.row(mark.frame)
    assert structure.basis is not None
    if row is None:
        raise UsageError("This kind of correction is not there yet.")
    pose = np.column_stack([cameras.rotation[row], cameras.translation[row]])
    term = CornerMarks(
        np.array([corner]),
        (cameras.intrinsics.pinhole().matrix @ pose)[None],
        session.straight(mark.frame, mark.xy)[None],
        np.array([options.mark_sigma]),
        np.ones(1, dtype=bool),
    )
    progress("Correcting", 0, 3)
    ranked = explain(structure.scene, structure.basis, structure.lines, structure.relations, corner, term, options.explain)
    best = ranked[0]
    progress("Correcting", 1, 3)
    scene, moved = _scene_after(replace(structure.scene, sketch=session.sketch), best, corner)
    changed = Structure(scene, structure.relations, structure.adjacency, structure.notes, best.basis, structure.lines, structure.anchor)
    tracks, rows = _followed(session, replace(model, structure=changed), moved, mark, options, preview)
    progress("Correcting", 3, 3)
    after = replace(session, tracks=tracks, model=replace(model, structure=changed))
    points = tuple(session.sketch.points[i].id for i in np.flatnonzero(moved))
    return Corrected(after, "moved" if best.alone else "solved", points, rows, _told(session, best, corner))


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


def _followed(
    session: Session, model: Model, moved: Bool[np.ndarray, "points"], mark: Mark, options: CorrectionOptions, preview: Preview
) -> tuple[Tracks, Int[np.ndarray, "frames"]]:
    """The tracks with those of the moved corners followed again, and the frames in which they are."""
    scene, cameras = model.structure.scene, model.cameras
    near = np.abs(cameras.frame - mark.frame) <= options.first_frames // 2
    if preview is not unseen:
        preview(_of_points(follow_corners(session.frames, scene, replace(cameras, posed=cameras.posed & near), model.corners), moved))
    new = _of_points(follow_corners(session.frames, scene, cameras, model.corners), moved)
    return spliced(session.tracks, new, moved), np.unique(new.frame)


def _of_points(tracks: Tracks, points: Bool[np.ndarray, "points"]) -> Tracks:
    return _taken(tracks, points[tracks.point_index])


def _taken(tracks: Tracks, rows: Bool[np.ndarray, "rows"]) -> Tracks:
    return Tracks(tracks.point_index[rows], tracks.frame[rows], tracks.xy[rows], tracks.covariance[rows], tracks.state[rows])


def spliced(old: Tracks, new: Tracks, points: Bool[np.ndarray, "points"]) -> Tracks:
    """The tracks of `points` from `new`, all others from `old`, in their order."""
    kept = _taken(old, ~points[old.point_index])
    order = np.lexsort((np.concatenate([kept.frame, new.frame]), np.concatenate([kept.point_index, new.point_index])))
    return Tracks(
        np.concatenate([kept.point_index, new.point_index])[order],
        np.concatenate([kept.frame, new.frame])[order],
        np.concatenate([kept.xy, new.xy])[order],
        np.concatenate([kept.covariance, new.covariance])[order],
        np.concatenate([kept.state, new.state])[order],
    )


def _told(session: Session, best: Explanation, corner: int) -> tuple[str, ...]:
    name = session.sketch.points[corner].id
    return (f"Corner {name} was moved in its faces, in all frames." if best.alone else f"Corner {name} and its faces were solved again.",)
