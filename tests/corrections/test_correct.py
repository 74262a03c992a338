"""One mark: what it repairs, what it leaves alone, what stays exact, and what is said where nothing explains it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planewright.corrections.correct import correct
from planewright.corrections.session import Mark, Session, with_mark
from planewright.errors import Cancelled, UsageError
from planewright.sketch.graph import PointId
from planewright.tracking.tracks import State, Tracks

A1, W0 = PointId("a1"), PointId("w0")


def rows_of(session: Session, point: str) -> Tracks:
    mine = session.tracks.point_index == session.row(PointId(point))
    tracks = session.tracks
    return Tracks(tracks.point_index[mine], tracks.frame[mine], tracks.xy[mine], tracks.covariance[mine], tracks.state[mine])


def assert_same_rows(a: Tracks, b: Tracks) -> None:
    for one, other in zip(vars(a).values(), vars(b).values(), strict=True):
        assert_array_equal(one, other)


def test_one_drag_repairs_a_bad_click_in_all_frames_and_moves_nothing_else(stage) -> None:
    staged = stage(clicks={"w0": (7.0, 4.0)})
    assert np.median(staged.errors(staged.session, "w0")) > 4.0
    done = correct(staged.session, Mark(W0, 30, staged.at("w0", 30, (0.4, -0.3))))
    assert done.kind == "moved"
    assert done.points == ("w0",)
    assert staged.errors(done.session, "w0").max() < 1.5
    for point in staged.session.sketch.points:
        if point.id != "w0":
            assert_same_rows(rows_of(done.session, point.id), rows_of(staged.session, point.id))
    assert any("first mark of w0" in sentence for sentence in done.sentences)


def test_one_drag_puts_a_face_right_that_was_measured_on_something_else(stage) -> None:
    staged = stage(plane={"lean_side": 0.25})
    assert np.median(staged.errors(staged.session, "l1")) > 10.0
    done = correct(staged.session, Mark(PointId("l1"), 0, staged.at("l1", 0)))
    assert done.kind == "solved"
    assert staged.errors(done.session, "l1").max() < 1.5


def test_one_drag_takes_a_corner_off_a_face_that_it_was_wrongly_found_on(stage) -> None:
    """An incidence is exact, so no mark outweighs it: it must be doubted as such."""
    staged = stage(found=(("front", "l1"),))
    assert np.median(staged.errors(staged.session, "l1")) > 10.0
    done = correct(staged.session, Mark(PointId("l1"), 0, staged.at("l1", 0, (0.3, 0.3))))
    assert np.median(staged.errors(done.session, "l1")) < 1.0
    assert done.session.model is not None
    basis, scene = done.session.model.structure.basis, done.session.model.structure.scene
    assert basis is not None
    assert [scene.face_row()["front"], scene.point_row()["l1"]] not in basis.incidences.tolist()
    assert done.session.overruled == ("l1",)
    assert any("l1 had been taken to lie on front" in sentence for sentence in done.sentences)


def test_a_mark_that_says_which_line_is_meant_moves_the_other_end_of_the_edge_as_well(stage) -> None:
    """The window's sill was taken for a line that runs beside it: both its corners are off by the same."""
    staged = stage(beside={("w0", "w1"): 12.0}, sigma=0.15)
    before = staged.session
    assert min(np.median(staged.errors(before, point)) for point in ("w0", "w1")) > 5.0
    done = correct(before, Mark(W0, 20, staged.at("w0", 20, (0.4, -0.3))))
    assert max(np.median(staged.errors(done.session, point)) for point in ("w0", "w1")) < 0.8
    assert "w1" in done.points
    assert done.session.model is not None
    ends = {before.row(W0), before.row(PointId("w1"))}
    sill = [line for line in done.session.model.structure.lines if {*line.edge} == ends]
    assert sill
    assert all(max(map(abs, line.offset)) < 1.5 * line.pixel for line in sill)
    for other in ("w2", "w3", "a0", "b1"):
        assert np.median(staged.errors(done.session, other)) < np.median(staged.errors(before, other)) + 0.3


