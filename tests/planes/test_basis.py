"""What a structure rests on can be moved with the world: the solution moves with it."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.geometry.rigid import rotations_from_vectors
from planewright.planes.basis import Basis
from planewright.planes.evidence import CornerLines, CornerMarks, CornerPriors, Evidence, PlanePoints
from planewright.planes.held import Held
from planewright.planes.planar_start import PlanarStart
from planewright.planes.structure_constraints import StructureConstraints
from planewright.planes.structured_bundle import solve_structure


def square() -> tuple[PlanarStart, Basis]:
    """One square face and two cameras."""
    rng = np.random.default_rng(0)
    points = np.array([[0.0, 0, 5], [1, 0, 5], [1, 1, 5], [0, 1, 5]])
    k = np.array([[500.0, 0, 160], [0, 500, 90], [0, 0, 1]])
    poses = [np.column_stack([np.eye(3), [-0.5, -0.5, 0.0]]), np.column_stack([rotations_from_vectors(np.array([[0, 0.3, 0]]))[0], [-2.0, -0.5, 0.5]])]
    marks = [(i, k @ pose, (k @ pose @ np.append(p, 1))) for i, p in enumerate(points) for pose in poses]
    xy = np.array([m[2][:2] / m[2][2] for m in marks]) + rng.normal(0, 0.5, (len(marks), 2))
    evidence = Evidence(
        PlanePoints(np.zeros(5, int), np.column_stack([rng.uniform(0, 1, (5, 2)), 5 + rng.normal(0, 0.01, 5)]), np.full(5, 0.01)),
        CornerMarks(np.array([m[0] for m in marks]), np.array([m[1] for m in marks]), xy, np.ones(len(marks))),
        CornerLines(np.array([0, 1]), np.array([[0.0, 1, 0], [0, 1, 0]]), np.array([0.002, -0.001]), np.full(2, 0.004)),
        CornerPriors(np.array([2]), np.array([[1.0, 1, 5.01]]), 20.0 * np.eye(3)[None]),
    )
    start = PlanarStart(points, np.ones(4, bool), np.array([[0.0, 0, -1]]), np.array([-5.0]), np.ones(1, bool))
    incidences = np.array([[0, c] for c in range(4)])
    return start, Basis(evidence, incidences, StructureConstraints(), (1.0, 1.0, 1.0, 1.0))


def test_a_moved_basis_has_the_moved_solution_and_the_same_cost() -> None:
    start, basis = square()
    turn, scale = rotations_from_vectors(np.array([[0.4, -0.2, 0.7]]))[0], 3.5
    before = solve_structure(start, basis.incidences, basis.evidence)
    moved = basis.moved(turn, scale)
    there = PlanarStart(scale * start.points @ turn.T, start.point_known, start.normals @ turn.T, scale * start.offsets, start.face_known)
    after = solve_structure(there, moved.incidences, moved.evidence)
    assert_allclose(after.points, scale * before.points @ turn.T, atol=1e-5)
    assert_allclose(after.cost, before.cost, rtol=1e-5)


def test_what_is_held_stays_and_what_is_free_obeys_its_constraints() -> None:
    start, basis = square()
    start = PlanarStart(start.points + np.outer([0, 0, 1, 0], [0.05, 0.05, 0]), start.point_known, start.normals, start.offsets, start.face_known)
    held = Held(np.array([True, True, False, True]), np.array([True]))
    found = solve_structure(start, basis.incidences, basis.evidence, held=held)
    assert_allclose(found.points[[0, 1, 3]], start.points[[0, 1, 3]], atol=1e-12)
    assert np.linalg.norm(found.points[2] - start.points[2]) > 0.02
    assert abs(found.normals[0] @ found.points[2] - found.offsets[0]) < 1e-12


def test_a_firm_mark_outweighs_what_a_robust_one_gives_up_against() -> None:
    start, basis = square()
    marks = basis.evidence.marks
    off = marks.xy.copy()
    off[0] += [40.0, 0.0]
    robust = Evidence(basis.evidence.plane_points, CornerMarks(marks.corner, marks.projection, off, marks.sigma), basis.evidence.lines, basis.evidence.priors)
    firm_marks = CornerMarks(marks.corner, marks.projection, off, marks.sigma, np.arange(len(off)) == 0)
    firm = Evidence(basis.evidence.plane_points, firm_marks, basis.evidence.lines, basis.evidence.priors)

    def miss(evidence: Evidence) -> float:
        found = solve_structure(start, basis.incidences, evidence)
        seen = marks.projection[0] @ np.append(found.points[0], 1.0)
        return float(np.linalg.norm(seen[:2] / seen[2] - off[0]))

    assert miss(robust) > 35.0
    assert miss(firm) < 5.0
