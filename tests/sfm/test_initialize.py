"""Laws of the first cameras."""

from dataclasses import replace

import numpy as np

from planewright.sfm.degeneracy import measure_parallax
from planewright.sfm.frame_table import frame_table, select_keyframes
from planewright.sfm.growth import GrowthOptions, keyframe_table
from planewright.sfm.initialize import find_start, mean_cost, neighbours


def started(scene):
    table = frame_table(scene.features, scene.numbers)
    keyframes = select_keyframes(table, motion=14.0, min_shared=0.5, min_keyframes=8, max_keyframes=12)
    parallax = measure_parallax(table, keyframes)
    assert parallax is not None
    keyed = keyframe_table(table, keyframes)
    start = find_start(keyed, parallax.ranked, scene.image_size, GrowthOptions(), prior=None, seed=3)
    assert start is not None
    return keyed, parallax, start


def test_the_cheapest_focal_of_the_profile_is_next_to_the_true_one(tracked):
    scene = tracked()
    _, _, start = started(scene)
    best = start.focals[np.argmin(start.costs)]
    assert 1 / 1.3 < best / scene.focal < 1.3
    assert abs(start.growth.values[0] / scene.focal - 1) < 0.05


def test_fewer_poses_never_look_cheaper(tracked):
    keyed, parallax, start = started(tracked())
    judged = neighbours(keyed, *parallax.pair, 4)
    assert judged[list(parallax.pair)].all() and judged.sum() == 6
    all_posed = mean_cost(start.growth, keyed, judged, 0.5)
    some = start.growth.posed.copy()
    some[np.nonzero(judged)[0][-1]] = False
    assert mean_cost(replace(start.growth, posed=some), keyed, judged, 0.5) > all_posed
