"""Planes chosen together: nothing is claimed that others hide, and corners are met."""

from dataclasses import replace

import numpy as np
import pytest

from planewright.lifting.energies import choose_planes, disagreement, explained
from planewright.lifting.hypothesis import Hypothesis
from planewright.lifting.located import corner_depths
from planewright.lifting.task import Task
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint
from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.motion import Path, draw_tremor
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, TrueFace, face_surfaces, quad
from planewright.synthetic.textures import bricks, planks, print_on

SCREEN, BOARD = ["s0", "s1", "s2", "s3"], ["b0", "b1", "b2", "b3"]


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


def farther(task: Task, plane: Hypothesis, times: float) -> Hypothesis:
    """A parallel plane this many times as far from the first camera."""
    start = float(plane.normal @ task.views.centers[0])
    return replace(plane, offset=start + times * (plane.offset - start))


def test_a_hidden_face_is_not_given_the_plane_of_what_stands_before_it(screen, lift) -> None:
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


def before_camera(task: Task, planes: list[Hypothesis]) -> list[bool]:
    """Which faces have all their corners before the camera; the ray of a mark misses the wall that is seen most aslant."""
    return [all(depth > 0 for depth, _ in corner_depths(task, f, plane).values()) for f, plane in enumerate(planes)]


def test_the_planes_that_meet_at_their_corners_are_chosen(task: Task, true_planes: list[Hypothesis]) -> None:
    seen = [replace(plane, view=0) for plane in true_planes]
    found = [[farther(task, plane, 1.6), plane, farther(task, plane, 0.7)] for plane in seen]
    choice, energy = choose_planes(task, found, {}, np.random.default_rng(0))
    before = before_camera(task, seen)
    assert sum(before) == task.num_faces - 1
    assert [guess is plane for guess, plane in zip(choice, seen, strict=True)] == before
    assert energy < sum(plane.energy for plane in seen)  # that they meet speaks for them


def test_a_face_whose_only_plane_is_contradicted_by_the_others_gets_none(task: Task, true_planes: list[Hypothesis]) -> None:
    shared = int(np.argmax(task.faces_at))
    liar = next(f for f, corners in enumerate(task.corners) if shared in corners)
    found = [[farther(task, plane, 1.6) if f == liar else plane] for f, plane in enumerate(true_planes)]
    choice, _ = choose_planes(task, found, {}, np.random.default_rng(0))
    assert choice[liar] is None
    others = [f for f in range(task.num_faces) if f != liar]
    assert [choice[f] is true_planes[f] for f in others] == [before_camera(task, true_planes)[f] for f in others]


def test_a_plane_behind_another_is_explained_by_it_and_one_before_it_is_not(task: Task, true_planes: list[Hypothesis]) -> None:
    front = true_planes[0]
    row = task.first_marks(task.corners[0])[0]
    view = int(task.rays.view[row])
    probe = task.rays.origin[[row]] + 4.0 * task.rays.direction[[row]]
    mine = replace(front, view=view, probe=probe, offset=float(front.normal @ probe[0]))
    center = task.views.centers[view]
    for times, hides in ((0.5, True), (1.0, True), (2.0, False)):  # the same plane explains as well as one before it
        other = replace(mine, offset=float(front.normal @ (center + times * (probe[0] - center))))
        assert explained(task, mine, other, None).tolist() == [hides]


def test_depths_that_agree_earn_and_depths_that_differ_cost_no_more_than_a_wrong_click() -> None:
    assert disagreement(0.0, 0.005) == pytest.approx(-4.1, abs=0.1)
    assert disagreement(0.2, 0.005) == pytest.approx(6.9, abs=0.1)
    costs = [disagreement(difference, 0.005) for difference in np.linspace(0.0, 0.1, 30)]
    assert (np.diff(costs) >= 0).all()
    assert disagreement(5.0, 0.005) <= -np.log(0.001) + 1e-9
