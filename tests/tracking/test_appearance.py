"""What a frame shows at a corner, against what is known to stand there."""

from itertools import pairwise, product

import numpy as np
from numpy.testing import assert_allclose

from planewright.tracking.appearance import AppearanceOptions, PatchViews, even_exposure, patch_odds, smooth_states, uncovered

ROWS, SAMPLES = 120, 24


def film(rng: np.random.Generator, texture: float = 25.0) -> tuple[np.ndarray, np.ndarray]:
    """A patch in all frames with noise, and its true colours."""
    look = np.clip(120.0 + texture * rng.normal(size=(SAMPLES, 3)), 20, 235)
    return look + 2.0 * rng.normal(size=(ROWS, SAMPLES, 3)), look


def odds_of(
    values: np.ndarray,
    marked: np.ndarray | None = None,
    distance: np.ndarray | None = None,
    scale: np.ndarray | None = None,
    ceiling: float = np.inf,
    turned: float = 0.3,
    options: AppearanceOptions = AppearanceOptions(),
) -> np.ndarray:
    rows = len(values)
    views = PatchViews(
        values=values,
        ceiling=np.full((rows, 3), ceiling),
        distance=np.full(values.shape[:2], 6.0) if distance is None else distance,
        radius=np.linspace(1.0, 9.0, values.shape[1]),
        scale=np.ones(rows) if scale is None else scale,
        sigma=np.full(rows, 0.3),
        turned=np.full(rows, turned),
        marked=np.zeros(rows, bool) if marked is None else marked,
    )
    return patch_odds(views, options)


def test_a_patch_that_stays_the_same_is_seen_and_one_behind_something_else_is_not() -> None:
    rng = np.random.default_rng(0)
    for texture in (0.0, 25.0):
        values, _ = film(rng, texture)
        values[40:70] = 60.0 + 30.0 * rng.normal(size=(30, SAMPLES, 3))
        odds = odds_of(values)
        assert odds[40:70].max() < -1.0
        assert np.delete(odds, np.s_[40:70]).min() > 1.0


def test_what_has_the_colour_of_a_bare_patch_is_not_told_from_it() -> None:
    values, _ = film(np.random.default_rng(1), texture=0.0)
    values[40:70] += 3.0
    assert odds_of(values).min() > -1.0


def test_the_marks_say_which_look_is_the_patch_where_most_frames_show_something_before_it() -> None:
    rng = np.random.default_rng(2)
    values, _ = film(rng)
    values[30:] = 70.0 + 25.0 * rng.normal(size=(SAMPLES, 3)) + 2.0 * rng.normal(size=(90, SAMPLES, 3))
    marked = np.zeros(ROWS, bool)
    marked[12] = True
    assert odds_of(values, marked)[:30].min() > 1.0
    assert odds_of(values, marked)[30:].max() < -1.0
    assert odds_of(values)[:30].max() < -1.0  # nobody marked it: the many are believed


def test_a_corner_that_shows_itself_for_a_moment_alone_is_known_by_the_mark_made_there() -> None:
    """Of the frames that are compared with each other, every second one of 120, two show it: the marked one and its neighbour."""
    rng = np.random.default_rng(8)
    values, _ = film(rng)
    values[:51], values[53:] = 200.0 + 2.0 * rng.normal(size=(51, SAMPLES, 3)), 200.0 + 2.0 * rng.normal(size=(67, SAMPLES, 3))
    marked = np.zeros(ROWS, bool)
    marked[51] = True
    odds = odds_of(values, marked)
    assert odds[51:53].min() > 1.0
    assert max(odds[:51].max(), odds[53:].max()) < -1.0


def test_a_mark_that_was_made_while_something_passed_does_not_hide_the_corner_for_good() -> None:
    rng = np.random.default_rng(7)
    values, _ = film(rng)
    values[40] = 70.0 + 25.0 * rng.normal(size=(SAMPLES, 3))
    odds = odds_of(values, np.arange(ROWS) == 40)
    assert odds[40] < -1.0
    assert np.delete(odds, 40).min() > 1.0


def test_samples_at_the_border_and_samples_that_are_not_seen_say_nothing() -> None:
    values, _ = film(np.random.default_rng(3))
    values[50, ::2] = np.nan
    far = np.full(values.shape[:2], 6.0)
    values[70] += 80.0
    far[70] = 1.0
    values[80] = np.nan
    odds = odds_of(values, distance=far)
    assert odds[50] > 1.0
    assert odds[70] == 0.0
    assert odds[80] == 0.0


def test_a_smaller_view_may_blur_the_texture() -> None:
    rng = np.random.default_rng(4)
    values, look = film(rng)
    values[90:] = 0.55 * values[90:] + 0.45 * look.mean(axis=0)
    scale = np.where(np.arange(ROWS) < 90, 1.0, 0.4)
    assert odds_of(values, scale=scale, turned=0.0)[90:].min() > odds_of(values, turned=0.0)[90:].max()


