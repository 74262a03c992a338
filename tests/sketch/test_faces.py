import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planewright.sketch.faces import FindFacesOptions, find_faces
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint
from planewright.sketch.read import read_sketch

Draw = Callable[..., Sketch]
BOX = {name: (x, y, z) for name, (x, y, z) in zip("abcdefgh", [(x, y, z) for z in (0, 2) for x, y in ((0, 0), (3, 0), (3, 2), (0, 2))], strict=True)}
FRONT, RIGHT, BACK, LEFT, TOP, BOTTOM = "abfe", "bcgf", "cdhg", "daeh", "efgh", "abcd"


def loops(faces: Iterable[SketchFace]) -> set[frozenset[str]]:
    return {frozenset(face.loop) for face in faces}


def corners(names: Iterable[Sequence[str]]) -> set[frozenset[str]]:
    return {frozenset(loop) for loop in names}


@pytest.mark.parametrize("eye", [(6, -9, 7), (9, -5, 3), (-6, -8, 4), (7, 7, 9)])
def test_a_box_shows_three_faces_and_its_outline_is_none(draw: Draw, eye: tuple[float, float, float]) -> None:
    seen = [FRONT if eye[1] < 0 else BACK, RIGHT if eye[0] > 0 else LEFT, TOP]
    found = find_faces(draw(BOX_SEEN := {name: BOX[name] for name in BOX if any(name in loop for loop in seen)}, seen, eye=eye, noise=1.0))
    assert len(BOX_SEEN) == 7
    assert loops(found.faces) == corners(seen)
    assert all(face.found for face in found.faces)


@pytest.mark.parametrize("eye", [(6, -9, 7), (9, -5, 3), (5, -8, 3)])
def test_a_box_drawn_with_its_hidden_edges_has_six_faces(draw: Draw, eye: tuple[float, float, float]) -> None:
    everything = [FRONT, RIGHT, BACK, LEFT, TOP, BOTTOM]
    assert loops(find_faces(draw(BOX, everything, eye=eye, noise=1.0)).faces) == corners(everything)


def test_corners_marked_in_other_frames_take_part(draw: Draw) -> None:
    walls = [FRONT, RIGHT, LEFT, TOP]
    other = (-7.0, 8.0, 5.0)
    sketch = draw(BOX, walls, hidden={"d": other, "h": other}, noise=1.0)
    assert loops(find_faces(sketch).faces) == corners(walls)


def test_a_door_cuts_its_wall(draw: Draw) -> None:
    house = {**BOX, "i": (1, 0, 0), "j": (1, 0, 1.2), "k": (1.7, 0, 1.2), "l": (1.7, 0, 0)}
    wall = "aijklbfe"
    seen = [wall, "ijkl", RIGHT, TOP]
    sketch = draw({name: house[name] for name in house if name != "d"}, seen, noise=1.0)
    assert loops(find_faces(sketch).faces) == corners(seen)


def test_a_window_is_a_hole_and_a_face(draw: Draw) -> None:
    house = {
        **BOX,
        **dict(zip("wxyz", [(1, 0, 0.8), (2, 0, 0.8), (2, 0, 1.5), (1, 0, 1.5)], strict=True)),
        "n": (1.2, 0, 1),
        "o": (1.8, 0, 1),
        "p": (1.5, 0, 1.4),
    }
    sketch = draw({name: house[name] for name in house if name != "d"}, [FRONT, RIGHT, TOP, "wxyz", "nop"])
    found = find_faces(sketch)
    assert loops(found.faces) == corners([FRONT, RIGHT, TOP, "wxyz", "nop"])
    holes = {frozenset(face.loop): [set(hole) for hole in face.holes] for face in found.faces}
    assert holes[frozenset(FRONT)] == [set("wxyz")]
    assert holes[frozenset("wxyz")] == [set("nop")]
    assert holes[frozenset(TOP)] == []


def test_a_wall_of_panes_and_a_roof() -> None:
    points = tuple(SketchPoint(PointId(f"{x},{y}"), {0: (100.0 * x, 100.0 * y)}) for y in range(4) for x in range(5))
    edges = [((x, y), (x + dx, y + dy)) for y in range(4) for x in range(5) for dx, dy in ((1, 0), (0, 1)) if x + dx < 5 and y + dy < 4]
    sketch = Sketch(points, edges=tuple((PointId(f"{a},{b}"), PointId(f"{c},{d}")) for (a, b), (c, d) in edges))
    found = find_faces(sketch).faces
    assert len(found) == 12
    assert all(len(face.loop) == 4 for face in found)


def test_loops_that_are_forbidden_are_not_found(draw: Draw) -> None:
    seen = [FRONT, RIGHT, TOP]
    sketch = replace(draw({n: BOX[n] for n in BOX if n != "d"}, seen), not_faces=(tuple(PointId(c) for c in TOP),))
    assert frozenset(TOP) not in loops(find_faces(sketch).faces)
    assert corners([FRONT, RIGHT]) <= loops(find_faces(sketch).faces)


