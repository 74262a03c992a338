"""From a finished run to corrections and back: nothing is measured again to begin with, and in the end the result is what a run would have given out."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from planewright.corrections.session import Model, Session
from planewright.errors import UsageError
from planewright.geometry.plane import tangent_basis
from planewright.model.build import build_model
from planewright.pipeline.result import Result
from planewright.planes.planar_scene import PlanarScene
from planewright.progress import Progress, silent
from planewright.refine.rounds import Structure
from planewright.relations.adjacency import adjacent_faces
from planewright.relations.relation import Relation
from planewright.texture.bake import BakeOptions, bake_texture
from planewright.tracking.follow import CornerOptions
from planewright.video.clip import Clip, open_clip
from planewright.video.frame_range import FrameRange
from planewright.video.kept_frames import KeptFrames
from planewright.video.undistort import UndistortedFrames


def open_session(
    clip: Clip | Path | str, result: Result, corners: CornerOptions = CornerOptions(), *, frames: FrameRange | None = None, max_bytes: int = 400_000_000
) -> Session:
    """The session that corrections of a result start from.

    Args:
        clip: the clip of the run, opened or by its path.
        corners: how corners were located in the run.
        frames: those that took part in the run, where `clip` is a path.
        max_bytes: memory for frames that are kept once they were looked at.

    Raises:
        VideoError: the clip cannot be read.
    """
    opened = clip if isinstance(clip, Clip) else open_clip(clip, frames)
    straight = KeptFrames(UndistortedFrames(opened, result.cameras.lens), max_bytes)
    return Session(straight, result.scene.sketch, result.tracks, Model(result.cameras, result.structure, corners))


def corrected_result(session: Session, before: Result, texture: BakeOptions = BakeOptions(), *, progress: Progress = silent) -> Result:
    """The result with a session's corrections: tracks, structure, and the model with a texture baked anew (seconds).

    Angles between faces are those of the corrected model, and so are the figures of relations that are not enforced; what is enforced stays.

    Args:
        before: the result from which the session was opened.

    Raises:
        UsageError: the session has no model.
        Cancelled: `progress` said so.
    """
    if session.model is None:
        raise UsageError("These corrections have no model, so there is nothing to export but their tracks.")
    cameras, scene = session.model.cameras, session.model.structure.scene
    structure = refreshed(session.model.structure, before.structure)
    atlas = bake_texture(session.frames, scene, cameras, texture, progress=progress)
    model = build_model(scene, atlas, cameras=cameras, unit=before.model.unit, world_up=before.model.world_up)
    gone = {*before.structure.notes, *before.model.notes} - {*structure.notes}
    warnings = (*(warning for warning in before.warnings if warning not in gone), *model.notes)
    return Result(before.clip, cameras, structure, session.tracks, model, tuple(dict.fromkeys(warnings)))


def refreshed(structure: Structure, before: Structure) -> Structure:
    """A corrected structure with adjacency, figures of relations and notes that go with it."""
    scene = structure.scene
    ids = [point.id for point in scene.sketch.points]
    left = {line.edge for line in before.lines} - {line.edge for line in structure.lines}
    starts = tuple(f"Edge {ids[a]}-{ids[b]} is ambiguous " for a, b in sorted(left))
    return replace(
        structure,
        adjacency=adjacent_faces(scene.sketch, scene),
        relations=_as_they_are(structure.relations, before.scene, scene),
        notes=tuple(note for note in structure.notes if not note.startswith(starts)) if starts else structure.notes,
    )


def _as_they_are(relations: Sequence[Relation], before: PlanarScene, scene: PlanarScene) -> tuple[Relation, ...]:
    """Relations that are not enforced, with their angles in the corrected model where a face of theirs moved."""
    row = scene.face_row()
    out: list[Relation] = []
    for relation in relations:
        faces = [row[face] for face in relation.faces if face in row]
        there = len(faces) == 2 and len(relation.faces) == 2 and bool(scene.face_known[faces].all() and before.face_known[faces].all())
        if relation.state == "enforced" or not there or np.array_equal(scene.normals[faces], before.normals[faces]):
            out.append(relation)
            continue
        angle, sigma = _angle_off(scene, faces[0], faces[1], relation.kind == "orthogonal")
        reason = f"{angle:.2f} deg +- {sigma:.2f} deg after corrections; it was decided on before them, and is {relation.state}."
        out.append(replace(relation, deviation_deg=angle, sigma_deg=sigma, offset_deviation=None, log_bayes_factor=None, reason=reason))
    return tuple(out)


def _angle_off(scene: PlanarScene, a: int, b: int, orthogonal: bool) -> tuple[float, float]:
    """Of two planes, from being orthogonal or parallel, and its standard deviation, degrees."""
    first, second = scene.normals[a], scene.normals[b]
    cross = np.cross(first, second)
    sine, cosine = float(np.linalg.norm(cross)), float(first @ second)
    angle = abs(float(np.arctan2(cosine, sine))) if orthogonal else float(np.arctan2(sine, abs(cosine)))
    axis = cross / sine if sine > 1e-9 else tangent_basis(first[None])[0, 0]
    slope = np.concatenate([-tangent_basis(first[None])[0] @ np.cross(axis, first), tangent_basis(second[None])[0] @ np.cross(axis, second)])
    columns = [3 * a, 3 * a + 1, 3 * b, 3 * b + 1]
    variance = float(slope @ scene.plane_covariance[np.ix_(columns, columns)] @ slope)
    return float(np.degrees(angle)), float(np.degrees(np.sqrt(max(variance, 0.0))))
