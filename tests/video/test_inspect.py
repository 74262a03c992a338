from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from planewright.arrays import ColorImage, GrayImage
from planewright.video.inspect import inspect_clip


class Given:
    """Frames from a list."""

    def __init__(self, images: Sequence[np.ndarray], first: int = 0) -> None:
        self.images = images
        self.first = first

    @property
    def image_size(self) -> tuple[int, int]:
        return self.images[0].shape[1], self.images[0].shape[0]

    @property
    def numbers(self) -> Sequence[int]:
        return range(self.first, self.first + len(self.images))

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, GrayImage]]:
        yield from ((number, self.images[number - self.first]) for number in numbers)

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, ColorImage]]:
        yield from ((number, np.repeat(image[..., None], 3, axis=2)) for number, image in self.gray(numbers))


def scene(seed: int, count: int, step: float = 2.0, size: tuple[int, int] = (160, 120)) -> list[np.ndarray]:
    """A camera that passes over a large picture, with noise."""
    rng = np.random.default_rng(seed)
    width, height = size
    coarse = rng.uniform(30, 220, (12, 24)).astype(np.float32)
    large = cv2.resize(coarse, (width * 4, height * 2), interpolation=cv2.INTER_CUBIC)
    frames = []
    for number in range(count):
        x = int(20 + step * number)
        view = large[20 : 20 + height, x : x + width]
        frames.append(np.clip(view + rng.normal(0, 3, view.shape), 0, 255).astype(np.uint8))
    return frames


def test_a_steady_clip_gives_nothing_to_say() -> None:
    for step in (0.0, 0.5, 3.0, 12.0):
        findings = inspect_clip(Given(scene(1, 25, step)))
        assert findings.sentences == ()
        assert findings.content is None


def test_cuts_are_found_where_they_are() -> None:
    findings = inspect_clip(Given([*scene(1, 20), *scene(2, 30), *scene(3, 15)], first=100))
    assert findings.cuts == (120, 150)
    assert "--frames 120:150" in findings.sentences[0]


def test_a_flash_or_a_blurred_frame_is_no_cut() -> None:
    frames = scene(4, 30)
    frames[10] = np.clip(frames[10].astype(float) * 1.4 + 20, 0, 255).astype(np.uint8)
    frames[20] = cv2.GaussianBlur(frames[20], (0, 0), 5)
    assert inspect_clip(Given(frames)).cuts == ()


def test_repeated_and_frozen_frames_are_told_apart() -> None:
    frames = scene(5, 40)
    doubled = [frame for number, frame in enumerate(frames) for frame in ([frame] * 2 if number % 5 == 4 else [frame])]
    findings = inspect_clip(Given(doubled))
    assert findings.repeats == tuple(number for number in range(1, len(doubled)) if doubled[number] is doubled[number - 1])
    assert findings.frozen == ()
    frozen = [*frames[:10], *[frames[10]] * 12, *frames[11:]]
    findings = inspect_clip(Given(frozen))
    assert findings.frozen == ((10, 21),)
    assert findings.repeats == ()
    assert "10-21" in findings.sentences[0]


def test_black_bars_are_measured_and_dark_walls_are_none() -> None:
    frames = scene(6, 12)
    barred = []
    for frame in frames:
        image = np.full_like(frame, 16)
        image[15:105] = frame[15:105]
        barred.append(image)
    assert inspect_clip(Given(barred)).content == (0, 15, 160, 105)
    rng = np.random.default_rng(0)
    walls = []
    for frame in frames:
        image = rng.integers(0, 22, frame.shape).astype(np.uint8)
        image[15:105] = frame[15:105]
        walls.append(image)
    assert inspect_clip(Given(walls)).content is None


def test_darkness_is_told() -> None:
    findings = inspect_clip(Given([(frame // 16) for frame in scene(7, 10)]))
    assert any("very dark" in sentence for sentence in findings.sentences)


def test_one_frame_and_no_frame() -> None:
    assert inspect_clip(Given(scene(8, 1))).sentences == ()
