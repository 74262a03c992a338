"""The next correction: what is doubtful comes first, what was said is not asked again."""

from dataclasses import replace

import numpy as np
import pytest

from planewright.corrections.correct import correct
from planewright.corrections.session import Mark
from planewright.corrections.suggest import chance_beyond, suggest
from planewright.sketch.graph import PointId
from planewright.tracking.tracks import State


def vague(session, point: str, sigma: float):
    mine = session.tracks.point_index == session.row(PointId(point))
    covariance = np.where(mine[:, None, None], sigma**2 * np.eye(2), session.tracks.covariance)
    return replace(session, tracks=replace(session.tracks, covariance=covariance))


def test_the_corner_whose_track_is_least_sure_comes_first(stage) -> None:
    session = vague(stage().session, "b0", 6.0)
    best = suggest(session, 3)
    assert best[0].point == "b0"
    assert [mark.gain for mark in best] == sorted((mark.gain for mark in best), reverse=True)
    assert "sure to 6.0 px" in best[0].reason


def test_a_gain_is_a_number_of_frames_in_which_the_corner_is_seen(stage) -> None:
    session = vague(stage().session, "b0", 100.0)
    seen = (session.tracks.point_index == session.row(PointId("b0"))) & (session.tracks.state == 1)
    gain = suggest(session, 1)[0].gain
    assert 0.9 * seen.sum() < gain <= seen.sum()


def test_a_track_beside_its_own_mark_is_named_with_the_distance(stage) -> None:
    session = stage().session
    row = session.row(PointId("a0"))
    shifted = session.tracks.xy + np.where(session.tracks.point_index == row, 9.0, 0.0)[:, None] * [1.0, 0.0]
    best = suggest(replace(session, tracks=replace(session.tracks, xy=shifted)), 1)[0]
    assert best.point == "a0"
    assert "off its mark" in best.reason


def test_the_frame_is_one_in_which_the_corner_is_seen_and_not_marked(stage) -> None:
    session = stage().session
    for mark in suggest(session, 20):
        here = (session.tracks.point_index == session.row(mark.point)) & (session.tracks.frame == mark.frame)
        assert session.tracks.state[here].tolist() == [int(State.HIDDEN if "called hidden" in mark.reason else State.TRACKED)]
        assert mark.frame not in session.sketch.points[session.row(mark.point)].marks


def test_what_was_corrected_is_worth_less_in_each_frame_afterwards(stage) -> None:
    staged = stage(plane={"lean_side": 0.25})
    done = correct(staged.session, Mark(PointId("l1"), 0, staged.at("l1", 0)))

    def worth(session) -> float:
        mine = session.tracks.point_index == session.row(PointId("l1"))
        seen = int((mine & (session.tracks.state == State.TRACKED)).sum())
        return next(mark.gain for mark in suggest(session, 40) if mark.point == "l1") / seen

    assert worth(done.session) < 0.5 * worth(staged.session)


def test_a_corner_without_a_place_in_space_is_asked_for(stage) -> None:
    session = stage().session
    assert session.model is not None
    scene = session.model.structure.scene
    known = scene.point_known.copy()
    known[session.row(PointId("b0"))] = False
    structure = replace(session.model.structure, scene=replace(scene, point_known=known))
    lost = replace(session, model=replace(session.model, structure=structure))
    best = suggest(lost, 1)[0]
    assert best.point == "b0"
    assert "no place in space" in best.reason
    assert suggest(lost, 1) == suggest(lost, 1)


def test_without_a_model_the_tracks_alone_are_asked(stage) -> None:
    session = replace(vague(stage().session, "b0", 6.0), model=None)
    assert suggest(session, 1)[0].point == "b0"


def test_what_a_person_found_right_sinks_until_its_track_moves(stage) -> None:
    session = vague(stage().session, "b0", 6.0)
    first = suggest(session, 1)[0]
    looked = session.looked(first.point, first.frame)
    after = {mark.point: mark for mark in suggest(looked, 30)}
    assert after[first.point].gain < 0.4 * first.gain
    assert after[first.point].frame != first.frame
    moved = replace(looked, tracks=replace(looked.tracks, xy=looked.tracks.xy + np.array([5.0, 0.0])))
    assert {mark.point: mark.gain for mark in suggest(moved, 30)}[first.point] > 0.9 * first.gain


def test_a_mark_that_agrees_sinks_its_point(stage) -> None:
    staged = stage()
    first = {mark.point: mark.gain for mark in suggest(staged.session, 30)}[PointId("m3")]
    done = correct(staged.session, Mark(PointId("m3"), 20, staged.at("m3", 20, (0.3, 0.2))))
    assert done.kind == "agreed"
    assert {mark.point: mark.gain for mark in suggest(done.session, 30)}[PointId("m3")] < 0.5 * first


def test_a_corner_that_is_called_hidden_everywhere_is_asked_for_where_nothing_is_before_it(stage) -> None:
    session = stage().session
    mine = session.tracks.point_index == session.row(PointId("b0"))
    state = np.where(mine & (session.tracks.state == State.TRACKED), int(State.HIDDEN), session.tracks.state)
    best = suggest(replace(session, tracks=replace(session.tracks, state=state)), 1)[0]
    assert best.point == "b0"
    assert "nothing in the model is before it" in best.reason


@pytest.mark.parametrize("sigmas", [(3.0, 3.0), (4.0, 0.5), (6.0, 2.0), (1.5, 0.1)])
def test_the_chance_to_be_far_off_is_that_of_a_gaussian(sigmas: tuple[float, float]) -> None:
    off = np.random.default_rng(0).normal(0.0, sigmas, (200_000, 2))
    variance = np.square(sigmas)
    chance = chance_beyond(variance[:1], variance[1:], 5.0)[0]
    assert abs(chance - (np.linalg.norm(off, axis=1) > 5.0).mean()) < 0.01


def test_after_one_corner_was_wrongly_found_on_a_face_one_beside_it_is_asked_for(stage) -> None:
    """m0 lies on the front by right. A mark overruled such an incidence of l1, with which it shares a face."""
    session = stage(found=(("front", "m0"),)).session
    before, after = ({mark.point: mark for mark in suggest(one, 30)} for one in (session, replace(session, overruled=(PointId("l1"),))))
    assert after[PointId("m0")].gain > 5.0 * before[PointId("m0")].gain
    assert "wrongly" in after[PointId("m0")].reason
    assert after[PointId("b0")].gain == before[PointId("b0")].gain


def test_a_short_run_of_frames_called_hidden_is_likelier_wrong_in_each_than_a_long_one(stage) -> None:
    session = stage().session
    mine = np.flatnonzero((session.tracks.point_index == session.row(PointId("b0"))) & (session.tracks.state == State.TRACKED))

    def gain(length: int) -> float:
        state = session.tracks.state.copy()
        state[mine[2 : 2 + length]] = int(State.HIDDEN)
        tracks = replace(session.tracks, state=state)
        return {mark.point: mark.gain for mark in suggest(replace(session, tracks=tracks), 30)}[PointId("b0")]

    assert gain(8) / 8 > 1.3 * gain(30) / 30
