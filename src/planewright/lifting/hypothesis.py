"""A plane a face may lie on, and what speaks for it."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Vec3
from planewright.lifting.photometric import PhotometricPlane

AGREEMENT = 4.0
"""What a plane with which nearly all pixels agree earns; one at which the views agree to a ZNCC of 0.4 earns nothing."""
CORNERS = 1.5
"""What a plane through three corners that are known by other faces earns; through more, twice that."""
WITNESS = 1.2
"""What each feature costs that is seen through a face, above a quarter of those inside it, and up to ten of them."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A plane a face may lie on."""

    normal: Vec3
    offset: float
    quality: float
    """Mean ZNCC over the views; NaN where pixels did not take part."""
    view: int
    """View in which it was found, -1 where it comes from corners."""
    probe: Float[np.ndarray, "probe 3"]
    """Points of the plane spread over the face, as seen in that view."""
    covered: Bool[np.ndarray, "probe faces"]
    """Which other faces are drawn over each of them in that view."""
    found: PhotometricPlane | None = None
    """The pixels' own account, where there is one."""
    support: float = 1.0
    """Where it comes from corners or scene features: how much speaks for it."""
    agreed: bool = False
    """Where it comes from corners: whether the pixels agree with it as well as with a plane of their own."""
    seen_through: float = 0.0
    """How many scene features inside the face were seen behind the plane, above a quarter of them."""

    @property
    def energy(self) -> float:
        """What choosing it costs by itself; negative where it earns."""
        earned = CORNERS * self.support if self.found is None else AGREEMENT * float(np.clip((self.quality - 0.4) / 0.5, -1.0, 1.1))
        return WITNESS * min(self.seen_through, 10.0) - earned


def agreement(found: PhotometricPlane) -> float:
    """Mean ZNCC, less where the views hardly show the face."""
    return found.zncc * min(1.0, 2 * found.share)
