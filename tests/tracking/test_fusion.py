"""Corners by what a model, marks and lines say of them, drawn with known truth: a camera that walks around a corner with three edges."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.tracking.fusion import FrameLines, FusionOptions, MarkOffsets, clip_scale, frame_scale, fuse_frames, refit_corners

PIXELS = 100.0
"""In a world unit, in all frames."""
OPTIONS = FusionOptions()
NO_MARKS = MarkOffsets(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)))


@dataclass(frozen=True, eq=False)
class Around:
    """Frames of cameras far away that walk around corners; each corner has three edges to neighbours that nothing is asked of."""

    jacobian: np.ndarray
    normal: np.ndarray
    """Of the edges, frames x corners x 3 x 2."""

    @property
    def num_corners(self) -> int:
        return self.normal.shape[1]

    def lines(self, offset: np.ndarray, edges: int = 3) -> FrameLines:
        """offset (frames, corners, 3): of each edge's line from the model. The second end of an edge is told as unseen."""
        frames, corners = self.normal.shape[:2]
        pairs = np.array([[c, corners] for c in range(corners) for _ in range(edges)])
        normal = self.normal[:, :, :edges].reshape(frames, -1, 2)
        ends = np.stack([offset[:, :, :edges].reshape(frames, -1), np.zeros((frames, len(pairs)))], axis=2)
        at_corner = np.tile([True, False], (frames, len(pairs), 1))
        information = np.tile(np.eye(2), (frames, len(pairs), 1, 1))
        return FrameLines(pairs, normal, np.zeros((frames, len(pairs), 2, 2)), at_corner, ends, information)

    def of(self, displacement: np.ndarray) -> np.ndarray:
        """Offsets (frames, corners, 3) of the lines of corners displaced by so much (corners, 3)."""
        return np.einsum("kcei,kij,cj->kce", self.normal, self.jacobian[:, 0], displacement)

    def all_jacobians(self) -> np.ndarray:
        return np.concatenate([np.repeat(self.jacobian, self.num_corners, axis=1), np.zeros((len(self.jacobian), 1, 2, 3))], axis=1)

    def refit(self, offset: np.ndarray, sigma: float, marks: MarkOffsets = NO_MARKS, edges: int = 3) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and covariances, pixels. sigma: the model's, pixels."""
        covariance = np.concatenate([np.tile(np.eye(3) * (sigma / PIXELS) ** 2, (self.num_corners, 1, 1)), np.full((1, 3, 3), np.inf)])
        shift, joint = refit_corners(self.lines(offset, edges), marks, self.all_jacobians(), covariance, OPTIONS)
        return PIXELS * shift[:-1], PIXELS**2 * joint[:-1]


