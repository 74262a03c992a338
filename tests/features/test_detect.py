"""Laws of corner detection."""

import cv2
import numpy as np

from planewright.features.detect import DetectOptions, detect_corners


def textured(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.clip(128 + 50 * cv2.resize(rng.normal(0, 1, (100, 140)), (420, 300), interpolation=cv2.INTER_CUBIC), 0, 255).astype(np.uint8)


def test_corners_keep_their_distance_from_each_other_and_the_border():
    options = DetectOptions(max_corners=150)
    corners = detect_corners(textured(), np.zeros((0, 2)), options)
    assert 50 < len(corners) <= 150
    apart = np.abs(corners[:, None] - corners[None]).max(axis=2) + 1e9 * np.eye(len(corners))
    assert apart.min() > options.min_distance
    assert (corners >= options.margin).all() and (corners < np.array([420, 300]) - options.margin).all()


def test_new_corners_stay_away_from_those_alive():
    image, options = textured(), DetectOptions(max_corners=150)
    alive = detect_corners(image, np.zeros((0, 2)), options)[:60] + 0.3
    new = detect_corners(image, alive, options)
    assert len(new) + len(alive) <= 150
    assert np.abs(new[:, None] - alive[None]).max(axis=2).min() > options.min_distance - 0.5


def test_a_few_bright_letters_do_not_silence_the_rest():
    image = (128 + 0.15 * (textured().astype(float) - 128)).astype(np.uint8)
    before = len(detect_corners(image, np.zeros((0, 2))))
    cv2.putText(image, "REC", (20, 40), cv2.FONT_HERSHEY_SIMPLEX, 1.0, 255, 2)
    assert len(detect_corners(image, np.zeros((0, 2)))) > 0.8 * before


def test_a_bare_picture_has_none():
    assert len(detect_corners(np.full((300, 420), 90, np.uint8), np.zeros((0, 2)))) == 0
    assert len(detect_corners(textured()[:15, :15], np.zeros((0, 2)))) == 0


def test_corners_are_confined_to_what_is_allowed():
    allowed = np.zeros((300, 420), bool)
    allowed[100:200, 150:250] = True
    corners = detect_corners(textured(), np.zeros((0, 2)), allowed=allowed).astype(int)
    assert len(corners) > 5
    assert allowed[corners[:, 1], corners[:, 0]].all()
