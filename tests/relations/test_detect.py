from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.planes.structure_constraints import Groups
from planewright.planes.structured_bundle import StructureSolution, solve_structure
from planewright.relations.detect import PAIR_KINDS, Detection, DetectOptions, Pair, detect_relations, weigh_pairs
from planewright.sketch.graph import FaceId
from planewright.synthetic.structure_truth import EvidenceNoise, StructureTruth, boxes_truth, evidence_of, house_truth, renumbered, start_of, yard_truth

Pairs = dict[str, set[frozenset[FaceId]]]


def solved(truth: StructureTruth, seed: int, noise: EvidenceNoise = EvidenceNoise()) -> StructureSolution:
    rng = np.random.default_rng(seed)
    evidence = evidence_of(truth, noise, rng)
    return solve_structure(start_of(truth, rng), np.concatenate([truth.incidences, truth.attached]), evidence)


def closed(truth: StructureTruth, solution: StructureSolution, found: Detection) -> Pairs:
    """What was accepted, and what follows from it."""
    count = len(truth.normals)
    direction, plane, crossed = Groups(count), Groups(count), []
    for f in range(count):
        direction.join(f, int(solution.face_direction[f]))
        plane.join(f, int(solution.face_plane[f]))
    for test in found.accepted:
        if test.kind == "orthogonal":
            crossed.append((test.a, test.b))
            continue
        direction.join(test.a, test.b)
        if test.kind == "coplanar":
            plane.join(test.a, test.b)
    roots = {frozenset((direction.root(a), direction.root(b))) for a, b in crossed}
    out: Pairs = {kind: set() for kind in PAIR_KINDS}
    for a, first in enumerate(truth.sketch.faces):
        for b, second in enumerate(truth.sketch.faces[:a]):
            pair = frozenset((first.id, second.id))
            if direction.root(a) == direction.root(b):
                out["parallel"].add(pair)
            if frozenset((direction.root(a), direction.root(b))) in roots:
                out["orthogonal"].add(pair)
            if plane.root(a) == plane.root(b):
                out["coplanar"].add(pair)
    return out


def precision_and_recall(truths: Iterable[StructureTruth], noise: EvidenceNoise, seeds: int) -> tuple[float, float]:
    right = wrong = missed = 0
    for truth in truths:
        for seed in range(seeds):
            solution = solved(truth, seed, noise)
            found = closed(truth, solution, detect_relations(solution))
            for kind in PAIR_KINDS:
                wanted = truth.pairs(kind)
                right, wrong, missed = right + len(found[kind] & wanted), wrong + len(found[kind] - wanted), missed + len(wanted - found[kind])
    return right / (right + wrong), right / (right + missed)


@pytest.mark.parametrize("decoy", [4.0, 6.0, 8.0])
def test_true_relations_are_found_and_near_misses_left_alone(decoy: float) -> None:
    precision, recall = precision_and_recall([house_truth(decoy), boxes_truth(decoy)], EvidenceNoise(), seeds=4)
    assert precision >= (0.99 if decoy == 4.0 else 0.998)
    assert recall >= 0.96


def test_a_near_miss_of_two_degrees_is_seen_where_the_evidence_can_tell() -> None:
    good = EvidenceNoise(tilt_deg=(0.1, 0.5), click=0.5, line=0.25, bare=0.0)
    precision, recall = precision_and_recall([house_truth(2.0), boxes_truth(2.0)], good, seeds=3)
    assert precision == 1.0
    assert recall >= 0.98


def test_many_faces_do_not_talk_each_other_into_errors() -> None:
    precision, recall = precision_and_recall([yard_truth()], EvidenceNoise(), seeds=3)
    assert precision >= 0.985
    assert recall >= 0.93


def test_a_tenth_of_a_degree_of_building_error_does_not_matter() -> None:
    precision, recall = precision_and_recall([house_truth(), boxes_truth()], EvidenceNoise(as_built_deg=0.1), seeds=4)
    assert precision >= 0.995
    assert recall >= 0.95


def test_overconfident_evidence_costs_relations_not_truth() -> None:
    precision, recall = precision_and_recall([house_truth(), boxes_truth()], EvidenceNoise(understated=1.5), seeds=4)
    assert precision >= 0.99
    assert recall >= 0.85


