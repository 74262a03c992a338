"""Laws of following, on clips whose motion is known."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planewright.errors import Cancelled
from planewright.features.detect import DetectOptions
from planewright.features.follow import FollowOptions, follow_features


@dataclass(frozen=True, eq=False)
class WarpedClip:
    """A texture under a homography a frame, with a slow change of exposure and a little noise."""

    texture: np.ndarray
    frame_from_texture: np.ndarray
    image_size: tuple[int, int]

    @property
    def numbers(self) -> Sequence[int]:
        return list(range(len(self.frame_from_texture)))

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for k in numbers:
            image = cv2.warpPerspective(self.texture, self.frame_from_texture[k], self.image_size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
            noise = np.random.default_rng(k).normal(0, 1.5, image.shape)
            yield k, np.clip(image * (1 - 0.004 * k) + 0.3 * k + noise, 0, 255).astype(np.uint8)

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for k, image in self.gray(numbers):
            yield k, np.repeat(image[..., None], 3, axis=2)


def warped_clip(num_frames: int = 25, size: tuple[int, int] = (400, 300), zoom: float = 1.0) -> WarpedClip:
    rng = np.random.default_rng(0)
    width, height = int(700 * zoom), int(600 * zoom)
    texture = sum(cv2.resize(rng.normal(0, 1, (max(height // s, 2), max(width // s, 2))), (width, height), interpolation=cv2.INTER_CUBIC) for s in (3, 9, 27))
    texture = np.clip(128 + 38 * texture, 0, 255).astype(np.uint8)
    motions = []
    for k in range(num_frames):
        a = 0.006 * k
        m = np.array([[np.cos(a), -np.sin(a), -140 * zoom + 1.9 * zoom * k], [np.sin(a), np.cos(a), -130 * zoom + 1.1 * zoom * k], [1e-5 * k / zoom, 0, 1]])
        motions.append(m @ np.diag([1 + 0.004 * k, 1 + 0.006 * k, 1]))
    return WarpedClip(texture, np.array(motions), (int(size[0] * zoom), int(size[1] * zoom)))


def drift(clip: WarpedClip, features) -> np.ndarray:
    """Distance of every observation from where the clip's motion carries the track's first, in pixels."""
    order = np.lexsort((features.frame, features.track_index))
    track, frame, xy = features.track_index[order], features.frame[order], features.xy[order].astype(float)
    first = np.concatenate([[0], np.nonzero(np.diff(track))[0] + 1])
    origin = np.repeat(first, np.diff(np.concatenate([first, [len(track)]])))
    # The warps carry pixel centres at whole numbers.
    moved = np.einsum(
        "nij,nj->ni", clip.frame_from_texture[frame] @ np.linalg.inv(clip.frame_from_texture[frame[origin]]), np.c_[xy[origin] - 0.5, np.ones(len(xy))]
    )
    return np.linalg.norm(moved[:, :2] / moved[:, 2:] + 0.5 - xy, axis=1)


OPTIONS = FollowOptions(detect=DetectOptions(max_corners=200))


def test_nothing_drifts_however_long_it_is_followed():
    clip = warped_clip()
    features = follow_features(clip, OPTIONS)
    off = drift(clip, features)
    assert features.num_tracks > 150
    assert np.median(off) < 0.06
    late = features.frame[np.lexsort((features.frame, features.track_index))] >= 20
    assert np.median(off[late]) < 0.1
    assert np.percentile(off, 95) < 0.3


def test_the_table_is_sorted_compact_and_free_of_short_tracks():
    features = follow_features(warped_clip(12), OPTIONS)
    assert_array_equal(np.lexsort((features.track_index, features.frame)), np.arange(len(features.frame)))
    lengths = np.bincount(features.track_index, minlength=features.num_tracks)
    assert lengths.min() >= OPTIONS.min_length and len(lengths) == features.num_tracks
    assert features.track_index.dtype == np.int32 and features.xy.dtype == np.float32


def test_twice_the_same_clip_gives_the_same_table():
    a, b = (follow_features(warped_clip(8), OPTIONS) for _ in range(2))
    assert_array_equal(a.xy, b.xy)
    assert_array_equal(a.track_index, b.track_index)


def test_large_pictures_are_followed_shrunk_and_reported_in_their_own_pixels():
    clip = warped_clip(8, zoom=2.0)
    features = follow_features(clip, FollowOptions(detect=DetectOptions(max_corners=200), max_pixels=400.0 * 300))
    assert features.xy[:, 0].max() > 500
    assert np.median(drift(clip, features)) < 0.2


def test_regions_confine_births_and_are_followed_both_ways():
    clip = warped_clip()
    square = np.array([[120.0, 80.0], [260.0, 80.0], [260.0, 200.0], [120.0, 200.0]])
    features = follow_features(clip, OPTIONS, regions={12: [square]})
    assert features.frame.min() == 0 and features.frame.max() == 24
    born = features.xy[features.frame == 12]
    assert len(born) > 15
    assert (born > [118, 78]).all() and (born < [262, 202]).all()
    assert set(features.track_index) == set(features.track_index[features.frame == 12])
    assert np.median(drift(clip, features)) < 0.1


def test_it_stops_when_asked():
    def stop(title: str, done: int, total: int | None) -> None:
        if done == 3:
            raise Cancelled("stopped")

    with pytest.raises(Cancelled):
        follow_features(warped_clip(8), OPTIONS, progress=stop)


def test_soft_features_live_on_when_their_shape_may_not_jump() -> None:
    clip = warped_clip()
    soft = 128 + 0.6 * cv2.GaussianBlur(clip.texture.astype(float) - 128, (0, 0), 5.0)
    clip = WarpedClip(soft.astype(np.uint8), clip.frame_from_texture, clip.image_size)
    free, held = (follow_features(clip, FollowOptions(shape_stiffness=stiffness, min_length=1)) for stiffness in (0.0, FollowOptions().shape_stiffness))
    assert np.bincount(held.track_index).mean() > 2 * np.bincount(free.track_index).mean()
    assert np.median(drift(clip, held)) < np.median(drift(clip, free)) + 0.05
