from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from planewright.arrays import Float
from planewright.geometry.plane import tangent_basis
from planewright.planes.evidence import Evidence
from planewright.planes.planar_start import PlanarStart
from planewright.planes.structure_constraints import StructureConstraints
from planewright.planes.structured_bundle import StructureOptions, StructureSolution, solve_structure
from planewright.synthetic.structure_truth import EvidenceNoise, StructureTruth, boxes_truth, evidence_of, house_truth, start_of

HOUSE, BOXES = house_truth(), boxes_truth()
ROW = {face.id: f for f, face in enumerate(HOUSE.sketch.faces)}
POINT = {point.id: i for i, point in enumerate(HOUSE.sketch.points)}
TRUE_RELATIONS = StructureConstraints(
    same_direction=np.array([[ROW["front"], ROW["chimney_front"]], [ROW["left"], ROW["right_gable"]], [ROW["chimney_left"], ROW["chimney_right"]]]),
    same_plane=np.array([[ROW["front"], ROW["wing_front"]], [ROW["left"], ROW["left_gable"]]]),
    angle_faces=np.array([[ROW["front"], ROW["left"]], [ROW["roof_front"], ROW["roof_back"]]]),
    angle_cosine=np.array([0.0, abs(HOUSE.normals[ROW["roof_front"]] @ HOUSE.normals[ROW["roof_back"]])]),
)


def simulated(truth: StructureTruth, seed: int, noise: EvidenceNoise = EvidenceNoise()) -> tuple[PlanarStart, Evidence]:
    rng = np.random.default_rng(seed)
    evidence = evidence_of(truth, noise, rng)
    return start_of(truth, rng), evidence


def incidences(truth: StructureTruth) -> np.ndarray:
    return np.concatenate([truth.incidences, truth.attached])


def plane_errors(truth: StructureTruth, found: StructureSolution) -> Float[np.ndarray, "faces 3"]:
    """Tilts and offset at the found centre, as the covariance has them."""
    tilt = np.einsum("fkj,fj->fk", tangent_basis(found.normals), truth.normals)
    true_height = (truth.normals * found.centers).sum(axis=1) - truth.offsets
    return np.column_stack([tilt, -true_height])


def max_angle(a: StructureSolution, b: StructureSolution) -> float:
    return float(np.max(np.linalg.norm(np.cross(a.normals, b.normals), axis=1)))


@pytest.mark.parametrize("truth", [HOUSE, BOXES], ids=["house", "boxes"])
def test_every_incidence_and_unit_length_is_exact(truth: StructureTruth) -> None:
    start, evidence = simulated(truth, 0)
    found = solve_structure(start, incidences(truth), evidence)
    assert found.converged and found.feasible
    face, corner = incidences(truth).T
    gap = (found.normals[face] * found.points[corner]).sum(axis=1) - found.offsets[face]
    assert np.abs(gap).max() < 1e-13 * truth.diagonal * 10
    assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0, atol=1e-14)
    assert ((found.normals * truth.normals).sum(axis=1) > 0.99).all()


def test_relations_are_exact_and_make_normals_better() -> None:
    better = []
    for seed in range(4):
        start, evidence = simulated(HOUSE, seed)
        free = solve_structure(start, incidences(HOUSE), evidence)
        found = solve_structure(start, incidences(HOUSE), evidence, TRUE_RELATIONS)
        assert found.feasible
        n, d = found.normals, found.offsets
        for a, b in TRUE_RELATIONS.same_direction:
            assert_allclose(np.cross(n[a], n[b]), 0.0, atol=1e-14)
        for a, b in TRUE_RELATIONS.same_plane:
            assert_allclose(np.append(n[a], d[a]), np.append(n[b], d[b]), atol=1e-12)
        for (a, b), cosine in zip(TRUE_RELATIONS.angle_faces, TRUE_RELATIONS.angle_cosine, strict=True):
            assert_allclose(abs(n[a] @ n[b]), cosine, atol=1e-12)
        assert found.cost > free.cost
        better.append(np.abs(plane_errors(HOUSE, found)[:, :2]).mean() / np.abs(plane_errors(HOUSE, free)[:, :2]).mean())
    assert np.mean(better) < 0.85


