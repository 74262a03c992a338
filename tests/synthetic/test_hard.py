"""Each hard clip is hard in the way it says, and only as hard as it says."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.arrays import Bool, Float
from planewright.synthetic import HARD, boxes, draw, hard, library, toy_house, true_cameras, true_tracks, truth
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.motion import Path
from planewright.synthetic.observe import object_pose

SMALL = (240, 135)
MEDIUM = (320, 180)


def drawn(clip: SyntheticClip, frame: int) -> tuple[Float[np.ndarray, "height width 3"], Bool[np.ndarray, "height width"]]:
    """A frame without noise and drift, and where it shows the thing that is sketched."""
    plain = replace(clip, options=replace(clip.options, noise=0.0, exposure_drift=0.0))
    thing = np.array([s.part == "thing" for s in clip.scene.surfaces] + [False])  # nothing at all has index -1
    return plain.renderer.frame(frame).astype(float), thing[clip.renderer.surface_index(frame)]


def contrast(image: Float[np.ndarray, "height width 3"], where: Bool[np.ndarray, "height width"]) -> float:
    """Mean step from pixel to pixel where both are inside, grey levels."""
    gray = image.mean(axis=2)
    inside = where[:, 1:] & where[:, :-1]
    return float(np.abs(np.diff(gray, axis=1))[inside].mean())


def test_the_set_has_its_eleven_names() -> None:
    names = [make.__name__ for make in HARD]
    assert len(set(names)) == len(names) == 11
    for make in HARD:
        clip = make(12, SMALL)
        assert clip.name == make.__name__
        assert clip.num_frames == 12


@pytest.mark.parametrize("make", HARD)
def test_every_face_can_be_drawn(make: Callable[..., SyntheticClip]) -> None:
    """A person sees each corner in some frame well enough to click it."""
    clip = make()
    assert 120 <= clip.num_frames <= 240
    sketch = draw(clip, np.random.default_rng(0))
    assert len(sketch.points) == len(clip.scene.points)
    assert len(sketch.faces) == len(clip.scene.faces) >= 8


def test_bare_walls_show_a_small_part_of_what_bricks_do() -> None:
    """At full size their mean step from pixel to pixel is 0.9 grey levels, half the noise."""
    bare, usual = hard.bare_walls(12, MEDIUM), toy_house(12, MEDIUM)
    for k, face in enumerate(bare.scene.faces):
        if face.id == "front":
            steps = [contrast(drawn(clip, 6)[0], clip.renderer.surface_index(6) == k) for clip in (bare, usual)]
            assert steps[0] < 0.4 * steps[1]


@pytest.mark.parametrize(("make", "arc"), [(hard.arc_10, 10.0), (hard.arc_20, 20.0)])
def test_an_arc_is_as_short_as_it_says(make: Callable[..., SyntheticClip], arc: float) -> None:
    clip = make()
    assert isinstance(clip.path, Path)
    away = true_cameras(clip).centers - clip.path.target
    ends = np.degrees(np.unwrap(np.arctan2(away[:, 1], away[:, 0])))
    assert_allclose(np.ptp(ends), arc, atol=3.5)  # the hand sways by a degree or two


def test_blending_walls_have_nearly_the_colour_of_what_is_behind() -> None:
    """Across the outlines of the cartons: a quarter of the steps are hardly more than the paint's own, and all are smaller than at the ordinary cartons."""
    steps: list[Float[np.ndarray, "3"]] = []
    for clip in (hard.blending(12, MEDIUM), boxes(12, MEDIUM)):
        image, thing = drawn(clip, 5)
        rim = thing[:, 4:-4] != thing[:, 5:-3]
        across = np.abs(image[:, 8:] - image[:, :-8]).mean(axis=2)[:, : rim.shape[1]][rim[:, : image.shape[1] - 8]]
        steps.append(np.percentile(across, [25, 50, 75]))
    assert np.all(steps[0] < 0.8 * steps[1])
    assert 4.0 < steps[0][0] < 20.0  # twice the noise: it can be seen


