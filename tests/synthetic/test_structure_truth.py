import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.synthetic.structure_truth import EvidenceNoise, StructureTruth, boxes_truth, evidence_of, house_truth


@pytest.mark.parametrize("truth", [house_truth(), boxes_truth()], ids=["house", "boxes"])
def test_corners_lie_on_their_planes_and_normals_point_to_some_camera(truth: StructureTruth) -> None:
    for face, corner in (*truth.incidences.tolist(), *truth.attached.tolist()):
        assert_allclose(truth.normals[face] @ truth.points[corner], truth.offsets[face], atol=1e-12)
    centers = -np.linalg.solve(truth.projections[:, :, :3], truth.projections[:, :, 3:])[:, :, 0]
    assert ((centers @ truth.normals.T - truth.offsets).max(axis=0) > 0.0).all()


def test_the_near_miss_is_no_relation_and_the_rest_is() -> None:
    truth = house_truth(wing_deg=2.0)
    assert len(truth.pairs("parallel")) == 25
    assert len(truth.pairs("coplanar")) == 7
    assert not any("wing_right" in pair for pair in truth.pairs("parallel"))


def test_evidence_is_as_noisy_as_it_claims() -> None:
    truth = house_truth()
    squares = {"points": [], "marks": [], "lines": []}
    for seed in range(20):
        evidence = evidence_of(truth, EvidenceNoise(), np.random.default_rng(seed))
        given = evidence.plane_points
        squares["points"].append(((truth.normals[given.face] * given.point).sum(axis=1) - truth.offsets[given.face]) / given.sigma)
        marks = evidence.marks
        seen = np.einsum("tij,tj->ti", marks.projection[:, :, :3], truth.points[marks.corner]) + marks.projection[:, :, 3]
        squares["marks"].append(((seen[:, :2] / seen[:, 2:] - marks.xy) / marks.sigma[:, None]).ravel())
        lines = evidence.lines
        squares["lines"].append(((lines.direction * truth.points[lines.corner]).sum(axis=1) - lines.offset) / lines.sigma)
    for kind, values in squares.items():
        assert_allclose(np.mean(np.concatenate(values) ** 2), 1.0, rtol=0.15, err_msg=kind)
