import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planewright.errors import SketchError
from planewright.sketch.graph import Sketch
from planewright.sketch.read import SketchLimits, read_sketch, save_text, sketch_to_json


def full_document() -> dict[str, Any]:
    """Every key of the format once."""
    return {
        "format": "planewright-sketch",
        "version": 1,
        "image_size": [960, 540],
        "points": [
            *({"id": f"p{k}", "marks": {"12": [10.0 * k, 5.5 * k * k]}} for k in range(8)),
            {"id": "late", "marks": {"131": [371.3, 396.5], "7": [1.0, 2.0]}, "hidden": [[0, 6], [20, 118]]},
            {"id": "loose", "marks": {}},
        ],
        "edges": [["p0", "p1"], ["p1", "p2"], ["p2", "late"]],
        "faces": [
            {"id": "f0", "loop": ["p0", "p1", "p2", "p3"], "holes": [["p4", "p5", "p6"]]},
            {"id": "f1", "loop": ["p1", "p2", "late"], "open": True},
            {"id": "f2", "loop": ["p5", "p6", "p7"]},
        ],
        "not_faces": [["p4", "p5", "p6"]],
        "relations": [
            {"kind": "parallel", "stance": "require", "faces": ["f0", "f1"]},
            {"kind": "angle", "stance": "forbid", "faces": ["f0", "f1"], "degrees": 120.0},
            {"kind": "equal_length", "stance": "require", "edges": [["p0", "p1"], ["p1", "p2"]]},
            {"kind": "symmetric", "stance": "require", "faces": ["f0", "f1"], "about": "f2"},
            {"kind": "vertical", "stance": "require", "faces": ["f0"]},
        ],
        "lengths": [{"edge": ["p0", "p1"], "length": 2.4, "sigma": 0.005}],
        "unit": "m",
        "up": {"face": "f1"},
        "camera": {"focal": 812.4, "sigma": 5.0},
    }


def test_everything_survives_reading_and_writing() -> None:
    document = full_document()
    sketch = read_sketch(document)
    written = sketch_to_json(sketch)
    late = next(point for point in written["points"] if point["id"] == "late")  # type: ignore[attr-defined]
    assert list(late["marks"]) == ["7", "131"]
    assert written == document
    assert read_sketch(save_text(sketch)) == sketch
    assert sketch.faces[1].open
    assert sketch.faces[0].corners == ("p0", "p1", "p2", "p3", "p4", "p5", "p6")


def test_unknown_keys_are_kept() -> None:
    document = full_document()
    document["colour"] = {"of": ["anything", None]}
    document["points"][0]["note"] = "a corner"
    document["faces"][1]["tint"] = [1, 2, 3]
    sketch = read_sketch(document)
    assert sketch.extra["colour"] == {"of": ["anything", None]}
    assert sketch_to_json(sketch) == document


def test_only_points_are_needed() -> None:
    sketch = read_sketch({"format": "planewright-sketch", "version": 1, "points": []})
    assert sketch == Sketch(points=())
    assert sketch_to_json(sketch) == {"format": "planewright-sketch", "version": 1, "points": []}


def test_an_edge_drawn_twice_is_one_edge() -> None:
    document = full_document()
    document["edges"] = [["p0", "p1"], ["p1", "p2"], ["p1", "p0"], ["p0", "p1"]]
    assert read_sketch(document).edges == (("p0", "p1"), ("p1", "p2"))


def set_at(document: Any, path: tuple[Any, ...], value: Any) -> Any:
    target = document
    for key in path[:-1]:
        target = target[key]
    if value is DELETED:
        del target[path[-1]]
    else:
        target[path[-1]] = value
    return document


