"""Tracks carried along with the model: as following them anew would have it, without looking at a frame."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from planewright.corrections.carry import carry_tracks, fused_with_mark
from planewright.sketch.graph import PointId
from planewright.tracking.tracks import State


def moved_by(session, point: str, shift: np.ndarray):
    scene = session.model.structure.scene
    points = scene.points.copy()
    points[session.row(PointId(point))] += shift
    return scene, replace(scene, points=points), np.arange(len(points)) == session.row(PointId(point))


def test_nothing_moves_where_the_model_does_not(stage) -> None:
    session = stage().session
    scene, same, chosen = moved_by(session, "b1", np.zeros(3))
    rows = carry_tracks(session.tracks, scene, same, session.model.cameras, chosen)
    old = session.tracks.point_index == session.row(PointId("b1"))
    tracked = session.tracks.state[old] == State.TRACKED
    assert_array_equal(rows.frame, session.tracks.frame[old])
    assert_allclose(rows.xy[tracked], session.tracks.xy[old][tracked], atol=0.02)
    assert_allclose(rows.covariance[tracked], session.tracks.covariance[old][tracked], rtol=0.05)


def test_frames_that_looked_at_something_else_are_not_believed(stage) -> None:
    staged = stage()
    session = staged.session
    shift = np.array([0.0, 0.0, 0.3])
    scene, other, chosen = moved_by(session, "b1", shift)
    rows = carry_tracks(session.tracks, scene, other, session.model.cameras, chosen, doubted=chosen)
    cameras, row = session.model.cameras, session.row(PointId("b1"))
    seen = [cameras.intrinsics.project(cameras.cam_from_world(cameras.row(int(f))).apply(other.points[row][None]))[0] for f in rows.frame]
    assert np.linalg.norm(rows.xy - np.array(seen), axis=1).max() < 1.0


def test_frames_of_other_corners_are_believed_and_hold_their_tracks(stage) -> None:
    session = stage().session
    tracks = session.tracks
    sure = replace(session, tracks=replace(tracks, covariance=np.full_like(tracks.covariance, 0.0) + 0.1**2 * np.eye(2)))
    spread = np.tile(1e-2 * np.eye(3), (len(session.sketch.points), 1, 1))
    scene, other, chosen = moved_by(sure, "b1", np.array([0.0, 0.0, 0.3]))
    vague, moved = (replace(s, point_covariance=spread) for s in (scene, other))
    rows = carry_tracks(sure.tracks, vague, moved, session.model.cameras, chosen)
    old = sure.tracks.point_index == session.row(PointId("b1"))
    at = np.searchsorted(rows.frame, sure.tracks.frame[old])
    assert np.linalg.norm(rows.xy[at] - sure.tracks.xy[old], axis=1).max() < 0.5


def test_a_bridged_stretch_of_another_corner_keeps_its_bits(stage) -> None:
    session = stage().session
    old = np.flatnonzero(session.tracks.point_index == session.row(PointId("b1")))
    state = session.tracks.state.copy()
    state[old[5:12]] = State.BRIDGED
    scene, other, chosen = moved_by(session, "b1", np.array([0.02, 0.0, 0.02]))
    rows = carry_tracks(replace(session.tracks, state=state), scene, other, session.model.cameras, chosen)
    at = np.searchsorted(rows.frame, session.tracks.frame[old[5:12]])
    assert_array_equal(rows.xy[at], session.tracks.xy[old[5:12]])
    assert set(rows.state[at]) == {int(State.BRIDGED)}


def test_covariances_are_symmetric_and_positive(stage) -> None:
    session = stage().session
    scene, other, chosen = moved_by(session, "b1", np.array([0.01, 0.0, 0.01]))
    rows = carry_tracks(session.tracks, scene, other, session.model.cameras, chosen)
    assert_allclose(rows.covariance, rows.covariance.transpose(0, 2, 1), atol=1e-12)
    assert np.linalg.eigvalsh(rows.covariance).min() > 0.0


def test_a_mark_draws_its_row_by_what_both_are_sure_of(stage) -> None:
    tracks = stage().session.tracks
    k = 7
    point, frame = int(tracks.point_index[k]), int(tracks.frame[k])
    sure = replace(tracks, covariance=np.where(np.arange(len(tracks.frame))[:, None, None] == k, 0.49 * np.eye(2), tracks.covariance))
    drawn = fused_with_mark(sure, point, frame, tracks.xy[k] + [2.0, 0.0], 0.7)
    assert_allclose(drawn.xy[k], tracks.xy[k] + [1.0, 0.0])
    assert_allclose(drawn.covariance[k], 0.245 * np.eye(2))
    assert_array_equal(np.delete(drawn.xy, k, axis=0), np.delete(tracks.xy, k, axis=0))
