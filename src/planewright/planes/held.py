"""A part of a structure solved while the rest stays: what a correction may move, and what it must not."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.planes.structure_problem import StructureProblem, StructureState


@dataclass(frozen=True, eq=False)
class Held:
    """What stays where it is."""

    points: Bool[np.ndarray, "points"]
    faces: Bool[np.ndarray, "faces"]
    """A face that shares its plane, or the direction of its normal, with a held one stays in that as well."""


@dataclass(frozen=True, eq=False)
class PartProblem:
    """Implements `ConstrainedProblem` on some of the unknowns of a structure. Constraints between held and free things hold exactly, like all others."""

    whole: StructureProblem
    free: Int[np.ndarray, "free"]
    """Columns of the unknowns that move."""

    def cost(self, state: StructureState) -> float:
        """That of the whole."""
        return self.whole.cost(state)

    def normal_equations(self, state: StructureState) -> tuple[Float[np.ndarray, "free"], Float[np.ndarray, "free free"]]:
        """Those of the whole, without the held unknowns."""
        gradient, hessian = self.whole.normal_equations(state)
        return gradient[self.free], hessian[np.ix_(self.free, self.free)]

    def constraints(self, state: StructureState) -> Float[np.ndarray, "rows"]:
        """Those of the whole; rows between held things are zero already."""
        return self.whole.constraints(state)

    def constraint_jacobian(self, state: StructureState) -> Float[np.ndarray, "rows free"]:
        """Derivative by the free unknowns."""
        return self.whole.constraint_jacobian(state)[:, self.free]

    def move(self, state: StructureState, step: Float[np.ndarray, "free"]) -> StructureState:
        """The free unknowns moved."""
        full = np.zeros(self.whole.num_unknowns)
        full[self.free] = step
        return self.whole.move(state, full)


def part_of(problem: StructureProblem, held: Held, face_plane: Int[np.ndarray, "faces"]) -> PartProblem:
    """The problem with only what is not held.

    face_plane: plane row of every face.
    """
    planes = np.zeros(len(problem.plane_direction), dtype=bool)
    planes[face_plane[held.faces]] = True
    directions = np.zeros(len(problem.anchor.directions), dtype=bool)
    directions[problem.plane_direction[planes]] = True
    free = np.concatenate([
        problem.tilt_columns(np.flatnonzero(~directions)).ravel(),
        problem.offset_columns(np.flatnonzero(~planes)),
        problem.point_columns(np.flatnonzero(~held.points)).ravel(),
    ])  # fmt: skip
    return PartProblem(problem, free)