DELETED = object()
WRONG: list[tuple[tuple[Any, ...], Any, str]] = [
    (("format",), DELETED, "lacks the key 'format'"),
    (("format",), "planewright-truth", "format is"),
    (("version",), DELETED, "lacks the key 'version'"),
    (("version",), 2, "version is 2, newer"),
    (("version",), "1", "version is"),
    (("version",), True, "version is true"),
    (("version",), 0, "versions count from 1"),
    (("points",), DELETED, "lacks the key 'points'"),
    (("points",), {}, "points is an object"),
    (("points", 0, "id"), DELETED, r"points\[0\] lacks the key 'id'"),
    (("points", 0, "id"), "", r"points\[0\].id is empty"),
    (("points", 0, "id"), 7, r"points\[0\].id is a number"),
    (("points", 0, "id"), "p1", r"points\[1\].id appears twice"),
    (("points", 0, "id"), "x" * 20_000, r"points\[0\].id has 20000 bytes"),
    (("points", 0, "marks"), DELETED, "lacks the key 'marks'"),
    (("points", 0, "marks"), [], "marks is a list"),
    (("points", 0, "marks"), {"1.5": [1, 2]}, "not the number of a frame"),
    (("points", 0, "marks"), {"-1": [1, 2]}, "not the number of a frame"),
    (("points", 0, "marks"), {"01": [1, 2]}, "not the number of a frame"),
    (("points", 0, "marks"), {"1": [1]}, r"marks.1 has 1 elements; it takes 2"),
    (("points", 0, "marks"), {"1": [1, "2"]}, r"marks.1\[1\] is"),
    (("points", 0, "marks"), {"1": [1, None]}, r"marks.1\[1\] is null"),
    (("points", 0, "marks"), {"1": [1, math.nan]}, "not finite"),
    (("points", 0, "marks"), {"1": [math.inf, 1]}, "not finite"),
    (("points", 0, "marks"), {"1": [1e300, 1]}, "lies between"),
    (("points", 8, "hidden"), [[5, 2]], "runs backwards"),
    (("points", 8, "hidden"), [[-5, 2]], "lies between"),
    (("points", 8, "hidden"), [[1.5, 2]], "whole number"),
    (("edges", 0), ["p0"], r"edges\[0\] has 1 elements"),
    (("edges", 0), ["p0", "p0"], "joins the point"),
    (("edges", 0), ["p0", "ghost"], 'names the point "ghost"'),
    (("faces", 0, "id"), "f1", "appears twice"),
    (("faces", 0, "loop"), ["p0", "p1"], "has 2 corners; a plane needs 3"),
    (("faces", 0, "loop"), ["p0", "p1", "p2", "p0"], "twice"),
    (("faces", 0, "loop"), ["p0", "p1", "ghost"], "ghost"),
    (("faces", 0, "holes"), [["p4", "p5"]], "has 2 corners"),
    (("faces", 0, "open"), 1, "true or false"),
    (("not_faces", 0), ["p0", "p1"], "has 2 corners"),
    (("relations", 0, "kind"), "perpendicular", "it is one of parallel"),
    (("relations", 0, "stance"), "maybe", "require, forbid"),
    (("relations", 0, "faces"), ["f0"], "needs two faces"),
    (("relations", 0, "faces"), ["f0", "ghost"], 'names the face "ghost"'),
    (("relations", 1, "degrees"), DELETED, "needs degrees"),
    (("relations", 1, "degrees"), 270, "lies between 0 and 180"),
    (("relations", 2, "edges"), [["p0", "p1"]], "needs two edges"),
    (("relations", 3, "about"), DELETED, "mirror"),
    (("relations", 4, "faces"), [], "names nothing"),
    (("lengths", 0, "length"), 0, "lies between"),
    (("lengths", 0, "sigma"), DELETED, "lacks the key 'sigma'"),
    (("unit",), "parsec", "it is one of m, cm, mm, ft, in"),
    (("up",), {}, "one of face, edge or direction"),
    (("up",), {"face": "f0", "edge": ["p0", "p1"]}, "only one"),
    (("up",), {"direction": [0, 0, 0]}, "points nowhere"),
    (("up",), {"direction": [0, 0]}, "it takes 3"),
    (("camera", "focal"), -5, "lies between"),
    (("image_size",), [960], "it takes 2"),
    (("image_size",), [960, 0], "lies between"),
    (("image_size",), [960.5, 540], "whole number"),
]


