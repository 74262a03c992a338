"""From a session back to a result: what was corrected is in all of it, and what was not is as before."""

from dataclasses import replace

import numpy as np
import pytest

from planewright.corrections.session import Mark, Model, Session, with_mark
from planewright.errors import UsageError
from planewright.geometry.plane import tangent_basis
from planewright.pipeline.corrected import corrected_result, refreshed
from planewright.pipeline.result import Result, document, to_json
from planewright.relations.adjacency import adjacent_faces
from planewright.synthetic.clip import SyntheticClip


def turned(result: Result, face: int, angle_deg: float) -> Result:
    """One face turned about the first row of its tangent basis."""
    scene = result.scene
    normals, angle = scene.normals.copy(), np.radians(angle_deg)
    normals[face] = np.cos(angle) * normals[face] + np.sin(angle) * np.cross(tangent_basis(normals[face : face + 1])[0, 0], normals[face])
    return replace(result, structure=replace(result.structure, scene=replace(scene, normals=normals)))


def test_angles_and_relations_are_those_of_the_corrected_model(true_result: Result) -> None:
    straight = turned(true_result, 0, 2.0)
    structure = refreshed(straight.structure, true_result.structure)
    assert structure.adjacency == adjacent_faces(straight.scene.sketch, straight.scene)
    assert structure.adjacency != adjacent_faces(true_result.scene.sketch, true_result.scene)
    enforced, released = structure.relations
    assert enforced == true_result.structure.relations[0]
    normals = straight.scene.normals
    rows = straight.scene.face_row()
    a, b = (rows[face] for face in released.faces)
    assert released.deviation_deg == pytest.approx(abs(90.0 - np.degrees(np.arccos(normals[a] @ normals[b]))), abs=1e-6)
    assert released.sigma_deg == pytest.approx(np.degrees(np.sqrt(2e-6)), rel=1e-3)
    assert released.reason.startswith(f"{released.deviation_deg:.2f} deg")


def test_relations_of_faces_that_did_not_move_keep_their_figures(true_result: Result) -> None:
    assert refreshed(true_result.structure, true_result.structure).relations == true_result.structure.relations


def test_a_result_with_corrections_is_whole(true_result: Result, scene_clip: SyntheticClip) -> None:
    point = true_result.scene.sketch.points[0]
    mark = Mark(point.id, 5, (12.0, 34.0))
    sketch = with_mark(true_result.scene.sketch, mark)
    structure = replace(true_result.structure, scene=replace(true_result.scene, sketch=sketch))
    session = Session(scene_clip.frames, sketch, true_result.tracks, Model(true_result.cameras, structure), (mark,))
    result = corrected_result(session, true_result)
    assert document(result)["report"]["corrections"] == document(true_result)["report"]["corrections"] + 1
    assert result.tracks is true_result.tracks
    assert result.model.unit == true_result.model.unit
    assert to_json(document(result)) == to_json(document(corrected_result(session, true_result)))


def test_corrections_without_a_model_give_no_result(true_result: Result, scene_clip: SyntheticClip) -> None:
    with pytest.raises(UsageError, match="no model"):
        corrected_result(Session(scene_clip.frames, true_result.scene.sketch, true_result.tracks, None), true_result)
