"""Corners in every frame: near the truth, within what is claimed, in pixels as displayed."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planewright.geometry.camera import Intrinsics
from planewright.geometry.rigid import rotations_from_vectors
from planewright.synthetic.houses import demo_scene
from planewright.synthetic.observe import true_tracks
from planewright.tracking.appearance import AppearanceOptions
from planewright.tracking.follow import CornerOptions, follow_corners
from planewright.tracking.tracks import State, Tracks
from planewright.tracking.visibility import corner_visibility


@pytest.fixture(scope="module")
def tracks(shed) -> Tracks:
    return follow_corners(shed.frames, shed.scene, shed.cameras)


def errors(shed, tracks: Tracks) -> np.ndarray:
    return tracks.xy - shed.pixels(shed.scene.points)[tracks.frame, tracks.point_index]


def test_rows_are_sorted_by_point_then_frame_and_no_place_is_claimed_twice(tracks: Tracks) -> None:
    key = tracks.point_index * 1000 + tracks.frame
    assert (np.diff(key) > 0).all()


def test_corners_are_where_the_truth_is_and_the_covariance_says_how_well(shed, tracks: Tracks) -> None:
    tracked = tracks.state == State.TRACKED
    off = errors(shed, tracks)[tracked]
    # The model here is exact; the lines of the clip draw it off by a little.
    assert np.median(np.linalg.norm(off, axis=1)) < 0.2
    assert np.percentile(np.linalg.norm(off, axis=1), 99) < 0.8
    distance = np.einsum("ni,nij,nj->n", off, np.linalg.inv(tracks.covariance[tracked]), off)
    assert (distance < 9.2).mean() > 0.97  # chi squared of two, 99 %


def test_covariances_are_symmetric_and_positive_definite(tracks: Tracks) -> None:
    assert_allclose(tracks.covariance, tracks.covariance.transpose(0, 2, 1), atol=1e-12)
    assert np.linalg.eigvalsh(tracks.covariance).min() > 0.1**2


def test_a_corner_whose_edges_contradict_the_model_has_a_larger_covariance(shed, tracks: Tracks) -> None:
    points = shed.scene.points.copy()
    points[2] += 8e-3 * shed.clip.scene.diagonal
    doubtful = follow_corners(shed.frames, replace(shed.scene, points=points), shed.cameras)
    size = [np.trace(doubtful.covariance[doubtful.point_index == i], axis1=1, axis2=2).mean() for i in range(len(points))]
    before = [np.trace(tracks.covariance[tracks.point_index == i], axis1=1, axis2=2).mean() for i in range(len(points))]
    assert size[2] > 1.5 * before[2]
    assert np.median(size) < 1.1 * np.median(before)


def test_a_corner_that_is_off_by_what_the_model_says_is_put_right_by_the_lines_of_the_clip(shed) -> None:
    rng = np.random.default_rng(0)
    points = shed.scene.points + rng.normal(size=shed.scene.points.shape) * 5e-3 * shed.clip.scene.diagonal
    covariance = np.tile(np.eye(3) * (5e-3 * shed.clip.scene.diagonal) ** 2, (len(points), 1, 1))
    found = follow_corners(shed.frames, replace(shed.scene, points=points, point_covariance=covariance), shed.cameras)
    seen = found.state == State.TRACKED
    model = np.linalg.norm(shed.pixels(points) - shed.pixels(shed.scene.points), axis=2)[found.frame, found.point_index]
    off = np.linalg.norm(errors(shed, found), axis=1)
    assert np.sqrt((model[seen] ** 2).mean()) > 1.4
    assert np.sqrt((off[seen] ** 2).mean()) < 0.6 * np.sqrt((model[seen] ** 2).mean())


def test_states_say_how_a_place_is_known(shed, tracks: Tracks) -> None:
    _, visible, in_image = true_tracks(shed.clip)
    rows = [list(shed.clip.scene.points).index(point.id) for point in shed.sketch.points]
    visible, in_image = visible[rows], in_image[rows]
    claimed = np.full(visible.shape, -1)
    claimed[tracks.point_index, tracks.frame] = tracks.state
    for i, point in enumerate(shed.sketch.points):
        for frame in point.marks:
            assert claimed[i, frame] == State.MARKED
    open_to_doubt = claimed != State.MARKED
    xy = shed.pixels(shed.scene.points).transpose(1, 0, 2)
    outside = ((xy < -1) | (xy > np.array(shed.frames.image_size) + 1)).any(axis=2) & (claimed >= 0) & open_to_doubt
    assert outside.sum() > 5
    assert (claimed[outside] == State.PREDICTED).all()
    # What nobody sketched hides a corner now and then; the model cannot know.
    assert (claimed == State.TRACKED)[visible & open_to_doubt].mean() > 0.98
    assert (claimed == State.HIDDEN)[in_image & ~visible & open_to_doubt].mean() > 0.6


def test_what_the_person_says_is_hidden_is_hidden(shed) -> None:
    points = list(shed.sketch.points)
    points[0] = replace(points[0], hidden=((3, 5), (30, 31)))
    found = follow_corners(shed.frames, replace(shed.scene, sketch=replace(shed.sketch, points=tuple(points))), shed.cameras)
    spans = (found.point_index == 0) & np.isin(found.frame, [3, 4, 5, 30, 31])
    assert spans.sum() == 5
    marked = np.isin(found.frame[spans], list(points[0].marks))
    assert (found.state[spans][~marked] == State.HIDDEN).all()


def test_a_corner_without_a_place_in_space_is_only_where_it_was_marked(shed) -> None:
    known = np.ones(len(shed.scene.points), bool)
    known[4] = False
    points = shed.scene.points.copy()
    points[4] = np.nan
    found = follow_corners(shed.frames, replace(shed.scene, points=points, point_known=known), shed.cameras)
    mine = found.point_index == 4
    assert_array_equal(found.frame[mine], sorted(shed.sketch.points[4].marks))
    assert_allclose(found.xy[mine], [xy for _, xy in sorted(shed.sketch.points[4].marks.items())])
    assert (found.state[mine] == State.MARKED).all()
    assert np.isfinite(found.covariance).all()


def test_places_are_as_displayed_with_the_lens_distortion(shed, tracks: Tracks) -> None:
    """The frames are those of the pinhole; the tracks are to lie on the frames of the lens that bends them."""
    pinhole = shed.clip.intrinsics
    lens = Intrinsics(pinhole.focal, pinhole.principal_point, pinhole.image_size, (-0.12, 0.03))
    bent = follow_corners(shed.frames, shed.scene, replace(shed.cameras, intrinsics=lens))
    where = {(int(i), int(k)): row for row, (i, k) in enumerate(zip(bent.point_index, bent.frame, strict=True))}
    rows = np.array([where[int(i), int(k)] for i, k in zip(tracks.point_index, tracks.frame, strict=True) if (int(i), int(k)) in where])
    straight = np.array([row for row, (i, k) in enumerate(zip(tracks.point_index, tracks.frame, strict=True)) if (int(i), int(k)) in where])
    assert_allclose(bent.xy[rows], lens.to_pixels(pinhole.normalize(tracks.xy[straight])), atol=1e-9)
    assert np.linalg.norm(bent.xy[rows] - tracks.xy[straight], axis=1).max() > 2


def test_a_frame_whose_camera_is_off_is_put_right_by_its_own_edges(shed, tracks: Tracks) -> None:
    rotation = shed.cameras.rotation.copy()
    turn = np.array([[0.0, 1.2 / shed.clip.intrinsics.focal, 0.0]])  # moves the picture by 1.2 pixels
    rotation[20] = rotations_from_vectors(turn)[0] @ rotation[20]
    translation = shed.cameras.translation.copy()
    translation[20] = rotations_from_vectors(turn)[0] @ translation[20]
    off = replace(shed.cameras, rotation=rotation, translation=translation)
    found = follow_corners(shed.frames, shed.scene, off)
    here = (found.frame == 20) & np.isin(found.state, [State.TRACKED, State.MARKED])
    assert np.median(np.linalg.norm(errors(shed, found)[here], axis=1)) < 0.5
    other = found.frame == 10
    assert_allclose(found.xy[other], tracks.xy[tracks.frame == 10], atol=0.05)


def test_frames_without_a_pose_have_no_rows(shed) -> None:
    posed = shed.cameras.posed.copy()
    posed[[0, 7]] = False
    found = follow_corners(shed.frames, shed.scene, replace(shed.cameras, posed=posed))
    assert not np.isin(found.frame, [0, 7]).any()
    assert len(np.unique(found.frame)) == 38


def test_nothing_known_gives_the_marks_alone(shed) -> None:
    nothing = replace(
        shed.scene, points=np.full_like(shed.scene.points, np.nan), point_known=np.zeros(len(shed.scene.points), bool),
        normals=np.full_like(shed.scene.normals, np.nan), face_known=np.zeros(len(shed.scene.normals), bool),
    )  # fmt: skip
    found = follow_corners(shed.frames, nothing, shed.cameras)
    assert len(found.frame) == sum(len(point.marks) for point in shed.sketch.points)


def test_the_same_is_found_twice(shed, tracks: Tracks) -> None:
    again = follow_corners(shed.frames, shed.scene, shed.cameras)
    assert again.xy.tobytes() == tracks.xy.tobytes()
    assert again.covariance.tobytes() == tracks.covariance.tobytes()


@dataclass(frozen=True, eq=False)
class Disturbed:
    """Frames with something done to some of them."""

    frames: Any
    change: Callable[[int, np.ndarray], np.ndarray]

    @property
    def image_size(self) -> tuple[int, int]:
        return self.frames.image_size

    @property
    def numbers(self) -> Sequence[int]:
        return self.frames.numbers

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for number, image in self.frames.color(numbers):
            yield number, self.change(number, image.copy())

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for number, image in self.color(numbers):
            yield number, np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


@pytest.fixture(scope="module")
def covered(shed) -> tuple[Disturbed, np.ndarray]:
    """A striped hand that moves through the picture in frames 23 to 38, and which corners are behind it in which frames.

    The corners are marked in frames 22 and 39: nobody marks a corner that a hand covers.
    """
    path = {k: np.array([60.0 + 14.0 * (k - 23), 90.0 + 2.0 * (k - 23)]) for k in range(23, 39)}
    y, x = np.mgrid[0:180, 0:320] + 0.5

    def pass_by(number: int, image: np.ndarray) -> np.ndarray:
        if number in path:
            inside = np.hypot(x - path[number][0], y - path[number][1]) < 34
            image[inside] = np.where(((x + y).astype(int) // 5 % 2 == 0)[..., None], [205, 150, 120], [150, 96, 76])[inside].astype(np.uint8)
        return image

    at = shed.pixels(shed.scene.points)
    behind = np.array([[k in path and bool(np.hypot(*(at[k, i] - path[k])) < 34) for i in range(at.shape[1])] for k in range(len(at))])
    return Disturbed(shed.frames, pass_by), behind


def hidden_f1(found: Tracks, other: Tracks, behind: np.ndarray) -> float:
    """Of the frames in which a corner is behind the hand, among those in which it can be seen without it."""
    asked = np.isin(other.state, [State.TRACKED])
    said, true = (found.state == State.HIDDEN)[asked], behind[found.frame, found.point_index][asked]
    return 2 * (said & true).sum() / (said.sum() + true.sum())


def test_what_nobody_sketched_hides_corners_and_does_not_bend_their_tracks(shed, tracks: Tracks, covered) -> None:
    frames, behind = covered
    found = follow_corners(frames, shed.scene, shed.cameras)
    blind = follow_corners(frames, shed.scene, shed.cameras, CornerOptions(appearance=AppearanceOptions(most=0.0)))
    assert behind.sum() > 30
    assert hidden_f1(found, tracks, behind) > 0.85
    assert hidden_f1(blind, tracks, behind) == 0.0
    hidden = behind[found.frame, found.point_index]
    assert np.percentile(np.linalg.norm(errors(shed, found)[hidden], axis=1), 95) < 0.8
    seen = (tracks.state == State.TRACKED) & ~hidden
    assert (found.state[seen] == State.TRACKED).mean() > 0.98


def test_one_frame_with_wrong_lines_does_not_bend_the_path(shed, tracks: Tracks) -> None:
    wrong = next(image for _, image in shed.frames.color([31]))
    found = follow_corners(Disturbed(shed.frames, lambda number, image: wrong if number == 20 else image), shed.scene, shed.cameras)
    here = found.frame == 20
    assert np.linalg.norm(errors(shed, found)[here], axis=1).max() < 2.0
    assert np.median(np.linalg.norm(errors(shed, found)[here], axis=1)) < 0.6
    assert_allclose(found.xy[~here], tracks.xy[~here], atol=0.3)


def test_a_change_of_exposure_hides_nothing(shed, tracks: Tracks) -> None:
    def expose(number: int, image: np.ndarray) -> np.ndarray:
        gain = 0.55 if 10 <= number < 20 else 1.0
        return np.clip(gain * image.astype(float), 0, 255).astype(np.uint8)

    found = follow_corners(Disturbed(shed.frames, expose), shed.scene, shed.cameras)
    seen = tracks.state == State.TRACKED
    assert (found.state[seen] == State.TRACKED).mean() > 0.98
    assert np.median(np.linalg.norm(errors(shed, found)[seen], axis=1)) < 0.2


def test_corners_that_leave_the_picture_come_back_where_they_are(film) -> None:
    clip = demo_scene(40, (320, 180))
    turned = film(replace(clip, path=replace(clip.path, pan_deg=(-22.0, 22.0))))
    found = follow_corners(turned.frames, turned.scene, turned.cameras)
    _, visible, in_image = true_tracks(turned.clip)
    rows = [list(turned.clip.scene.points).index(point.id) for point in turned.sketch.points]
    visible, in_image = visible[rows][found.point_index, found.frame], in_image[rows][found.point_index, found.frame]
    open_to_doubt = found.state != State.MARKED
    assert (~in_image).sum() > 80
    assert (found.state[~in_image & open_to_doubt] == State.PREDICTED).mean() > 0.97
    assert (found.state[visible & open_to_doubt] == State.TRACKED).mean() > 0.95
    off = np.linalg.norm(found.xy - turned.pixels(turned.scene.points)[found.frame, found.point_index], axis=1)
    assert np.percentile(off[visible], 95) < 1.0


def test_what_the_lens_draws_into_the_picture_is_not_hidden(film) -> None:
    """A barrel lens shows what is beyond the border of the straight picture; nothing can be measured there, but nothing is before it either."""
    clip = demo_scene(40, (320, 180))
    turned = film(replace(clip, path=replace(clip.path, pan_deg=(-22.0, 22.0))))
    pinhole = turned.clip.intrinsics
    lens = Intrinsics(pinhole.focal, pinhole.principal_point, pinhole.image_size, (-0.12, 0.03))
    found = follow_corners(turned.frames, turned.scene, replace(turned.cameras, intrinsics=lens))
    straight = turned.pixels(turned.scene.points)[found.frame, found.point_index]
    size = np.array(pinhole.image_size)
    drawn_in = ((straight < 0) | (straight >= size)).any(axis=1) & ((found.xy >= 0) & (found.xy < size)).all(axis=1)
    everywhere = np.zeros((len(turned.cameras.frame), len(turned.sketch.points)), bool)
    scene = turned.scene
    seen = corner_visibility(scene.sketch, scene.points, scene.normals, scene.offsets, turned.cameras.centers, 1e-3, everywhere)
    assert np.count_nonzero(drawn_in) > 10
    here = drawn_in & seen[found.frame, found.point_index]
    assert (found.state[here] != State.HIDDEN).mean() > 0.95
    assert (found.state[drawn_in & ~seen[found.frame, found.point_index]] == State.HIDDEN).all()
