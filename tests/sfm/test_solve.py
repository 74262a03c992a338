"""Laws of the camera solve, over tracks with known truth."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planewright.features.features import Features
from planewright.features.follow import follow_features
from planewright.geometry.rigid import rotation_angle
from planewright.sfm.degeneracy import Refused
from planewright.sfm.solve import Solved, solve_cameras
from planewright.sketch.graph import KnownCamera
from planewright.video.clip import open_clip


def solve(scene, **more):
    return solve_cameras(scene.features, scene.numbers, scene.image_size, rng=np.random.default_rng(5), **more)


def errors(scene, solved: Solved) -> tuple[np.ndarray, np.ndarray]:
    """Rotation errors in degrees and position errors relative to the path's extent, after the best similarity."""
    posed = solved.cameras.posed
    truth, found = scene.centers[posed], solved.cameras.centers[posed]
    mean_t, mean_f = truth.mean(axis=0), found.mean(axis=0)
    u, s, vt = np.linalg.svd((truth - mean_t).T @ (found - mean_f))
    d = np.diag([1, 1, np.linalg.det(u @ vt)])
    turn = u @ d @ vt
    scale = (s * np.diag(d)).sum() / ((found - mean_f) ** 2).sum()
    off = np.linalg.norm(scale * (found - mean_f) @ turn.T + mean_t - truth, axis=1) / np.ptp(truth, axis=0).max()
    m = np.einsum("kji,kjl->il", scene.rotation[posed], solved.cameras.rotation[posed])
    u, _, vt = np.linalg.svd(m)
    common = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    angles = [rotation_angle(r @ common, q) for r, q in zip(scene.rotation[posed], solved.cameras.rotation[posed], strict=True)]
    return np.degrees(angles), off


@pytest.mark.parametrize("kind", ["orbit", "forward"])
def test_cameras_and_focal_are_recovered(tracked, kind):
    scene = tracked(kind)
    solved = solve(scene)
    assert isinstance(solved, Solved)
    assert solved.cameras.posed.all()
    turn, off = errors(scene, solved)
    assert np.median(turn) < 0.02 and turn.max() < 0.1
    assert np.median(off) < 2e-3
    assert abs(solved.cameras.intrinsics.focal / scene.focal - 1) < 0.005
    low, high = solved.cameras.focal_interval
    assert high is not None and low < solved.cameras.intrinsics.focal < high
    # 95 % intervals miss one truth in twenty; 3.5 standard deviations one in two thousand.
    assert abs(solved.cameras.intrinsics.focal - scene.focal) < 3.5 * solved.cameras.focal_sigma
    assert solved.summary.radial_terms == 0


def test_the_same_input_gives_the_same_cameras(tracked):
    scene = tracked(num_frames=40)
    a, b = solve(scene), solve(scene)
    assert isinstance(a, Solved) and isinstance(b, Solved)
    assert_array_equal(a.cameras.rotation, b.cameras.rotation)
    assert_array_equal(a.cameras.translation, b.cameras.translation)
    assert_array_equal(a.points.xyz, b.points.xyz)
    assert a.cameras.intrinsics.focal == b.cameras.intrinsics.focal and a.cameras.focal_interval == b.cameras.focal_interval


def test_a_lens_that_bends_is_noticed_and_measured(tracked):
    scene = tracked(distortion=(-0.08, 0.0))
    solved = solve(scene)
    assert isinstance(solved, Solved)
    assert solved.summary.radial_terms >= 1
    assert abs(solved.cameras.intrinsics.distortion[0] + 0.08) < 0.02
    assert abs(solved.cameras.intrinsics.focal / scene.focal - 1) < 0.01


@pytest.mark.parametrize(
    ("kind", "more", "code"),
    [
        ("rotation", {}, "rotation-only"),
        ("static", {}, "static-camera"),
        ("orbit", {"flat": True}, "planar-scene"),
        ("orbit", {"num_points": 25}, "too-few-features"),
    ],
)
def test_a_clip_that_holds_no_cameras_is_refused_by_name(tracked, kind, more, code):
    refused = solve(tracked(kind, **more))
    assert isinstance(refused, Refused)
    assert refused.code == code
    assert "Film" in refused.reason or "Walk" in refused.reason


def test_points_that_each_go_their_own_way_make_no_scene():
    rng = np.random.default_rng(0)
    frames, count = 30, 200
    xy = rng.uniform([50, 50], [900, 500], (count, 2)) + np.arange(frames)[:, None, None] * rng.normal(0, 3, (count, 2))
    own = Features(
        track_index=np.tile(np.arange(count), frames).astype(np.int32),
        frame=np.repeat(np.arange(frames), count).astype(np.int32),
        xy=xy.reshape(-1, 2).astype(np.float32),
        num_tracks=count,
    )
    refused = solve_cameras(own, np.arange(frames), (960, 540), rng=np.random.default_rng(0))
    assert isinstance(refused, Refused)
    assert refused.code in ("not-rigid", "no-start", "lost")


