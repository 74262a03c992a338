from dataclasses import replace

import numpy as np
import pytest

from planewright.planes.structure_constraints import StructureConstraints
from planewright.planes.structured_bundle import StructureOptions, StructureSolution, solve_structure
from planewright.relations.adjust import adjust_structure
from planewright.relations.supports import supported_corners
from planewright.sketch.graph import FaceId
from planewright.synthetic.structure_truth import EvidenceNoise, StructureTruth, boxes_truth, evidence_of, house_truth, start_of, yard_truth

AS_BUILT = 0.0005
"""Share of the diagonal."""


def solved(truth: StructureTruth, seed: int) -> StructureSolution:
    """By clicks, lines and planes, without any corner on a plane that it was not drawn on."""
    rng = np.random.default_rng(seed)
    evidence = evidence_of(truth, EvidenceNoise(), rng)
    return solve_structure(start_of(truth, rng), truth.incidences, evidence, StructureConstraints(), StructureOptions())


def found(truth: StructureTruth, solution: StructureSolution) -> set[tuple[int, int]]:
    return {(f, c) for f, c in supported_corners(solution, truth.incidences, AS_BUILT * solution.diagonal).tolist()}


def lifted(truth: StructureTruth, name: str, by: float) -> StructureTruth:
    """The same with the box of that name `by` above where it stood."""
    rows = [i for i, point in enumerate(truth.sketch.points) if point.id.startswith(name)]
    points = truth.points.copy()
    points[rows, 2] += by
    faces = [f for f, face in enumerate(truth.sketch.faces) if face.id.startswith(f"{name}_")]
    offsets = truth.offsets.copy()
    offsets[faces] += by * truth.normals[faces, 2]
    return replace(truth, points=points, offsets=offsets)


@pytest.mark.parametrize("truth", [boxes_truth(), yard_truth()], ids=["boxes", "yard"])
@pytest.mark.parametrize("seed", range(4))
def test_feet_are_put_on_the_ground_they_stand_on(truth: StructureTruth, seed: int) -> None:
    ground = [face.id for face in truth.sketch.faces].index(FaceId("ground"))
    standing = {c for f, c in truth.attached.tolist() if f == ground}
    here = {c for f, c in found(truth, solved(truth, seed)) if f == ground}
    assert len(here & standing) >= 0.8 * len(standing)
    assert here <= standing


@pytest.mark.parametrize("truth", [boxes_truth(), yard_truth(), house_truth()], ids=["boxes", "yard", "house"])
@pytest.mark.parametrize("seed", range(4))
def test_no_corner_is_put_on_a_plane_that_it_is_not_on(truth: StructureTruth, seed: int) -> None:
    for face, corner in found(truth, solved(truth, seed)):
        off = abs(truth.normals[face] @ truth.points[corner] - truth.offsets[face]) / truth.diagonal
        assert off < 1e-9, (truth.sketch.faces[face].id, truth.sketch.points[corner].id, off)


@pytest.mark.parametrize("by", [0.1, 0.2])
def test_a_box_that_hovers_over_the_ground_is_left_in_the_air(by: float) -> None:
    truth = lifted(boxes_truth(), "b", by)
    names = {truth.sketch.points[c].id for _, c in found(truth, solved(truth, 5))}
    assert names & {"a0", "a1", "c0", "c1"}
    assert not [name for name in names if name.startswith("b")]


def test_a_corner_of_uncertain_height_follows_the_others_and_only_them() -> None:
    # Box b's near corner is known to .12 only and lies two standard deviations too high: put on the ground that seven others stand on, left where none does.
    truth = boxes_truth()
    solution, row = solved(truth, 3), {point.id: i for i, point in enumerate(truth.sketch.points)}
    at, up = 3 * len(truth.normals) + 3 * row["b0"] + 2, 0.12
    points, covariance = solution.points.copy(), solution.covariance.copy()
    points[row["b0"], 2] += 2.0 * up
    covariance[at, at] += up**2
    vague = replace(solution, points=points, covariance=covariance)
    assert row["b0"] in {c for _, c in found(truth, vague)}
    others = [row[f"{box}{k}"] for box in "abc" for k in range(4) if f"{box}{k}" in row and f"{box}{k}" != "b0"]
    points = points.copy()
    points[others, 2] += np.linspace(0.05, 0.4, len(others))
    assert row["b0"] not in {c for _, c in found(truth, replace(vague, points=points))}


def test_the_adjustment_holds_feet_on_their_ground_exactly() -> None:
    truth = boxes_truth()
    rng = np.random.default_rng(6)
    result = adjust_structure(truth.sketch, start_of(truth, rng), evidence_of(truth, EvidenceNoise(), rng), np.zeros((0, 2), dtype=np.int64))
    ground = [face.id for face in truth.sketch.faces].index(FaceId("ground"))
    feet = [c for f, c in truth.attached.tolist() if f == ground and [f, c] in result.incidences.tolist()]
    assert len(feet) >= 8
    assert np.abs(result.scene.points[feet] @ result.scene.normals[ground] - result.scene.offsets[ground]).max() < 1e-12 * truth.diagonal
