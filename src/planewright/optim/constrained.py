"""Least squares under exact equality constraints, dense, for some hundreds of unknowns.

Each step is a Levenberg-Marquardt step inside the null space of the constraints' Jacobian, followed by a retraction: Gauss-Newton steps of least norm
back onto the constraints. All iterates satisfy the constraints, so the plain cost decides whether a step is taken; there is no penalty weight and no
multiplier to tune. (Nocedal & Wright, Numerical Optimization, 2nd ed., sections 10.3, 15.3 and 18.3; Absil, Mahony & Sepulchre, Optimization Algorithms
on Matrix Manifolds, section 4.1, for retractions.)
"""

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar, cast, runtime_checkable

import numpy as np
from scipy.linalg import cho_factor, cho_solve, lstsq, qr, solve_triangular

from planewright.arrays import Float, Int

State = TypeVar("State")
FloatArray = Float[np.ndarray, "..."]
IndexArray = Int[np.ndarray, "..."]


@runtime_checkable
class ConstrainedProblem(Protocol[State]):
    """A cost and constraints on states that a vector of `n` small numbers moves."""

    def cost(self, state: State) -> float:
        """Half the (robust) sum of squares."""
        ...

    def normal_equations(self, state: State) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n n"]]:
        """Gradient of the cost and its Gauss-Newton Hessian, which is positive definite, for a small move from `state`."""
        ...

    def constraints(self, state: State) -> Float[np.ndarray, "rows"]:
        """What has to be zero; scaled so that 1 is a gross violation."""
        ...

    def constraint_jacobian(self, state: State) -> Float[np.ndarray, "rows n"]:
        """Derivative of the constraints by a small move from `state`."""
        ...

    def move(self, state: State, step: Float[np.ndarray, "n"]) -> State:
        """The state after a small move."""
        ...


@dataclass(frozen=True, kw_only=True)
class ConstrainedOptions:
    """When to stop."""

    max_iterations: int = 60
    """Most steps taken; 0 only satisfies the constraints."""
    step_tolerance: float = 1e-7
    """Stop once the largest entry of a step is smaller (units of the unknowns)."""
    rank_tolerance: float = 1e-7
    """A constraint whose pivot is smaller than this share of the largest counts as redundant."""
    constraint_tolerance: float = 1e-11
    """Largest violation along the way; the final state is polished to the precision of the arithmetic."""
    max_retractions: int = 40
    """Most Gauss-Newton steps back onto the constraints before they count as contradictory."""


@dataclass(frozen=True, eq=False)
class ConstrainedSolution(Generic[State]):
    """The best state found; `feasible` tells whether it satisfies the constraints."""

    state: State
    cost: float
    iterations: int
    converged: bool
    feasible: bool
    violation: float
    """Largest constraint violation left."""
    conflicting: Int[np.ndarray, "violated"]
    """Rows of constraints that could not be satisfied together; empty where feasible."""
    num_redundant: int
    """Constraints that follow from the others."""


class _Factors:
    """Rank-revealing QR of the transposed Jacobian: its range gives least-norm steps onto the constraints, its null space the moves along them."""

    def __init__(self, jacobian: Float[np.ndarray, "rows n"], tolerance: float) -> None:
        rows, n = jacobian.shape
        if rows == 0:
            self.rank, self._range, self.null, self._lower = 0, np.zeros((n, 0)), np.eye(n), np.zeros((0, 0))
            self._order = np.zeros(0, dtype=np.int64)
            return
        q, r, order = cast(tuple[FloatArray, FloatArray, IndexArray], qr(jacobian.T, pivoting=True))
        pivots = np.abs(np.diag(r))
        self.rank = int(np.count_nonzero(pivots > tolerance * max(float(pivots[0]), 1e-300))) if pivots[0] > 0 else 0
        self._range, self.null = q[:, : self.rank], q[:, self.rank :]
        self._lower, self._order = r[: self.rank].T, order

    def onto(self, violation: Float[np.ndarray, "rows"]) -> Float[np.ndarray, "n"]:
        """The shortest step that removes the violation, or leaves least of it where the constraints contradict each other."""
        target = -violation[self._order]
        if self.rank == 0:
            return np.zeros(self._range.shape[0])
        if self.rank == len(target):
            return self._range @ solve_triangular(self._lower, target, lower=True)
        return self._range @ cast(FloatArray, lstsq(self._lower, target, lapack_driver="gelsy")[0])  # pyright: ignore[reportOptionalSubscript]


