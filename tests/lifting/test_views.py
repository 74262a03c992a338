"""Frames and their cameras stay together when they are thinned out and reduced."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planewright.geometry.camera import Intrinsics
from planewright.lifting.views import ViewOptions, load_views
from planewright.sfm.cameras import Cameras, ScenePoints


@dataclass(frozen=True)
class Lamp:
    """Frames of a lamp in the dark: a Gaussian spot where a world point is projected."""

    cameras: Cameras
    lamp: np.ndarray

    @property
    def image_size(self) -> tuple[int, int]:
        return self.cameras.intrinsics.image_size

    @property
    def numbers(self):
        return self.cameras.frame.tolist()

    def gray(self, numbers):
        width, height = self.image_size
        for number in numbers:
            x, y = self.cameras.intrinsics.project(self.cameras.cam_from_world(int(number)).apply(self.lamp[None]))[0]
            columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
            yield number, np.rint(250 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 6.0**2))).astype(np.uint8)

    def color(self, numbers):
        for number, image in self.gray(numbers):
            yield number, np.repeat(image[:, :, None], 3, axis=2)


@pytest.fixture
def lamp() -> Lamp:
    """30 frames of 242x161; the camera moves sideways, frame 7 has no pose."""
    posed = np.arange(30) != 7
    translation = np.column_stack([np.linspace(-0.4, 0.4, 30), np.zeros(30), np.full(30, 3.0)])
    intrinsics = Intrinsics(200.0, np.array([118.0, 83.0]), (242, 161))
    cameras = Cameras(intrinsics, np.arange(30), np.tile(np.eye(3), (30, 1, 1)), translation, posed, 0.0, (200.0, 200.0))
    return Lamp(cameras, np.array([0.15, -0.1, 0.0]))


def cloud(depth: float = 0.0) -> ScenePoints:
    xyz = np.random.default_rng(0).normal(0.0, 0.2, (50, 3)) * [1.0, 1.0, 0.1] + [0.0, 0.0, depth]
    return ScenePoints(xyz, np.arange(50), np.zeros((50, 3, 3)), np.tile([0, 29], (50, 1)))


@pytest.mark.parametrize("max_pixels", [10**6, 20_000, 5_000])
def test_a_world_point_is_where_the_views_project_it_at_any_size(lamp: Lamp, max_pixels: int) -> None:
    views = load_views(lamp, lamp.cameras, cloud(), [], ViewOptions(max_pixels=max_pixels))
    height, width = views.images.shape[1:]
    assert width * height <= 1.02 * max_pixels
    for image, projection in zip(views.images, views.projections, strict=True):
        x, y, z = projection @ [*lamp.lamp, 1.0]
        weight = image.astype(float)
        rows, columns = np.mgrid[0:height, 0:width] + 0.5
        assert_allclose([(weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()], [x / z, y / z], atol=0.05)


def test_frames_with_marks_are_kept_and_frames_without_a_pose_are_not(lamp: Lamp) -> None:
    views = load_views(lamp, lamp.cameras, cloud(), [3, 7, 28], ViewOptions(max_views=5))
    assert {3, 28} <= set(views.frame.tolist())
    assert 7 not in views.frame
    assert_array_equal(views.frame, np.unique(views.frame))
    for k, frame in enumerate(views.frame):
        assert views.index(int(frame)) == k
        assert_allclose(views.centers[k], lamp.cameras.centers[frame])
    assert views.index(7) is None


def test_the_number_of_views_is_bounded_by_memory(lamp: Lamp) -> None:
    few = load_views(lamp, lamp.cameras, cloud(), [], ViewOptions(max_bytes=25 * 242 * 161))
    assert len(few.frame) == 25
    assert few.frame[0] == 0 and few.frame[-1] == 29


@pytest.mark.parametrize("depth", [0.0, 5.0])
def test_depth_per_pixel_moves_the_middle_of_a_view_by_about_one_pixel_where_it_moves_most(lamp: Lamp, depth: float) -> None:
    views = load_views(lamp, lamp.cameras, cloud(depth), [])
    last = views.projections[-1]
    ray = np.array([0.0, 0.0, 3.0 + depth])
    moved = []
    for factor in (1.0, 1.0 + views.depth_per_pixel):
        x, _, z = last @ [*(ray * factor - views.translation[0]), 1.0]
        moved.append(x / z)
    # The reach is the median over views; the first view and the last one see the most.
    assert 0.9 < abs(moved[1] - moved[0]) < 2.1


def test_blur_is_what_the_options_say(lamp: Lamp) -> None:
    sharp = load_views(lamp, lamp.cameras, cloud(), [], ViewOptions(blur=0.0))
    blurred = load_views(lamp, lamp.cameras, cloud(), [], replace(ViewOptions(), blur=2.0))
    assert_array_equal(sharp.images[0], next(iter(lamp.gray([0])))[1])
    assert_array_equal(blurred.images[0], cv2.GaussianBlur(sharp.images[0], (0, 0), 2.0))
