"""Pictures of a model."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planewright.geometry.camera import Intrinsics
from planewright.geometry.rigid import Rigid
from planewright.model.planar_model import FaceMesh, PlanarModel
from planewright.model.render import RenderOptions, border_edges, render_model

CAMERA = Intrinsics(focal=100.0, principal_point=np.array([80.0, 60.0]), image_size=(160, 120))
HERE = Rigid(np.eye(3), np.zeros(3))
NO_LINES = RenderOptions(line_strength=0.0)


def board(name: str, depth: float, left: float, uv_left: float) -> FaceMesh:
    """A square of side 1 that faces the camera, showing a half of the atlas."""
    vertices = np.array([[left, -0.5, depth], [left + 1, -0.5, depth], [left + 1, 0.5, depth], [left, 0.5, depth]])
    uv = np.array([[uv_left, 0], [uv_left + 0.5, 0], [uv_left + 0.5, 1], [uv_left, 1]])
    return FaceMesh(name, np.array([0.0, 0.0, -1.0]), vertices, np.array([[0, 2, 1], [0, 3, 2]]), uv)


@pytest.fixture(scope="module")
def model() -> PlanarModel:
    atlas = np.zeros((64, 128, 3), dtype=np.uint8)
    atlas[:, :64] = np.stack([np.tile(np.arange(64) * 3, (64, 1)), np.tile(np.arange(64)[:, None] * 3, (1, 64)), np.full((64, 64), 30)], axis=-1)
    atlas[:, 64:] = [200, 40, 40]
    faces = (board("far", 2.0, -0.75, 0.0), board("near", 1.6, 0.0, 0.5))
    return PlanarModel(faces, atlas, None, None, np.zeros((64, 128), dtype=bool))


def test_every_pixel_shows_the_texel_of_the_nearest_face(model: PlanarModel) -> None:
    image = render_model(model, HERE, CAMERA, "textured", NO_LINES).astype(float)
    for x in range(6, 154, 7):
        for y in range(6, 114, 7):
            ray = (np.array([x + 0.5, y + 0.5]) - CAMERA.principal_point) / 100.0
            near, far = ray * 1.6, ray * 2.0
            if 0.03 < near[0] < 0.97 and abs(near[1]) < 0.47:
                assert np.abs(image[y, x] - [200, 40, 40]).max() <= 1
            elif -0.72 < far[0] < 0.22 and abs(far[1]) < 0.47 and near[0] < -0.03:
                texel = (far - [-0.75, -0.5]) * 64 - 0.5
                assert np.abs(image[y, x] - [3 * texel[0], 3 * texel[1], 30]).max() <= 2


def test_shading_is_one_tone_a_face_and_wire_shows_through(model: PlanarModel) -> None:
    shaded = render_model(model, HERE, CAMERA, "shaded", NO_LINES)
    assert len(np.unique(shaded[45:75, 85:110].reshape(-1, 3), axis=0)) == 1
    wire = render_model(model, HERE, CAMERA, "wire").min(axis=2)
    # The right side of the far board is hidden by the near one: fainter than what is in sight, darker than the background.
    hidden, in_sight, background = wire[60, 90:95].min(), wire[60, 40:45].min(), wire[60, 20]
    assert in_sight < hidden - 30 < hidden + 20 < background


def test_a_fine_pattern_seen_from_afar_is_its_average(model: PlanarModel) -> None:
    checks = np.zeros((64, 128, 3), dtype=np.uint8)
    checks[(np.add.outer(np.arange(64), np.arange(128)) // 2) % 2 == 0] = 200
    image = render_model(replace(model, atlas=checks, faces=model.faces[:1]), Rigid(np.eye(3), np.array([0.25, 0.0, 4.0])), CAMERA, "textured", NO_LINES)
    assert np.abs(image[55:66, 75:86].astype(float) - 100).max() < 25


def test_an_empty_model_and_one_behind_the_camera_show_the_background(model: PlanarModel) -> None:
    empty = render_model(replace(model, faces=()), HERE, CAMERA)
    behind = render_model(model, Rigid(np.eye(3), np.array([0.0, 0.0, -5.0])), CAMERA)
    assert_array_equal(empty, behind)
    assert empty.shape == (120, 160, 3)


def test_a_camera_amid_the_faces_does_no_harm(model: PlanarModel) -> None:
    for angle in np.linspace(0, np.pi, 7):
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        for mode in ("textured", "shaded", "wire"):
            render_model(model, Rigid(turn, turn @ np.array([-0.5, 0.0, -1.6])), CAMERA, mode)


def test_borders_are_the_edges_of_one_triangle() -> None:
    face = board("a", 1.0, 0.0, 0.0)
    assert_array_equal(border_edges(face), [[0, 1], [0, 3], [1, 2], [2, 3]])