def test_given_faces_always_count(draw: Draw) -> None:
    seen = [FRONT, RIGHT, TOP]
    sketch = draw({n: BOX[n] for n in BOX if n != "d"}, seen)
    given = replace(sketch, faces=(SketchFace(FaceId("f0"), tuple(PointId(c) for c in RIGHT)),))
    assert find_faces(given) is given
    beside = find_faces(given, FindFacesOptions(beside_given=True))
    assert beside.faces[0] == given.faces[0]
    assert loops(beside.faces) == corners(seen)
    assert len({face.id for face in beside.faces}) == 3


def test_ids_do_not_depend_on_the_order_of_edges_and_finding_again_changes_nothing(draw: Draw) -> None:
    sketch = draw(BOX, [FRONT, RIGHT, BACK, LEFT, TOP, BOTTOM])
    found = find_faces(sketch)
    rng = np.random.default_rng(3)
    for _ in range(5):
        order = rng.permutation(len(sketch.edges))
        turned = tuple(sketch.edges[k] if rng.random() < 0.5 else sketch.edges[k][::-1] for k in order)
        assert find_faces(replace(sketch, edges=turned)).faces == found.faces
    assert find_faces(found).faces == found.faces
    assert [face.id for face in found.faces] == [f"f{k}" for k in range(6)]


@pytest.mark.parametrize("edges", [[], ["ab"], ["ab", "bc", "cd"], ["ab", "cd"]])
def test_without_loops_there_are_no_faces(draw: Draw, edges: list[str]) -> None:
    sketch = replace(draw(BOX, [FRONT]), edges=tuple((PointId(a), PointId(b)) for a, b in edges))
    assert find_faces(sketch).faces == ()


def test_every_face_is_a_loop_of_drawn_edges_and_no_edge_has_three_faces() -> None:
    rng = np.random.default_rng(11)
    for _ in range(25):
        count = int(rng.integers(4, 14))
        marks = [{int(rng.integers(3)): (float(x), float(y))} if rng.random() < 0.9 else {} for x, y in rng.uniform(0, 500, (count, 2))]
        points = tuple(SketchPoint(PointId(f"p{k}"), where) for k, where in enumerate(marks))
        pairs = {tuple(sorted(rng.choice(count, 2, replace=False).tolist())) for _ in range(int(rng.integers(3, 30)))}
        sketch = Sketch(points, edges=tuple((PointId(f"p{a}"), PointId(f"p{b}")) for a, b in sorted(pairs)))
        drawn = {frozenset(edge) for edge in sketch.edges}
        uses: dict[frozenset[str], int] = {}
        for face in find_faces(sketch).faces:
            assert len(set(face.loop)) == len(face.loop) >= 3
            for pair in zip(face.loop, (*face.loop[1:], face.loop[0]), strict=True):
                assert frozenset(pair) in drawn
                uses[frozenset(pair)] = uses.get(frozenset(pair), 0) + 1
        assert max(uses.values(), default=0) <= 2


def test_a_long_polygon_and_a_large_mesh_end_soon() -> None:
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    points = tuple(SketchPoint(PointId(str(k)), {0: (float(np.cos(a)), float(np.sin(a)))}) for k, a in enumerate(angle))
    ring = Sketch(points, edges=tuple((PointId(str(k)), PointId(str((k + 1) % 400))) for k in range(400)))
    assert [len(face.loop) for face in find_faces(ring).faces] == [400]
    side = 25
    mesh_points = tuple(SketchPoint(PointId(f"{x},{y}"), {0: (9.0 * x + 0.1 * y, 9.0 * y)}) for y in range(side) for x in range(side))
    links = [(f"{x},{y}", f"{x + dx},{y + dy}") for y in range(side) for x in range(side) for dx, dy in ((1, 0), (0, 1)) if x + dx < side and y + dy < side]
    mesh = Sketch(mesh_points, edges=tuple((PointId(a), PointId(b)) for a, b in links))
    assert len(find_faces(mesh).faces) == (side - 1) ** 2


DATA = os.environ.get("PLANEWRIGHT_DATA")


@pytest.mark.skipif(not DATA, reason="PLANEWRIGHT_DATA names no folder with clips")
@pytest.mark.parametrize("name", ["sample", "toyhouse"])
def test_the_faces_of_a_house_come_from_its_edges(name: str) -> None:
    folder = Path(DATA or "") / name
    found = find_faces(read_sketch(folder / "sketch_edges_only.json"))
    truth = json.loads((folder / "truth.json").read_text())
    assert loops(found.faces) == corners(face["loop"] for face in truth["faces"])
    wanted = {frozenset(face["loop"]): [set(hole) for hole in face["holes"]] for face in truth["faces"]}
    assert {frozenset(face.loop): [set(hole) for hole in face.holes] for face in found.faces} == wanted
