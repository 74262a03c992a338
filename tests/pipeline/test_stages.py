"""Refusals and fallbacks of the walk."""

from dataclasses import replace

import numpy as np
import pytest

from planewright.errors import GeometryError, SketchError
from planewright.features.follow import follow_features
from planewright.geometry.camera import Intrinsics
from planewright.geometry.lens import Lens
from planewright.pipeline.stages import StageOptions, check_structure, checked_sketch, face_regions, find_cameras, unused_marks, without_distortion
from planewright.planes.planar_scene import PlanarScene
from planewright.refine.rounds import Structure
from planewright.sketch.graph import Sketch
from planewright.synthetic.observe import draw, true_cameras
from planewright.synthetic.refusals import object_on_turntable, rotating_camera
from planewright.video.clip import ClipInfo


def info(size: tuple[int, int] = (320, 180), num_frames: int = 24) -> ClipInfo:
    return ClipInfo("clip.mp4", "0" * 64, size, num_frames, 30.0, tuple(np.arange(num_frames) / 30))


@pytest.fixture(scope="module")
def turntable_sketch() -> Sketch:
    return draw(object_on_turntable(), np.random.default_rng(0))


def test_an_object_that_turns_before_a_still_room_is_solved_from_its_faces(turntable_sketch: Sketch) -> None:
    clip = object_on_turntable()
    options = StageOptions()
    features = follow_features(clip.frames, options.features)
    filmed = find_cameras(clip.frames, features, turntable_sketch, options, np.random.default_rng(0))
    assert "drawn faces" in filmed.notes[0]
    found, true = filmed.solved.cameras, true_cameras(clip)
    assert found.posed.all()
    # Turns between the first frame and each other one, whatever the world's axes are.
    turn = np.einsum("kij,lj->kil", found.rotation, found.rotation[0])
    true_turn = np.einsum("kij,lj->kil", true.rotation, true.rotation[0])
    angles = np.degrees(np.arccos(np.clip((np.einsum("kij,kij->k", turn, true_turn) - 1) / 2, -1, 1)))
    assert angles.max() < 4


def test_a_camera_that_only_turns_is_refused_once_and_in_words() -> None:
    clip = rotating_camera()
    options = StageOptions()
    sketch = draw(clip, np.random.default_rng(0))
    features = follow_features(clip.frames, options.features)
    with pytest.raises(GeometryError, match="turns") as raised:
        find_cameras(clip.frames, features, sketch, options, np.random.default_rng(0))
    sentences = str(raised.value).split(". ")
    assert len(set(sentences)) == len(sentences)
    with pytest.raises(GeometryError, match="turns"):
        find_cameras(clip.frames, features, replace(sketch, faces=(), edges=()), options, np.random.default_rng(0))


def test_regions_are_the_faces_as_they_were_marked(turntable_sketch: Sketch) -> None:
    regions = face_regions(turntable_sketch)
    marks = {point.id: point.marks for point in turntable_sketch.points}
    assert regions
    for frame, polygons in regions.items():
        wanted = [[marks[c][frame] for c in face.loop if frame in marks[c]] for face in turntable_sketch.faces]
        assert [polygon.tolist() for polygon in polygons] == [list(map(list, polygon)) for polygon in wanted if len(polygon) >= 3]


def test_errors_of_a_sketch_stop_the_walk_and_warnings_go_on(turntable_sketch: Sketch) -> None:
    checked, notes = checked_sketch(turntable_sketch, info(num_frames=40), range(40))
    assert checked.faces
    assert all(isinstance(note, str) for note in notes)
    with pytest.raises(SketchError, match="640x360"):
        checked_sketch(turntable_sketch, info((640, 360), 40), range(40))
    with pytest.raises(SketchError):
        checked_sketch(replace(turntable_sketch, points=(), edges=(), faces=()), info(num_frames=40), range(40))


def test_marks_in_frames_that_are_left_out_are_told(turntable_sketch: Sketch) -> None:
    frames = sorted({frame for point in turntable_sketch.points for frame in point.marks})
    with pytest.raises(SketchError, match=f"frames? {frames[0]}"):
        unused_marks(turntable_sketch, [k for k in range(40) if k not in frames])
    assert unused_marks(turntable_sketch, range(40)) == ()
    twice = replace(turntable_sketch, points=tuple(replace(p, marks={**p.marks, 41: (1.0, 1.0)}) for p in turntable_sketch.points))
    (note,) = unused_marks(twice, range(40))
    assert "frame 41" in note


def test_a_result_without_a_face_is_refused_with_the_reason(turntable_sketch: Sketch) -> None:
    points, faces = len(turntable_sketch.points), len(turntable_sketch.faces)
    scene = PlanarScene(
        sketch=turntable_sketch,
        points=np.full((points, 3), np.nan),
        point_known=np.zeros(points, np.bool_),
        point_covariance=np.full((points, 3, 3), np.nan),
        normals=np.full((faces, 3), np.nan),
        offsets=np.full(faces, np.nan),
        face_known=np.zeros(faces, np.bool_),
        plane_covariance=np.full((3 * faces, 3 * faces), np.nan),
    )
    with pytest.raises(GeometryError, match=r"no drawn face .* The front hides."):
        check_structure(Structure(scene, (), (), ("The front hides.",)))


def test_marks_move_to_where_the_undistorted_frame_shows_them(turntable_sketch: Sketch) -> None:
    lens = Intrinsics(300.0, np.array([160.0, 90.0]), (320, 180), (-0.1, 0.02))
    moved = without_distortion(turntable_sketch, Lens(lens))
    rays = np.random.default_rng(0).uniform([-0.4, -0.25], [0.4, 0.25], (50, 2))
    for before, after in zip(turntable_sketch.points, moved.points, strict=True):
        assert before.marks.keys() == after.marks.keys()
        for frame in before.marks:
            np.testing.assert_allclose(lens.to_pixels(lens.pinhole().normalize(np.array([after.marks[frame]]))), [before.marks[frame]], atol=1e-6)
    np.testing.assert_allclose(lens.normalize(lens.to_pixels(rays)), rays, atol=1e-9)
    assert without_distortion(turntable_sketch, Lens(lens.pinhole())) is turntable_sketch
