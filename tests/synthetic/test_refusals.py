"""Clips that determine no answer are what they claim to be."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.synthetic import object_on_turntable, rotating_camera, single_plane, still_camera, true_cameras, true_tracks
from planewright.synthetic.observe import face_planes


def test_a_still_camera_does_not_move() -> None:
    clip = still_camera(6)
    xy, _, _ = true_tracks(clip)
    assert_allclose(xy, xy[:, :1].repeat(6, axis=1), atol=1e-9)
    images = np.stack([image for _, image in clip.frames.gray(range(6))]).astype(float)
    assert np.abs(images - images.mean(axis=0)).mean() > 0.5  # but the sensor is alive


def test_a_rotating_camera_stays_where_it_is() -> None:
    cameras = true_cameras(rotating_camera())
    assert_allclose(cameras.centers, cameras.centers[:1].repeat(len(cameras.frame), axis=0), atol=1e-9)
    xy, _, _ = true_tracks(rotating_camera())
    assert np.ptp(xy[..., 0], axis=1).min() > 40


def test_a_single_plane_is_one_plane_and_fills_the_image() -> None:
    clip = single_plane()
    normals, offsets = face_planes(clip.scene)
    assert_allclose(normals, normals[:1].repeat(len(normals), axis=0), atol=1e-12)
    assert_allclose(offsets, offsets[0], atol=1e-12)
    for number in (0, clip.num_frames - 1):
        assert clip.renderer.surface_index(number).min() >= 0


def test_on_the_turntable_only_the_object_moves() -> None:
    clip = object_on_turntable(10)
    first, last = (clip.renderer.frame(k).astype(float) for k in (0, 9))
    moving = np.isin(clip.renderer.surface_index(0), [0, 1, 2]) | np.isin(clip.renderer.surface_index(9), [0, 1, 2])
    brightness = last[~moving].mean() / first[~moving].mean()
    still, turned = (np.abs(last[where] - brightness * first[where]).mean() for where in (~moving, moving))
    assert still < 5 < turned
    assert 0.1 < moving.mean() < 0.5
