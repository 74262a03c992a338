"""Laws of registration and of lines, on images that are known."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.registration.homography import apply_homography, change_jacobian
from planewright.registration.kernels import align_face, find_lines
from planewright.registration.templates import TemplateOptions, clear_share, make_template, pyramid

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def texture(rng: np.random.Generator, contrast: float = 30.0, size: int = 260) -> np.ndarray:
    image = sum(cv2.resize(rng.normal(0, 1, (size // s, size // s)), (size, size), interpolation=cv2.INTER_CUBIC) for s in (4, 10, 26))
    return 120 + contrast * np.asarray(image) / 1.5


def register(moved: np.ndarray, still: np.ndarray, start: np.ndarray, prior: np.ndarray, h: np.ndarray) -> tuple[bool, np.ndarray, np.ndarray, np.ndarray]:
    options = TemplateOptions()
    mask = np.zeros(still.shape, bool)
    mask[60:200, 60:200] = True
    template = make_template(pyramid(still, options), mask, 0, h, np.zeros((8, 8)), options)
    assert template is not None
    t = template.levels[0]
    assert t is not None
    weights, information, figures = np.zeros(len(t.q)), np.zeros((8, 8)), np.zeros(6)
    found = start.copy()
    image = pyramid(moved, options)[0]
    crowd = 12.0 * t.share / clear_share(t, 1.0) ** 2
    good = align_face(image, t.q, t.values, t.steepest, found, np.zeros(8), prior, 1.0, crowd, 30, 0.005, weights, information, figures)
    return good, found, information, figures


@pytest.fixture(scope="module")
def h() -> np.ndarray:
    return np.array([[70.0, 0.0, 130.0], [0.0, 70.0, 130.0], [0.0, 0.0, 1.0]])


def test_a_moved_face_is_found_whatever_the_light_and_a_cover_do(h: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    still = texture(rng)
    for _ in range(3):
        motion = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]]) + rng.normal(0, 1, (3, 3)) * [[0.01, 0.01, 1.2], [0.01, 0.01, 1.2], [5e-5, 5e-5, 0]]
        moved = cv2.warpPerspective(still, motion, (260, 260), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        moved = 0.8 * moved + 25
        moved[100:150, 60:110] = 40  # in front of a ninth of it
        noisy = [np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8) for image in (moved, still)]
        good, found, information, figures = register(*noisy, h, np.eye(8) * 1e-6, h)
        assert good
        error = apply_homography(found, CORNERS) - apply_homography(motion @ h, CORNERS)
        assert np.abs(error).max() < 0.12
        assert 0.76 < figures[4] < 0.84
        assert np.linalg.eigvalsh(information).min() > 0


def test_a_bare_face_stays_where_its_prior_is(h: np.ndarray) -> None:
    rng = np.random.default_rng(2)
    still, moved = (np.clip(120 + rng.normal(0, 2, (260, 260)), 0, 255).astype(np.uint8) for _ in range(2))
    start = h + np.array([[0, 0, 0.5], [0, 0, -0.4], [0, 0, 0]])
    j = change_jacobian(start, CORNERS).reshape(8, 8)
    _, found, _, _ = register(moved, still, start, j.T @ j / 0.5**2, h)  # half a pixel at each corner
    assert np.abs(apply_homography(found, CORNERS) - apply_homography(start, CORNERS)).max() < 1.0


def test_a_face_that_leaves_the_image_is_refused(h: np.ndarray) -> None:
    still = texture(np.random.default_rng(3)).clip(0, 255).astype(np.uint8)
    away = h + np.array([[0, 0, 250.0], [0, 0, 0], [0, 0, 0]])
    good, *_ = register(still, still, away, np.eye(8) * 1e-6, h)
    assert not good


def test_lines_are_found_to_a_twentieth_of_a_pixel() -> None:
    rows, columns = np.mgrid[:120, :160].astype(float)
    for shift, tilt in ((0.0, 0.0), (1.7, 0.0), (-2.2, 0.01), (0.6, -0.02)):
        edge = 60 + shift + tilt * (columns - 80)
        image = (90 + 80 / (1 + np.exp(-(rows - edge) / 0.7))).astype(np.float32)
        out = np.zeros((2, 4))
        find_lines(image, np.array([[30.0, 60.0, 130.0, 60.0], [30.0, 60.0, 33.0, 60.0]]), 3.5, 3.0, 3.0, out)
        assert_allclose(out[0, :2], [shift - 50 * tilt, shift + 50 * tilt], atol=0.05)
        assert out[0, 3] == 1.0
        assert out[1, 3] == 0.0  # too short to be looked at


def test_where_there_is_no_step_there_is_no_line() -> None:
    out = np.ones((1, 4))
    find_lines(np.full((100, 100), 90, np.float32), np.array([[20.0, 50.0, 80.0, 50.0]]), 3.5, 3.0, 3.0, out)
    assert (out == 0).all()
