"""The figure that says how hard a clip is."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.arrays import Float
from planewright.synthetic import demo_scene, difficulty, draw, still_camera, true_tracks
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.difficulty import clicked, follow_corners


def measure(clip: SyntheticClip, click_noise: float = 1.0) -> tuple[Float[np.ndarray, "2"], int]:
    xy, visible, _ = true_tracks(clip)
    marks = clicked(draw(clip, np.random.default_rng(0), click_noise=click_noise), list(clip.scene.points))
    figure = difficulty(clip.frames.gray(range(clip.num_frames)), marks, xy, visible)
    return np.array([figure.within_2px_pct, figure.within_5px_pct]), figure.visible


def test_the_demo_is_too_hard_for_lucas_kanade_on_its_corners() -> None:
    share, visible = measure(demo_scene(60, (480, 270)))
    assert 15 < share[0] < 60
    assert visible > 700


def test_a_still_clip_with_exact_clicks_is_easy() -> None:
    share, _ = measure(still_camera(8), click_noise=0.0)
    assert share[0] > 99


def test_corners_are_followed_both_ways_from_their_mark() -> None:
    """A sheet of noise that slides by a pixel and a half a frame."""
    rng = np.random.default_rng(1)
    sheet = rng.integers(0, 255, (60, 100), np.uint8).repeat(3, axis=0).repeat(3, axis=1)
    frames = [(k, np.ascontiguousarray(sheet[20:140, 20 + 3 * k : 220 + 3 * k])) for k in range(5)]
    found = follow_corners(frames, {7: (2, (100.5, 60.5))}, 5)
    assert_allclose(found[7], [[100.5 - 3 * (k - 2), 60.5] for k in range(5)], atol=0.05)