@pytest.mark.parametrize(("truth", "constraints"), [(HOUSE, StructureConstraints()), (HOUSE, TRUE_RELATIONS), (BOXES, StructureConstraints())])
def test_honest_sigmas_give_honest_uncertainty(truth: StructureTruth, constraints: StructureConstraints) -> None:
    squared = []
    for seed in range(12):
        start, evidence = simulated(truth, seed)
        found = solve_structure(start, incidences(truth), evidence, constraints)
        error, block = plane_errors(truth, found), found.plane_covariance.reshape(len(found.normals), 3, len(found.normals), 3)
        for f in range(len(found.normals)):
            squared.append(error[f] @ np.linalg.solve(block[f, :, f], error[f]) / 3)
        corner = found.points - truth.points
        squared += [e @ np.linalg.pinv(c, rcond=1e-9) @ e / 3 for e, c in zip(corner, found.point_covariance, strict=True)]
    # The Cauchy loss makes the claimed variance about a tenth too large.
    assert 0.75 < np.mean(squared) < 1.2


def test_the_scene_s_unit_place_and_turn_do_not_matter() -> None:
    start, evidence = simulated(HOUSE, 1)
    plain = solve_structure(start, incidences(HOUSE), evidence, TRUE_RELATIONS)
    scale, shift = 1234.5, np.array([3e4, -2e4, 5e3])
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    back = np.vstack([np.column_stack([turn.T / scale, -turn.T @ shift / scale]), [0.0, 0.0, 0.0, 1.0]])
    points, marks, lines = evidence.plane_points, evidence.marks, evidence.lines
    moved_evidence = Evidence(
        replace(points, point=scale * points.point @ turn.T + shift, sigma=scale * points.sigma),
        replace(marks, projection=marks.projection @ back),
        replace(lines, direction=lines.direction @ turn.T, offset=scale * lines.offset + lines.direction @ turn.T @ shift, sigma=scale * lines.sigma),
        evidence.priors,
    )
    normals = start.normals @ turn.T
    moved_start = replace(start, points=scale * start.points @ turn.T + shift, normals=normals, offsets=scale * start.offsets + normals @ shift)
    moved = solve_structure(moved_start, incidences(HOUSE), moved_evidence, TRUE_RELATIONS)
    assert_allclose(moved.cost, plain.cost, rtol=1e-6)
    assert_allclose((moved.points - shift) @ turn / scale, plain.points, atol=3e-6 * HOUSE.diagonal)
    assert_allclose(moved.normals @ turn, plain.normals, atol=1e-5)
    assert_allclose(moved.normal_sigma, plain.normal_sigma, rtol=1e-3)


def test_an_independent_solver_with_penalties_agrees() -> None:
    start, evidence = simulated(HOUSE, 2)
    links = incidences(HOUSE)
    found = solve_structure(start, links, evidence, options=StructureOptions(loss_scale=np.inf, step_tolerance=1e-9))
    faces, corners = len(HOUSE.normals), len(HOUSE.points)

    def residuals(x: Float[np.ndarray, "n"], penalty: float) -> Float[np.ndarray, "m"]:
        normal, offset, point = x[: 3 * faces].reshape(-1, 3), x[3 * faces : 4 * faces], x[4 * faces :].reshape(-1, 3)
        given, marks, lines = evidence.plane_points, evidence.marks, evidence.lines
        seen = np.einsum("tij,tj->ti", marks.projection, np.column_stack([point[marks.corner], np.ones(corners)]))
        return np.concatenate(
            [
                ((normal[given.face] * given.point).sum(axis=1) - offset[given.face]) / given.sigma,
                ((seen[:, :2] / seen[:, 2:] - marks.xy) / marks.sigma[:, None]).ravel(),
                ((lines.direction * point[lines.corner]).sum(axis=1) - lines.offset) / lines.sigma,
                penalty * ((normal[links[:, 0]] * point[links[:, 1]]).sum(axis=1) - offset[links[:, 0]]),
                penalty * ((normal**2).sum(axis=1) - 1.0),
                # The drawing forces window and door into the front.
                *(penalty * (np.append(normal[f], offset[f]) - np.append(normal[0], offset[0])) for f in (ROW["window"], ROW["door"])),
            ]
        )

    best = np.concatenate([found.normals.ravel(), found.offsets, found.points.ravel()])
    other = least_squares(residuals, best + 1e-3 * np.random.default_rng(0).normal(size=len(best)), args=(1e6,), xtol=1e-14, ftol=1e-14, max_nfev=30)
    assert_allclose(other.cost, found.cost, rtol=1e-4)
    assert_allclose(other.x[3 * faces + faces :].reshape(corners, 3), found.points, atol=2e-4 * HOUSE.diagonal)


