"""What frames said of corners, as points in space."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from planewright.corrections.said import show, what_frames_said
from planewright.tracking.tracks import State


def test_a_track_beside_the_model_is_a_point_beside_it(stage) -> None:
    session = stage().session
    scene, cameras, tracks = session.model.structure.scene, session.model.cameras, session.tracks
    row = session.row("b1")
    beside = scene.points[row] + 3e-3 * np.array([1.0, -2.0, 0.5]) * np.linalg.norm(np.ptp(scene.points, axis=0))
    mine = tracks.point_index == row
    rows = np.array([cameras.row(int(f)) for f in tracks.frame[mine]])
    xy = tracks.xy.copy()
    xy[mine] = show(beside[None], cameras, rows).xy[:, 0]
    said = what_frames_said(replace(tracks, xy=xy), scene, cameras, np.array([row]))
    assert said.spoke.all()
    assert np.linalg.norm(said.place[0] - beside) < 0.05 * np.linalg.norm(scene.points[row] - beside)


def test_a_covariance_in_space_shows_that_of_the_track(stage) -> None:
    session = stage().session
    scene, cameras, tracks = session.model.structure.scene, session.model.cameras, session.tracks
    row = session.row("b1")
    spread = np.diag([1.0, 4.0, 2.0]) * (1e-3 * np.linalg.norm(np.ptp(scene.points, axis=0))) ** 2
    mine = np.flatnonzero(tracks.point_index == row)
    rows = np.array([cameras.row(int(f)) for f in tracks.frame[mine]])
    jacobian = show(scene.points[row : row + 1], cameras, rows).jacobian[:, 0]
    covariance = tracks.covariance.copy()
    covariance[mine] = np.einsum("kia,ab,kjb->kij", jacobian, spread, jacobian)
    vague = replace(scene, point_covariance=np.tile(100.0 * spread, (len(scene.points), 1, 1)))
    said = what_frames_said(replace(tracks, covariance=covariance), vague, cameras, np.array([row]))
    seen = np.einsum("kia,ab,kjb->kij", jacobian, said.covariance[0], jacobian)
    assert_allclose(seen, covariance[mine], rtol=0.15, atol=0.02)


def test_hidden_and_bridged_frames_say_nothing(stage) -> None:
    session = stage().session
    scene, cameras, tracks = session.model.structure.scene, session.model.cameras, session.tracks
    chosen = np.array([session.row("b1"), session.row("m3")])
    for state in (State.HIDDEN, State.BRIDGED):
        silent = replace(tracks, state=np.full_like(tracks.state, int(state)))
        said = what_frames_said(silent, scene, cameras, chosen)
        assert not said.spoke.any()
        assert_allclose(said.place, scene.points[chosen])
        assert (said.information == 0.0).all()
