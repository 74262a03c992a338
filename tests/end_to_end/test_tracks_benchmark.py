"""The tracks benchmark's own rules: baselines follow what can be followed, users stop when a clip is good, claims are judged strictly."""

from xml.etree import ElementTree

import numpy as np
import pytest
from benchmarks.baselines import BASELINES, sweep
from benchmarks.claims import CLAIMS
from benchmarks.corners import corner_errors
from benchmarks.report import page
from benchmarks.simulated_user import Followed, UserOptions, correct_as_user, worst
from benchmarks.tables import CURVE, group_table
from numpy.testing import assert_allclose, assert_array_equal

from planewright.arrays import Float, GrayImage
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint

SHIFT = np.array([1.7, -0.9])
"""Pixels by which the picture moves from frame to frame."""
CORNERS = {"a": (60.0, 90.0), "b": (150.0, 84.0), "c": (158.0, 170.0), "d": (52.0, 160.0)}


def textured(num_frames: int) -> list[GrayImage]:
    """A window with random paint inside a frame of plain paint, moving by `SHIFT`: sums of waves, so that it can be drawn at any place."""
    rng = np.random.default_rng(3)
    waves = rng.uniform(0.02, 0.4, (40, 2)) * rng.choice([-1, 1], (40, 2))
    phase = rng.uniform(0, 2 * np.pi, 40)
    images: list[GrayImage] = []
    for k in range(num_frames):
        y, x = np.mgrid[0:240, 0:240] + 0.5
        x, y = x - SHIFT[0] * k, y - SHIFT[1] * k
        values = np.cos(x[..., None] * waves[:, 0] + y[..., None] * waves[:, 1] + phase).sum(axis=-1)
        images.append(np.clip(128 + 12 * values, 0, 255).astype(np.uint8))
    return images


def drawn(marks: dict[str, dict[int, tuple[float, float]]]) -> Sketch:
    loop = tuple(PointId(p) for p in CORNERS)
    edges = tuple((loop[k], loop[(k + 1) % 4]) for k in range(4))
    return Sketch(tuple(SketchPoint(PointId(p), marks[p]) for p in CORNERS), (240, 240), edges, (SketchFace(FaceId("f"), loop),))


def marked_in(frame: int) -> dict[str, dict[int, tuple[float, float]]]:
    return {p: {frame: tuple(np.add(xy, SHIFT * frame))} for p, xy in CORNERS.items()}


def true_tracks(num_frames: int) -> dict[str, dict[str, list[object]]]:
    return {p: {"xy": [list(np.add(xy, SHIFT * k)) for k in range(num_frames)], "visible": [True] * num_frames} for p, xy in CORNERS.items()}


