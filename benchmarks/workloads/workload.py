"""One clip to measure."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ClipFiles:
    """Where a clip lies."""

    clip: Path
    sketch: Path
    truths: tuple[Path, ...]
    """What is known of it; each is scored, and their figures are put together."""


@dataclass(frozen=True)
class Workload:
    """A clip and what should come of it."""

    name: str
    prepare: Callable[[Path], ClipFiles]
    """Make or find the files; what is made goes to the folder it is given."""
    group: str = "recorded"
    """`twin`: ordinary clips with full truth; `hard`: hard on purpose, each in one way; `quick`: small; `refused`: those that determine no answer."""
    expected_status: int = 0
    """Exit status of `planewright reconstruct`; 4 where the views determine no answer."""
    quick: bool = False
    """Takes a minute or so."""
