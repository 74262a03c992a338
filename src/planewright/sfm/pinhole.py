"""The drawing as if it had been made on frames without lens distortion."""

from dataclasses import replace

import numpy as np

from planewright.geometry.camera import Intrinsics
from planewright.sketch.graph import Sketch


def pinhole_sketch(sketch: Sketch, intrinsics: Intrinsics) -> Sketch:
    """The sketch with its marks moved to where `intrinsics.pinhole()` would show them; the same sketch where there is no distortion."""
    if not any(intrinsics.distortion):
        return sketch
    flat = intrinsics.pinhole()
    points = []
    for point in sketch.points:
        frames = list(point.marks)
        xy = np.array([point.marks[frame] for frame in frames], float).reshape(-1, 2)
        moved = flat.to_pixels(intrinsics.normalize(xy))
        points.append(replace(point, marks={frame: (float(x), float(y)) for frame, (x, y) in zip(frames, moved, strict=True)}))
    return replace(sketch, points=tuple(points))
