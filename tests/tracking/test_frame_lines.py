"""Lines in single frames, drawn with known places."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.tracking.frame_lines import FrameLineOptions, view_edges
from planewright.tracking.kernels import frame_edges


def picture(at: float, slope: float, blur: float, contrast: float, rng: np.random.Generator) -> np.ndarray:
    """An upright edge through x = at + slope y, a ramp of `blur` pixels (its middle is the edge), with noise of 1.2 grey levels."""
    y, x = np.mgrid[0:120, 0:160].astype(float)
    away = x - at - slope * y
    step = np.clip(away / max(blur, 1.0) + 0.5, 0.0, 1.0)
    return np.clip(np.rint(100.0 + contrast * step + 1.2 * rng.normal(size=x.shape)), 0, 255).astype(np.uint8)


def lines(image: np.ndarray, ends: list[list[float]], blur: float = 0.0, cover: np.ndarray | None = None) -> np.ndarray:
    """`frame_edges` on the smoothed picture with what a step is by default; cover: depth of another face in the way, infinite where there is none."""
    out = np.zeros((len(ends), 6))
    depth = np.full((60, 80), np.inf, np.float32) if cover is None else cover.astype(np.float32)
    faces = np.where(np.isfinite(depth), 1, -1).astype(np.int16)
    own = np.tile([True, False], (len(ends), 1))
    usual = FrameLineOptions()
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8), np.uint8)
    near, width = np.full((len(ends), 2), 0.2), np.full((len(ends), 2), blur)
    frame_edges(smooth, np.array(ends), near, own, width, faces, depth, 0.05, usual.search, usual.spacing, usual.min_step, out)
    return out


def test_a_line_is_where_it_was_drawn() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        off, slope = rng.uniform(-1.5, 1.5), rng.uniform(-0.01, 0.01)
        found = lines(picture(80.0 + off, slope, 1.0, 60.0, rng), [[80.0, 10.0, 80.0, 110.0]])[0]
        # The normal of a line that runs down points to the left.
        assert_allclose(found[:2], [-(off + 10 * slope), -(off + 110 * slope)], atol=0.2)
        assert found[5] > 0.9


def test_lines_are_not_drawn_to_the_places_between_pixels() -> None:
    rng = np.random.default_rng(11)
    found = np.array([-lines(picture(80.0 + off, 0.0, 2.0, 60.0, rng), [[80.0, 10.0, 80.0, 110.0]])[0, :2].mean() - off for off in np.linspace(-0.5, 0.5, 11)])
    assert np.abs(found).max() < 0.07


def test_blurred_edges_are_found_where_their_middle_is_and_lost_if_the_blur_is_not_allowed_for() -> None:
    rng = np.random.default_rng(1)
    allowed, ignored = [], []
    for _ in range(20):
        off = rng.uniform(-1.5, 1.5)
        image = picture(80.0 + off, 0.0, 8.0, 22.0, rng)
        for blur, errors in ((8.0, allowed), (0.0, ignored)):
            found = lines(image, [[80.0, 10.0, 80.0, 110.0]], blur)[0]
            errors.append(np.abs(found[:2] + off).max() if found[5] > 0.5 else np.inf)
    assert np.median(allowed) < 0.4
    assert np.max(allowed) < 1.0
    assert np.mean(np.array(ignored) < 0.5) < 0.5


def test_an_edge_that_leaves_the_picture_is_measured_where_it_is_seen_and_says_little_of_its_other_end() -> None:
    rng = np.random.default_rng(2)
    whole, part = lines(picture(80.7, 0.0, 1.0, 60.0, rng), [[80.0, 10.0, 80.0, 110.0], [80.0, 20.0, 80.0, 500.0]])
    assert_allclose(part[0], -0.7, atol=0.15)
    assert_allclose(whole[2:5], [4 / 3, 2 / 3, 4 / 3], rtol=0.15)
    near, far = ((part[2] * part[4] - part[3] ** 2) / part[[4, 2]]).tolist()
    assert near > 0.5
    assert far < 0.02


def test_what_the_model_hides_of_an_edge_is_not_looked_at() -> None:
    rng = np.random.default_rng(3)
    image = picture(80.5, 0.0, 1.0, 60.0, rng)
    image[60:] = picture(78.0, 0.0, 1.0, 60.0, rng)[60:]  # the outline of what covers the lower half
    cover = np.full((60, 80), np.inf)
    cover[30:] = 2.0
    free, covered = lines(image, [[80.0, 10.0, 80.0, 115.0]])[0], lines(image, [[80.0, 10.0, 80.0, 115.0]], cover=cover)[0]
    assert abs(covered[0] + 0.5) < 0.15
    assert abs(covered[1] + 0.5) < 0.3
    assert abs(free[1] + 0.5) > 0.4
    cover[30:] = 6.0  # behind the edge, which is at 5
    assert_allclose(lines(image, [[80.0, 10.0, 80.0, 115.0]], cover=cover)[0], free)


def test_no_line_where_there_is_no_edge() -> None:
    flat = np.full((120, 160), 90, np.uint8)
    assert (lines(flat, [[80.0, 10.0, 80.0, 110.0], [300.0, 10.0, 300.0, 110.0]]) == 0).all()


def test_edges_that_pass_the_camera_are_cut_in_front_of_it(shed) -> None:
    cameras, scene = shed.cameras, shed.scene
    rows = np.arange(3)
    points = scene.points.copy()
    points[0] = cameras.centers[1] - 0.5 * cameras.rotation[1, 2]
    view = view_edges(scene, points, cameras, rows, 0.01, FrameLineOptions())
    e, side = (int(n[0]) for n in np.nonzero(view.edges == 0))
    other = int(view.edges[e, 1 - side])
    assert not view.at_corner[1, e, side]
    assert view.at_corner[1, e, 1 - side]
    assert view.inverse_depth[1, e].min() > 0
    assert_allclose(view.place[1, e, 1 - side], shed.pixels(scene.points)[1, other], atol=1e-9)


@pytest.mark.parametrize("gap", [1, 3])
def test_the_length_of_the_blur_is_that_of_one_frames_motion(shed, gap: int) -> None:
    rows = np.arange(0, 40, gap)
    view = view_edges(shed.scene, shed.scene.points, shed.cameras, rows, 0.01, FrameLineOptions(exposure=0.5))
    every = view_edges(shed.scene, shed.scene.points, shed.cameras, np.arange(40), 0.01, FrameLineOptions(exposure=0.5))
    assert_allclose(np.median(view.blur), np.median(every.blur), rtol=0.25)
    assert every.blur.max() < 0.5 * np.linalg.norm(np.diff(shed.pixels(shed.scene.points), axis=0), axis=2).max() + 1e-6