def test_on_the_turntable_the_cartons_turn_and_the_room_stays() -> None:
    clip = hard.turntable(12, SMALL)
    (first, before), (last, after) = drawn(clip, 0), drawn(clip, 11)
    disc = [s.carrier == "object" for s in clip.scene.surfaces] + [False]
    still = ~(np.array(disc)[clip.renderer.surface_index(0)] | np.array(disc)[clip.renderer.surface_index(11)])
    assert np.abs(first - last)[still].mean() < 1.0 < 10.0 < np.abs(first - last)[before & after].mean()
    assert contrast(first, still) > 2.0  # the room says loudly that nothing moves
    centers = true_cameras(hard.turntable(150, SMALL)).centers
    assert_allclose(np.degrees(np.ptp(np.unwrap(np.arctan2(centers[:, 1], centers[:, 0])))), 116.0, atol=1.0)


def test_a_bare_background_is_bare() -> None:
    clip = hard.bare_background(12, MEDIUM)
    image, thing = drawn(clip, 5)
    assert contrast(image, ~thing) < 0.15 * contrast(image, thing)


def test_corners_smear_over_eight_pixels_where_the_hand_shakes() -> None:
    clip = hard.blur()
    _, visible, _ = true_tracks(clip)
    points = clip.scene.corner_array(list(clip.scene.points))
    half = 0.5 * clip.options.shutter
    smear: list[float] = []
    for k in range(clip.num_frames):
        a, b = (clip.intrinsics.project(object_pose(clip, k + t).apply(points)) for t in (-half, half))
        smear += np.linalg.norm(b - a, axis=1)[visible[:, k]].tolist()
    assert 6.0 < np.percentile(smear, 95) < 10.0
    assert np.median(smear) > 2.5


def test_the_hand_covers_corners_in_fifteen_percent_of_the_frames() -> None:
    clip = hard.occluder()
    _, visible, _ = true_tracks(clip)
    _, without, _ = true_tracks(replace(clip, visit=None))
    assert not np.any(visible & ~without)
    assert_allclose(np.mean((without & ~visible).any(axis=0)), 0.15, atol=0.02)


def test_rows_are_read_one_after_the_other() -> None:
    clip = hard.rolling_shutter(40)
    assert truth(clip)["camera"]["readout"] == 0.7  # pyright: ignore[reportIndexIssue]
    xy, visible, _ = true_tracks(clip)
    at_once, _, _ = true_tracks(replace(clip, options=replace(clip.options, readout=0.0)))
    assert np.percentile(np.linalg.norm(xy - at_once, axis=2)[visible], 95) > 2.0


def test_what_was_built_carelessly_is_told_as_it_was_meant() -> None:
    clip, meant = hard.as_built(12, SMALL), truth(library(12, SMALL))
    known = truth(clip)
    assert known["as_built"] and not meant["as_built"]
    assert known["relations"] == meant["relations"]
    assert known["near_misses"] == meant["near_misses"]
    turned = [
        np.degrees(np.arccos(np.clip(np.dot(a["normal"], b["normal"]), -1.0, 1.0)))
        for a, b in zip(known["faces"], meant["faces"], strict=True)  # pyright: ignore[reportArgumentType]
        if a["id"] not in ("plaza", "lawn")  # the ground is level
    ]
    assert min(turned) > 0.05 and max(turned) < 0.35
    assert 0.1 < np.median(turned) < 0.3


def test_faces_that_nobody_could_draw_are_left_out_and_still_hide() -> None:
    clip, whole = hard.arc_10(30, SMALL), boxes(30, SMALL, 12)
    assert len(clip.scene.faces) < len(whole.scene.faces)
    loops = [[tuple(map(tuple, s.loops[0])) for s in c.scene.surfaces if s.carrier == "world"] for c in (clip, whole)]
    assert sorted(loops[0]) == sorted(loops[1])
    for face, surface in zip(clip.scene.faces, clip.scene.surfaces, strict=False):
        assert_allclose(surface.loops[0], clip.scene.corner_array(face.loop))


def test_shakes_are_continuous() -> None:
    clip = hard.blur(200, SMALL)
    centers = np.array([object_pose(clip, 0.25 * k).rotation[2] for k in range(160)])
    steps = np.array([np.linalg.norm(b - a) for a, b in pairwise(centers)])
    assert steps.max() < np.radians(0.5)
    assert np.abs(np.diff(steps)).max() < np.radians(0.1)
