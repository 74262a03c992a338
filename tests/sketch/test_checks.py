from collections.abc import Callable
from dataclasses import replace
from typing import Any, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planewright.errors import SketchError
from planewright.sketch.checks import FindingCode, check_sketch
from planewright.sketch.faces import find_faces
from planewright.sketch.graph import Edge, FaceId, KnownLength, PointId, RelationKind, Sketch, SketchFace, SketchPoint, SketchRelation, Stance, Up
from planewright.sketch.read import read_sketch

Draw = Callable[..., Sketch]
Code = FindingCode


def sketch_of(marks: dict[str, dict[int, tuple[float, float]]], loops: dict[str, str] | None = None, **rest: object) -> Sketch:
    """Points of one letter each; faces as strings of letters."""
    faces = tuple(SketchFace(FaceId(name), tuple(PointId(c) for c in loop)) for name, loop in (loops or {}).items())
    points = tuple(SketchPoint(PointId(name), where) for name, where in marks.items())
    return replace(Sketch(points=points, image_size=(960, 540), faces=faces), **rest)  # type: ignore[arg-type]


SQUARE = {"a": {5: (100.0, 100.0)}, "b": {5: (300.0, 110.0)}, "c": {5: (290.0, 280.0)}, "d": {5: (90.0, 270.0)}}
COLUMN = {name: {5: (400.0 + 7 * k, 100.0 + 50 * (k % 2) * (k + 1))} for k, name in enumerate("pqrs")}


def codes(sketch: Sketch, **known: object) -> dict[FindingCode, str]:
    return {finding.code: finding.severity for finding in check_sketch(sketch, **known)}  # type: ignore[arg-type]


def test_a_sound_sketch_gives_no_findings() -> None:
    assert check_sketch(sketch_of(SQUARE, {"f": "abcd"}), image_size=(960, 540), num_frames=10) == ()


def test_an_empty_sketch_and_one_without_faces_are_refused() -> None:
    assert codes(Sketch(points=())) == {Code.NO_POINTS: "error"}
    assert codes(sketch_of(SQUARE))[Code.NO_FACES] == "error"


def test_faces_found_in_edges_count() -> None:
    edges = tuple((PointId(a), PointId(b)) for a, b in ("ab", "bc", "cd", "da"))
    assert check_sketch(sketch_of(SQUARE, edges=edges)) == ()


@pytest.mark.parametrize(("size", "hint"), [((540, 960), "turned"), ((1920, 1080), "scaled")])
def test_another_picture_size_is_refused(size: tuple[int, int], hint: str) -> None:
    findings = check_sketch(sketch_of(SQUARE, {"f": "abcd"}), image_size=size)
    assert (findings[0].severity, findings[0].code) == ("error", Code.IMAGE_SIZE)
    assert hint in findings[0].sentence


def test_marks_outside_are_told() -> None:
    sketch = sketch_of({**SQUARE, "d": {5: (-20.0, 270.0)}, "x": {10: (5.0, 5.0)}}, {"f": "abcd"})
    assert codes(sketch, num_frames=11)[Code.MARK_OUTSIDE_IMAGE] == "warning"
    assert codes(sketch, num_frames=10)[Code.MARK_OUTSIDE_CLIP] == "error"
    far = sketch_of({**SQUARE, "d": {5: (1e6, 270.0)}}, {"f": "abcd"})
    assert codes(far)[Code.MARK_OUTSIDE_IMAGE] == "error"


def test_a_mark_in_a_hidden_span_is_told() -> None:
    sketch = sketch_of(SQUARE, {"f": "abcd"})
    hidden = replace(sketch, points=(replace(sketch.points[0], hidden=((0, 5),)), *sketch.points[1:]))
    assert codes(hidden) == {Code.MARK_WHERE_HIDDEN: "warning"}


def test_points_alone_and_unmarked_are_told() -> None:
    assert codes(sketch_of({**SQUARE, "x": {1: (9.0, 9.0)}}, {"f": "abcd"})) == {Code.POINT_ALONE: "info"}
    assert codes(sketch_of({**SQUARE, "x": {}}, {"f": "abcd"})) == {Code.POINT_UNMARKED: "warning"}


def test_two_points_in_one_place_and_an_edge_without_length() -> None:
    marks = {**SQUARE, "x": {5: (100.0, 100.1)}}
    found = codes(sketch_of(marks, {"f": "abcd"}, edges=((PointId("a"), PointId("x")),)))
    assert found == {Code.POINTS_COINCIDE: "warning", Code.EDGE_WITHOUT_LENGTH: "warning"}


