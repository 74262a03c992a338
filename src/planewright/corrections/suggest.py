"""The next correction worth making: which corner, in which frame, and what it would gain."""

from dataclasses import dataclass

import numpy as np

from planewright.corrections.session import Session
from planewright.sketch.graph import PointId
from planewright.tracking.tracks import State


@dataclass(frozen=True)
class Suggestion:
    """One mark that a person could make."""

    point: PointId
    frame: int
    gain: float
    """Frames in which the corner is seen and expected to come from more than 5 px off to within."""
    reason: str


def suggest(session: Session, count: int = 5) -> tuple[Suggestion, ...]:
    """The marks that gain most, best first, one a point."""
    tracks = session.tracks
    seen = np.isin(tracks.state, (int(State.TRACKED), int(State.BRIDGED)))
    variance = np.linalg.eigvalsh(tracks.covariance).mean(axis=1)
    lost = np.where(seen, np.exp(-0.5 * 5.0**2 / np.maximum(variance, 1e-6)), 0.0)
    found: list[Suggestion] = []
    for i, point in enumerate(session.sketch.points):
        mine = np.flatnonzero(tracks.point_index == i)
        if not seen[mine].any():
            continue
        gain = float(lost[mine].sum())
        worst = mine[int(np.argmax(np.where(seen[mine], variance[mine], -1.0)))]
        sigma = float(np.sqrt(variance[worst]))
        found.append(Suggestion(point.id, int(tracks.frame[worst]), gain, f"Its position in frame {int(tracks.frame[worst])} is only sure to {sigma:.1f} px."))
    return tuple(sorted(found, key=lambda suggestion: -suggestion.gain)[:count])