@pytest.mark.parametrize("frames", [0, 1, 2, 5])
def test_a_clip_without_features_is_refused(frames):
    nothing = Features(track_index=np.zeros(0, np.int32), frame=np.zeros(0, np.int32), xy=np.zeros((0, 2), np.float32), num_tracks=0)
    refused = solve_cameras(nothing, np.arange(frames), (960, 540), rng=np.random.default_rng(0))
    assert isinstance(refused, Refused) and refused.code == ("too-few-frames" if frames < 3 else "too-few-features")


def test_a_plane_gives_cameras_once_the_focal_is_known(tracked):
    scene = tracked(flat=True)
    solved = solve(scene, known=KnownCamera(focal=scene.focal, sigma=2.0))
    assert isinstance(solved, Solved)
    assert any("one plane" in warning for warning in solved.summary.warnings)
    turn, _ = errors(scene, solved)
    assert np.median(turn) < 0.1


def test_a_nearly_affine_clip_says_that_its_focal_is_hardly_known(tracked):
    scene = tracked(away=40.0, noise=0.3, num_frames=40, num_points=200)
    solved = solve(scene)
    assert isinstance(solved, Solved)
    low, high = solved.cameras.focal_interval
    assert high is None or (high - low) / solved.cameras.intrinsics.focal > 0.3
    assert low < scene.focal < (high or np.inf)
    assert any("affine" in warning for warning in solved.summary.warnings)


def test_a_known_focal_pulls_a_nearly_affine_clip(tracked):
    scene = tracked(away=40.0, noise=0.3, num_frames=40, num_points=200)
    free, held = solve(scene), solve(scene, known=KnownCamera(focal=scene.focal, sigma=0.01 * scene.focal))
    assert isinstance(free, Solved) and isinstance(held, Solved)
    assert held.cameras.focal_sigma < 0.3 * free.cameras.focal_sigma
    assert abs(held.cameras.intrinsics.focal / scene.focal - 1) < 0.03


def test_growth_crosses_a_thin_stretch(tracked):
    scene = tracked(num_frames=80, thin=(38, 44))
    solved = solve(scene)
    assert isinstance(solved, Solved)
    assert solved.cameras.posed.all()
    turn, _ = errors(scene, solved)
    assert np.median(turn) < 0.05


def test_a_frame_without_features_gets_no_pose(tracked):
    scene = tracked()
    keep = (scene.features.frame < 30) | (scene.features.frame > 32)
    blind = replace(scene.features, track_index=scene.features.track_index[keep], frame=scene.features.frame[keep], xy=scene.features.xy[keep])
    solved = solve(replace(scene, features=blind))
    assert isinstance(solved, Solved)
    assert_array_equal(np.nonzero(~solved.cameras.posed)[0], [30, 31, 32])
    assert_array_equal(solved.cameras.rotation[31], np.eye(3))
    assert any("3 of 60 frames" in warning for warning in solved.summary.warnings)


def test_letters_laid_over_the_picture_do_no_harm(tracked):
    scene = tracked()
    f = scene.features
    rng = np.random.default_rng(1)
    where = rng.uniform([50, 20], [900, 60], (120, 2))
    frames = np.repeat(scene.numbers, 120)
    track = np.concatenate([f.track_index, f.num_tracks + np.tile(np.arange(120), len(scene.numbers))]).astype(np.int32)
    frame = np.concatenate([f.frame, frames]).astype(np.int32)
    xy = np.concatenate([f.xy, np.tile(where, (len(scene.numbers), 1)) + rng.normal(0, 0.05, (len(frames), 2))]).astype(np.float32)
    order = np.lexsort((track, frame))
    solved = solve(replace(scene, features=replace(f, track_index=track[order], frame=frame[order], xy=xy[order], num_tracks=f.num_tracks + 120)))
    assert isinstance(solved, Solved)
    turn, _ = errors(scene, solved)
    assert np.median(turn) < 0.02


def test_cameras_of_a_rendered_clip_are_as_good_as_is_promised():
    """Promised: rotation .03 degrees (median), focal .5 %; here a tighter hold, since .005 degrees and .03 % were measured."""
    folder = os.environ.get("PLANEWRIGHT_DATA")
    if not folder or not (Path(folder) / "sample" / "truth.json").exists():
        pytest.skip("PLANEWRIGHT_DATA does not name a folder with the clip `sample`")
    truth = json.loads((Path(folder) / "sample" / "truth.json").read_text())
    clip = open_clip(Path(folder) / "sample" / "clip.mp4")
    solved = solve_cameras(follow_features(clip), np.array(clip.numbers), clip.image_size, rng=np.random.default_rng(0))
    assert isinstance(solved, Solved) and solved.cameras.posed.all()
    true = np.array([frame["cam_from_world"]["rotation"] for frame in truth["frames"]])
    u, _, vt = np.linalg.svd(np.einsum("kji,kjl->il", true, solved.cameras.rotation))
    common = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    angles = [rotation_angle(r @ common, q) for r, q in zip(true, solved.cameras.rotation, strict=True)]
    assert np.degrees(np.median(angles)) < 0.012
    assert abs(solved.cameras.intrinsics.focal / truth["camera"]["focal"][0] - 1) < 0.002
