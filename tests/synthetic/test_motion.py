"""The hand that holds the camera."""

from itertools import pairwise

import numpy as np
from numpy.testing import assert_allclose

from planewright.geometry.rigid import rotation_angle
from planewright.synthetic import demo_scene, desktop, hall, toy_house
from planewright.synthetic.motion import Walk, draw_tremor, look_at


def test_a_camera_looks_at_its_target_upright() -> None:
    target = np.array([0.3, -0.2, 0.9])
    pose = look_at(np.array([3.0, -4.0, 2.5]), target)
    seen, above = pose.apply(np.stack([target, target + np.array([0.0, 0.0, 0.1])]))
    assert_allclose(seen, [0.0, 0.0, np.linalg.norm(target - [3.0, -4.0, 2.5])], atol=1e-12)
    assert above[1] < 0 and abs(above[0]) < 1e-12  # y runs down
    assert_allclose(np.linalg.det(pose.rotation), 1.0)


def test_a_tremor_has_the_asked_deviation() -> None:
    offsets = np.array([draw_tremor(0.05, 1.0, np.random.default_rng(seed)).at(time) for seed in range(40) for time in np.arange(0.0, 400.0, 7.0).tolist()])
    assert_allclose(offsets[:, :3].std(axis=0), 0.05, rtol=0.1)
    assert_allclose(np.degrees(offsets[:, 3:].std(axis=0)), 1.0, rtol=0.1)


def test_a_path_is_smooth_and_stays_so_on_long_clips() -> None:
    for clip in (demo_scene(80), demo_scene(3000), toy_house(300), hall(350), desktop(150)):
        poses = [clip.path.cam_from_world(k / 4) for k in range(0, 400)]
        turn = np.degrees([rotation_angle(b.rotation, a.rotation) for a, b in pairwise(poses)])
        assert turn.max() < 0.8  # a quarter of a frame
        assert np.abs(np.diff(turn)).max() < 0.1


def test_a_walk_comes_to_its_places_at_equal_times_and_looks_at_its_targets() -> None:
    rng = np.random.default_rng(4)
    places = rng.uniform(-1.0, 1.0, (5, 3))
    targets = places + np.array([0.0, 6.0, 0.0]) + rng.uniform(-1.0, 1.0, (5, 3))
    walk = Walk(200, places, targets, draw_tremor(0.0, 0.0, rng))
    for k in range(5):
        pose = walk.cam_from_world(50.0 * k - 0.5)
        assert_allclose(-pose.rotation.T @ pose.translation, places[k], atol=1e-12)
        assert_allclose(pose.apply(targets[k][None])[0], [0.0, 0.0, float(np.linalg.norm(targets[k] - places[k]))], atol=1e-12)