def test_incidences_and_relations_stay_exact(stage) -> None:
    wanted = (("orthogonal", "front", "side"), ("parallel", "front", "pane"))
    staged = stage(clicks={"a1": (3.0, -2.0)}, relations=wanted)
    done = correct(staged.session, Mark(A1, 33, staged.at("a1", 33)))
    assert done.session.model is not None
    scene, basis = done.session.model.structure.scene, done.session.model.structure.basis
    assert basis is not None
    face, corner = basis.incidences.T
    off = (scene.normals[face] * scene.points[corner]).sum(axis=1) - scene.offsets[face]
    assert np.abs(off).max() < 1e-9
    rows = scene.face_row()
    front, side, pane = (scene.normals[rows[name]] for name in ("front", "side", "pane"))
    assert abs(front @ side) < 1e-9
    assert np.linalg.norm(np.cross(front, pane)) < 1e-9
    assert not np.array_equal(scene.points, staged.session.model.structure.scene.points)


def test_what_shares_no_face_and_no_relation_keeps_its_bits(stage) -> None:
    staged = stage(plane={"lean_side": 0.25})
    done = correct(staged.session, Mark(PointId("l1"), 36, staged.at("l1", 36)))
    sketch = staged.session.sketch
    touched = {c for face in sketch.faces if "l1" in face.corners for c in face.corners}
    apart = [p.id for p in sketch.points if p.id not in touched]
    assert len(apart) > 5
    for point in apart:
        assert_same_rows(rows_of(done.session, point), rows_of(staged.session, point))
    assert staged.session.model is not None and done.session.model is not None
    old, new = staged.session.model.structure.scene, done.session.model.structure.scene
    keep = [old.point_row()[PointId(point)] for point in apart]
    assert_array_equal(new.points[keep], old.points[keep])


def test_a_mark_that_the_model_contradicts_is_obeyed_in_the_image_and_said(stage) -> None:
    staged = stage()
    away = staged.at("m3", 20, (25.0, -18.0))
    done = correct(staged.session, Mark(PointId("m3"), 20, away))
    assert done.kind == "bridged"
    assert done.session.model is not None and staged.session.model is not None
    assert done.session.model.structure.scene.points is staged.session.model.structure.scene.points
    rows = rows_of(done.session, "m3")
    here = rows.frame == 20
    np.testing.assert_allclose(rows.xy[here][0], away)
    assert rows.state[here][0] == State.MARKED
    assert set(rows.state[np.isin(rows.frame, done.frames) & ~here & (rows.state != State.MARKED)]) <= {State.BRIDGED, State.HIDDEN}
    assert "px off in frame 20" in done.sentences[0]
    assert "meet" in done.sentences[0] and "front" in done.sentences[0]
    for point in ("w0", "a0", "l1"):
        assert_same_rows(rows_of(done.session, point), rows_of(staged.session, point))


def test_without_a_model_a_mark_acts_up_to_the_next_mark(stage) -> None:
    staged = stage()
    tracks = staged.session.tracks
    row = staged.session.row(W0)
    drift = np.where(tracks.point_index == row, np.clip(tracks.frame - 10, 0, 20) / 4.0, 0.0)
    points = tuple(replace(p, marks={10: staged.at("w0", 10)}) if p.id == W0 else p for p in staged.session.sketch.points)
    sketch = replace(staged.session.sketch, points=points)
    flat = replace(staged.session, model=None, sketch=sketch, tracks=replace(tracks, xy=tracks.xy + drift[:, None] * [1.0, 0.5]))
    done = correct(flat, Mark(W0, 30, staged.at("w0", 30)))
    assert done.kind == "bridged"
    rows, old = rows_of(done.session, "w0"), rows_of(flat, "w0")
    between = (rows.frame > 10) & (rows.frame < 30)
    errors = staged.errors(done.session, "w0")
    assert errors[between].max() < 1.3
    assert_array_equal(rows.xy[rows.frame < 10], old.xy[old.frame < 10])


