from fractions import Fraction
from itertools import pairwise

import av
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planewright.video.pixels import Orientation, color_pixels, gray_pixels

LIMITED, FULL, PQ, HLG, BT601, BT709, BT2020 = 1, 2, 16, 18, 6, 1, 9


def yuv_frame(codes: tuple[int, int, int], name: str = "yuv420p", *, full: bool = False, transfer: int = 2, matrix: int = BT709) -> av.VideoFrame:
    """A picture of one colour, 34 x 18 (its rows are padded in memory)."""
    frame = av.VideoFrame(34, 18, name)
    for plane, code in zip(frame.planes, codes, strict=False):
        dtype = np.uint8 if frame.format.components[0].bits == 8 else np.dtype("<u2")
        plane.update(np.full(plane.buffer_size // np.dtype(dtype).itemsize, code, dtype=dtype).tobytes())
    frame.color_range = FULL if full else LIMITED
    frame.color_trc = transfer
    frame.colorspace = matrix
    return frame


def test_limited_range_is_stretched_by_the_stated_rule() -> None:
    for code in range(256):
        expected = int(np.floor(np.clip((code - 16) * 255 / 219, 0, 255) + 0.5))
        assert (gray_pixels(yuv_frame((code, 128, 128))) == expected).all()
        assert (gray_pixels(yuv_frame((code, 128, 128), full=True)) == code).all()


def test_ten_bits_follow_the_same_rule() -> None:
    for code in range(0, 1024, 7):
        expected = int(np.floor(np.clip((code - 64) * 255 / 876, 0, 255) + 0.5))
        assert (gray_pixels(yuv_frame((code, 512, 512), "yuv420p10le")) == expected).all()
        assert (gray_pixels(yuv_frame((code, 512, 512), "yuv420p10le", transfer=HLG)) == expected).all()


def test_pq_is_compressed_monotonically_with_white_below_the_top() -> None:
    grays = [int(gray_pixels(yuv_frame((code, 512, 512), "yuv420p10le", transfer=PQ))[0, 0]) for code in range(64, 941, 4)]
    assert all(a <= b for a, b in pairwise(grays))
    assert grays[0] == 0
    assert grays[-1] == 255
    # 203 cd/m2 (PQ signal 0.58) is diffuse white: L = 1 becomes (1 + 1 / 4.93^2) / 2 before the gamma.
    white = int(gray_pixels(yuv_frame((64 + round(0.5807 * 876), 512, 512), "yuv420p10le", transfer=PQ))[0, 0])
    assert abs(white - 255 * ((1 + (203 / 1000) ** 2) / 2) ** (1 / 2.2)) < 2
    color = color_pixels(yuv_frame((64 + round(0.5807 * 876), 512, 512), "yuv420p10le", transfer=PQ))
    assert_allclose(color[9, 17].astype(float), white, atol=1)


@pytest.mark.parametrize(("matrix", "red", "blue"), [(BT601, 0.299, 0.114), (BT709, 0.2126, 0.0722), (BT2020, 0.2627, 0.0593)])
@pytest.mark.parametrize("bits", [8, 10])
@pytest.mark.parametrize("full", [False, True])
def test_colour_returns_through_the_matrix_that_made_it(matrix: int, red: float, blue: float, bits: int, full: bool) -> None:
    rng = np.random.default_rng(4)
    for rgb in rng.uniform(0.1, 0.9, (12, 3)):
        y = red * rgb[0] + (1 - red - blue) * rgb[1] + blue * rgb[2]
        cb, cr = (rgb[2] - y) / (2 * (1 - blue)), (rgb[0] - y) / (2 * (1 - red))
        unit = 2 ** (bits - 8)
        if full:
            codes = (y * (256 * unit - 1), cb * (256 * unit - 1) + 128 * unit, cr * (256 * unit - 1) + 128 * unit)
        else:
            codes = ((16 + 219 * y) * unit, (128 + 224 * cb) * unit, (128 + 224 * cr) * unit)
        frame = yuv_frame(tuple(round(c) for c in codes), "yuv420p" if bits == 8 else "yuv420p10le", full=full, matrix=matrix)  # type: ignore[arg-type]
        assert_allclose(color_pixels(frame)[3, 5].astype(float), 255 * rgb, atol=2.6 if bits == 8 else 1.2)


def test_rgb_becomes_grey_by_bt601_weights() -> None:
    image = np.random.default_rng(1).integers(0, 256, (20, 40, 3), dtype=np.uint8)
    frame = av.VideoFrame.from_ndarray(image, format="rgb24")
    assert_array_equal(color_pixels(frame), image)
    assert_allclose(gray_pixels(frame), image @ np.array([0.299, 0.587, 0.114]), atol=0.6)


def test_orientations_are_the_eight_of_the_square() -> None:
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    results = {Orientation(turns, mirrored).apply(image).tobytes() for turns in range(4) for mirrored in (False, True)}
    assert len(results) == 8
    for turns in range(4):
        orientation = Orientation(turns, False, float(Fraction(2, 1)))
        shown = orientation.apply(image)
        assert orientation.displayed_size((4, 3)) == (shown.shape[1], shown.shape[0])