def test_a_start_far_off_leads_to_the_same_optimum() -> None:
    _, evidence = simulated(HOUSE, 3)
    near = solve_structure(start_of(HOUSE, np.random.default_rng(0), 0.001, 0.2), incidences(HOUSE), evidence)
    far = solve_structure(start_of(HOUSE, np.random.default_rng(1), 0.03, 12.0), incidences(HOUSE), evidence)
    assert_allclose(far.cost, near.cost, rtol=1e-5)
    assert max_angle(far, near) < np.radians(0.01)


def test_saying_a_relation_four_times_changes_nothing() -> None:
    start, evidence = simulated(HOUSE, 4)
    once = solve_structure(start, incidences(HOUSE), evidence, TRUE_RELATIONS)
    often = StructureConstraints(
        same_direction=np.tile(TRUE_RELATIONS.same_direction, (4, 1)),
        same_plane=np.tile(TRUE_RELATIONS.same_plane, (4, 1)),
        angle_faces=np.tile(TRUE_RELATIONS.angle_faces, (4, 1)),
        angle_cosine=np.tile(TRUE_RELATIONS.angle_cosine, 4),
    )
    again = solve_structure(start, incidences(HOUSE), evidence, often)
    assert again.feasible and again.num_redundant >= 6
    assert max_angle(again, once) < 1e-7
    assert_allclose(again.covariance, once.covariance, atol=1e-9)


def test_contradictory_relations_are_reported_and_nothing_breaks() -> None:
    start, evidence = simulated(HOUSE, 5)
    a, b, c = ROW["front"], ROW["chimney_front"], ROW["dormer_front"]
    wrong = StructureConstraints(same_direction=np.array([[a, b], [b, c]]), angle_faces=np.array([[a, c]]), angle_cosine=np.zeros(1))
    found = solve_structure(start, incidences(HOUSE), evidence, wrong)
    assert not found.feasible
    assert found.violation > 0.1
    assert np.isfinite(found.points).all() and np.isfinite(found.normals).all()


def test_what_no_evidence_holds_is_unknown_and_harms_nothing() -> None:
    start, evidence = simulated(BOXES, 6, EvidenceNoise(bare=0.0))
    whole = solve_structure(start, BOXES.incidences, evidence)
    row = {face.id: f for f, face in enumerate(BOXES.sketch.faces)}
    gone_face = row["d_top"]
    gone = BOXES.incidences[BOXES.incidences[:, 0] == gone_face, 1]
    points, marks, lines = evidence.plane_points, evidence.marks, evidence.lines
    keep, keep_marks, keep_lines = points.face != gone_face, ~np.isin(marks.corner, gone), ~np.isin(lines.corner, gone)
    less = Evidence(
        replace(points, face=points.face[keep], point=points.point[keep], sigma=points.sigma[keep]),
        replace(marks, corner=marks.corner[keep_marks], projection=marks.projection[keep_marks], xy=marks.xy[keep_marks], sigma=marks.sigma[keep_marks]),
        replace(lines, corner=lines.corner[keep_lines], direction=lines.direction[keep_lines], offset=lines.offset[keep_lines], sigma=lines.sigma[keep_lines]),
        evidence.priors,
    )
    known = np.ones(len(start.points), dtype=bool)
    known[gone] = False
    faces_known = np.ones(len(start.normals), dtype=bool)
    faces_known[gone_face] = False
    holes = replace(
        start,
        points=np.where(known[:, None], start.points, np.nan),
        point_known=known,
        normals=np.where(faces_known[:, None], start.normals, np.nan),
        offsets=np.where(faces_known, start.offsets, np.nan),
        face_known=faces_known,
    )
    found = solve_structure(holes, BOXES.incidences, less)
    assert found.feasible and np.isfinite(found.covariance).all() and np.isfinite(found.points).all()
    assert not found.face_known[gone_face]
    others = [f for name, f in row.items() if not name.startswith("d_")]
    assert found.face_known[others].all()
    assert_allclose(found.normals[others], whole.normals[others], atol=np.radians(0.5))
    assert set(np.flatnonzero(~found.point_known).tolist()) <= set(gone.tolist())