def test_the_same_mark_twice_gives_the_same_bits(stage) -> None:
    staged = stage(clicks={"a1": (3.0, -2.0)})
    mark = Mark(A1, 33, staged.at("a1", 33))
    one, other = correct(staged.session, mark), correct(staged.session, mark)
    assert_same_rows(one.session.tracks, other.session.tracks)


def test_a_first_answer_comes_before_the_last_and_near_it(stage) -> None:
    staged = stage(clicks={"w0": (7.0, 4.0)})
    shown: list[Tracks] = []
    done = correct(staged.session, Mark(W0, 30, staged.at("w0", 30)), preview=shown.append)
    assert len(shown) == 1
    final = rows_of(done.session, "w0")
    at = np.searchsorted(final.frame, shown[0].frame)
    assert 10 < len(at) < len(final.frame)
    assert np.linalg.norm(final.xy[at] - shown[0].xy, axis=1).max() < 2.0


def test_the_session_before_is_untouched_and_the_mark_is_in_the_drawing_after(stage) -> None:
    staged = stage(clicks={"w0": (7.0, 4.0)})
    before = rows_of(staged.session, "w0")
    done = correct(staged.session, Mark(W0, 30, staged.at("w0", 30)))
    assert_same_rows(rows_of(staged.session, "w0"), before)
    assert 30 not in staged.session.sketch.points[staged.session.row(W0)].marks
    assert 30 in done.session.sketch.points[done.session.row(W0)].marks
    assert done.session.marks == (Mark(W0, 30, staged.at("w0", 30)),)


def test_a_mark_parts_a_span_in_which_its_point_was_said_to_be_hidden(stage) -> None:
    sketch = stage().session.sketch
    hidden = replace(sketch, points=tuple(replace(p, hidden=((5, 20), (30, 31))) for p in sketch.points))
    marked = with_mark(hidden, Mark(W0, 12, (1.0, 2.0)))
    assert next(p for p in marked.points if p.id == "w0").hidden == ((5, 11), (13, 20), (30, 31))
    assert next(p for p in marked.points if p.id == "a0").hidden == ((5, 20), (30, 31))


def test_what_cannot_be_carried_out_is_said(stage) -> None:
    session = stage().session
    with pytest.raises(UsageError, match="no point nobody"):
        correct(session, Mark(PointId("nobody"), 3, (1.0, 1.0)))
    with pytest.raises(UsageError, match="Frame 40"):
        correct(session, Mark(W0, 40, (1.0, 1.0)))
    with pytest.raises(UsageError, match="finite"):
        correct(session, Mark(W0, 3, (float("nan"), 1.0)))

    def stop(title: str, done: int, total: int | None) -> None:
        raise Cancelled("Stopped.")

    with pytest.raises(Cancelled):
        correct(session, Mark(W0, 3, (100.0, 100.0)), progress=stop)


def test_a_mark_that_agrees_changes_its_own_track_alone_and_that_hardly(stage) -> None:
    staged = stage()
    done = correct(staged.session, Mark(PointId("m3"), 20, staged.at("m3", 20, (0.5, -0.4))))
    assert done.kind == "agreed"
    assert done.session.model is not None and staged.session.model is not None
    assert done.session.model.structure.scene.points is staged.session.model.structure.scene.points
    for point in staged.session.sketch.points:
        if point.id != "m3":
            assert_same_rows(rows_of(done.session, point.id), rows_of(staged.session, point.id))
    assert staged.errors(done.session, "m3").max() < staged.errors(staged.session, "m3").max() + 0.3


def test_a_drag_leaves_corners_that_the_frames_hold_within_what_they_said(stage) -> None:
    staged = stage(clicks={"a1": (5.0, -4.0)})
    tracks = staged.session.tracks
    sure = replace(
        staged.session,
        tracks=replace(
            tracks, covariance=np.where(np.isin(tracks.point_index, [staged.session.row(A1)])[:, None, None], tracks.covariance, 0.2**2 * np.eye(2))
        ),
    )
    before = {p.id: np.median(staged.errors(sure, p.id)) for p in sure.sketch.points}
    done = correct(sure, Mark(A1, 33, staged.at("a1", 33)))
    after = {p.id: np.median(staged.errors(done.session, p.id)) for p in sure.sketch.points}
    assert max(after[p] - before[p] for p in before if p != "a1") < 0.3


