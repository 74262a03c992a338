"""The truth is what the pixels show: visibility agrees with the drawn image, planes hold their corners, relations are closed."""

import json
from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.synthetic import demo_scene, draw, object_on_turntable, toy_house, true_cameras, true_tracks, truth
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.observe import face_planes, main_frame
from planewright.synthetic.score import close

CLIPS = [demo_scene(24, (320, 180)), toy_house(24, (320, 180)), object_on_turntable(12)]


@pytest.mark.parametrize("clip", CLIPS, ids=lambda clip: clip.name)
def test_corners_lie_on_their_planes_and_normals_point_outside(clip: SyntheticClip) -> None:
    normals, offsets = face_planes(clip.scene)
    middle = np.mean(list(clip.scene.points.values()), axis=0)
    outside = 0
    for face, n, d in zip(clip.scene.faces, normals, offsets, strict=True):
        corners = clip.scene.corner_array([*face.loop, *(k for h in face.holes for k in h)])
        assert_allclose(corners @ n, d, atol=1e-12, err_msg=face.id)
        outside += bool(n @ middle < d)
    assert outside >= len(normals) - 3  # the sides of what stands on a roof may look at the middle of a house


@pytest.mark.parametrize("clip", CLIPS, ids=lambda clip: clip.name)
def test_the_truth_is_json_with_relations_closed_under_transitivity(clip: SyntheticClip) -> None:
    known = json.loads(json.dumps(truth(clip)))
    triples = [(kind, a, b) for kind, pairs in known["relations"].items() for a, b in pairs]
    implied = close([f["id"] for f in known["faces"]], triples)
    assert implied == {kind: {frozenset(p) for p in pairs} for kind, pairs in known["relations"].items()}
    related = {frozenset(p) for kind in ("parallel", "orthogonal") for p in known["relations"][kind]}
    assert not related & {frozenset((m["a"], m["b"])) for m in known["near_misses"]}
    assert len(known["frames"]) == known["num_frames"] == clip.num_frames
    assert {len(t["xy"]) for t in known["tracks"].values()} == {clip.num_frames}


@pytest.mark.parametrize("clip", CLIPS, ids=lambda clip: clip.name)
def test_a_corner_is_visible_where_its_faces_are_drawn(clip: SyntheticClip) -> None:
    """Against the picture: around a visible corner one of its faces is drawn, around a hidden one none is."""
    xy, visible, in_image = true_tracks(clip)
    width, height = clip.intrinsics.image_size
    order = list(clip.scene.points)
    agree, hidden = [], 0
    for frame in range(0, clip.num_frames, 4):
        index = clip.renderer.surface_index(frame)
        for row in np.flatnonzero(in_image[:, frame]):
            own = [p for p, face in enumerate(clip.scene.faces) if order[row] in {*face.loop, *(k for h in face.holes for k in h)}]
            x, y = xy[row, frame].astype(int)
            around = index[max(0, y - 1) : min(height, y + 2), max(0, x - 1) : min(width, x + 2)]
            agree.append(np.isin(around, own).any() == visible[row, frame])
            hidden += not visible[row, frame]
    # Where a cover's rim runs within a pixel or two of the corner, the picture cannot tell.
    assert np.mean(agree) > 0.97
    assert hidden > 0


def test_tracks_are_projections_by_the_true_cameras() -> None:
    clip = object_on_turntable(12)
    xy, _, _ = true_tracks(clip)
    cameras = true_cameras(clip)
    points = clip.scene.corner_array(list(clip.scene.points))
    for row in range(clip.num_frames):
        assert_allclose(clip.intrinsics.project(cameras.cam_from_world(row).apply(points)), xy[:, row], atol=1e-9)
    assert np.ptp(cameras.centers, axis=0).max() > 1.0  # seen from the carton, it is the camera that moves


def test_the_sketch_marks_every_corner_once_where_it_is_visible_with_the_asked_noise() -> None:
    clip = toy_house(120, (480, 270))
    xy, visible, _ = true_tracks(clip)
    main = main_frame(visible)
    errors = []
    for seed in range(6):
        sketch = draw(clip, np.random.default_rng(seed), click_noise=1.0)
        assert len(sketch.points) == 35 and len(sketch.faces) == 18
        for row, point in enumerate(sketch.points):
            ((frame, at),) = point.marks.items()
            assert visible[row, frame]
            assert frame == main or not visible[row, main] or np.any((xy[row, main] < 3) | (xy[row, main] > np.array([477, 267])))
            errors.append(np.array(at) - xy[row, frame])
    assert_allclose(np.std(errors), 1.0, rtol=0.12)


def test_the_toy_house_has_what_the_drawing_must_cope_with() -> None:
    clip = toy_house(24, (320, 180))
    known = truth(clip)
    near = {frozenset((m["a"], m["b"])): m for m in known["near_misses"]}
    assert near[frozenset(("far_gable", "wing_side"))] == {"a": "far_gable", "b": "wing_side", "kind": "near_parallel", "angle_deg": 8.0}
    assert near[frozenset(("slope_s", "slope_n"))]["angle_deg"] == 84.0
    front = clip.scene.faces[0]
    assert front.holes == (clip.scene.faces[1].loop,)
    feet = clip.scene.corner_array(["sw", "door_1", "door_4", "se"])
    assert all(np.linalg.norm(np.cross(feet[j] - feet[i], feet[3] - feet[0])) < 1e-12 for i, j in combinations(range(4), 2))
