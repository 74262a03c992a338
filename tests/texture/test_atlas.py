"""Rectangles around faces, charts on them, and their places in the atlas."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from planewright.geometry.rigid import rotations_from_vectors
from planewright.texture.atlas import chart_mask, face_rectangle, lay_charts, pack


def in_the_world(loop: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A loop in a plane put anywhere, and the plane's normal."""
    frame = rotations_from_vectors(rng.normal(size=(1, 3)) * 2)[0]
    return loop @ frame[:2] + rng.normal(size=3) * 5, frame[2]


def test_a_rectangle_fits_a_right_angled_face_without_slack() -> None:
    rng = np.random.default_rng(1)
    notched = np.array([[0, 0], [3, 0], [3, 1], [2, 1], [2, 2], [0, 2]], dtype=np.float64)
    for _ in range(30):
        border, normal = in_the_world(notched, rng)
        rectangle = face_rectangle(normal, border, rng.normal(size=3))
        assert rectangle is not None
        assert_allclose(sorted(rectangle.size), [2, 3], atol=1e-9)


def test_seen_from_the_front_the_chart_is_upright_and_not_mirrored() -> None:
    rng = np.random.default_rng(2)
    for _ in range(30):
        border, normal = in_the_world(rng.normal(size=(5, 2)), rng)
        up = rng.normal(size=3)
        rectangle = face_rectangle(normal, border, up)
        assert rectangle is not None
        assert_allclose(np.cross(rectangle.axis_u, rectangle.axis_v), -normal, atol=1e-9)
        # No quarter turn would bring "down" farther from up.
        assert rectangle.axis_v @ up <= min(-rectangle.axis_v @ up, rectangle.axis_u @ up, -rectangle.axis_u @ up) + 1e-12


def test_all_corners_are_in_the_chart_and_texels_map_back() -> None:
    rng = np.random.default_rng(3)
    border, normal = in_the_world(rng.normal(size=(7, 2)), rng)
    rectangle = face_rectangle(normal, border, np.array([0.0, 0.0, 1.0]))
    assert rectangle is not None
    (chart,), _ = lay_charts({4: rectangle}, {4: 0.013}, 4096, 4)
    texels = chart.to_texels(border)
    assert (texels >= -1e-9).all()
    assert (texels <= np.array([chart.width, chart.height]) + 1e-9).all()
    assert_allclose(chart.to_world(texels), border, atol=1e-9)


def test_a_face_without_area_has_no_rectangle() -> None:
    line = np.array([[0.0, 0, 0], [1, 1, 0], [2, 2, 0]])
    up = np.array([0.0, 0, 1])
    assert face_rectangle(up, line, up) is None
    assert face_rectangle(up, np.ones((3, 3)), up) is None


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 90), st.integers(1, 90)), min_size=1, max_size=40))
def test_packed_rectangles_do_not_overlap(sizes: list[tuple[int, int]]) -> None:
    placed = pack(sizes, 4096)
    assert placed is not None
    places, (width, height) = placed
    taken = np.zeros((height, width), dtype=int)
    for (x, y), (w, h) in zip(places, sizes, strict=True):
        assert x >= 0 and y >= 0 and x + w <= width and y + h <= height
        taken[y : y + h, x : x + w] += 1
    assert taken.max() == 1
    assert taken.sum() == sum(w * h for w, h in sizes)


def test_packing_wastes_little() -> None:
    rng = np.random.default_rng(4)
    sizes = [(int(w), int(h)) for w, h in rng.integers(10, 200, (40, 2))]
    placed = pack(sizes, 4096)
    assert placed is not None
    assert sum(w * h for w, h in sizes) > 0.8 * placed[1][0] * placed[1][1]


def test_what_does_not_fit_is_refused() -> None:
    assert pack([(50, 50), (50, 50), (50, 50)], 99) is None
    assert pack([(50, 50)] * 4, 100) is not None


def test_texels_grow_until_the_atlas_fits() -> None:
    rng = np.random.default_rng(5)
    rectangles = {}
    for f in range(6):
        border, normal = in_the_world(np.array([[0.0, 0], [2, 0], [2, 1], [0, 1]]), rng)
        rectangle = face_rectangle(normal, border, np.array([0.0, 0, 1]))
        assert rectangle is not None
        rectangles[f] = rectangle
    charts, size = lay_charts(rectangles, dict.fromkeys(range(6), 0.001), 512, 4)
    assert max(size) <= 512
    assert len({chart.texel for chart in charts}) == 1
    assert charts[0].texel > 0.001


@pytest.mark.parametrize("texel", [0.05, 0.011])
def test_the_mask_covers_the_face_and_not_its_holes(texel: float) -> None:
    rng = np.random.default_rng(6)
    border, hole = np.array([[0.0, 0], [4, 0], [4.5, 2], [0, 3]]), np.array([[1.0, 1], [1, 2], [2, 2], [2, 1]])
    both, normal = in_the_world(np.concatenate([border, hole]), rng)
    loops = [both[:4], both[4:]]
    rectangle = face_rectangle(normal, loops[0], np.array([0.0, 0, 1]))
    assert rectangle is not None
    (chart,), _ = lay_charts({0: rectangle}, {0: texel}, 4096, 2)
    area = 0.5 * abs(border[:, 0] @ np.roll(border[:, 1], -1) - border[:, 1] @ np.roll(border[:, 0], -1)) - 1.0
    # Texels on the line count, half a texel's width along the borders.
    outline = 16.2
    assert area - 0.5 * outline * texel < chart_mask(chart, loops).sum() * texel**2 < area + 1.2 * outline * texel
