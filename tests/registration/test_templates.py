"""Laws of templates."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.registration.homography import apply_homography, changed
from planewright.registration.templates import TemplateOptions, cell_of, face_mask, make_template, pyramid, to_level


def picture() -> np.ndarray:
    y, x = np.mgrid[:120, :160]
    return (120 + 40 * np.sin(x / 6.0) + 30 * np.cos(y / 5.0 + x / 11.0)).astype(np.uint8)


def test_a_point_keeps_its_place_on_every_level() -> None:
    y, x = np.mgrid[:128, :128].astype(float)
    dot = (200 * np.exp(-((x - 50.3) ** 2 + (y - 71.8) ** 2) / (2 * 9.0**2))).astype(np.uint8)
    for level, image in enumerate(pyramid(dot, TemplateOptions())):
        rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
        heavy = image.astype(float)
        found = np.array([(columns * heavy).sum(), (rows * heavy).sum()]) / heavy.sum()
        assert_allclose(found, (to_level(level) @ [50.3, 71.8, 1.0])[:2], atol=0.1)


def test_steepest_descent_is_the_change_of_the_grey_values() -> None:
    h = np.array([[40.0, 3.0, 80.0], [-2.0, 35.0, 60.0], [0.05, 0.02, 1.0]])
    options = TemplateOptions()
    levels = pyramid(picture(), options)
    mask = np.zeros((120, 160), bool)
    mask[30:90, 45:115] = True
    template = make_template(levels, mask, 0, h, np.zeros((8, 8)), options)
    assert template is not None
    fine = template.levels[0]
    assert fine is not None
    assert len(fine.q) <= options.max_pixels[0]
    here = np.round(apply_homography(h, fine.q)).astype(int)
    assert_allclose(fine.values, levels[0][here[:, 1], here[:, 0]])
    step = 1e-3
    for d in np.eye(8):
        moved = apply_homography(changed(h, step * d), fine.q) - apply_homography(h, fine.q)
        gx = (levels[0][here[:, 1], here[:, 0] + 1] - levels[0][here[:, 1], here[:, 0] - 1]) / 2
        gy = (levels[0][here[:, 1] + 1, here[:, 0]] - levels[0][here[:, 1] - 1, here[:, 0]]) / 2
        assert_allclose(fine.steepest @ d * step, gx * moved[:, 0] + gy * moved[:, 1], atol=0.02)


def test_masks_leave_out_the_border_and_what_lies_before() -> None:
    square, hole = np.array([[10.0, 10.0], [50.0, 10.0], [50.0, 50.0], [10.0, 50.0]]), np.array([[20.0, 20.0], [30.0, 20.0], [30.0, 30.0], [20.0, 30.0]])
    mask = face_mask((80, 80), square, [], [hole], 2.0)
    assert mask[40, 40]
    assert not mask[11, 30]
    assert not mask[25, 25]
    assert not mask[25, 32]
    assert not mask[60, 60]


def test_a_face_of_a_few_pixels_has_no_template() -> None:
    options = TemplateOptions()
    mask = np.zeros((120, 160), bool)
    mask[50:56, 50:56] = True
    assert make_template(pyramid(picture(), options), mask, 0, np.diag([3.0, 3.0, 1.0]), np.zeros((8, 8)), options) is None


def test_cells_cover_the_square() -> None:
    at = (np.arange(6) + 0.5) / 3 - 1
    grid = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    assert sorted(cell_of(grid, 6)) == list(range(36))
    assert cell_of(np.array([[-3.0, -3.0], [3.0, 3.0]]), 6).tolist() == [0, 35]
