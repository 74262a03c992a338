from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from planewright.planes.structured_bundle import solve_structure
from planewright.relations.adjacency import adjacent_faces
from planewright.synthetic.structure_truth import EvidenceNoise, boxes_truth, evidence_of, house_truth, start_of

PRECISE = EvidenceNoise(tilt_deg=(0.001, 0.002), bare=0.0, click=0.001, line=0.001)


def test_a_box_has_right_angles_and_a_door_is_flat_in_its_wall() -> None:
    for truth, pair, angle in (
        (boxes_truth(), ("a_front", "a_right"), 90.0),
        (house_truth(), ("front", "door"), 180.0),
        (house_truth(), ("roof_front", "roof_back"), 96.0),
    ):
        rng = np.random.default_rng(0)
        solution = solve_structure(start_of(truth, rng), truth.incidences, evidence_of(truth, PRECISE, rng))
        meeting = next(found for found in adjacent_faces(truth.sketch, solution) if set(found.faces) == set(pair))
        assert_allclose(meeting.dihedral_deg, angle, atol=0.02)
        inside_out = replace(solution, normals=-solution.normals, offsets=-solution.offsets)
        again = next(found for found in adjacent_faces(truth.sketch, inside_out) if set(found.faces) == set(pair))
        assert_allclose(again.dihedral_deg, meeting.dihedral_deg, atol=1e-9)


def test_every_shared_edge_is_listed_once_and_open_chains_are_not_closed() -> None:
    truth, rng = house_truth(), np.random.default_rng(1)
    solution = solve_structure(start_of(truth, rng), truth.incidences, evidence_of(truth, EvidenceNoise(), rng))
    found = adjacent_faces(truth.sketch, solution)
    keys = [(frozenset(meeting.faces), frozenset(meeting.edge)) for meeting in found]
    assert len(keys) == len(set(keys))
    # The window's four edges are those of the hole in the front.
    assert sum(set(meeting.faces) == {"front", "window"} for meeting in found) == 4
    opened = replace(truth.sketch, faces=tuple(replace(face, open=face.id == "window") for face in truth.sketch.faces))
    assert sum(set(meeting.faces) == {"front", "window"} for meeting in adjacent_faces(opened, solution)) == 3


def test_unknown_faces_have_no_neighbours() -> None:
    truth, rng = house_truth(), np.random.default_rng(2)
    solution = solve_structure(start_of(truth, rng), truth.incidences, evidence_of(truth, EvidenceNoise(), rng))
    unknown = replace(solution, face_known=np.arange(len(truth.normals)) != 0)
    assert not any("front" in meeting.faces for meeting in adjacent_faces(truth.sketch, unknown))
