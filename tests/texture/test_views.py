"""Which views are chosen for a face of the small world."""

import numpy as np
import pytest

from planewright.planes.polygons import face_loops
from planewright.texture.atlas import FaceRectangle, face_rectangle
from planewright.texture.views import ViewOptions, choose_views, spread_rows


@pytest.fixture(scope="module")
def rectangles(world) -> dict[int, FaceRectangle]:
    up = np.array([0.0, -1.0, 0.0])
    found = {f: face_rectangle(world.scene.normals[f], loops[0], up) for f, loops in enumerate(face_loops(world.scene))}
    return {f: rectangle for f, rectangle in found.items() if rectangle is not None}


def test_a_face_is_seen_from_its_front_only(world, rectangles) -> None:
    views = choose_views(world.scene, world.cameras, rectangles, world.cameras.frame.tolist(), ViewOptions(min_cos=0.2))
    names = [face.id for face in world.scene.sketch.faces]
    assert {names[f] for f in views} == {"wall", "window", "side", "panel"}
    for f, chosen in views.items():
        middle = np.mean(face_loops(world.scene)[f][0], axis=0)
        rays = world.cameras.centers[chosen.row] - middle
        cos = rays @ world.scene.normals[f] / np.linalg.norm(rays, axis=1)
        # A large face may be flatter at its middle than at the part that is seen best.
        assert cos.min() > 0.1


def test_the_best_view_weighs_most_and_sets_the_texel(world, rectangles) -> None:
    views = choose_views(world.scene, world.cameras, rectangles, world.cameras.frame.tolist())
    for f, chosen in views.items():
        assert chosen.weight.max() == 1.0
        assert (chosen.weight > 0).all()
        best = chosen.row[np.argmax(chosen.weight)]
        middle = np.mean(face_loops(world.scene)[f][0], axis=0, keepdims=True)
        depth = world.cameras.cam_from_world(int(best)).apply(middle)[0, 2]
        assert chosen.footprint == pytest.approx(depth / 260.0, rel=0.15)


def test_no_more_views_than_asked_for_and_only_frames_that_take_part(world, rectangles) -> None:
    available = world.cameras.frame[::2].tolist()
    views = choose_views(world.scene, world.cameras, rectangles, available, ViewOptions(max_views=3))
    for chosen in views.values():
        assert 1 <= len(chosen.row) <= 3
        assert set(world.cameras.frame[chosen.row].tolist()) <= set(available)
        assert (np.diff(chosen.row) > 0).all()


def test_frames_are_spread_over_the_clip(world) -> None:
    rows = spread_rows(world.scene, world.cameras, world.cameras.frame.tolist(), 5)
    assert [row // 4 for row in rows.tolist()] == [0, 1, 2, 3, 4]
