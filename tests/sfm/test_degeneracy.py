"""Laws of the gates."""

import numpy as np
import pytest

from planewright.geometry.rigid import rotations_from_vectors
from planewright.sfm.degeneracy import homography_residual, rotation_spread


@pytest.mark.parametrize("focal", [500.0, 900.0, 2500.0])
def test_a_turning_camera_has_no_spread_and_tells_its_focal(focal):
    k = np.array([[focal, 0, 480], [0, focal, 270], [0, 0, 1.0]])
    turn = rotations_from_vectors(np.array([[0.05, 0.15, 0.02]]))[0]
    spread, found = rotation_spread(k @ turn @ np.linalg.inv(k), (960, 540))
    assert spread < 0.005
    assert abs(found / focal - 1) < 0.06


def test_a_plane_seen_from_two_places_has_spread():
    k = np.array([[800.0, 0, 480], [0, 800.0, 270], [0, 0, 1.0]])
    turn = rotations_from_vectors(np.array([[0.0, 0.15, 0.0]]))[0]
    h = k @ (turn + np.outer([0.15, 0.02, 0.05], [0.1, 0.3, 0.9])) @ np.linalg.inv(k)
    assert rotation_spread(h, (960, 540))[0] > 0.02


def test_points_of_one_plane_leave_no_residual_and_points_in_depth_do():
    rng = np.random.default_rng(0)
    a = rng.uniform([0, 0], [960, 540], (200, 2))
    h = np.array([[1.05, 0.02, 5], [-0.01, 0.98, -3], [1e-5, 2e-5, 1]])
    b = np.c_[a, np.ones(200)] @ h.T
    b = b[:, :2] / b[:, 2:]
    assert homography_residual(a, b + rng.normal(0, 0.05, b.shape))[1] < 0.3
    assert homography_residual(a, b + np.c_[rng.uniform(-30, 30, 200), np.zeros(200)])[1] > 5
