"""Relations between faces: what is claimed, what was decided, and why."""

from dataclasses import dataclass
from typing import Literal

from planewright.sketch.graph import FaceId, RelationKind

RelationState = Literal["enforced", "released", "ambiguous", "conflicting"]
Source = Literal["detected", "person"]


@dataclass(frozen=True)
class Relation:
    """One pair of faces (or what the person named) and the decision on it."""

    kind: RelationKind
    faces: tuple[FaceId, ...]
    state: RelationState
    source: Source
    deviation_deg: float | None
    """Measured before enforcing: angle from the exact relation; for coplanar the angle between the planes."""
    sigma_deg: float | None
    offset_deviation: float | None
    """Coplanar only: distance of the planes at the midpoint of the faces, scene units."""
    log_bayes_factor: float | None
    """2 ln BF for the relation, at the step at which it was decided."""
    order: int | None
    """The step at which it was consolidated, from 1."""
    reason: str
    """A plain sentence with the figures."""
