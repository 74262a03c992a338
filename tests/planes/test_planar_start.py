from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from planewright.planes.planar_start import complete_start
from planewright.synthetic.structure_truth import EvidenceNoise, evidence_of, house_truth, start_of

TRUTH = house_truth()


def test_known_values_stay_as_they_are() -> None:
    rng = np.random.default_rng(0)
    start = start_of(TRUTH, rng)
    full = complete_start(start, TRUTH.incidences, evidence_of(TRUTH, EvidenceNoise(), rng))
    assert_allclose(full.points, start.points)
    assert_allclose(full.normals, start.normals, atol=1e-15)
    assert_array_equal(full.point_known, start.point_known)


def test_planes_come_from_their_points_and_corners_from_where_planes_and_clicks_meet() -> None:
    rng = np.random.default_rng(1)
    evidence = evidence_of(TRUTH, EvidenceNoise(tilt_deg=(0.05, 0.1), bare=0.0, click=0.2), rng)
    nothing = replace(
        start_of(TRUTH, rng),
        points=np.full_like(TRUTH.points, np.nan),
        point_known=np.zeros(len(TRUTH.points), dtype=bool),
        normals=np.full_like(TRUTH.normals, np.nan),
        offsets=np.full_like(TRUTH.offsets, np.nan),
        face_known=np.zeros(len(TRUTH.normals), dtype=bool),
    )
    full = complete_start(nothing, TRUTH.incidences, evidence)
    assert ((full.normals * TRUTH.normals).sum(axis=1) > np.cos(np.radians(1.0))).all()
    assert np.linalg.norm(full.points - TRUTH.points, axis=1).max() < 0.01 * TRUTH.diagonal


def test_a_bare_plane_comes_from_its_known_corners() -> None:
    rng = np.random.default_rng(2)
    evidence = evidence_of(TRUTH, EvidenceNoise(), rng)
    keep = evidence.plane_points.face != 0
    given = evidence.plane_points
    bare = replace(evidence, plane_points=replace(given, face=given.face[keep], point=given.point[keep], sigma=given.sigma[keep]))
    known = np.ones(len(TRUTH.normals), dtype=bool)
    known[0] = False
    full = complete_start(replace(start_of(TRUTH, rng, 1e-4), face_known=known), TRUTH.incidences, bare)
    assert full.normals[0] @ TRUTH.normals[0] > np.cos(np.radians(0.5))
    assert not full.face_known[0]