def test_a_mark_in_a_frame_called_hidden_uncovers_the_run_around_it(stage) -> None:
    staged = stage()
    mine = staged.session.tracks.point_index == staged.session.row(PointId("m3"))
    run = mine & (staged.session.tracks.frame >= 15) & (staged.session.tracks.frame <= 25)
    covered = replace(staged.session.tracks, state=np.where(run, int(State.HIDDEN), staged.session.tracks.state))
    done = correct(replace(staged.session, tracks=covered), Mark(PointId("m3"), 20, staged.at("m3", 20)))
    rows = rows_of(done.session, "m3")
    assert not (rows.state[(rows.frame >= 15) & (rows.frame <= 25)] == State.HIDDEN).any()


def without_place(staged, point: str) -> Session:
    """A session in which no stage could place a point: its faces are not known either, and its track is its mark."""
    session, row = staged.session, staged.session.row(PointId(point))
    structure = session.model.structure
    scene, basis = structure.scene, structure.basis
    faces = np.isin(np.arange(len(scene.normals)), basis.incidences[basis.incidences[:, 1] == row, 0])
    lost = np.arange(len(scene.points)) == row
    evidence = basis.evidence
    planes, lines = evidence.plane_points, evidence.lines
    measured, drawn = ~faces[planes.face], lines.corner != row
    less = replace(
        evidence,
        plane_points=type(planes)(planes.face[measured], planes.point[measured], planes.sigma[measured]),
        lines=type(lines)(lines.corner[drawn], lines.direction[drawn], lines.offset[drawn], lines.sigma[drawn]),
    )
    unknown = replace(
        scene,
        points=np.where(lost[:, None], np.nan, scene.points),
        point_known=scene.point_known & ~lost,
        normals=np.where(faces[:, None], np.nan, scene.normals),
        offsets=np.where(faces, np.nan, scene.offsets),
        face_known=scene.face_known & ~faces,
    )
    tracks = session.tracks
    keep = (tracks.point_index != row) | (tracks.state == State.MARKED)
    few = Tracks(tracks.point_index[keep], tracks.frame[keep], tracks.xy[keep], tracks.covariance[keep], tracks.state[keep])
    changed = replace(structure, scene=unknown, basis=replace(basis, evidence=less), lines=tuple(line for line in structure.lines if row not in line.edge))
    return replace(session, tracks=few, model=replace(session.model, structure=changed))


def test_one_mark_places_a_corner_that_no_stage_could_place(stage) -> None:
    """Its first mark and this one, from elsewhere, meet in one place."""
    staged = stage()
    session = without_place(staged, "b0")
    assert len(rows_of(session, "b0").frame) == 1
    first = int(rows_of(session, "b0").frame[0])
    frame = 0 if first > 20 else 39
    done = correct(session, Mark(PointId("b0"), frame, staged.at("b0", frame, (0.4, -0.4))))
    assert done.kind == "solved"
    assert len(rows_of(done.session, "b0").frame) > 30
    assert np.median(staged.errors(done.session, "b0")) < 1.5


def test_a_corner_without_a_place_is_followed_from_a_mark_that_does_not_tell_where_it_is(stage) -> None:
    """Two marks in frames side by side do not meet; the images carry them further."""
    staged = stage()
    session = without_place(staged, "w2")
    first = int(rows_of(session, "w2").frame[0])
    model = replace(session.model, structure=replace(session.model.structure, basis=None))
    done = correct(replace(session, model=model), Mark(PointId("w2"), first + 1, staged.at("w2", first + 1)))
    assert done.kind == "bridged"
    assert len(done.frames) > 10
    assert np.median(staged.errors(done.session, "w2")) < 1.5
