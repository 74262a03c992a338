from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.arrays import ColorImage, GrayImage
from planewright.geometry.camera import Intrinsics
from planewright.geometry.lens import Lens, RollingShutter
from planewright.video.undistort import UndistortedFrames


class OneFrame:
    def __init__(self, image: np.ndarray) -> None:
        self.image = image

    @property
    def image_size(self) -> tuple[int, int]:
        return self.image.shape[1], self.image.shape[0]

    @property
    def numbers(self) -> Sequence[int]:
        return (0,)

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, GrayImage]]:
        yield from ((number, self.image) for number in numbers)

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, ColorImage]]:
        yield from ((number, np.repeat(self.image[..., None], 3, axis=2)) for number in numbers)


def spot_image(size: tuple[int, int], spots: np.ndarray, sigma: float = 2.5) -> np.ndarray:
    """Gaussian spots at pixel positions (the first pixel's centre is 0.5)."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    total = sum(np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * sigma**2)) for cx, cy in spots)
    return np.rint(np.clip(total * 240, 0, 255)).astype(np.uint8)


def centroid(image: np.ndarray, near: np.ndarray, radius: int = 9) -> np.ndarray:
    x, y = np.meshgrid(np.arange(image.shape[1]) + 0.5, np.arange(image.shape[0]) + 0.5)
    weight = image.astype(float) * ((x - near[0]) ** 2 + (y - near[1]) ** 2 < radius**2)
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


@pytest.mark.parametrize("distortion", [(-0.15,), (0.1,), (-0.2, 0.06)])
def test_a_point_ends_where_the_pinhole_camera_sees_it(distortion: tuple[float, ...]) -> None:
    camera = Intrinsics(260.0, np.array([163.0, 117.0]), (320, 240), distortion)
    points = np.array([[x, y, 1.0] for x in (-0.45, -0.2, 0.05, 0.4) for y in (-0.3, 0.02, 0.33)])
    image = spot_image((320, 240), camera.project(points))
    result = next(UndistortedFrames(OneFrame(image), Lens(camera)).gray([0]))[1]
    for expected in camera.pinhole().project(points):
        # A wrong half pixel would show as 0.5.
        assert_allclose(centroid(result, expected), expected, atol=0.1)


def test_without_distortion_frames_pass_through() -> None:
    image = np.random.default_rng(0).integers(0, 255, (40, 60), dtype=np.uint8)
    for distortion in ((), (0.0,)):
        frames = UndistortedFrames(OneFrame(image), Lens(Intrinsics(50.0, np.array([30.0, 20.0]), (60, 40), distortion)))
        assert next(frames.gray([0]))[1] is image
        assert frames.image_size == (60, 40)
        assert list(frames.numbers) == [0]


def test_colour_is_resampled_like_grey() -> None:
    image = np.random.default_rng(0).integers(0, 255, (40, 60), dtype=np.uint8)
    frames = UndistortedFrames(OneFrame(image), Lens(Intrinsics(50.0, np.array([30.0, 20.0]), (60, 40), (0.1,))))
    gray, color = next(frames.gray([0]))[1], next(frames.color([0]))[1]
    assert_allclose(color, np.repeat(gray[..., None], 3, axis=2), atol=1)


def test_a_camera_for_other_frames_is_refused() -> None:
    with pytest.raises(ValueError, match="camera is for"):
        UndistortedFrames(OneFrame(np.zeros((40, 60), dtype=np.uint8)), Lens(Intrinsics(50.0, np.array([30.0, 20.0]), (61, 40))))


def test_a_rolling_shutter_is_taken_away_frame_by_frame() -> None:
    camera = Intrinsics(260.0, np.array([163.0, 117.0]), (320, 240), (-0.08,))
    turn = np.array([[[0.03, 0.05, -0.02], [0.01, 0.0, 0.01], [0.0, 0.01, 0.0]]])
    shutter = RollingShutter(
        0.8, np.array([0]), turn, np.array([[[0.2, -0.1, 0.05], [0.0, 0.0, 0.0], [0.01, 0.0, 0.0]]]), np.linspace(0.1, 0.3, 12).reshape(1, 3, 4)
    )
    lens = Lens(camera, shutter)
    straight = np.array([[x, y] for x in (45.0, 111.0, 158.0, 270.0) for y in (35.0, 122.0, 205.0)])
    shown = lens.to_displayed(0, straight)
    assert np.linalg.norm(shown - Lens(camera).to_displayed(0, straight), axis=1).max() > 3
    image = spot_image((320, 240), shown)
    result = next(UndistortedFrames(OneFrame(image), lens).gray([0]))[1]
    for expected in straight:
        assert_allclose(centroid(result, expected), expected, atol=0.1)
    # A frame without a camera has no known motion: it is only unbent.
    other = next(UndistortedFrames(OneFrame(image), lens).gray([7]))[1]
    same = next(UndistortedFrames(OneFrame(image), Lens(camera)).gray([7]))[1]
    assert np.abs(other[:-16, :-16].astype(int) - same[:-16, :-16]).max() <= 2