def test_faces_need_three_corners_off_a_line() -> None:
    line = {name: {5: (100.0 + 40 * k, 50.0 + 30 * k)} for k, name in enumerate("abcd")}
    assert codes(sketch_of(line, {"f": "abcd"})) == {Code.FACE_ON_A_LINE: "error"}
    unmarked = {**SQUARE, "c": {}, "d": {}}
    assert codes(sketch_of(unmarked, {"f": "abcd"}))[Code.FACE_UNMARKED] == "error"
    spread = {name: {k // 2: SQUARE[name][5]} for k, name in enumerate("abcd")}
    assert codes(sketch_of(spread, {"f": "abcd"})) == {Code.FACE_SPREAD: "warning"}
    thin = {**line, "b": {5: (140.0, 82.5)}}
    assert codes(sketch_of(thin, {"f": "abcd"})) == {Code.FACE_THIN: "warning"}


def test_a_face_seen_edge_on_may_come_from_the_faces_beside_it() -> None:
    """A cube's side whose four corners are on a line in the only frame they are marked in; three of them belong to the top and the front."""
    line = {name: {5: (100.0 + 40 * k, 50.0 + 30 * k)} for k, name in enumerate("abcd")}
    beside = {"e": {5: (300.0, 50.0)}, "g": {5: (300.0, 90.0)}}
    assert codes(sketch_of({**line, **beside}, {"side": "abcd", "top": "abeg", "front": "cbeg"}))[Code.FACE_ON_A_LINE] == "warning"


def test_a_line_in_one_frame_is_no_trouble_when_another_shows_the_face() -> None:
    marks = {name: {5: (100.0 + 40 * k, 50.0 + 30 * k), 9: SQUARE[name][5]} for k, name in enumerate("abcd")}
    assert codes(sketch_of(marks, {"f": "abcd"})) == {}


def test_a_loop_that_crosses_itself_is_refused() -> None:
    assert codes(sketch_of(SQUARE, {"f": "acbd"})) == {Code.FACE_CROSSES_ITSELF: "error"}
    assert codes(sketch_of(SQUARE, {"f": "abcd", "g": "bcda"})) == {Code.FACE_TWICE: "warning"}


def test_a_loop_that_crosses_itself_by_a_click_is_only_mentioned() -> None:
    outline = {"a": (100.0, 100.0), "b": (300.0, 100.0), "c": (300.0, 140.0)}
    for low, severity in [(97.0, "warning"), (60.0, "error")]:
        marks = {name: {5: xy} for name, xy in {**outline, "d": (100.0, low)}.items()}
        assert codes(sketch_of(marks, {"f": "abcd"})) == {Code.FACE_CROSSES_ITSELF: severity}


def test_holes_lie_in_their_faces() -> None:
    inside = {"x": {5: (150.0, 150.0)}, "y": {5: (200.0, 150.0)}, "z": {5: (180.0, 200.0)}}
    for shift, expected in [(0.0, {}), (110.0, {Code.HOLE_OUTSIDE: "warning"}), (300.0, {Code.HOLE_OUTSIDE: "error"})]:
        moved = {name: {5: (xy[5][0] + shift, xy[5][1])} for name, xy in inside.items()}
        hole = tuple(PointId(c) for c in "xyz")
        face = SketchFace(FaceId("f"), tuple(PointId(c) for c in "abcd"), holes=(hole,))
        assert codes(sketch_of({**SQUARE, **moved}, faces=(face,))) == expected


def relation(kind: RelationKind, faces: str = "", stance: Stance = "require", degrees: float | None = None, edges: tuple[str, ...] = ()) -> SketchRelation:
    named: tuple[Edge, ...] = tuple((PointId(a), PointId(b)) for a, b in edges)
    return SketchRelation(kind, stance, tuple(FaceId(f) for f in faces), named, degrees)


@pytest.mark.parametrize(
    "relations",
    [
        [relation("parallel", "fg"), relation("orthogonal", "fg")],
        [relation("parallel", "fg"), relation("parallel", "gh"), relation("orthogonal", "fh")],
        [relation("orthogonal", "fg"), relation("parallel", "gh"), relation("angle", "fh", degrees=60.0)],
        [relation("coplanar", "fg"), relation("angle", "fg", degrees=30.0)],
        [relation("parallel", "fg"), relation("parallel", "gf", "forbid")],
        [relation("parallel", "fgh"), relation("parallel", "fh", "forbid")],
        [relation("vertical", "f"), relation("horizontal", "f")],
        [relation("vertical", "f"), relation("horizontal", "g"), relation("coplanar", "fg")],
        [relation("vertical", "f"), relation("vertical", "f", "forbid")],
        [relation("horizontal", "fg"), relation("orthogonal", "fg")],
        [relation("angle", "fg", degrees=40.0), relation("angle", "gf", degrees=50.0)],
        [relation("parallel", edges=("ab", "cd")), relation("orthogonal", edges=("dc", "ba"))],
        [relation("equal_length", edges=("ab", "cd")), relation("equal_length", stance="forbid", edges=("dc", "ba"))],
    ],
)
def test_relations_that_cannot_hold_together_are_found(relations: list[SketchRelation]) -> None:
    faces = {"f": "abcd", "g": "pqrs", "h": "abpq"}
    found = check_sketch(sketch_of({**SQUARE, **COLUMN}, faces, relations=tuple(relations)))
    assert [f.severity for f in found if f.code is Code.RELATIONS_CONTRADICT][:1] == ["error"]


@pytest.mark.parametrize(
    "relations",
    [
        [relation("parallel", "fg"), relation("orthogonal", "gh"), relation("orthogonal", "fh")],
        [relation("angle", "fg", degrees=60.0), relation("angle", "gf", degrees=120.0)],
        [relation("coplanar", "fg", "forbid"), relation("parallel", "fg")],
        [relation("vertical", "fgh"), relation("orthogonal", "fg")],
        [relation("horizontal", edges=("ab", "cd")), relation("orthogonal", edges=("ab", "cd"))],
        [relation("parallel", "fg", "forbid"), relation("orthogonal", "fg", "forbid")],
        [relation("angle", "fg", "forbid", degrees=40.0), relation("angle", "fg", degrees=50.0)],
    ],
)
def test_relations_that_can_hold_together_pass(relations: list[SketchRelation]) -> None:
    faces = {"f": "abcd", "g": "pqrs", "h": "abpq"}
    found = codes(sketch_of({**SQUARE, **COLUMN}, faces, relations=tuple(relations)))
    assert Code.RELATIONS_CONTRADICT not in found


def test_names_and_lengths_must_agree() -> None:
    edge = (PointId("a"), PointId("b"))
    lengths = (KnownLength(edge, 2.0, 0.01), KnownLength(edge[::-1], 2.5, 0.01))
    assert codes(sketch_of(SQUARE, {"f": "abcd"}, lengths=lengths)) == {Code.LENGTHS_CONTRADICT: "error"}
    assert codes(sketch_of(SQUARE, {"f": "abcd"}, up=Up(face=FaceId("ghost")))) == {Code.UNKNOWN_FACE: "error"}


def test_errors_come_first_and_name_their_place() -> None:
    sketch = sketch_of({**SQUARE, "x": {1: (9.0, 9.0)}, "y": {99: (1.0, 1.0)}}, {"f": "acbd"})
    findings = check_sketch(sketch, num_frames=10)
    order = ["error", "warning", "info"]
    assert [order.index(f.severity) for f in findings] == sorted(order.index(f.severity) for f in findings)
    assert findings[0].where in ('faces["f"]', 'points["y"]')
    assert all(finding.sentence.endswith(".") for finding in findings)


def test_hostile_ids_are_escaped() -> None:
    marks = {**SQUARE, "<img src=x>\n": {50: (1.0, 1.0)}}
    for finding in check_sketch(sketch_of(marks, {"f": "abcd"}), num_frames=10):
        assert "<" not in finding.sentence + finding.where
        assert "\n" not in finding.sentence + finding.where


names = st.sampled_from("abcdefgh")
# A coarse grid makes coincident points, lines, T-junctions, crossings and nested loops common; the far value is a slip of the mouse.
coordinate = st.sampled_from([0.0, 100.0, 200.0, 300.0, 100.4, 1e6])
loop = st.lists(names, min_size=3, max_size=6, unique=True)
edge = st.lists(names, min_size=2, max_size=2, unique=True)
document = st.fixed_dictionaries(
    {
        "format": st.just("planewright-sketch"),
        "version": st.just(1),
        "image_size": st.just([320, 240]),
        "points": st.fixed_dictionaries(
            {name: st.dictionaries(st.sampled_from(["0", "7", "99"]), st.tuples(coordinate, coordinate).map(list), max_size=2) for name in "abcdefgh"}
        ).map(lambda marks: [{"id": name, "marks": where} for name, where in marks.items()]),
        "edges": st.lists(edge, max_size=14),
        "faces": st.lists(st.tuples(loop, st.lists(loop, max_size=1), st.booleans()), max_size=4).map(
            lambda faces: [{"id": f"f{k}", "loop": outer, "holes": holes, "open": is_open} for k, (outer, holes, is_open) in enumerate(faces)]
        ),
        "relations": st.lists(
            st.fixed_dictionaries(
                {
                    "kind": st.sampled_from(get_args(RelationKind)),
                    "stance": st.sampled_from(get_args(Stance)),
                    "faces": st.lists(st.sampled_from(["f0", "f1", "f2"]), max_size=3),
                    "edges": st.lists(edge, max_size=2),
                    "degrees": st.sampled_from([0.0, 45.0, 90.0]),
                    "about": st.just("f0"),
                }
            ),
            max_size=4,
        ),
    }
)


@settings(max_examples=150, deadline=None)
@given(document)
def test_degenerate_drawings_are_judged_in_words(drawn: dict[str, Any]) -> None:
    try:
        sketch = read_sketch(drawn)
    except SketchError:
        return
    found = find_faces(sketch)
    findings = check_sketch(found, image_size=(320, 240), num_frames=50)
    assert findings == check_sketch(found, image_size=(320, 240), num_frames=50)
    for finding in findings:
        assert finding.sentence.endswith(".")
        assert finding.where
    if any(finding.severity == "error" for finding in findings):
        return
    marked = {point.id for point in found.points if point.marks}
    assert found.faces
    assert all(len(marked.intersection(face.loop)) >= 3 for face in found.faces)
