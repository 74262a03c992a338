"""A patch that moves over a textured background on a known curve; traces that drift, jump, or both."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from planewright.mending.gap import Gap, WindowOptions, blend, layer
from planewright.mending.mend import MendOptions, mend

COUNT = 60


@dataclass(frozen=True, eq=False)
class Moving:
    """Frames in which one textured square moves before another texture; the second half of the way it is as bright as what is behind it."""

    truth: np.ndarray
    seed: int = 0

    @property
    def image_size(self) -> tuple[int, int]:
        return (320, 240)

    @property
    def numbers(self) -> Sequence[int]:
        return range(len(self.truth))

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        rng = np.random.default_rng(self.seed)
        behind = cv2.GaussianBlur(rng.uniform(0, 255, (240, 320)).astype(np.float32), (0, 0), 3.0)
        behind = 90 + 6 * (behind - behind.mean())
        square = cv2.GaussianBlur(rng.uniform(0, 255, (64, 64)).astype(np.float32), (0, 0), 1.5)
        square = 140 + 4 * (square - square.mean())
        for number in numbers:
            x, y = self.truth[number]
            to_frame = np.array([[1.0, 0.0, x - 32.0], [0.0, 1.0, y - 32.0]])
            moved = cv2.warpAffine(square, to_frame, self.image_size, flags=cv2.INTER_LINEAR)
            mask = cv2.warpAffine(np.ones((64, 64), np.float32), to_frame, self.image_size, flags=cv2.INTER_LINEAR)
            noise = np.random.default_rng([self.seed, number]).normal(0, 2.0, (240, 320))
            yield number, np.clip(behind * (1 - mask) + moved * mask + noise, 0, 255).astype(np.uint8)

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for number, image in self.gray(numbers):
            yield number, np.repeat(image[..., None], 3, axis=2)


def curve(count: int = COUNT) -> np.ndarray:
    t = np.linspace(0.0, 1.0, count)
    return np.column_stack([90 + 130 * t + 12 * np.sin(5 * t), 120 + 45 * np.sin(3.2 * t)])


def gap_of(truth: np.ndarray, wrong: np.ndarray) -> Gap:
    """What a tracker hands over that was off by `wrong` in each frame, once both ends are put right."""
    track = truth + wrong
    return Gap(np.arange(len(truth)), track + (truth[0] - track[0]), track + (truth[-1] - track[-1]))


def errors(path: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.linalg.norm(path - truth, axis=1)


def test_an_even_drift_is_taken_out() -> None:
    truth = curve()
    wrong = np.linspace(0.0, 1.0, COUNT)[:, None] * np.array([6.0, 4.0])
    mended = mend(Moving(truth), gap_of(truth, wrong))
    assert errors(mended.xy, truth).max() < 0.6


def test_a_drift_that_comes_late_is_seen_in_the_images() -> None:
    truth = curve()
    wrong = np.maximum(np.linspace(-1.5, 1.0, COUNT), 0.0)[:, None] * np.array([5.0, -4.0])
    gap = gap_of(truth, wrong)
    mended = mend(Moving(truth), gap)
    assert errors(blend(gap), truth).max() > 1.5
    assert errors(mended.xy, truth).max() < 1.0
    assert np.median(errors(mended.xy, truth)) < 0.35


def test_a_jump_is_found_in_the_frame_where_it_happens() -> None:
    truth = curve()
    wrong = np.zeros((COUNT, 2))
    wrong[23:] = [18.0, 9.0]
    gap = gap_of(truth, wrong)
    mended = mend(Moving(truth), gap)
    assert errors(blend(gap), truth).max() > 8.0
    assert errors(mended.xy, truth).max() < 1.0
    switch = int(np.flatnonzero(mended.side == 1)[0])
    assert abs(switch - 23) <= 1


def test_the_anchors_stay() -> None:
    truth = curve()
    wrong = np.linspace(0.0, 1.0, COUNT)[:, None] * np.array([3.0, 4.0])
    gap = gap_of(truth, wrong)
    mended = mend(Moving(truth), gap)
    np.testing.assert_array_equal(mended.xy[[0, -1]], truth[[0, -1]])


def test_the_claimed_sigma_covers_the_errors() -> None:
    truth = curve()
    inside = []
    for seed in range(4):
        wander = np.cumsum(np.random.default_rng(seed).normal(0.0, 0.25, (COUNT, 2)), axis=0)
        mended = mend(Moving(truth, seed), gap_of(truth, wander))
        off = mended.xy - truth
        square = np.einsum("ki,kij,kj->k", off, np.linalg.inv(mended.covariance), off)[1:-1]
        inside.append(square < 5.99)
    assert 0.85 < np.mean(inside) <= 1.0


@pytest.mark.parametrize("literal", [False, True])
def test_the_printed_weight_makes_a_drifting_track_worse_and_that_of_the_text_better(literal: bool) -> None:
    truth = curve(30)
    gap = gap_of(truth, np.linspace(0.0, 1.0, 30)[:, None] * np.array([1.5, 1.0]))
    mended = mend(Moving(truth), gap, MendOptions(literal_weight=literal, settle=None, windows=WindowOptions(literal=literal)))
    assert (errors(mended.xy, truth).mean() > errors(gap.forward, truth).mean()) == literal


def test_windows_are_small_at_both_anchors_and_bounded_between() -> None:
    truth = curve()
    gap = gap_of(truth, np.zeros((COUNT, 2)))
    sizes = [len(layer(gap, k, WindowOptions()).nodes) for k in range(COUNT)]
    assert sizes[0] == sizes[-1] == 1
    assert sizes[1] == sizes[-2] == 25
    assert max(sizes) == 225
    assert sizes == sizes[::-1]
    assert len(layer(gap, 10, WindowOptions(literal=True)).nodes) == 23**2


def test_traces_far_apart_have_a_window_each() -> None:
    truth = curve()
    wrong = np.zeros((COUNT, 2))
    wrong[23:] = [18.0, 9.0]
    middle = layer(gap_of(truth, wrong), COUNT // 2, WindowOptions())
    assert len(middle.nodes) == 450
    assert set(middle.side.tolist()) == {0, 1}


def test_two_frames_are_just_their_anchors() -> None:
    truth = curve(2)
    mended = mend(Moving(truth), gap_of(truth, np.zeros((2, 2))))
    np.testing.assert_array_equal(mended.xy, truth)
