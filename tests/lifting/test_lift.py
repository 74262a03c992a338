"""The sketch lifted: corners and planes near the truth, and nothing claimed that is hidden."""

import numpy as np
import pytest

from planewright.lifting.lift import Lifted, lift_sketch
from planewright.lifting.views import load_views
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint
from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.motion import Path, draw_tremor
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, TrueFace, face_surfaces, quad
from planewright.synthetic.textures import bricks, planks, print_on


def lift(filmed, sketch: Sketch) -> Lifted:
    marked = {frame for point in sketch.points for frame in point.marks}
    views = load_views(filmed.frames, filmed.cameras, filmed.cloud, marked)
    return lift_sketch(views, sketch, filmed.cloud, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def lifted(shed) -> Lifted:
    return lift(shed, shed.sketch)


@pytest.fixture(scope="module")
def screen(film):
    """A brick screen, and a printed board that stands wholly behind it in the middle frame."""
    points = {
        "s0": (-0.9, -0.6, 0.0), "s1": (0.9, -0.6, 0.0), "s2": (0.9, -0.6, 1.5), "s3": (-0.9, -0.6, 1.5),
        "b0": (-0.35, 0.9, 0.3), "b1": (0.35, 0.9, 0.3), "b2": (0.35, 0.9, 1.0), "b3": (-0.35, 0.9, 1.0),
    }  # fmt: skip
    faces = (TrueFace("screen", ("s0", "s1", "s2", "s3")), TrueFace("board", ("b0", "b1", "b2", "b3")))
    paints = {"screen": bricks((178, 96, 70), (205, 196, 184)), "board": print_on((190, 140, 70), 20, 0.3)}
    around = (
        quad((-5.0, -4.0, 0.0), (10.0, 0, 0), (0, 8.0, 0), planks((158, 122, 84), 0.32, 0.16), 60.0),
        quad((-5.0, 3.5, 0.0), (10.0, 0, 0), (0, 0, 4.0), print_on((206, 204, 196), 14, 0.4), 50.0),
    )
    scene = Scene(points, faces, (*face_surfaces(points, faces, paints, 90.0), *around), (0.35, -0.65, 0.8))
    tremor = draw_tremor(0.03, 0.4, np.random.default_rng(0))
    path = Path(num_frames=25, target=np.array([0.0, 0.0, 0.7]), radius=4.6, height=(1.6, 2.0), azimuth_deg=(-106.0, -74.0), tremor=tremor)
    return film(SyntheticClip("screen", scene, path, centered_camera((320, 180), 0.83), RenderOptions()))


def marked_at(filmed, frame: int, names: list[str], faces: tuple[SketchFace, ...]) -> Sketch:
    """Corners marked where they are in a frame, seen or not."""
    where = filmed.pixels(filmed.clip.scene.corner_array(names))[frame]
    points = tuple(SketchPoint(PointId(name), {frame: (float(x), float(y))}) for name, (x, y) in zip(names, where, strict=True))
    return Sketch(points, filmed.clip.intrinsics.image_size, (), faces)


def sketched_face(name: str, corners: list[str]) -> SketchFace:
    return SketchFace(FaceId(name), tuple(PointId(c) for c in corners))


SCREEN, BOARD = ["s0", "s1", "s2", "s3"], ["b0", "b1", "b2", "b3"]


def test_corners_are_lifted_near_to_where_they_are(shed, lifted: Lifted) -> None:
    assert lifted.point_known.all()
    error = np.linalg.norm(lifted.points - shed.scene.points, axis=1) / shed.clip.scene.diagonal
    assert np.median(error) < 0.01
    assert np.percentile(error, 90) < 0.04


def test_faces_that_are_seen_well_get_the_plane_they_lie_on(shed, lifted: Lifted) -> None:
    assert lifted.face_known.all()
    cosine = (lifted.normals * shed.scene.normals).sum(axis=1)
    names = [face.id for face in shed.scene.sketch.faces]
    hidden = names.index(FaceId("lean_side"))  # where it is drawn; which side is seen in other frames is found later
    cosine[hidden] = abs(cosine[hidden])
    turned = dict(zip(names, np.degrees(np.arccos(np.clip(cosine, -1, 1))), strict=True))
    assert lifted.from_pixels[names.index(FaceId("front"))]
    assert turned[FaceId("front")] < 1.0
    assert turned[FaceId("roof")] < 3.0
    assert np.median(list(turned.values())) < 2.5
    assert max(turned.values()) < 25.0


def test_corners_lie_on_their_marks_rays(shed, lifted: Lifted) -> None:
    for i, point in enumerate(shed.sketch.points):
        frame, xy = next(iter(sorted(point.marks.items())))
        seen = shed.clip.intrinsics.project(shed.cameras.cam_from_world(frame).apply(lifted.points[i][None]))[0]
        assert np.linalg.norm(seen - xy) < 0.01


def test_a_hidden_face_is_not_given_the_plane_of_what_stands_before_it(screen) -> None:
    both = (sketched_face("screen", SCREEN), sketched_face("board", BOARD))
    found = lift(screen, marked_at(screen, 12, SCREEN + BOARD, both))
    assert found.face_known[0]
    assert abs(found.normals[0] @ screen.scene.normals[0]) > np.cos(np.radians(2.0))
    assert not found.face_known[1]
    # It is the screen in the sketch that tells: without it the pixels agree with its plane all too well.
    alone = lift(screen, marked_at(screen, 12, BOARD, both[1:]))
    assert alone.face_known[0]
    assert abs(alone.normals[0] @ screen.scene.normals[0]) > np.cos(np.radians(3.0))
    assert abs(alone.offsets[0] - screen.scene.offsets[0]) < 0.1


def test_a_point_on_no_face_gets_the_depth_of_the_patch_around_its_mark(shed) -> None:
    spot = np.array([[-0.4, -1.5, 0.0], [3.0, 1.25, 0.9]])  # on the planks before the shed, and on a box beside it
    frame = 20
    where = shed.pixels(spot)[frame]
    points = tuple(SketchPoint(PointId(f"p{i}"), {frame: (float(x), float(y))}) for i, (x, y) in enumerate(where))
    sketch = Sketch((*points, SketchPoint(PointId("unmarked"), {})), shed.clip.intrinsics.image_size)
    found = lift(shed, sketch)
    assert found.point_known.tolist() == [True, True, False]
    center = shed.cameras.centers[frame]
    depth = np.linalg.norm(found.points[:2] - center, axis=1) / np.linalg.norm(spot - center, axis=1)
    assert abs(depth[0] - 1) < 0.02


def test_two_marks_far_apart_fix_a_point_without_a_face(shed) -> None:
    spot = np.array([[0.0, -1.2, 0.5]])  # in the air: no patch shows it
    where = shed.pixels(spot)[:, 0]
    point = SketchPoint(PointId("air"), {k: (float(where[k, 0]), float(where[k, 1])) for k in (2, 37)})
    found = lift(shed, Sketch((point,), shed.clip.intrinsics.image_size))
    assert np.linalg.norm(found.points[0] - spot[0]) < 1e-3


def test_the_same_seed_lifts_the_same(shed, lifted: Lifted) -> None:
    again = lift(shed, shed.sketch)
    assert again.points.tobytes() == lifted.points.tobytes()
    assert again.normals.tobytes() == lifted.normals.tobytes()
