"""Edges found again: where they are, not where a stronger line is, and not where there is none."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planewright.lifting.views import Views, load_views
from planewright.planes.polygons import scene_polygons
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint
from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.motion import Path, draw_tremor
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, TrueFace, face_surfaces, quad
from planewright.synthetic.textures import Painter, plaster
from planewright.tracking.edges import Anchor, EdgeLine, EdgeOptions, corner_lines, drawn_edges, measure_edges
from planewright.tracking.visibility import owners_in_views

STRIPE = 0.13
"""Scene units from the board's left edge to the middle of its stripe: eight pixels."""
EDGES = {"foot": (0, 0, 1), "right": (0, 1, 2), "top": (0, 2, 3), "left": (0, 0, 3)}


def striped(width: float, height: float, density: float, rng: np.random.Generator) -> np.ndarray:
    """Pale, with a dark stripe beside the left edge that is several times as steep as the edge against the wall behind."""
    image = plaster((176, 172, 166), 0.01)(width, height, density, rng)
    u = (np.arange(image.shape[1]) + 0.5) / density
    left = u.min() + STRIPE
    image[:, np.abs(u - left) < 0.025] *= 0.25
    return image


def board_before_wall(film, paint: Painter, wall_paint: Painter):
    """A board that is walked past in 24 frames, and a wall three units behind it."""
    points = {"b0": (-0.8, 0.0, 0.3), "b1": (0.8, 0.0, 0.3), "b2": (0.8, 0.0, 1.4), "b3": (-0.8, 0.0, 1.4)}
    faces = (TrueFace("board", ("b0", "b1", "b2", "b3")),)
    wall = quad((-6.0, 3.0, -2.0), (12.0, 0, 0), (0, 0, 7.0), wall_paint, 60.0)
    scene = Scene(points, faces, (*face_surfaces(points, faces, {"board": paint}, 200.0), wall), (0.35, -0.65, 0.8))
    tremor = draw_tremor(0.03, 0.4, np.random.default_rng(0))
    path = Path(num_frames=24, target=np.array([0.0, 0.0, 0.85]), radius=4.6, height=(1.2, 1.9), azimuth_deg=(-104.0, -76.0), tremor=tremor)
    return film(SyntheticClip("board", scene, path, centered_camera((320, 180), 0.83), RenderOptions()))


@pytest.fixture(scope="module")
def board(film):
    """Before a wall that is nearly as bright."""
    return board_before_wall(film, striped, plaster((132, 132, 132), 0.01))


@pytest.fixture(scope="module")
def board_views(board) -> Views:
    return load_views(board.frames, board.cameras, board.cloud, [])


@pytest.fixture(scope="module")
def pixel(board) -> float:
    """World length of a pixel on the board."""
    return 4.6 / board.clip.intrinsics.focal


def anchored(points: np.ndarray, sigma: float) -> Anchor:
    return Anchor(points, np.tile(sigma**2 * np.eye(3), (len(points), 1, 1)))


def measure(board, views: Views, names: list[str], points: np.ndarray, anchor: Anchor) -> list[EdgeLine]:
    owners = owners_in_views(views, scene_polygons(replace(board.scene, points=points)))
    return measure_edges(views, [EDGES[name] for name in names], points, anchor, board.scene.normals, owners)


def off_truth(board, line: EdgeLine, points: np.ndarray, pixel: float) -> np.ndarray:
    """Pixels from the true edge to the line at both ends, along `across`."""
    return np.array([line.offset[end] + line.across @ (points[c] - board.scene.points[c]) for end, c in enumerate(line.edge)]) / pixel


def test_an_edge_between_colours_of_one_brightness_is_found(film, pixel: float) -> None:
    clay = board_before_wall(film, plaster((182, 106, 132), 0.0), plaster((132, 132, 132), 0.0))
    views = load_views(clay.frames, clay.cameras, clay.cloud, [])
    shift = np.array([1.0, -1.0, 1.0, -1.0])[:, None] * [1.4 * pixel, 0.0, 1.4 * pixel]
    points = clay.scene.points + shift
    owners = owners_in_views(views, scene_polygons(replace(clay.scene, points=points)))
    names = ["foot", "right", "top"]
    arguments = views, [EDGES[name] for name in names], points, anchored(points, 2.5 * pixel), clay.scene.normals, owners
    for line in measure_edges(*arguments):
        assert_allclose(off_truth(clay, line, points, pixel), 0.0, atol=0.6)
    in_grey = measure_edges(*arguments, EdgeOptions(hue=0.0))
    assert max((np.abs(off_truth(clay, line, points, pixel)).max() for line in in_grey), default=2.0) > 1.0 or len(in_grey) < len(names)
    assert len(measure_edges(*arguments)) == len(names)


