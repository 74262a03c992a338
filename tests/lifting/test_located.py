"""Corners from planes, and polygons from corners."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from planewright.lifting.hypothesis import Hypothesis
from planewright.lifting.located import corner_depths, face_in_view, locate, nothing_located, places_in_view
from planewright.lifting.task import Task
from planewright.sketch.graph import FaceId


def test_true_planes_locate_every_corner_they_reach(shed, task: Task, true_planes: list[Hypothesis]) -> None:
    located = locate(task, true_planes, nothing_located(task))
    assert located.known.all()
    error = np.linalg.norm(located.points - shed.scene.points, axis=1) / shed.clip.scene.diagonal
    assert np.median(error) < 0.01
    assert (located.spread < 0.1).all()
    # one wall is seen so much aslant that a mark's ray misses it
    missed = [(f, c) for f, corners in enumerate(task.corners) for c in corners if f not in located.told_by[c]]
    assert len(missed) == 1
    assert all(corner_depths(task, f, true_planes[f])[c][0] < 0 for f, c in missed)


def test_a_plane_that_others_contradict_is_outvoted(shed, task: Task, true_planes: list[Hypothesis]) -> None:
    shared = int(np.argmax(task.faces_at))
    assert task.faces_at[shared] >= 3
    liar = next(f for f, corners in enumerate(task.corners) if shared in corners)
    center = task.views.centers[0]
    # twice as far from the cameras
    moved = replace(true_planes[liar], offset=2.0 * true_planes[liar].offset - float(true_planes[liar].normal @ center))
    planes = [moved if f == liar else plane for f, plane in enumerate(true_planes)]
    located = locate(task, planes, nothing_located(task))
    honest = locate(task, [None if f == liar else plane for f, plane in enumerate(true_planes)], nothing_located(task))
    assert_allclose(located.points[shared], honest.points[shared], atol=1e-9)


def test_a_corner_that_nothing_tells_any_more_is_unknown(task: Task, true_planes: list[Hypothesis]) -> None:
    before = locate(task, true_planes, nothing_located(task))
    after = locate(task, [None] * task.num_faces, before)
    assert_array_equal(np.flatnonzero(after.known), sorted(task.triangulated))
    assert np.isinf(after.spread[~after.known]).all()
    assert_array_equal(after.points[~after.known], before.points[~after.known])


def plane_at(task: Task, like: Hypothesis, row: int, depth: float, facing: float) -> Hypothesis:
    """The plane through a point on a mark's ray: square to the ray with `facing` 1, along it with 0."""
    toward = task.rays.direction[row] / np.linalg.norm(task.rays.direction[row])
    aside = np.cross(toward, [0.0, 0.0, 1.0])
    normal = facing * toward + np.sqrt(1.0 - facing**2) * aside / np.linalg.norm(aside)
    return replace(like, normal=normal, offset=float(normal @ (task.rays.origin[row] + depth * task.rays.direction[row])))


def test_a_corner_is_less_sure_on_a_plane_seen_aslant(task: Task, true_planes: list[Hypothesis]) -> None:
    row = int(task.first_marks(task.corners[0])[0])
    corner = int(task.rays.point[row])
    facing, turned = (corner_depths(task, 0, plane_at(task, true_planes[0], row, 5.0, share))[corner] for share in (1.0, 0.1))
    assert_allclose([facing[0], turned[0]], 5.0)
    assert turned[1] > 1.5 * facing[1]


def test_one_plane_that_is_sure_outweighs_two_that_are_not(task: Task, true_planes: list[Hypothesis]) -> None:
    shared = int(np.argmax(task.faces_at))
    row = int(task.rays.of_point(shared)[0])
    sure, *unsure = [f for f, corners in enumerate(task.corners) if shared in corners][:3]
    planes: list[Hypothesis | None] = [None] * task.num_faces
    planes[sure] = plane_at(task, true_planes[sure], row, 4.0, 1.0)
    for f in unsure:
        planes[f] = plane_at(task, true_planes[f], row, 6.0, 0.05)
    located = locate(task, planes, nothing_located(task))
    assert_allclose(located.points[shared], task.rays.origin[row] + 4.0 * task.rays.direction[row], atol=0.1)


def test_a_face_is_drawn_where_its_corners_are(shed, task: Task, true_planes: list[Hypothesis]) -> None:
    nothing = nothing_located(task)
    face = [face.id for face in shed.sketch.faces].index(FaceId("roof"))
    view = int(task.rays.view[task.first_marks(task.loops[face])[0]])
    marked = places_in_view(task, nothing, view, task.loops[face])
    assert len(marked) >= 3
    # known corners are projected into views in which they are not marked, where nothing else tells of them
    far = next(v for v in range(len(task.views.frame)) if v not in task.rays.view)
    assert places_in_view(task, nothing, far, task.loops[face]) == []
    assert face_in_view(task, nothing, far, face) is None
    located = replace(locate(task, true_planes, nothing), points=shed.scene.points)
    drawn = face_in_view(task, located, far, face)
    assert drawn is not None
    mask, border = drawn
    there = shed.pixels(shed.scene.points[list(task.loops[face])])[task.views.frame[far]] * task.views.scale - 0.5
    assert_allclose(border, there, atol=1e-6)
    assert abs(int(mask.sum()) - cv2.contourArea(there.astype(np.float32))) < cv2.arcLength(there.astype(np.float32), True)


def test_holes_are_not_part_of_a_face(task: Task, true_planes: list[Hypothesis]) -> None:
    located = locate(task, true_planes, nothing_located(task))
    view, (hole,) = 5, task.holes[0]
    with_hole = face_in_view(task, located, view, 0)
    whole = face_in_view(replace(task, holes=((),) * task.num_faces), located, view, 0)
    assert with_hole is not None
    assert whole is not None
    border = np.array(places_in_view(task, located, view, hole), np.float32)
    missing = int(whole[0].sum()) - int(with_hole[0].sum())
    assert abs(missing - cv2.contourArea(border)) < cv2.arcLength(border, True)
    inside = border.mean(axis=0).round().astype(int)
    assert whole[0][inside[1], inside[0]] == 1
    assert with_hole[0][inside[1], inside[0]] == 0