def around(corners: int, rng: np.random.Generator, frames: int = 40) -> Around:
    turn = np.linspace(-0.6, 0.6, frames)
    right = np.stack([np.cos(turn), np.sin(turn), np.zeros(frames)], axis=1)
    jacobian = PIXELS * np.stack([right, np.tile([0.0, 0.0, -1.0], (frames, 1))], axis=1)
    along = rng.normal(size=(corners, 3, 3))
    seen = np.einsum("kij,cej->kcei", jacobian, along)
    normal = np.stack([-seen[..., 1], seen[..., 0]], axis=-1)
    return Around(jacobian[:, None], normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def drawn(corners: int, sigma: float, rng: np.random.Generator, other: float = 0.0) -> tuple[Around, np.ndarray, np.ndarray]:
    """Corners off by `sigma` pixels an axis, with lines that are off by .2 pixels in common; a share of them are other lines. Truth in pixels."""
    scene = around(corners, rng)
    truth = sigma * rng.normal(size=(corners, 3))
    offset = scene.of(truth / PIXELS) + 0.2 * rng.normal(size=(1, corners, 3)) + 0.15 * rng.normal(size=(40, corners, 3))
    elsewhere = rng.random((1, corners, 3)) < other
    return scene, truth, np.where(elsewhere, scene.of(truth / PIXELS) + rng.uniform(1.0, 3.0, (1, corners, 3)) * rng.choice([-1, 1], (1, corners, 3)), offset)


def image_error(scene: Around, off: np.ndarray) -> np.ndarray:
    """Of displacements (corners, 3) in pixels, in the middle frame."""
    return off @ scene.jacobian[20, 0].T / PIXELS


@pytest.mark.parametrize("sigma", [0.3, 0.8])
def test_lines_put_corners_right_that_are_off_by_what_the_model_says(sigma: float) -> None:
    scene, truth, offset = drawn(200, sigma, np.random.default_rng(1))
    found, _ = scene.refit(offset, sigma)
    before, after = image_error(scene, truth), image_error(scene, found - truth)
    assert np.sqrt((after**2).mean()) < 0.75 * np.sqrt((before**2).mean())


@pytest.mark.parametrize("other", [0.0, 0.15])
def test_covariances_hold_what_corners_are_off_by_and_not_three_times_that(other: float) -> None:
    scene, truth, offset = drawn(300, 0.4, np.random.default_rng(2), other)
    found, covariance = scene.refit(offset, 0.4)
    off = image_error(scene, found - truth)
    across = scene.jacobian[20, 0] / PIXELS
    square = np.einsum("ci,cij,cj->c", off, np.linalg.inv(across @ covariance @ across.T), off)
    assert (square < 5.99).mean() > 0.93
    assert 1.0 / 9.0 < np.median(square) / 1.386 < 1.3


@pytest.mark.parametrize("sigma", [0.2, 0.4])
def test_a_line_far_from_a_sure_model_is_another_line(sigma: float) -> None:
    scene, truth, offset = drawn(100, sigma, np.random.default_rng(3))
    moved = offset.copy()
    moved[:, ::2, 0] += 2.2
    found, _ = scene.refit(moved, sigma)
    as_before, _ = scene.refit(offset, sigma)
    assert np.median(np.linalg.norm(image_error(scene, found - as_before)[::2], axis=1)) < 0.5 * sigma
    assert np.sqrt((image_error(scene, found - truth) ** 2).mean()) < 1.3 * sigma


def test_two_edges_that_a_corner_can_always_meet_do_not_make_it_sure() -> None:
    """Two lines have one meeting point wherever they are: that they fit together is no evidence, least of all that the model's doubt was none."""
    scene, _, offset = drawn(200, 0.8, np.random.default_rng(4))
    alone, doubtful = scene.refit(offset, 0.8, edges=2)[1], scene.refit(np.zeros_like(offset), 0.8, edges=2)[1]
    size = [np.sqrt(np.median(np.trace(c, axis1=1, axis2=2) / 3.0)) for c in (alone, doubtful)]
    # A clip whose lines all are where the model has them may be sure of half of that, and not of a tenth.
    assert size[0] > 0.4
    assert size[1] > 0.2


def test_a_corner_whose_lines_contradict_the_model_says_so() -> None:
    scene, _, offset = drawn(60, 0.3, np.random.default_rng(5))
    torn = offset.copy()
    torn[:, 7] += np.array([1.1, -1.1, 1.1])
    calm, doubtful = scene.refit(offset, 0.3)[1], scene.refit(torn, 0.3)[1]
    assert np.trace(doubtful[7]) > 1.5 * np.trace(calm[7])
    others = np.arange(60) != 7
    assert_allclose(np.trace(doubtful[others], axis1=1, axis2=2), np.trace(calm[others], axis1=1, axis2=2), rtol=0.2)


def test_frames_in_which_another_line_is_steeper_have_little_say() -> None:
    scene, _, offset = drawn(100, 0.8, np.random.default_rng(6))
    switched = offset.copy()
    switched[31:, :, 1] += 2.8
    whole, _ = scene.refit(offset, 0.8)
    part, _ = scene.refit(switched, 0.8)
    assert np.median(np.linalg.norm(image_error(scene, part - whole), axis=1)) < 0.15


def test_near_frames_see_the_same_displacement_larger_and_are_heard() -> None:
    """A walk up to a corner: half the frames see it five times larger. One place in space explains them all."""
    scene, truth, _ = drawn(50, 1.0, np.random.default_rng(7))
    nearness = np.where(np.arange(40) < 20, 1.0, 5.0)
    walked = Around(scene.jacobian * nearness[:, None, None, None], scene.normal)
    offset = np.einsum("kcei,kij,cj->kce", walked.normal, walked.jacobian[:, 0], truth / PIXELS)
    found, _ = walked.refit(offset, 1.0)
    assert np.median(np.linalg.norm(image_error(scene, found - truth), axis=1)) < 0.2


def test_marks_are_heard_where_the_model_is_wrong_and_only_there() -> None:
    scene, _, _ = drawn(2, 0.2, np.random.default_rng(8))
    far = MarkOffsets(np.zeros(3, np.int64), np.array([0, 20, 39]), np.tile([6.0, 0.0], (3, 1)))
    near = MarkOffsets(np.zeros(3, np.int64), np.array([0, 20, 39]), np.tile([1.0, 0.0], (3, 1)))
    covariance = np.tile(np.eye(3) * (0.8 / PIXELS) ** 2, (3, 1, 1))
    moved, joint = refit_corners(None, far, scene.all_jacobians(), covariance, OPTIONS)
    stays, sure = refit_corners(None, near, scene.all_jacobians(), covariance, OPTIONS)
    assert PIXELS * np.linalg.norm(moved[0]) > 3.0
    assert PIXELS * np.linalg.norm(stays[0]) < 0.3
    assert np.trace(joint[0]) > np.trace(sure[0])
    assert_allclose(moved[1:], 0.0)
    assert_allclose(joint[1:], covariance[1:])


def test_a_clips_scale_is_that_of_its_misfits_not_of_those_that_are_other_lines() -> None:
    rng = np.random.default_rng(9)
    usual = OPTIONS.usual_misfit * rng.normal(size=400)
    usual[::10] = 9.0
    scales = [clip_scale([(factor * u, 1.0) for u in usual.tolist()], OPTIONS) for factor in (0.5, 1.0, 2.0)]
    assert scales[0] < 0.75
    assert 0.9 < scales[1] < 1.2
    assert 1.6 < scales[2] < 2.4
    assert clip_scale([], OPTIONS) == 1.0
    few = clip_scale([(5.0, 1.0), (0.1, 1.0), (5.0, 1.0)], OPTIONS)
    assert 1.0 < few < 4.0


@pytest.mark.parametrize("noise", [0.05, 0.2, 0.8])
def test_frames_are_as_unsure_as_their_lines_scatter(noise: float) -> None:
    rng = np.random.default_rng(10)
    scene = around(20, rng)
    left = noise * rng.normal(size=(40, 60, 1)) * np.array([1.0, 0.0])
    lines = scene.lines(np.zeros((40, 20, 3)))
    scale = frame_scale(lines, left, OPTIONS)
    assert_allclose(scale, noise / np.hypot(OPTIONS.line_sigma, OPTIONS.corner_sigma), rtol=0.1)
    base = np.concatenate([rng.uniform(0.0, 300.0, (40, 20, 2)), np.zeros((40, 1, 2))], axis=1)
    moved, spread = fuse_frames(lines, base, left, (320, 240), OPTIONS, scale)
    off = (moved - base)[:, :20]
    square = np.einsum("kci,kcij,kcj->kc", off, np.linalg.inv(spread[:, :20]), off)
    assert (square < 5.99).mean() > 0.95
    assert np.sqrt((off**2).mean()) < 0.5 * noise


def test_nothing_is_said_of_few_lines_and_pictures_without_noise_still_have_pixels() -> None:
    rng = np.random.default_rng(11)
    scene = around(1, rng)
    assert frame_scale(around(1, rng, 10).lines(np.zeros((10, 1, 3))), np.zeros((10, 3, 2)), OPTIONS) == 1.0
    assert frame_scale(scene.lines(np.zeros((40, 1, 3))), np.zeros((40, 3, 2)), OPTIONS) > 0.0


def test_the_unit_of_the_world_does_not_matter() -> None:
    scene, _, offset = drawn(20, 0.5, np.random.default_rng(12), other=0.2)
    covariance = np.concatenate([np.tile(np.eye(3) * (0.5 / PIXELS) ** 2, (20, 1, 1)), np.full((1, 3, 3), np.inf)])
    lines = scene.lines(offset)
    shift, joint = refit_corners(lines, NO_MARKS, scene.all_jacobians(), covariance, OPTIONS)
    large, wide = refit_corners(lines, NO_MARKS, scene.all_jacobians() / 1000.0, covariance * 1e6, OPTIONS)
    assert_allclose(large[:-1], 1000.0 * shift[:-1], rtol=1e-6, atol=1e-9)
    assert_allclose(wide[:-1], 1e6 * joint[:-1], rtol=1e-6)
