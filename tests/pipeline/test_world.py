"""The world of the result: upright and in metres where the sketch says so; what the cameras see stays what it was."""

from dataclasses import replace

import numpy as np
import pytest

from planewright.geometry.plane import tangent_basis
from planewright.pipeline.result import Result
from planewright.pipeline.world import place
from planewright.refine.rounds import Structure
from planewright.sketch.graph import FaceId, KnownLength, PointId, Up


def told(result: Result, **more: object) -> Structure:
    """The structure in a world that is turned and scaled at random, with more said in its sketch."""
    return replace(result.structure, scene=replace(result.scene, sketch=replace(result.scene.sketch, **more)))  # pyright: ignore[reportArgumentType]


def edge(result: Result) -> tuple[tuple[PointId, PointId], float]:
    a, b = result.scene.sketch.edges[3]
    row = result.scene.point_row()
    return (a, b), float(np.linalg.norm(result.scene.points[row[a]] - result.scene.points[row[b]]))


def test_without_words_nothing_moves(true_result: Result) -> None:
    placed = place(true_result.structure, true_result.cameras)
    np.testing.assert_array_equal(placed.structure.scene.points, true_result.scene.points)
    np.testing.assert_array_equal(placed.cameras.rotation, true_result.cameras.rotation)
    assert (placed.unit, placed.world_up, placed.notes) == (None, None, ())


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("cm", 0.01), ("ft", 0.3048), (None, 1.0)])
def test_a_known_length_makes_metres(true_result: Result, unit: str | None, metres: float) -> None:
    ends, length = edge(true_result)
    structure = told(true_result, lengths=(KnownLength(ends, 7.5, 0.01),), unit=unit)
    placed = place(structure, true_result.cameras)
    row = placed.structure.scene.point_row()
    points = placed.structure.scene.points
    np.testing.assert_allclose(np.linalg.norm(points[row[ends[0]]] - points[row[ends[1]]]), 7.5 * metres)
    np.testing.assert_allclose(placed.structure.scene.point_covariance, true_result.scene.point_covariance * (7.5 * metres / length) ** 2)
    assert placed.unit == "m"


def test_lengths_that_disagree_are_said(true_result: Result) -> None:
    ends, length = edge(true_result)
    a, b = true_result.scene.sketch.edges[5]
    row = true_result.scene.point_row()
    other = float(np.linalg.norm(true_result.scene.points[row[a]] - true_result.scene.points[row[b]]))
    good = place(told(true_result, lengths=(KnownLength(ends, length, 0.01), KnownLength((a, b), other, 0.01))), true_result.cameras)
    assert good.notes == ()
    bad = place(told(true_result, lengths=(KnownLength(ends, length, 0.01), KnownLength((a, b), 1.3 * other, 0.01))), true_result.cameras)
    assert any("Check the lengths" in note for note in bad.notes)


@pytest.mark.parametrize("kind", ["face", "edge", "direction"])
def test_what_is_called_up_is_z_and_the_cameras_see_the_same(true_result: Result, kind: str) -> None:
    scene = true_result.scene
    ends, _ = edge(true_result)
    direction = np.array([0.3, -0.8, 0.4])
    words = {"face": Up(face=FaceId(scene.sketch.faces[2].id)), "edge": Up(edge=ends), "direction": Up(direction=(0.3, -0.8, 0.4))}
    row = scene.point_row()
    before = {"face": scene.normals[2], "edge": scene.points[row[ends[1]]] - scene.points[row[ends[0]]], "direction": direction}[kind]
    placed = place(told(true_result, up=words[kind], lengths=(KnownLength(ends, 3.0, 0.01),)), true_result.cameras)
    moved, cameras = placed.structure.scene, placed.cameras
    after = {"face": moved.normals[2], "edge": moved.points[row[ends[1]]] - moved.points[row[ends[0]]]}.get(kind)
    if after is not None:
        np.testing.assert_allclose(after / np.linalg.norm(after), [0, 0, 1], atol=1e-12)
    else:
        first = true_result.cameras.rotation[0] @ before / np.linalg.norm(before)
        np.testing.assert_allclose(cameras.rotation[0] @ [0, 0, 1], first, atol=1e-12)
    for k in (0, 11, 23):
        pose, was = cameras.cam_from_world(k), true_result.cameras.cam_from_world(k)
        np.testing.assert_allclose(cameras.intrinsics.project(pose.apply(moved.points)), cameras.intrinsics.project(was.apply(scene.points)), atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(pose.rotation), 1.0)
    np.testing.assert_allclose(placed.world_up, [0, 0, 1])


def test_corners_stay_on_their_planes_and_equal_normals_equal(true_result: Result) -> None:
    ends, _ = edge(true_result)
    placed = place(told(true_result, up=Up(direction=(0.1, 0.9, -0.2)), lengths=(KnownLength(ends, 3.0, 0.01),)), true_result.cameras)
    scene, row = placed.structure.scene, placed.structure.scene.point_row()
    for f, face in enumerate(scene.sketch.faces):
        corners = scene.points[[row[corner] for corner in face.corners]]
        np.testing.assert_allclose(corners @ scene.normals[f] - scene.offsets[f], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(scene.normals, axis=1), 1.0, atol=1e-14)


def test_the_covariance_of_planes_turns_with_them(true_result: Result) -> None:
    """Tilts drawn from the old covariance, moved as vectors, have the new covariance."""
    ends, length = edge(true_result)
    scene = true_result.scene
    rng = np.random.default_rng(0)
    root = rng.normal(size=scene.plane_covariance.shape)
    structure = replace(told(true_result, up=Up(direction=(0.1, 0.9, -0.2)), lengths=(KnownLength(ends, 3.0, 0.01),)))
    structure = replace(structure, scene=replace(structure.scene, plane_covariance=root @ root.T))
    placed = place(structure, true_result.cameras)
    turn = np.linalg.lstsq(scene.normals, placed.structure.scene.normals, rcond=None)[0].T
    old, new = tangent_basis(scene.normals), tangent_basis(placed.structure.scene.normals)
    moved = np.empty_like(root)
    for f in range(len(scene.normals)):
        moved[3 * f : 3 * f + 2] = new[f] @ turn @ old[f].T @ root[3 * f : 3 * f + 2]
        moved[3 * f + 2] = 3.0 / length * root[3 * f + 2]
    np.testing.assert_allclose(placed.structure.scene.plane_covariance, moved @ moved.T, rtol=1e-7, atol=1e-9)


def test_an_up_that_is_not_known_is_said(true_result: Result) -> None:
    known = true_result.scene.face_known.copy()
    known[2] = False
    structure = told(true_result, up=Up(face=true_result.scene.sketch.faces[2].id))
    placed = place(replace(structure, scene=replace(structure.scene, face_known=known)), true_result.cameras)
    assert placed.world_up is None
    assert len(placed.notes) == 1
