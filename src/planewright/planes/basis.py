"""What a solved structure rests on: enough to solve it again when one thing is added, without measuring anything anew."""

from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Float, Int, Mat3
from planewright.planes.evidence import CornerLines, CornerPriors, Evidence, PlanePoints
from planewright.planes.structure_constraints import StructureConstraints


@dataclass(frozen=True, eq=False)
class Basis:
    """The arguments of the last `solve_structure`, but for the start."""

    evidence: Evidence
    incidences: Int[np.ndarray, "incidences 2"]
    """Face row and corner row."""
    constraints: StructureConstraints
    """Of the relations that are enforced."""
    scale: tuple[float, float, float, float]
    """The factors of `EvidenceScale`: a plain tuple, so that it is read back from a file as what it was."""

    def moved(self, turn: Mat3, scale: float) -> "Basis":
        """The same in the world x' = scale * turn @ x."""
        points, marks, lines, priors = self.evidence.plane_points, self.evidence.marks, self.evidence.lines, self.evidence.priors
        # P [x; 1] = P [turn' x' / scale; 1], times the scale, which no pixel sees: so depths stay depths.
        projection = np.concatenate([marks.projection[:, :, :3] @ turn.T, scale * marks.projection[:, :, 3:]], axis=2)
        evidence = Evidence(
            PlanePoints(points.face, _turned(points.point, turn, scale), scale * points.sigma),
            replace(marks, projection=projection),
            CornerLines(lines.corner, _turned(lines.direction, turn, 1.0), scale * lines.offset, scale * lines.sigma),
            CornerPriors(priors.corner, _turned(priors.mean, turn, scale), priors.whitening @ turn.T / scale),
        )
        given = self.constraints
        return Basis(evidence, self.incidences, replace(given, across_vector=_turned(given.across_vector, turn, 1.0)), self.scale)


def _turned(vectors: Float[np.ndarray, "rows 3"], turn: Mat3, scale: float) -> Float[np.ndarray, "rows 3"]:
    return scale * vectors @ turn.T
