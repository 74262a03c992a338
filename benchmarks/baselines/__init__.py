"""What others do with the same marks: ways to follow corners that planewright is measured against, on the same frames and the same sketch.

Each is given every advantage that its own idea allows: marks in any frame count, points are followed forwards and backwards from the nearest mark, flow is
checked there and back, estimates are robust. None of them knows cameras, depth or what is visible: that is their idea's limit, not ours to mend.
"""

from collections.abc import Callable
from functools import partial

from benchmarks.baselines.edge_samples import EdgeSampleOptions as EdgeSampleOptions
from benchmarks.baselines.edge_samples import edge_samples as edge_samples
from benchmarks.baselines.face_homographies import face_homographies as face_homographies
from benchmarks.baselines.single_corners import single_corners as single_corners
from benchmarks.baselines.sweep import Paths as Paths
from benchmarks.baselines.sweep import Step as Step
from benchmarks.baselines.sweep import sweep as sweep
from planewright.sketch.graph import Sketch

BASELINES: dict[str, Callable[[Sketch], Step]] = {
    "LK corners": single_corners,
    "face homographies": face_homographies,
    "edge samples": edge_samples,
    "edge samples, 3 x 3": partial(edge_samples, options=EdgeSampleOptions(window=3, samples=12)),
}
"""Name in the tables -> what makes the step from a frame to the next for a sketch."""