@pytest.mark.parametrize("seed", range(3))
def test_the_numbering_of_faces_does_not_matter(seed: int) -> None:
    truth = house_truth()
    rng = np.random.default_rng(seed)
    evidence, start = evidence_of(truth, EvidenceNoise(), rng), start_of(truth, rng)
    plain = solve_structure(start, np.concatenate([truth.incidences, truth.attached]), evidence)
    other, moved_evidence, moved_start = renumbered(truth, evidence, start, rng)
    moved = solve_structure(moved_start, np.concatenate([other.incidences, other.attached]), moved_evidence)
    one, two = detect_relations(plain), detect_relations(moved)

    def named(found: Detection) -> list[tuple[str, int]]:
        return [(test.kind, round(test.log_bayes_factor, 1)) for test in found.accepted]

    assert closed(truth, plain, one) == closed(other, moved, two)
    assert [kind for kind, _ in named(one)] == [kind for kind, _ in named(two)]
    assert_allclose([factor for _, factor in named(one)], [factor for _, factor in named(two)], atol=0.15)


def test_an_uncertain_face_does_not_bridge_two_directions() -> None:
    # A face known to 3 degrees between two that are 6 degrees apart and known to .1: pairwise both would pass, and closure would join all three.
    truth = boxes_truth(6.0)
    row = {face.id: f for f, face in enumerate(truth.sketch.faces)}
    good = EvidenceNoise(tilt_deg=(0.1, 0.1), bare=0.0, click=0.2, line=0.1)
    solution = solved(truth, 0, good)
    a, b, bridge = row["a_front"], row["b_front"], row["c_front"]
    normals = solution.normals.copy()
    normals[bridge] = normals[a] + normals[b]
    normals[bridge] /= np.linalg.norm(normals[bridge])
    covariance = solution.covariance.copy()
    at = 3 * bridge + np.arange(3)
    covariance[at, :] = covariance[:, at] = 0.0
    covariance[at, at] = [np.radians(3.0) ** 2, np.radians(3.0) ** 2, solution.diagonal**2 * 1e-4]
    found = detect_relations(replace(solution, normals=normals, covariance=covariance), DetectOptions(max_sigma_deg=10.0))
    joined = Groups(len(normals))
    for test in found.accepted:
        if test.kind == "parallel":
            joined.join(test.a, test.b)
    assert joined.root(a) != joined.root(b)


def test_forbidden_relations_come_about_in_no_way() -> None:
    truth = house_truth()
    row = {face.id: f for f, face in enumerate(truth.sketch.faces)}
    solution = solved(truth, 1, EvidenceNoise(bare=0.0))
    forbidden: list[Pair] = [
        ("parallel", row["left"], row["chimney_right"]),
        ("orthogonal", row["front"], row["wing_roof"]),
        ("coplanar", row["front"], row["wing_front"]),
    ]
    found = closed(truth, solution, detect_relations(solution, forbidden=forbidden))
    for kind, a, b in forbidden:
        assert frozenset((truth.sketch.faces[a].id, truth.sketch.faces[b].id)) not in found[kind]
    assert len(found["parallel"]) > 10


def test_uncertain_pairs_are_shown_and_not_applied() -> None:
    truth = house_truth()
    solution = solved(truth, 2)
    blurred = replace(solution, covariance=solution.covariance * 25.0**2)
    found = detect_relations(blurred)
    assert all(np.degrees(test.sigma) <= 1.5 for test in found.accepted if test.kind != "coplanar")
    assert any(found.ambiguous)
    for test, unclear in zip(found.refused, found.ambiguous, strict=True):
        if unclear:
            assert test.log_bayes_factor > -3.0


def test_weighing_true_pairs_is_calibrated() -> None:
    truth = house_truth()
    row = {face.id: f for f, face in enumerate(truth.sketch.faces)}
    pairs = {kind: np.array([sorted(row[face] for face in pair) for pair in sorted(truth.pairs(kind), key=sorted)]) for kind in ("parallel", "orthogonal")}
    ratio: dict[str, list[float]] = {"parallel": [], "orthogonal": []}
    for seed in range(10):
        solution = solved(truth, seed)
        for kind, freedom in (("parallel", 2), ("orthogonal", 1)):
            tests = weigh_pairs(solution, kind, pairs[kind])
            ratio[kind] += (tests.plain_wald / freedom).tolist()
    assert 0.6 < np.mean(ratio["parallel"]) < 1.3
    assert 0.6 < np.mean(ratio["orthogonal"]) < 1.3


def test_conditioning_brings_the_planes_closer_to_the_truth() -> None:
    truth = house_truth()
    before, after = [], []
    for seed in range(4):
        solution = solved(truth, seed)
        found = detect_relations(solution)
        before.append(np.linalg.norm(np.cross(solution.normals, truth.normals), axis=1).mean())
        after.append(np.linalg.norm(np.cross(found.normals, truth.normals), axis=1).mean())
    assert np.mean(after) < 0.6 * np.mean(before)
