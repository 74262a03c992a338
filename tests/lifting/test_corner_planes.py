"""Planes through located corners."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.lifting.corner_planes import from_corners, planes_through
from planewright.lifting.hypothesis import CORNERS, Hypothesis, agreement
from planewright.lifting.located import Located, locate, nothing_located
from planewright.lifting.search import Searches, search
from planewright.lifting.task import Task


@pytest.fixture(scope="module")
def located(shed, task: Task, true_planes: list[Hypothesis]) -> Located:
    """All corners where they are, each told by all of its faces."""
    return replace(locate(task, true_planes, nothing_located(task)), points=shed.scene.points)


@pytest.fixture(scope="module")
def four_cornered(task: Task) -> int:
    """A face with four corners, of which other faces tell each."""
    return next(f for f, corners in enumerate(task.corners) if len(corners) == 4 and (task.faces_at[list(corners)] >= 2).all())


def test_corners_known_by_other_faces_give_the_plane_they_lie_on(shed, task: Task, located: Located, four_cornered: int) -> None:
    (found,) = planes_through(task, located, four_cornered)
    assert_allclose(abs(found.normal @ shed.scene.normals[four_cornered]), 1.0, atol=1e-9)
    assert found.view == -1
    assert found.support == 2.0
    marks = task.first_marks(task.corners[four_cornered])
    assert float(found.normal @ task.rays.origin[marks[0]]) > found.offset  # towards the camera


def test_what_a_face_said_of_its_own_corners_does_not_come_back_to_it(task: Task, located: Located, four_cornered: int) -> None:
    alone = replace(located, told_by=(frozenset({four_cornered}),) * task.num_points)
    assert planes_through(replace(task, triangulated={}), alone, four_cornered) == []


def test_one_wrong_corner_of_four_leaves_the_plane_of_the_others(shed, task: Task, located: Located, four_cornered: int) -> None:
    points = located.points.copy()
    wrong = task.corners[four_cornered][0]
    points[wrong] += 0.4 * shed.clip.scene.diagonal * shed.scene.normals[four_cornered]
    found = planes_through(task, replace(located, points=points, spread=np.full(task.num_points, 0.005)), four_cornered)
    assert 1 <= len(found) <= 4
    assert max(abs(guess.normal @ shed.scene.normals[four_cornered]) for guess in found) > 1.0 - 1e-9
    assert all(guess.support == 1.0 for guess in found)


def test_corners_on_a_line_are_no_plane(task: Task, located: Located, four_cornered: int) -> None:
    points = located.points.copy()
    a, b, *rest = task.corners[four_cornered]
    for k, c in enumerate(rest, 1):
        points[c] = points[a] + (points[b] - points[a]) * k / 3.0
    assert planes_through(task, replace(located, points=points), four_cornered) == []


def test_pixels_that_agree_with_a_plane_through_corners_speak_for_it(task: Task, located: Located) -> None:
    face = 0
    seen = search(task, nothing_located(task), Searches(), face, np.random.default_rng(0))
    best = max((guess for guess in seen if guess.found is not None), key=lambda guess: guess.quality)
    assert best.found is not None
    assert agreement(best.found) > 0.7
    # corners on the pixels' own plane: they tell it from that of the corners by nothing
    points = located.points.copy()
    corners = list(task.corners[face])
    points[corners] -= (points[corners] @ best.normal - best.offset)[:, None] * best.normal
    known = replace(located, points=points, told_by=(frozenset({-1}),) * task.num_points)
    (lent,) = from_corners(task, known, face, [best])
    assert lent.agreed
    assert float(lent.normal @ best.normal) > 0.999
    assert_allclose(lent.support, 2.0 - best.energy / CORNERS)
    (alone,) = from_corners(task, known, face, [])
    assert not alone.agreed
    assert alone.support == 2.0
