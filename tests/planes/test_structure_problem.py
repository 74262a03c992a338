from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from planewright.planes.evidence import CornerPriors
from planewright.planes.structure_constraints import StructureConstraints
from planewright.planes.structure_problem import EvidenceScale, StructureProblem, StructureState
from planewright.synthetic.structure_truth import EvidenceNoise, evidence_of, house_truth


def every_kind_of_term() -> tuple[StructureProblem, StructureState]:
    truth, rng = house_truth(), np.random.default_rng(0)
    evidence = evidence_of(truth, EvidenceNoise(), rng)
    priors = CornerPriors(np.array([3, 5]), truth.points[[3, 5]] + 0.01, rng.normal(size=(2, 3, 3)))
    direction = np.arange(len(truth.normals))
    direction[8] = 0  # two planes of one direction
    state = StructureState(np.delete(truth.normals, 8, axis=0), truth.offsets.copy(), truth.points.copy())
    direction[9:] -= 1
    given = StructureConstraints(
        angle_faces=np.array([[0, 3], [6, 7]]),
        angle_cosine=np.array([0.0, 0.1]),
        equal_length=np.array([[0, 1, 2, 3], [0, 1, 1, 4]]),
        across_face=np.array([3]),
        across_vector=np.array([[0.0, 0.0, 1.0]]),
        across_edge=np.array([[0, 2, 3]]),
        along_edge=np.array([[5, 4, 6]]),
        mirror=np.array([[6, 7, 0], [3, 5, 9]]),
    )
    problem = StructureProblem(direction, truth.incidences, replace(evidence, priors=priors), given, state, 1e-4, 3.0, EvidenceScale(1.5, 2.0, 1.2, 0.7))
    moved = problem.move(state, 0.02 * rng.normal(size=problem.num_unknowns))
    return problem, moved


def test_the_jacobian_of_the_constraints_is_their_derivative() -> None:
    problem, state = every_kind_of_term()
    jacobian, step = problem.constraint_jacobian(state), 1e-6
    assert jacobian.shape == (len(problem.constraints(state)), problem.num_unknowns)
    for k in range(problem.num_unknowns):
        nudge = np.zeros(problem.num_unknowns)
        nudge[k] = step
        slope = (problem.constraints(problem.move(state, nudge)) - problem.constraints(problem.move(state, -nudge))) / (2 * step)
        assert_allclose(jacobian[:, k], slope, atol=1e-7)


def test_the_gradient_is_the_derivative_of_the_cost() -> None:
    problem, state = every_kind_of_term()
    gradient, hessian = problem.normal_equations(state)
    for k in range(problem.num_unknowns):
        step = 1e-4 / np.sqrt(hessian[k, k])
        nudge = np.zeros(problem.num_unknowns)
        nudge[k] = step
        slope = (problem.cost(problem.move(state, nudge)) - problem.cost(problem.move(state, -nudge))) / (2 * step)
        assert_allclose(gradient[k] / np.sqrt(hessian[k, k]), slope / np.sqrt(hessian[k, k]), atol=1e-3)
    assert np.linalg.eigvalsh(hessian)[0] > 0.0


def test_a_corner_behind_its_camera_costs_much_and_stays_finite() -> None:
    problem, state = every_kind_of_term()
    behind = replace(state, points=state.points - 100.0 * np.array([0.0, 1.0, 0.0]))
    assert np.isfinite(problem.cost(behind))
    assert problem.cost(behind) > problem.cost(state)
    gradient, hessian = problem.normal_equations(behind)
    assert np.isfinite(gradient).all() and np.isfinite(hessian).all()
