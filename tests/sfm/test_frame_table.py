"""Laws of the table of frames and of keyframes."""

import numpy as np
from numpy.testing import assert_array_equal

from planewright.sfm.frame_table import frame_table, select_keyframes, static_tracks


def test_shared_tracks_are_those_seen_in_both_frames(tracked):
    scene = tracked(num_frames=20, num_points=60)
    table, f = frame_table(scene.features, scene.numbers), scene.features
    tracks, a, b = table.shared(3, 11)
    assert_array_equal(tracks, sorted(set(f.track_index[f.frame == 3]) & set(f.track_index[f.frame == 11])))
    for k, xy in ((3, a), (11, b)):
        rows = np.nonzero((f.frame == k) & np.isin(f.track_index, tracks))[0]
        assert_array_equal(xy, f.xy[rows])


def test_frames_that_do_not_take_part_are_left_out(tracked):
    scene = tracked(num_frames=20, num_points=60)
    table = frame_table(scene.features, scene.numbers[::2])
    assert_array_equal(table.frame, scene.numbers[::2])
    assert table.start[-1] == (scene.features.frame % 2 == 0).sum()


def test_keyframes_are_bounded_in_number_and_hold_both_ends(tracked):
    table = frame_table(tracked().features, np.arange(60))
    many = select_keyframes(table, motion=14.0, min_shared=0.5, min_keyframes=20, max_keyframes=40)
    few = select_keyframes(table, motion=14.0, min_shared=0.5, min_keyframes=2, max_keyframes=5)
    assert len(few) <= 5 and 20 <= len(many) <= 40
    for keyframes in (many, few):
        assert keyframes[0] == 0 and keyframes[-1] == 59
        assert (np.diff(keyframes) > 0).all()


def test_hardly_a_track_of_a_clip_that_moves_is_called_static(tracked):
    scene = tracked()
    assert len(static_tracks(frame_table(scene.features, scene.numbers))) < 0.01 * scene.features.num_tracks
