"""Laws of where faces start."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.registration.homography import apply_homography
from planewright.registration.strands import find_strands
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint


def sketch(marks: dict[str, dict[int, tuple[float, float]]], faces: dict[str, str]) -> Sketch:
    points = tuple(SketchPoint(PointId(name), at) for name, at in marks.items())
    return Sketch(points=points, faces=tuple(SketchFace(FaceId(name), tuple(PointId(c) for c in loop)) for name, loop in faces.items()))


SQUARE = {"a": (10.0, 10.0), "b": (60.0, 10.0), "c": (60.0, 60.0), "d": (10.0, 60.0)}


def test_a_face_starts_in_every_frame_that_shows_three_of_its_corners() -> None:
    marks = {name: {4: at, **({9: at} if name != "d" else {}), **({7: at} if name in "ab" else {})} for name, at in SQUARE.items()}
    strands = find_strands(sketch(marks, {"f": "abcd"}), range(20))
    assert [(s.frame, len(s.corners)) for s in strands] == [(4, 4), (9, 3)]
    for s in strands:
        at = apply_homography(s.h, s.q) + 0.5
        assert_allclose(at, [SQUARE["abcd"[i]] for i in s.corners])
        assert np.abs(s.q).max() <= 1.0 + 1e-9
    assert len(strands[0].edges) == 4
    assert len(strands[1].edges) == 2


def test_frames_that_are_left_out_start_nothing() -> None:
    assert find_strands(sketch({name: {4: at} for name, at in SQUARE.items()}, {"f": "abcd"}), range(5, 20)) == ()


def test_a_face_that_is_turned_away_does_not_start() -> None:
    """Its hidden corner is not marked there, and what is seen inside its outline are its neighbours."""
    marks = {name: {4: at} for name, at in SQUARE.items()} | {"h": {8: (30.0, 30.0)}}
    assert [s.face for s in find_strands(sketch(marks, {"front": "abcd", "back": "abdh"}), range(20))] == [0]
    beside = marks | {"e": {4: (90.0, 15.0)}, "g": {8: (90.0, 70.0)}}
    assert [s.face for s in find_strands(sketch(beside, {"front": "abcd", "side": "becg"}), range(20))] == [0, 1]


def test_a_smaller_face_lies_before_a_larger_one() -> None:
    marks = {name: {0: at} for name, at in SQUARE.items()} | {
        name: {0: at} for name, at in {"p": (20.0, 20.0), "q": (40.0, 20.0), "r": (40.0, 40.0), "s": (20.0, 40.0)}.items()
    }
    wall, window = find_strands(sketch(marks, {"wall": "abcd", "window": "pqrs"}), range(3))
    assert len(wall.others) == 1
    assert window.others == ()
    assert_allclose(apply_homography(wall.h, wall.others[0]) + 0.5, [marks[c][0] for c in "pqrs"])
