"""A hand that shakes with up to 9 Hz carries a camera whose rows are read one after the other."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.features.features import Features
from planewright.geometry.rigid import Rigid, rotations_from_vectors
from planewright.sfm.cameras import Cameras
from planewright.sfm.frame_table import frame_table
from planewright.sfm.shutter import Poses, ShutterOptions, depth_surfaces, motion_within_frames
from planewright.sfm.solve import SfmOptions, Solved, solve_cameras
from planewright.synthetic.motion import Path, draw_tremor

SIZE, FOCAL, FRAMES, POINTS = (960, 540), 770.0, 70, 500


@cache
def path() -> Path:
    tremor = draw_tremor(0.02, 0.25, np.random.default_rng(5))
    return Path(FRAMES, np.array([0.0, 0.0, 0.5]), 8.0, (2.0, 2.4), (-18.0, 18.0), tremor)


def pixels(pose: Rigid, points: np.ndarray) -> np.ndarray:
    in_cam = pose.apply(points)
    return FOCAL * in_cam[:, :2] / in_cam[:, 2:] + np.array(SIZE) / 2


@cache
def scene(readout: float) -> tuple[Features, np.ndarray]:
    """Features with 0.1 pixels of noise; and where every point is displayed without it, (frames, points, 2)."""
    rng = np.random.default_rng(8)
    points = rng.uniform([-3, -3, -0.5], [3, 3, 2.5], (POINTS, 3))
    shown = np.empty((FRAMES, POINTS, 2))
    shares = np.linspace(-0.7, 0.7, 15)
    for k in range(FRAMES):
        at_share = np.stack([pixels(path().cam_from_world(k + readout * s), points) for s in shares])
        # The row at which a point is met: where its own row and the row being read cross.
        gap = at_share[..., 1] / SIZE[1] - 0.5 - shares[:, None]
        cross = np.argmax((gap[:-1] >= 0) & (gap[1:] < 0), axis=0)
        every = np.arange(POINTS)
        part = gap[cross, every] / (gap[cross, every] - gap[cross + 1, every])
        shown[k] = (1 - part)[:, None] * at_share[cross, every] + part[:, None] * at_share[cross + 1, every]
        shown[k][gap[cross, every] * gap[cross + 1, every] > 0] = -1.0
    inside = ((shown > 5) & (shown < np.array(SIZE) - 5)).all(axis=2)
    track, frame, xy, count = [], [], [], 0
    for p in range(POINTS):
        k = int(rng.integers(0, 20)) - 10
        while k < FRAMES:
            span = np.arange(max(k, 0), min(k + int(rng.integers(15, 45)), FRAMES))
            k += 45 if not len(span) else len(span)
            span = span[np.cumprod(inside[span, p]).astype(bool)]
            if len(span) >= 3:
                track.append(np.full(len(span), count))
                frame.append(span)
                xy.append(shown[span, p] + rng.normal(0, 0.1, (len(span), 2)))
                count += 1
    tracks, frames = np.concatenate(track), np.concatenate(frame)
    order = np.lexsort((tracks, frames))
    shown[~inside] = np.nan
    return Features(tracks[order].astype(np.int32), frames[order].astype(np.int32), np.concatenate(xy)[order].astype(np.float32), count), shown


@cache
def solved(readout: float, allowed: bool = True) -> Cameras:
    shutter = ShutterOptions() if allowed else ShutterOptions(min_frames=FRAMES + 1)
    found = solve_cameras(scene(readout)[0], np.arange(FRAMES), SIZE, options=SfmOptions(shutter=shutter), rng=np.random.default_rng(0))
    assert isinstance(found, Solved)
    return found.cameras


def floor(cameras: Cameras, shown: np.ndarray) -> np.ndarray:
    """Pixels by which points placed by these cameras miss where they were seen, straightened, in all frames."""
    lens, errors = cameras.lens, []
    for p in range(150):
        frames = np.flatnonzero(np.isfinite(shown[:, p, 0]))
        if len(frames) < 10:
            continue
        straight = lens.to_straight(frames, shown[frames, p])
        rays = np.column_stack([lens.intrinsics.pinhole().normalize(straight), np.ones(len(frames))])
        # Linear triangulation: x cross (R X + t) = 0.
        a = np.concatenate([rays[:, k : k + 1] * cameras.rotation[frames, 2] - cameras.rotation[frames, k] for k in (0, 1)])
        b = np.concatenate([cameras.translation[frames, k] - rays[:, k] * cameras.translation[frames, 2] for k in (0, 1)])
        point = np.linalg.lstsq(a, b, rcond=None)[0]
        in_cam = cameras.rotation[frames] @ point + cameras.translation[frames]
        errors.append(np.linalg.norm(lens.intrinsics.pinhole().project(in_cam) - straight, axis=1))
    return np.concatenate(errors)


@pytest.mark.parametrize("readout", [0.7, -0.45])
def test_the_readout_is_found_and_what_it_does_taken_away(readout: float) -> None:
    cameras = solved(readout)
    assert cameras.shutter is not None
    assert_allclose(cameras.shutter.readout, readout, atol=0.025)
    off = floor(cameras, scene(readout)[1])
    assert np.sqrt((off**2).mean()) < 0.12 and np.percentile(off, 99) < 0.3
    assert abs(cameras.intrinsics.focal / FOCAL - 1) < 0.003


def test_without_the_model_the_same_points_are_off() -> None:
    off = floor(solved(0.7, allowed=False), scene(0.7)[1])
    assert np.sqrt((off**2).mean()) > 0.18 and np.percentile(off, 99) > 0.45


def test_a_shutter_that_opens_for_all_rows_at_once_stays_one() -> None:
    cameras = solved(0.0)
    assert cameras.shutter is None
    assert cameras.lens.intrinsics is cameras.intrinsics


def test_motion_within_a_frame_is_that_of_the_path() -> None:
    poses = [path().cam_from_world(float(k)) for k in range(FRAMES)]
    known = np.arange(FRAMES) != 31
    turn, shift = motion_within_frames(np.arange(FRAMES), Poses(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]), known))
    assert not turn[31].any() and not shift[31].any()
    worst, unmoved = 0.0, 0.0
    points = np.array([[0.0, 0.0, 7.0], [2.0, 1.0, 9.0], [-2.0, -1.0, 6.0]])
    for k in range(4, FRAMES - 4):
        if abs(k - 31) < 4:
            continue
        for s in (-0.4, 0.25):
            there = path().cam_from_world(k + s) @ poses[k].inverse()
            step = Rigid(rotations_from_vectors((np.array([s, s**2, s**3]) @ turn[k])[None])[0], np.array([s, s**2, s**3]) @ shift[k])
            still = Rigid(np.eye(3), np.zeros(3))
            worst = max(worst, np.linalg.norm(pixels(step, points) - pixels(there, points), axis=1).max())
            unmoved = max(unmoved, np.linalg.norm(pixels(still, points) - pixels(there, points), axis=1).max())
    assert unmoved > 1.9 and worst < 0.12


def test_the_surface_goes_through_the_points_and_passes_over_stray_ones() -> None:
    rng = np.random.default_rng(0)
    xy = rng.uniform([0, 0], SIZE, (400, 2))
    depth = 1 / (0.1 + 0.05 * xy[:, 0] / SIZE[0] + 0.03 * xy[:, 1] / SIZE[1])
    depth[:8] = 1.0
    points = np.column_stack([(xy - np.array(SIZE) / 2) / FOCAL, np.ones(400)]) * depth[:, None]
    features = Features(np.arange(400, dtype=np.int32), np.zeros(400, np.int32), xy.astype(np.float32), 400)
    table = frame_table(features, np.array([0]))
    still = Poses(np.eye(3)[None], np.zeros((1, 3)), np.array([True]))
    surface = depth_surfaces(table, np.array([FOCAL, *np.array(SIZE) / 2, 0.0, 0.0]), SIZE, still, points, ShutterOptions())[0]
    u, v = np.meshgrid(np.linspace(0, 1, surface.shape[1]), np.linspace(0, 1, surface.shape[0]))
    assert_allclose(surface, 0.1 + 0.05 * u + 0.03 * v, rtol=0.03)
