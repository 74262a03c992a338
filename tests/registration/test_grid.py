"""Faces without features of their own still say where the camera was."""

from dataclasses import replace

import numpy as np
import pytest

from planewright.features.follow import follow_features
from planewright.pipeline.stages import StageOptions, face_regions, find_cameras
from planewright.registration.follow import follow_faces
from planewright.registration.grid import face_features, grid_points
from planewright.sfm.solve import Refused, Solved, solve_cameras
from planewright.sketch.graph import Sketch
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.hard import repainted
from planewright.synthetic.observe import draw, true_cameras
from planewright.synthetic.refusals import object_on_turntable, rotating_camera, single_plane
from planewright.synthetic.textures import plaster


@pytest.fixture(scope="module")
def bare_carton() -> SyntheticClip:
    """A nearly bare carton on a turntable, before a still room."""
    clip = object_on_turntable()
    paint = {face.id: plaster(color, 0.012, 0.5) for face, color in zip(clip.scene.faces, ((190, 150, 100), (150, 120, 70), (210, 180, 130)), strict=True)}
    return replace(clip, scene=repainted(clip.scene, {}, paint))


@pytest.fixture(scope="module")
def sketch(bare_carton: SyntheticClip) -> Sketch:
    return draw(bare_carton, np.random.default_rng(1))


def test_cameras_come_from_faces_that_have_hardly_a_feature(bare_carton: SyntheticClip, sketch: Sketch) -> None:
    frames, options = bare_carton.frames, StageOptions()
    inside = follow_features(frames, options.features, regions=face_regions(sketch))
    assert isinstance(solve_cameras(inside, np.array(frames.numbers), frames.image_size, rng=np.random.default_rng(0)), Refused)
    filmed = find_cameras(frames, follow_features(frames), sketch, options, np.random.default_rng(0))
    assert "followed as wholes" in filmed.notes[0]
    found, true = filmed.solved.cameras, true_cameras(bare_carton)
    assert found.posed.all()
    turn, true_turn = (np.einsum("kij,lj->kil", c.rotation, c.rotation[0]) for c in (found, true))
    angle = np.degrees(np.arccos(np.clip((np.einsum("kij,kij->k", turn, true_turn) - 1) / 2, -1, 1)))
    assert angle.max() < 3
    low, high = found.focal_interval
    assert low < true.intrinsics.focal
    assert high is None or true.intrinsics.focal < high


@pytest.mark.parametrize("clip", [rotating_camera(), single_plane()], ids=lambda clip: clip.name)
def test_what_cannot_be_solved_is_still_refused(clip: SyntheticClip) -> None:
    features = face_features(follow_faces(clip.frames, draw(clip, np.random.default_rng(1))))
    outcome = solve_cameras(features, np.array(clip.frames.numbers), clip.frames.image_size, rng=np.random.default_rng(0))
    assert not isinstance(outcome, Solved)
    assert outcome.code in ("rotation-only", "planar-scene")


def test_grid_points_lie_on_the_face_and_not_on_what_covers_it(sketch: Sketch, bare_carton: SyntheticClip) -> None:
    for strand in follow_faces(bare_carton.frames, sketch).strands:
        q = grid_points(strand, 40)
        assert 40 <= len(q) < 120
        assert np.abs(q).max() < 1
        covered = replace(strand, others=(np.array([[-2.0, -2.0], [0.0, -2.0], [0.0, 2.0], [-2.0, 2.0]]),))
        assert (grid_points(covered, 10)[:, 0] > 0).all()
