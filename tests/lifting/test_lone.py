"""Points of which no plane is known."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_array_equal

from planewright.lifting.hypothesis import Hypothesis
from planewright.lifting.located import locate, nothing_located
from planewright.lifting.lone import locate_lone_points
from planewright.lifting.task import Task
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchPoint


def test_a_point_on_no_face_gets_the_depth_of_the_patch_around_its_mark(shed, lift) -> None:
    spot = np.array([[-0.4, -1.5, 0.0], [3.0, 1.25, 0.9]])  # on the planks before the shed, and on a box beside it
    frame = 20
    where = shed.pixels(spot)[frame]
    points = tuple(SketchPoint(PointId(f"p{i}"), {frame: (float(x), float(y))}) for i, (x, y) in enumerate(where))
    sketch = Sketch((*points, SketchPoint(PointId("unmarked"), {})), shed.clip.intrinsics.image_size)
    found = lift(shed, sketch)
    assert found.point_known.tolist() == [True, True, False]
    center = shed.cameras.centers[frame]
    depth = np.linalg.norm(found.points[:2] - center, axis=1) / np.linalg.norm(spot - center, axis=1)
    assert abs(depth[0] - 1) < 0.02


def test_what_is_known_stays_where_it_is_and_a_patch_is_less_sure_than_a_plane(shed, task: Task, true_planes: list[Hypothesis]) -> None:
    located = locate(task, true_planes, nothing_located(task))
    some = located.known.copy()
    pane = [face.id for face in shed.sketch.faces].index(FaceId("pane"))
    lone = task.loops[pane][0]
    some[lone] = False
    after = locate_lone_points(task, replace(located, known=some))
    assert_array_equal(after.points[some], located.points[some])
    assert_array_equal(after.spread[some], located.spread[some])
    assert after.known.all()
    assert after.spread[lone] > 3.0 * located.spread[lone]