def test_no_evidence_at_all_is_all_unknown() -> None:
    start, evidence = simulated(HOUSE, 7)
    points, marks, lines = evidence.plane_points, evidence.marks, evidence.lines
    none = Evidence(
        replace(points, face=points.face[:0], point=points.point[:0], sigma=points.sigma[:0]),
        replace(marks, corner=marks.corner[:0], projection=marks.projection[:0], xy=marks.xy[:0], sigma=marks.sigma[:0]),
        replace(lines, corner=lines.corner[:0], direction=lines.direction[:0], offset=lines.offset[:0], sigma=lines.sigma[:0]),
        evidence.priors,
    )
    for known in (True, False):
        flags = replace(start, point_known=np.full(len(start.points), known), face_known=np.full(len(start.normals), known))
        found = solve_structure(flags, HOUSE.incidences, none)
        assert not found.point_known.any() and not found.face_known.any()
        assert np.isfinite(found.points).all() and np.isfinite(found.covariance).all()


def test_other_relations_hold_exactly() -> None:
    start, evidence = simulated(HOUSE, 8)
    up = np.array([0.0, 0.0, 1.0])
    constraints = StructureConstraints(
        equal_length=np.array([[POINT["FL"], POINT["eFL"], POINT["BL"], POINT["eBL"]]]),
        across_face=np.array([ROW["front"]]),
        across_vector=up[None],
        across_edge=np.array([[ROW["left"], POINT["bfr"], POINT["tfr"]]]),
        along_edge=np.array([[ROW["chimney_top"], POINT["cb1"], POINT["ct1"]]]),
    )
    found = solve_structure(start, incidences(HOUSE), evidence, constraints)
    assert found.feasible
    n, x = found.normals, found.points
    length = [np.linalg.norm(x[POINT[a]] - x[POINT[b]]) for a, b in (("FL", "eFL"), ("BL", "eBL"))]
    assert_allclose(length[0], length[1], rtol=1e-12)
    assert_allclose(n[ROW["front"]] @ up, 0.0, atol=1e-12)
    assert_allclose(n[ROW["left"]] @ (x[POINT["tfr"]] - x[POINT["bfr"]]), 0.0, atol=1e-12)
    assert_allclose(np.cross(n[ROW["chimney_top"]], x[POINT["ct1"]] - x[POINT["cb1"]]), 0.0, atol=1e-12)


def test_planes_mirror_each_other_in_a_third() -> None:
    # The roofs are mirror images in the upright plane through the ridge. No face lies there; the chimney's front, a little before it, is pulled onto it.
    start, evidence = simulated(HOUSE, 9)
    a, b, c = ROW["roof_front"], ROW["roof_back"], ROW["chimney_front"]
    keep = evidence.plane_points.face != c
    points = evidence.plane_points
    free_c = replace(evidence, plane_points=replace(points, face=points.face[keep], point=points.point[keep], sigma=points.sigma[keep]))
    found = solve_structure(start, HOUSE.incidences, free_c, StructureConstraints(mirror=np.array([[a, b, c]])))
    assert found.feasible
    n, d = found.normals, found.offsets
    mirrored = n[a] - 2.0 * (n[a] @ n[c]) * n[c]
    assert_allclose(np.cross(mirrored, n[b]), 0.0, atol=1e-12)
    assert_allclose((mirrored @ n[b]) * d[b], d[a] - 2.0 * (n[a] @ n[c]) * d[c], atol=1e-12 * HOUSE.diagonal)


def test_understated_sigmas_are_noticed() -> None:
    estimates = []
    for seed in range(4):
        start, evidence = simulated(HOUSE, seed, EvidenceNoise(understated=2.0, bare=0.0, line_share=1.0))
        estimates.append(solve_structure(start, incidences(HOUSE), evidence).estimated_scale)
    assert 1.5 < np.mean([scale.lines for scale in estimates]) < 2.5
    assert 1.4 < np.mean([scale.marks for scale in estimates]) < 2.6


def test_two_gross_errors_move_little() -> None:
    start, evidence = simulated(HOUSE, 10)
    clean = solve_structure(start, incidences(HOUSE), evidence)
    xy = evidence.marks.xy.copy()
    xy[[POINT["eFR"], POINT["ct2"]]] += [[40.0, -25.0], [-30.0, 50.0]]
    dirty = solve_structure(start, incidences(HOUSE), replace(evidence, marks=replace(evidence.marks, xy=xy)))
    assert max_angle(clean, dirty) < np.radians(1.0)
    assert dirty.point_residual[POINT["eFR"]] > 8.0


def test_the_same_call_gives_the_same_bits() -> None:
    start, evidence = simulated(BOXES, 11)
    one, two = (solve_structure(start, incidences(BOXES), evidence) for _ in range(2))
    assert one.points.tobytes() == two.points.tobytes() and one.covariance.tobytes() == two.covariance.tobytes()