@pytest.mark.parametrize("name", ["foot", "right", "top"])
def test_an_edge_is_found_when_its_corners_start_two_pixels_off(board, board_views: Views, pixel: float, name: str) -> None:
    rng = np.random.default_rng(4)
    for _ in range(4):
        shift = rng.choice([-1, 1], (4, 3)) * [2 * pixel / np.sqrt(2), 0.0, 2 * pixel / np.sqrt(2)]
        points = board.scene.points + shift
        (line,) = measure(board, board_views, [name], points, anchored(points, 2.5 * pixel))
        assert_allclose(off_truth(board, line, points, pixel), 0.0, atol=0.5)
        assert max(line.sigma) < 1.5 * pixel
        assert_allclose(line.pixel, pixel, rtol=0.15)


def test_across_is_a_unit_vector_in_the_plane_at_right_angles_to_the_edge(board, board_views: Views, pixel: float) -> None:
    points = board.scene.points
    for line in measure(board, board_views, ["foot", "right", "top"], points, anchored(points, pixel)):
        assert_allclose(np.linalg.norm(line.across), 1.0)
        assert_allclose(line.across @ board.scene.normals[0], 0.0, atol=1e-12)
        assert_allclose(line.across @ (points[line.edge[1]] - points[line.edge[0]]), 0.0, atol=1e-12)


def test_a_stronger_parallel_line_does_not_take_an_edge_that_is_well_anchored(board, board_views: Views, pixel: float) -> None:
    points = board.scene.points
    (line,) = measure(board, board_views, ["left"], points, anchored(points, 0.7 * pixel))
    assert_allclose(off_truth(board, line, points, pixel), 0.0, atol=0.6)
    # It is the stronger one: with the same certainty in its place, or with none at all, the stripe is found.
    at_stripe = points + np.array([STRIPE, 0.0, 0.0])
    (line,) = measure(board, board_views, ["left"], at_stripe, anchored(at_stripe, 0.7 * pixel))
    assert_allclose(np.abs(off_truth(board, line, at_stripe, pixel)), STRIPE / pixel, atol=2.0)


def test_the_anchor_decides_wherever_the_strip_is_cut(board, board_views: Views, pixel: float) -> None:
    """The present corners have been drawn to the stripe; clicks and planes say that the edge is elsewhere."""
    drawn_away = board.scene.points + np.array([STRIPE, 0.0, 0.0])
    (line,) = measure(board, board_views, ["left"], drawn_away, anchored(board.scene.points, 0.7 * pixel))
    assert_allclose(off_truth(board, line, drawn_away, pixel), 0.0, atol=0.6)


def test_where_two_lines_are_as_likely_the_sigma_spans_both(board, board_views: Views, pixel: float) -> None:
    points = board.scene.points
    between = points + np.array([0.6 * STRIPE, 0.0, 0.0])
    lines = measure(board, board_views, ["left"], points, anchored(between, 6.0 * pixel))
    for line in lines:
        off = np.abs(off_truth(board, line, points, pixel))
        assert (off < 3 * np.array(line.sigma) / pixel).all()


def test_no_edge_is_found_where_the_board_is_bare(board, board_views: Views, pixel: float) -> None:
    points = board.scene.points.copy()
    points[2], points[3] = [0.7, 0.0, 0.85], [-0.1, 0.0, 0.85]  # a line across the middle that nobody painted
    owners = owners_in_views(board_views, scene_polygons(board.scene))
    found = measure_edges(board_views, [EDGES["top"]], points, anchored(points, 1.5 * pixel), board.scene.normals, owners)
    assert all(min(line.sigma) > 1.0 * pixel for line in found)


def test_no_edge_is_found_on_a_face_that_is_hidden_or_shows_its_back(board, board_views: Views, pixel: float) -> None:
    points, anchor = board.scene.points, anchored(board.scene.points, pixel)
    nobody = np.full((len(board_views.frame), 90, 160), -1, np.int16)
    assert measure_edges(board_views, list(EDGES.values()), points, anchor, board.scene.normals, nobody) == []
    owners = owners_in_views(board_views, scene_polygons(board.scene))
    assert measure_edges(board_views, list(EDGES.values()), points, anchor, -board.scene.normals, owners) == []