@pytest.mark.parametrize(("path", "value", "words"), WRONG, ids=[f"{'.'.join(map(str, path))}-{number}" for number, (path, _, _) in enumerate(WRONG)])
def test_what_is_wrong_is_named(path: tuple[Any, ...], value: Any, words: str) -> None:
    with pytest.raises(SketchError, match=words) as raised:
        read_sketch(set_at(full_document(), path, value))
    assert len(str(raised.value)) < 400
    assert str(raised.value).startswith('"sketch":')


def test_faces_may_be_named_before_they_are_found() -> None:
    document = full_document()
    del document["faces"]
    assert read_sketch(document).relations[0].faces == ("f0", "f1")


@pytest.mark.parametrize("identity", ['"', "\n", "<script>alert(1)</script>", "\u202e", "é" * 5000, "\x00", "日本", " ", "=cmd|' /C calc'!A0", "\ud800"])
def test_any_text_is_an_id_and_messages_show_it_escaped(identity: str) -> None:
    document = full_document()
    document["points"].append({"id": identity, "marks": {}})
    assert read_sketch(document).points[-1].id == identity
    document["edges"].append([identity, identity])
    with pytest.raises(SketchError) as raised:
        read_sketch(document)
    message = str(raised.value)
    assert message.isascii()
    assert message.isprintable()
    assert "<" not in message
    assert len(message) < 300


def test_files_are_read_and_their_troubles_told(tmp_path: Path) -> None:
    path = tmp_path / "sketch.json"
    path.write_text(json.dumps(full_document()), encoding="utf-8")
    assert read_sketch(path) == read_sketch(str(path)) == read_sketch(full_document())
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert read_sketch(path) == read_sketch(full_document())
    for content, words in [
        (b"", "not valid JSON"),
        (b"{", r"line 1, column 2"),
        (b"[]", "the document is a list"),
        (b"\xff\xfe\x00", "not UTF-8"),
        (b'{"format": "planewright-sketch", "version": 1, "points": [], "points": []}', "stands twice"),
        (b'{"format": NaN}', "finite"),
        (b'{"format": ' + b"[" * 200_000, "nested too deeply"),
        (b'{"version": ' + b"9" * 10_000 + b"}", "10000 digits"),
    ]:
        path.write_bytes(content)
        with pytest.raises(SketchError, match=words) as raised:
            read_sketch(path)
        assert '"sketch.json"' in str(raised.value)
        assert str(tmp_path) not in str(raised.value)
    with pytest.raises(SketchError, match="cannot be read"):
        read_sketch(tmp_path / "missing.json")
    with pytest.raises(SketchError, match="cannot be read"):
        read_sketch(tmp_path)


def test_large_sketches_are_refused_before_they_cost_anything(tmp_path: Path) -> None:
    path = tmp_path / "large.json"
    path.write_bytes(b" " * 3000)
    with pytest.raises(SketchError, match="larger than"):
        read_sketch(path, SketchLimits(max_bytes=2000))
    document = full_document()
    document["points"] = [{}] * 1_000_000
    with pytest.raises(SketchError, match="1000000 elements; the limit is 10000"):
        read_sketch(document)
    for limits, words in [
        (SketchLimits(max_edges=2), "edges has 3"),
        (SketchLimits(max_faces=2), "faces has 3"),
        (SketchLimits(max_marks=5), "number of marks"),
    ]:
        with pytest.raises(SketchError, match=words):
            read_sketch(full_document(), limits)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


def all_paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [*([path] if path else []), *(found for key, inner in items for found in all_paths(inner, (*path, key)))]


@given(st.sampled_from(all_paths(full_document())), json_values | st.just(DELETED))
def test_any_value_anywhere_is_read_or_refused(path: tuple[Any, ...], value: Any) -> None:
    document = set_at(full_document(), path, value)
    try:
        sketch = read_sketch(document)
    except SketchError as error:
        assert len(str(error)) < 500
    else:
        assert read_sketch(sketch_to_json(sketch)) == sketch
        if not any(isinstance(extra, float) for extra in sketch.extra.values()):
            json.dumps(sketch_to_json(sketch))


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text: str) -> None:
    with pytest.raises(SketchError):
        read_sketch("{" + text)
