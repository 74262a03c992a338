"""Laws of posing one frame."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.geometry.rigid import Rigid, rotation_angle, rotations_from_vectors
from planewright.sfm.resection import NotPosed, Posed, resect

VALUES = np.array([700.0, 480.0, 270.0, -0.05, 0.0])


def frame(count: int, outliers: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    pose = Rigid(rotations_from_vectors(np.array([[0.2, -0.4, 0.1]]))[0], np.array([0.3, -0.2, 7.0]))
    xyz = rng.uniform(-2, 2, (count, 3))
    x = pose.apply(xyz)
    uv = x[:, :2] / x[:, 2:]
    xy = VALUES[1:3] + VALUES[0] * (1 + VALUES[3] * (uv**2).sum(axis=1, keepdims=True)) * uv + rng.normal(0, 0.1, (count, 2))
    xy[:outliers] = rng.uniform([0, 0], [960, 540], (outliers, 2))
    return pose, xyz, xy


@pytest.mark.parametrize("outliers", [0, 30])
def test_the_pose_is_found_without_a_guess(outliers):
    pose, xyz, xy = frame(80, outliers)
    found = resect(VALUES, xyz, xy, scale=0.25, seed=1)
    assert isinstance(found, Posed)
    assert np.degrees(rotation_angle(found.cam_from_world.rotation, pose.rotation)) < 0.02
    assert_allclose(found.cam_from_world.translation, pose.translation, atol=3e-3)


def test_a_good_guess_needs_no_search():
    pose, xyz, xy = frame(80, 20)
    guess = Rigid(rotations_from_vectors(np.array([[0.02, 0.01, 0.0]]))[0] @ pose.rotation, pose.translation + 0.05)
    found = resect(VALUES, xyz, xy, scale=0.25, guesses=(guess,))
    assert isinstance(found, Posed)
    assert np.degrees(rotation_angle(found.cam_from_world.rotation, pose.rotation)) < 0.03


@pytest.mark.parametrize(("count", "outliers"), [(5, 0), (60, 60), (14, 8)])
def test_a_pose_is_never_invented(count, outliers):
    _, xyz, xy = frame(count, outliers, seed=4)
    found = resect(VALUES, xyz, xy, scale=0.25, seed=1)
    assert isinstance(found, NotPosed)
    assert str(count) in found.reason