def minimize_constrained(problem: ConstrainedProblem[State], start: State, options: ConstrainedOptions = ConstrainedOptions()) -> ConstrainedSolution[State]:
    """The state of least cost among those that satisfy the constraints, downhill from `start`, which need not satisfy them.

    Redundant constraints do no harm. Contradictory ones end at once with `feasible` False and the rows that are still violated where their least-squares
    compromise is.
    """
    state, factors = _retract(problem, start, None, options, options.constraint_tolerance)
    if factors is None:
        return _infeasible(problem, state, options)
    cost, damping, done, converged = problem.cost(state), 1e-4, 0, options.max_iterations == 0
    while done < options.max_iterations and not converged:
        done += 1
        factors = _Factors(problem.constraint_jacobian(state), options.rank_tolerance)
        null = factors.null
        if null.shape[1] == 0:
            converged = True
            break
        gradient, hessian = problem.normal_equations(state)
        reduced_gradient, reduced = null.T @ gradient, null.T @ hessian @ null
        diagonal = np.diag(reduced).copy()
        for _ in range(12):
            step = null @ -cho_solve(cho_factor(reduced + np.diag(damping * diagonal)), reduced_gradient)
            moved, onto = _retract(problem, problem.move(state, step), factors, options, options.constraint_tolerance)
            new_cost = problem.cost(moved) if onto is not None else np.inf
            size = float(np.max(np.abs(step)))
            if new_cost <= cost:
                # A small step under strong damping is no sign of an optimum.
                converged = size < options.step_tolerance and damping <= 1e-2
                state, cost, damping = moved, new_cost, max(damping / 8.0, 1e-9)
                break
            if size < options.step_tolerance:
                converged = True  # the cost differs by rounding only
                break
            damping = max(damping * 10.0, 1e-6)
        else:
            break
    state, _ = _retract(problem, state, None, options, 0.0)
    violation = np.abs(problem.constraints(state))
    redundant = len(violation) - _Factors(problem.constraint_jacobian(state), options.rank_tolerance).rank
    return ConstrainedSolution(
        state=state,
        cost=problem.cost(state),
        iterations=done,
        converged=converged,
        feasible=True,
        violation=float(violation.max(initial=0.0)),
        conflicting=np.zeros(0, dtype=np.int64),
        num_redundant=redundant,
    )


def constrained_covariance(problem: ConstrainedProblem[State], state: State, options: ConstrainedOptions = ConstrainedOptions()) -> Float[np.ndarray, "n n"]:
    """Covariance of a small move about the optimum: Z (Z' H Z)^-1 Z' with the Gauss-Newton Hessian H and the null space Z of the constraints."""
    null = _Factors(problem.constraint_jacobian(state), options.rank_tolerance).null
    _, hessian = problem.normal_equations(state)
    reduced = null.T @ hessian @ null
    # Scaled to a unit diagonal first: unknowns that nothing but a weak prior holds differ from the others by many orders of magnitude.
    scale = 1.0 / np.sqrt(np.diag(reduced))
    inverse = cho_solve(cho_factor(reduced * np.outer(scale, scale)), np.eye(len(scale)))
    covariance = null @ (inverse * np.outer(scale, scale)) @ null.T
    return 0.5 * (covariance + covariance.T)


def _retract(
    problem: ConstrainedProblem[State], state: State, factors: _Factors | None, options: ConstrainedOptions, tolerance: float
) -> tuple[State, _Factors | None]:
    """The state moved onto the constraints, and the factors used last; None in their place where it cannot be brought there.

    Factors of a nearby state are used as long as they shrink the violation tenfold (a chord iteration: a factorization costs as much as many of its steps).
    With a tolerance of zero the violation is driven down until rounding stops it.
    """
    violation = problem.constraints(state)
    fresh = False
    for _ in range(options.max_retractions):
        if _largest(violation) <= tolerance:
            break
        if factors is None:
            factors, fresh = _Factors(problem.constraint_jacobian(state), options.rank_tolerance), True
        step = factors.onto(violation)
        accepted = None
        for shrink in (1.0, 0.5, 0.25, 0.0625) if fresh else (1.0,):
            moved = problem.move(state, shrink * step)
            left = problem.constraints(moved)
            if np.isfinite(left).all() and _norm(left) < (1.0 - 0.05 * shrink) * _norm(violation):
                accepted = moved, left
                break
        if accepted is None:
            if fresh:
                break  # a stationary point of the violation, or rounding
            factors = None
            continue
        if _norm(accepted[1]) > 0.1 * _norm(violation):
            factors = None
        (state, violation), fresh = accepted, False
    if not _largest(violation) <= options.constraint_tolerance:
        return state, None
    return state, factors if factors is not None else _Factors(problem.constraint_jacobian(state), options.rank_tolerance)


def _norm(violation: Float[np.ndarray, "rows"]) -> float:
    return float(np.linalg.norm(violation))


def _largest(violation: Float[np.ndarray, "rows"]) -> float:
    return float(np.abs(violation).max(initial=0.0))


def _infeasible(problem: ConstrainedProblem[State], state: State, options: ConstrainedOptions) -> ConstrainedSolution[State]:
    violation = np.abs(problem.constraints(state))
    worst = float(violation.max(initial=0.0))
    return ConstrainedSolution(
        state=state,
        cost=problem.cost(state),
        iterations=0,
        converged=False,
        feasible=False,
        violation=worst,
        conflicting=np.flatnonzero(violation > max(0.05 * worst, options.constraint_tolerance)),
        num_redundant=0,
    )