def test_a_corner_of_which_nothing_is_known_is_no_obstacle(board, board_views: Views, pixel: float) -> None:
    points = board.scene.points
    anchor = anchored(points, pixel)
    anchor.covariance[1] = np.inf
    (line,) = measure(board, board_views, ["top"], points, anchor)
    assert_allclose(off_truth(board, line, points, pixel), 0.0, atol=0.5)
    for line in measure(board, board_views, ["foot"], points, anchor):
        assert np.isfinite(line.offset).all()
        assert np.isfinite(line.sigma).all()


def test_most_edges_of_the_shed_are_found_where_they_are(shed) -> None:
    views = load_views(shed.frames, shed.cameras, shed.cloud, [])
    scene = shed.scene
    edges = drawn_edges(scene.sketch)
    size = 4.6 / shed.clip.intrinsics.focal
    points = scene.points + np.random.default_rng(3).normal(0.0, 1.2 * size, scene.points.shape)
    lines = measure_edges(views, edges, points, anchored(points, 1.5 * size), scene.normals, owners_in_views(views, scene_polygons(scene)))
    assert len(lines) > 0.7 * len(edges)
    true = [np.array([line.offset[k] + line.across @ (points[c] - scene.points[c]) for k, c in enumerate(line.edge)]) for line in lines]
    off = np.abs([error / line.pixel for error, line in zip(true, lines, strict=True)]).max(axis=1)
    assert np.median(off) < 0.8
    within = [(np.abs(error) < 3 * np.array(line.sigma)).all() for error, line in zip(true, lines, strict=True)]
    assert np.mean(within) > 0.85


def test_edges_go_round_each_loop_once_open_faces_do_not_close_and_only_drawn_ones_count() -> None:
    p = [PointId(f"p{i}") for i in range(9)]
    faces = (SketchFace(FaceId("a"), tuple(p[:4]), (tuple(p[4:7]),)), SketchFace(FaceId("b"), (p[2], p[7], p[8]), open=True))
    sketch = Sketch(tuple(SketchPoint(name, {}) for name in p), faces=faces)
    assert drawn_edges(sketch) == [(0, 0, 1), (0, 1, 2), (0, 2, 3), (0, 3, 0), (0, 4, 5), (0, 5, 6), (0, 6, 4), (1, 2, 7), (1, 7, 8)]
    assert drawn_edges(replace(sketch, edges=((p[1], p[0]), (p[6], p[4]), (p[2], p[8])))) == [(0, 0, 1), (0, 6, 4)]


def test_corners_lie_on_their_lines_and_an_edge_of_two_faces_counts_once() -> None:
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0]])
    up, side = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    one = EdgeLine((0, 1), 0, up, up, (0.1, -0.2), (0.01, 0.02), 0.01, 3.0, False, None)
    lines = [one, replace(one, face=1), EdgeLine((1, 2), 0, side, side, (0.0, 0.3), (0.01, 0.01), 0.01, 3.0, False, None)]
    found = corner_lines(lines, points)
    assert_array_equal(found.corner, [0, 1, 0, 1, 1, 2])
    assert_allclose(found.offset, [0.1, -0.2, 0.1, -0.2, 2.0, 2.3])
    assert_allclose(found.sigma, np.array([0.01, 0.02, 0.01, 0.02, 0.01, 0.01]) * np.sqrt([2, 2, 2, 2, 1, 1]))
    assert_allclose(found.direction[:2], [up, up])
    # seen at a slant, a line says the same about corners in its plane, and says it along the line of sight
    slanted = replace(one, facing=np.array([0.0, 0.6, 0.8]))
    along = corner_lines([slanted], points)
    assert_allclose(along.direction, [slanted.facing] * 2)
    assert_allclose(along.offset, [0.06, -0.12])
    assert_allclose(along.sigma, [0.006, 0.012])
    empty = corner_lines([], points)
    assert empty.direction.shape == (0, 3)


def test_the_same_is_measured_twice(board, board_views: Views, pixel: float) -> None:
    points = board.scene.points
    runs = [measure(board, board_views, list(EDGES), points, anchored(points, 2 * pixel)) for _ in range(2)]
    assert [line.offset for line in runs[0]] == [line.offset for line in runs[1]]
    assert [line.sigma for line in runs[0]] == [line.sigma for line in runs[1]]
