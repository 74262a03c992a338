"""Laws of following faces, on rendered clips whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planewright.errors import Cancelled
from planewright.registration.corners import corner_tracks, visible_frames
from planewright.registration.follow import follow_faces
from planewright.registration.homography import apply_homography
from planewright.registration.registered import Registered
from planewright.sketch.graph import Sketch
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.observe import draw, true_tracks
from planewright.synthetic.refusals import object_on_turntable
from planewright.tracking.tracks import State


@pytest.fixture(scope="module")
def clip() -> SyntheticClip:
    return object_on_turntable()


@pytest.fixture(scope="module")
def sketch(clip: SyntheticClip) -> Sketch:
    return draw(clip, np.random.default_rng(1))


@pytest.fixture(scope="module")
def registered(clip: SyntheticClip, sketch: Sketch) -> Registered:
    return follow_faces(clip.frames, sketch)


def test_faces_of_a_turning_carton_are_where_they_are(clip: SyntheticClip, sketch: Sketch, registered: Registered) -> None:
    """A homography carries the true corners of the first frame to those of every other one."""
    true, visible, _ = true_tracks(clip)
    row = {name: i for i, name in enumerate(clip.scene.points)}
    errors = []
    for s, strand in enumerate(registered.strands):
        points = [row[sketch.points[i].id] for i in strand.corners]
        first = int(np.searchsorted(registered.frame, strand.frame))
        q = apply_homography(np.linalg.inv(strand.h), true[points, first] - 0.5)
        for k in np.nonzero(registered.found[s])[0]:
            if visible[points, k].all():
                errors.append(np.linalg.norm(apply_homography(registered.homography[s, k], q) + 0.5 - true[points, k], axis=1))
    assert registered.found.mean() > 0.8
    assert np.median(errors) < 0.15
    assert np.percentile(errors, 95) < 1.0


def test_corners_come_with_errors_that_hold(clip: SyntheticClip, sketch: Sketch, registered: Registered) -> None:
    true, visible, _ = true_tracks(clip)
    row = {name: i for i, name in enumerate(clip.scene.points)}
    tracks = corner_tracks(registered, sketch)
    points = np.array([row[sketch.points[i].id] for i in tracks.point_index])
    measured = np.isin(tracks.state, [State.TRACKED, State.MARKED])
    seen = visible[points, tracks.frame]
    error = tracks.xy - true[points, tracks.frame]
    size = np.linalg.norm(error, axis=1)[seen & measured]
    assert (seen & measured).sum() > 0.95 * visible[[row[p.id] for p in sketch.points]].sum()
    assert np.median(size) < 0.5
    assert (size < 2).mean() > 0.97
    spread = np.einsum("ni,nij,nj->n", error, np.linalg.inv(tracks.covariance), error)[seen & measured]
    assert (spread < 5.99).mean() > 0.85
    assert np.sqrt(np.trace(tracks.covariance, axis1=1, axis2=2) / 2)[seen & measured].max() < 4
    order = np.lexsort((tracks.frame, tracks.point_index))
    assert_array_equal(order, np.arange(len(order)))


def test_what_the_person_says_is_hidden_is_hidden(sketch: Sketch, registered: Registered) -> None:
    told = replace(sketch, points=(replace(sketch.points[0], hidden=((3, 6),)), *sketch.points[1:]))
    tracks = corner_tracks(registered, told)
    inside = (tracks.point_index == 0) & (tracks.frame >= 3) & (tracks.frame <= 6)
    assert (tracks.state[inside] == State.HIDDEN).all()


def test_following_twice_gives_the_same_bits(clip: SyntheticClip, sketch: Sketch, registered: Registered) -> None:
    again = follow_faces(clip.frames, sketch)
    assert_array_equal(again.homography, registered.homography)
    assert_array_equal(again.found, registered.found)


def test_a_sketch_without_faces_has_nothing_to_follow(clip: SyntheticClip, sketch: Sketch) -> None:
    found = follow_faces(clip.frames, replace(sketch, faces=()))
    assert found.found.shape == (0, len(clip.frames.numbers))
    assert len(corner_tracks(found, replace(sketch, faces=())).frame) == 0


def test_the_person_can_stop_it(clip: SyntheticClip, sketch: Sketch) -> None:
    def stop(title: str, done: int, total: int | None) -> None:
        if done == 5:
            raise Cancelled("Stopped.")

    with pytest.raises(Cancelled):
        follow_faces(clip.frames, sketch, progress=stop)


def test_single_wrong_frames_do_not_change_what_is_visible() -> None:
    evidence = np.array([True] * 20 + [False] * 30 + [True] * 15)
    flipped = evidence.copy()
    flipped[[5, 12, 33, 60]] ^= True
    assert_array_equal(visible_frames(flipped), evidence)