def shifted(old: GrayImage, new: GrayImage, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
    """A step that knows the motion."""
    del old, new
    return points + SHIFT


@pytest.mark.parametrize("name", BASELINES)
def test_a_baseline_follows_a_moving_picture_both_ways(name: str) -> None:
    sketch, images = drawn(marked_in(3)), textured(7)
    paths = sweep(images, sketch, BASELINES[name](sketch), together=True)
    expected = np.array([[np.add(xy, SHIFT * k) for k in range(7)] for xy in CORNERS.values()])
    # Nine candidates a corner wander by a pixel a frame at most.
    assert_allclose(paths, expected, atol=3.5 if "3 x 3" in name else 0.25)
    assert_array_equal(paths[:, 3], expected[:, 3])


def test_of_two_marks_the_nearer_one_counts() -> None:
    marks = marked_in(0)
    marks["a"][8] = (0.0, 0.0)
    path = sweep(textured(1) * 9, drawn(marks), lambda old, new, points: points.copy())[0]
    assert_allclose(path[:5], np.tile(CORNERS["a"], (5, 1)))
    assert_allclose(path[5:], 0.0)


def test_points_marked_elsewhere_stand_beside_a_point_from_its_first_frame_on() -> None:
    company: list[int] = []

    def step(old: GrayImage, new: GrayImage, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
        company.append(int(np.isfinite(points[:, 0]).sum()))
        return points.copy()

    marks = marked_in(0) | {"a": {5: CORNERS["a"]}}
    sweep(textured(1) * 6, drawn(marks), step)
    alone = company.copy()
    company.clear()
    sweep(textured(1) * 6, drawn(marks), step, together=True)
    assert min(alone) == 1
    assert min(company[len(alone) :]) == 4


def test_what_is_not_claimed_is_infinitely_wrong() -> None:
    truth = {"a": {"xy": [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], "visible": [True, True, False]}, "b": {"7": [1.0, 1.0]}}
    found = {"a": {"0": {"xy": [1.0, 5.0], "state": "tracked"}, "1": {"xy": [3.0, 4.0], "state": "hidden"}}}
    errors = corner_errors(found, truth)
    assert errors.corner == ("a", "a", "b")
    assert_array_equal(errors.frame, [0, 1, 7])
    assert_array_equal(errors.error, [3.0, np.inf, np.inf])
    assert errors.medians() == {"a": np.inf, "b": np.inf}
    assert worst(errors) in (1, 2)


def test_one_click_mends_one_bad_mark_and_a_good_clip_needs_none() -> None:
    truth = true_tracks(9)
    good = Followed(textured(1) * 9, drawn(marked_in(0)), shifted)
    assert correct_as_user(good, truth, "worst first", np.random.default_rng(0)).corrections == 0
    marks = marked_in(0) | {"b": {0: (170.0, 84.0)}}
    bad = Followed(textured(1) * 9, drawn(marks), shifted)
    done = correct_as_user(bad, truth, "worst first", np.random.default_rng(0), UserOptions(share=85.0))
    assert done.satisfied
    assert done.marks[0][0] == "b"
    assert done.corrections == len(done.marks) == len(done.seconds) == len(done.within) - 1
    assert 75.0 == done.within[0] < done.within[-1]


def test_a_user_gives_up_and_one_whose_list_names_nothing_wrong_stops() -> None:
    truth = true_tracks(5)
    lost = Followed(textured(1) * 5, drawn(marked_in(0)), lambda old, new, points: np.full_like(points, np.nan))
    done = correct_as_user(lost, truth, "worst first", np.random.default_rng(0), UserOptions(patience=3))
    assert (done.corrections, done.satisfied) == (3, False)
    done = correct_as_user(lost, truth, "list followed", np.random.default_rng(0))
    assert (done.corrections, done.satisfied) == (0, False)


def test_a_claim_holds_only_where_every_clip_keeps_it() -> None:
    claims = {claim.key: claim for claim in CLAIMS}
    assert claims["rmse_px"].verdict("twin", [0.5, 0.9], 0.7)
    assert not claims["rmse_px"].verdict("twin", [0.1, 0.91], 0.5)
    assert not claims["rmse_px"].verdict("twin", [0.1, None], 0.1)  # a clip without a result
    assert not claims["coverage95_pct"].verdict("twin", [99.5], 99.5)  # too cautious is wrong as well
    assert claims["good_corners_pct"].verdict("twin", [90.0, 100.0], 98.5)
    assert claims["corrections"].verdict("hard", [0.0, 3.0, 20.0], None)
    assert not claims["corrections_max"].verdict("twin", [0.0, 3.0], None)
    assert claims["within_1px_pct"].verdict("twin", [1.0], 1.0) is None


def test_a_table_marks_the_clip_that_breaks_a_goal() -> None:
    ours = {"rmse_px": 0.5, "median_px": 0.2}
    clips = {"fine": {"status": 0, "ours": ours}, "off": {"status": 0, "ours": {**ours, "rmse_px": 1.25}}}
    total = {"ours": {"rmse_px": 0.8, "median_px": 0.2}}
    lines, kept = group_table("twin", clips, total)
    rows = {line.split("|")[1].strip(): line for line in lines}
    assert not kept
    assert "**1.25**" in rows["corner RMSE, px"]
    assert rows["corner RMSE, px"].endswith("| **not kept** |")
    assert rows["median error, px"].endswith("| kept |")
    assert group_table("twin", {"fine": clips["fine"]}, total)[1]
    assert not group_table("twin", {"fine": clips["fine"], "refused": {"status": 4}}, total)[1]


def test_a_page_and_its_diagrams_are_made_of_what_was_measured() -> None:
    figures = {"rmse_px": 0.5, "median_px": 0.2, "curve": [100.0 * k / (len(CURVE) - 1) for k in range(len(CURVE))]}
    user = {"corrections": 3, "looks": 0, "within": [91.0, 99.5], "seconds": [0.2, 0.3, 0.4], "satisfied": True, "stopped_by": None}
    clip = {"group": "twin", "status": 0, "ours": {**figures, "bad_corners": {"ridge": 3.14, "sill": None}}, "users": [{"worst first": user}]}
    tracks = {"command": "the command", "clips": {"house": clip}, "totals": {"twin": {"ours": figures, "baselines": {"LK": figures}}}}
    clip["baselines"] = {"LK": figures}
    correction = {"span": 30, "seconds": 0.25, "first": 0.1, "processor": 0.2}
    path = {"span": 300, "seconds": 1.5, "first": None, "processor": 1.2}
    stages = {"frames": 100, "stages": {"features": 2.0}, "ms_per_frame": 20.0, "peak_memory_mb": 300.0}
    speed = {"machine": {"cores": 2}, "clips": {"960x540": stages}, "corrections": [correction], "paths": [path], "profile": []}
    text, diagrams = page(tracks, speed, "0009-name")
    for words in ("`the command`", "ridge (3.1), sill (not claimed)", "| house | 0 | worst first | 3 |", "| 30 | 1 | 0.10 |", "| features | 20.0 |"):
        assert words in text, words
    assert set(diagrams) == {f"0009-name-{part}.svg" for part in ("twin", "corrections", "paths")}
    for name, svg in diagrams.items():
        assert f"]({name})" in text
        assert ElementTree.fromstring(svg).tag.endswith("svg")