def test_what_changes_slowly_as_the_camera_goes_on_is_followed_and_what_comes_suddenly_is_not() -> None:
    rng = np.random.default_rng(8)
    values, _ = film(rng, texture=15.0)
    values -= np.clip(np.arange(ROWS) - 40, 0, 40)[:, None, None] * 0.9  # 36 levels in 40 frames of .3 degrees: 3 a degree
    covered = values.copy()
    covered[90:] = 60.0 + 25.0 * rng.normal(size=(SAMPLES, 3))
    assert odds_of(values).min() > 1.0
    assert odds_of(values, turned=0.0)[90:].max() < 0.0  # from a camera that stands still nothing should change
    assert odds_of(covered)[:90].min() > 1.0
    assert odds_of(covered)[90:].max() < -1.0


def test_what_is_as_bright_as_the_picture_can_be_is_no_sign_of_something_else() -> None:
    rng = np.random.default_rng(9)
    values = 240.0 + 2.0 * rng.normal(size=(ROWS, SAMPLES, 3))
    values[40:70] = 215.0  # the frame was taken out of a brighter exposure, in which everything above is cut off
    views = PatchViews(
        values, np.where((np.arange(ROWS) >= 40) & (np.arange(ROWS) < 70), 214.0, 260.0)[:, None] * np.ones(3), np.full(values.shape[:2], 6.0),
        np.linspace(1.0, 9.0, SAMPLES), np.ones(ROWS), np.full(ROWS, 0.3), np.zeros(ROWS), np.zeros(ROWS, bool),
    )  # fmt: skip
    assert patch_odds(views).min() > 0.5
    assert odds_of(values, turned=0.0)[40:70].max() < 0.0


def test_a_loosely_known_border_is_allowed_to_let_other_colours_in() -> None:
    rng = np.random.default_rng(10)
    values, _ = film(rng, texture=10.0)
    values[60:] += 25.0
    views = {
        sigma: PatchViews(
            values, np.full((ROWS, 3), np.inf), np.full(values.shape[:2], 3.0), np.linspace(1.0, 9.0, SAMPLES), np.ones(ROWS), np.full(ROWS, sigma),
            np.zeros(ROWS), np.arange(ROWS) == 3,
        )
        for sigma in (0.2, 3.0)
    }  # fmt: skip
    assert patch_odds(views[3.0])[60:].min() > patch_odds(views[0.2])[60:].max() + 1.0


def test_the_exposure_is_taken_out() -> None:
    rng = np.random.default_rng(5)
    values = np.concatenate([film(rng)[0] for _ in range(30)], axis=1)
    gain = np.exp(0.3 * rng.normal(size=(ROWS, 3)))
    values[20:30, :SAMPLES] = np.nan
    even = gain[:, None] * values / even_exposure(gain[:, None] * values)[:, None]
    ratio = np.nanmedian(even / values, axis=1)
    assert (ratio / ratio.mean(axis=0)).std() < 0.08 * gain.std()


def test_states_are_the_posterior_of_a_two_state_chain() -> None:
    """Against the sum over all paths."""
    options = AppearanceOptions(stay=0.9, visible=0.8)
    odds = np.array([2.0, -1.0, -3.0, 0.0, 1.5, -0.5])
    leave = 1.0 - options.stay
    move = np.array([[1 - 2 * leave * 0.2, 2 * leave * 0.2], [2 * leave * 0.8, 1 - 2 * leave * 0.8]])
    total = np.zeros((6, 2))
    for path in product((0, 1), repeat=6):
        chance = (0.8, 0.2)[path[0]] * np.prod([move[a, b] for a, b in pairwise(path)])
        chance *= np.exp(sum(o for o, state in zip(odds, path, strict=True) if state == 0))
        total[np.arange(6), path] += chance
    assert_allclose(smooth_states(odds, np.ones(6, bool), options), total[:, 0] / total.sum(axis=1), rtol=1e-10)


def test_runs_that_the_model_hides_between_are_chains_of_their_own() -> None:
    odds, possible = np.array([-4.0, -4.0, 9.0, 0.0, 0.0]), np.array([True, True, False, True, True])
    found = smooth_states(odds, possible)
    assert found[2] == 1.0
    assert_allclose(found[:2], smooth_states(odds[:2], np.ones(2, bool)))
    assert_allclose(found[3:], smooth_states(odds[3:], np.ones(2, bool)))


def test_one_odd_frame_does_not_cover_a_corner_and_a_corner_without_patches_stays_visible() -> None:
    rng = np.random.default_rng(6)
    values, _ = film(rng, texture=8.0)
    values[60] += 25.0
    far, radius = np.full(values.shape[:2], 6.0), np.linspace(1.0, 9.0, SAMPLES)
    small, still = np.full((ROWS, 3), 0.3), np.zeros((ROWS, 3))
    found = uncovered(
        values, far, radius, np.array([0, SAMPLES]), np.array([1]), np.ones((ROWS, 1)), small, still, np.ones((ROWS, 3), bool), np.zeros((ROWS, 3), bool),
    )  # fmt: skip
    assert found[:, [0, 2]].min() > 0.9
    assert found[np.arange(ROWS) != 60, 1].min() > 0.9
