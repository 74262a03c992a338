from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from planewright.arrays import Float
from planewright.optim.constrained import ConstrainedOptions, constrained_covariance, minimize_constrained

Vector = Float[np.ndarray, "n"]


@dataclass
class Quadrics:
    """Squared distance from a target, weighted, on the intersection of quadrics x' A x + b . x = c."""

    target: Vector
    weight: Vector
    quadrics: list[tuple[Float[np.ndarray, "n n"], Vector, float]] = field(default_factory=list)

    def cost(self, state: Vector) -> float:
        return float(0.5 * (self.weight * (state - self.target) ** 2).sum())

    def normal_equations(self, state: Vector) -> tuple[Vector, Float[np.ndarray, "n n"]]:
        return self.weight * (state - self.target), np.diag(self.weight)

    def constraints(self, state: Vector) -> Float[np.ndarray, "rows"]:
        return np.array([state @ a @ state + b @ state - c for a, b, c in self.quadrics])

    def constraint_jacobian(self, state: Vector) -> Float[np.ndarray, "rows n"]:
        return np.array([(a + a.T) @ state + b for a, b, _ in self.quadrics]).reshape(len(self.quadrics), len(state))

    def move(self, state: Vector, step: Vector) -> Vector:
        return state + step


def drawn(seed: int) -> Quadrics:
    rng = np.random.default_rng(seed)
    n, rows = 6, 3
    problem = Quadrics(rng.normal(size=n), rng.uniform(0.5, 2.0, n))
    for _ in range(rows):
        a = 0.2 * rng.normal(size=(n, n))
        inside = rng.normal(size=n)
        b = rng.normal(size=n)
        problem.quadrics.append((a, b, float(inside @ a @ inside + b @ inside)))
    return problem


def sphere(n: int, radius: float, center: Vector) -> tuple[Float[np.ndarray, "n n"], Vector, float]:
    return np.eye(n), -2.0 * center, float(radius**2 - center @ center)


TIGHT = ConstrainedOptions(step_tolerance=1e-10, max_iterations=200)


@pytest.mark.parametrize("seed", range(5))
def test_the_optimum_satisfies_the_constraints_and_has_no_slope_along_them(seed: int) -> None:
    problem = drawn(seed)
    found = minimize_constrained(problem, problem.target.copy(), TIGHT)
    assert found.feasible and found.converged
    assert found.violation < 1e-13
    gradient, _ = problem.normal_equations(found.state)
    jacobian = problem.constraint_jacobian(found.state)
    left = gradient - jacobian.T @ np.linalg.lstsq(jacobian.T, gradient, rcond=None)[0]
    assert_allclose(left, 0.0, atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_an_independent_solver_finds_nothing_better_nearby(seed: int) -> None:
    problem = drawn(seed)
    found = minimize_constrained(problem, problem.target.copy(), TIGHT)
    other = minimize(
        problem.cost,
        found.state + 0.05,
        jac=lambda x: problem.normal_equations(x)[0],
        method="SLSQP",
        constraints={"type": "eq", "fun": problem.constraints, "jac": problem.constraint_jacobian},
        options={"ftol": 1e-14, "maxiter": 300},
    )
    assert other.success
    assert_allclose(found.cost, other.fun, rtol=1e-8)
    assert_allclose(found.state, other.x, atol=1e-5)


def test_redundant_constraints_change_nothing() -> None:
    problem = drawn(1)
    once = minimize_constrained(problem, problem.target.copy(), TIGHT)
    scaled = [(2.0 * a, 2.0 * b, 2.0 * c) for a, b, c in problem.quadrics]
    many = Quadrics(problem.target, problem.weight, [*problem.quadrics, *scaled, *problem.quadrics])
    again = minimize_constrained(many, problem.target.copy(), TIGHT)
    assert again.feasible and again.num_redundant == 6 and once.num_redundant == 0
    assert_allclose(again.state, once.state, atol=1e-7)


def test_contradictory_constraints_end_with_the_rows_that_conflict() -> None:
    apart = [sphere(3, 1.0, np.zeros(3)), sphere(3, 1.0, np.array([5.0, 0.0, 0.0])), (np.zeros((3, 3)), np.array([0.0, 1.0, 0.0]), 0.3)]
    found = minimize_constrained(Quadrics(np.ones(3), np.ones(3), apart), np.ones(3))
    assert not found.feasible
    assert found.violation > 1.0
    assert set(found.conflicting.tolist()) == {0, 1}


def test_without_constraints_it_is_least_squares() -> None:
    problem = Quadrics(np.array([1.0, -2.0]), np.array([1.0, 4.0]))
    found = minimize_constrained(problem, np.array([5.0, 5.0]), TIGHT)
    assert_allclose(found.state, problem.target, atol=1e-9)
    assert_allclose(constrained_covariance(problem, found.state), np.diag([1.0, 0.25]), atol=1e-12)


def test_as_many_constraints_as_unknowns_leave_a_point_without_uncertainty() -> None:
    rows = [(np.zeros((2, 2)), np.array([1.0, 0.0]), 3.0), (np.zeros((2, 2)), np.array([0.0, 1.0]), 4.0)]
    problem = Quadrics(np.zeros(2), np.ones(2), rows)
    found = minimize_constrained(problem, np.zeros(2))
    assert_allclose(found.state, [3.0, 4.0], atol=1e-12)
    assert_allclose(constrained_covariance(problem, found.state), 0.0)


def test_the_covariance_is_that_of_the_estimate_under_noise() -> None:
    rng = np.random.default_rng(3)
    normal = np.array([1.0, 2.0, -1.0])
    rows = [(np.zeros((3, 3)), normal, 1.0)]
    weight = np.array([1e4, 4e4, 2e4])
    truth = np.array([1.0, 0.5, 1.0])
    estimates = []
    for _ in range(400):
        noisy = Quadrics(truth + rng.normal(size=3) / np.sqrt(weight), weight, rows)
        estimates.append(minimize_constrained(noisy, truth).state)
    claimed = constrained_covariance(Quadrics(truth, weight, rows), truth)
    assert_allclose(normal @ claimed @ normal, 0.0, atol=1e-18)
    assert_allclose(np.cov(np.array(estimates).T), claimed, atol=0.25 * np.max(claimed))
