"""Planes found in single views."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.lifting.located import nothing_located
from planewright.lifting.search import Searches, planes_of_scene, search, search_scene
from planewright.lifting.task import Task
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint


def test_the_views_find_the_plane_of_a_face_they_show(shed, task: Task) -> None:
    front = [face.id for face in shed.sketch.faces].index(FaceId("front"))
    searches = Searches()
    found = search(task, nothing_located(task), searches, front, np.random.default_rng(0))
    best = min(found, key=lambda guess: guess.energy)
    assert best.found is not None
    assert float(best.normal @ shed.scene.normals[front]) > np.cos(np.radians(1.5))
    assert_allclose(best.probe @ best.normal, best.offset, atol=1e-9)
    assert any(f == front for f, *_ in searches.tried)


def test_a_view_is_searched_once_for_the_same_corners(task: Task) -> None:
    searches = Searches()
    assert search(task, nothing_located(task), searches, 0, np.random.default_rng(0))
    assert search(task, nothing_located(task), searches, 0, np.random.default_rng(0)) == []


def test_most_of_the_scene_lies_on_its_first_planes(task: Task) -> None:
    planes = planes_of_scene(task, np.random.default_rng(0))
    assert 2 <= len(planes) <= 6
    normals, offsets = np.array([normal for normal, _ in planes]), np.array([offset for _, offset in planes])
    assert max(abs(normals[:, 2])) > np.cos(np.radians(1.0))  # the ground
    away = np.abs(task.scene.xyz @ normals.T - offsets)
    distance = np.median(np.linalg.norm(task.scene.xyz - task.views.centers.mean(axis=0), axis=1))
    assert (away.min(axis=1) < 2.0 * task.views.depth_per_pixel * distance).mean() > 0.6


def test_a_face_whose_corners_are_marked_in_different_frames_is_looked_for_on_planes_of_the_scene(shed, to_task) -> None:
    """No view shows three of its corners, so nothing but the scene tells where to look."""
    patch = np.array([[-0.9, -1.9, 0.0], [0.9, -1.9, 0.0], [0.9, -1.1, 0.0], [-0.9, -1.1, 0.0]])  # of the ground
    where, frames = shed.pixels(patch), (2, 14, 26, 38)
    names = [PointId(f"g{i}") for i in range(4)]
    points = tuple(SketchPoint(name, {k: (float(where[k, i, 0]), float(where[k, i, 1]))}) for i, (name, k) in enumerate(zip(names, frames, strict=True)))
    task = to_task(shed, Sketch(points, shed.clip.intrinsics.image_size, (), (SketchFace(FaceId("ground"), tuple(names)),)))
    nothing, searches = nothing_located(task), Searches()
    assert search(task, nothing, searches, 0, np.random.default_rng(0)) == []
    found = search_scene(task, nothing, searches, 0, np.random.default_rng(0))
    best = min(found, key=lambda guess: guess.energy)
    assert abs(best.normal[2]) > np.cos(np.radians(2.0))
    assert abs(best.offset) < 0.1
    assert not nothing.known.any()
    assert search_scene(task, nothing, searches, 0, np.random.default_rng(0)) == []
