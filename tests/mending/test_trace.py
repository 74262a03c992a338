"""A point followed from one frame on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.testing import assert_allclose

from planewright.mending.trace import trace


@dataclass(frozen=True)
class Sliding:
    """A texture that slides by 1.5 and .5 pixels a frame, and is its negative from frame `cut` on."""

    cut: int = 1000
    numbers: Sequence[int] = range(40)
    image_size: tuple[int, int] = (160, 120)

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        y, x = np.mgrid[0:120, 0:160].astype(np.float64)
        for k in numbers:
            u, v = x - 1.5 * k, y - 0.5 * k
            waves = sum(np.sin(a * u + b * v) for a, b in [(0.31, 0.12), (-0.17, 0.29), (0.05, -0.41), (0.23, 0.21)])
            # The negative of a picture is like it nowhere.
            yield k, np.clip(128.0 + (28.0 if k < self.cut else -28.0) * waves, 0, 255).astype(np.uint8)

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for k, image in self.gray(numbers):
            yield k, np.repeat(image[..., None], 3, axis=2)


def test_a_point_is_followed_both_ways() -> None:
    start = np.array([80.3, 60.7])
    for numbers in (list(range(10, 40)), list(range(10, -1, -1))):
        path, known = trace(Sliding(), numbers, start)
        assert known.all()
        assert_allclose(path, start + np.outer(np.array(numbers) - 10, [1.5, 0.5]), atol=0.4)


def test_what_is_not_like_it_any_more_is_not_followed() -> None:
    path, known = trace(Sliding(cut=25), list(range(10, 40)), np.array([60.0, 60.0]))
    assert known[:15].all()
    assert not known[15:].any()
    assert_allclose(path[15:], np.tile(path[14], (15, 1)))


def test_a_point_that_leaves_the_image_is_lost() -> None:
    _, known = trace(Sliding(), list(range(40)), np.array([140.0, 60.0]))
    assert known[:5].all()
    assert not known[-10:].any()
