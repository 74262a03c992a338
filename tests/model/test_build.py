"""From faces to triangles."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from planewright.model.build import average_up, build_model
from planewright.model.planar_model import FaceMesh
from planewright.synthetic.houses import demo_scene
from planewright.synthetic.observe import true_cameras

SQUARE = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]
HOLE = [(0.6, 0.3), (0.4, 1.0), (1.2, 1.1)]
OTHER_HOLE = [(1.4, 1.4), (1.8, 1.4), (1.6, 1.8), (1.4, 1.7)]


def star(rng: np.random.Generator, corners: int) -> list[tuple[float, float]]:
    # No gap of half a turn, or the loop would cross itself.
    angles = (np.arange(corners) + rng.uniform(0, 0.45, corners)) * 2 * np.pi / corners
    return [(r * np.cos(a), r * np.sin(a)) for a, r in zip(angles, rng.uniform(0.4, 2.0, corners), strict=True)]


def area_of_loop(loop: list[tuple[float, float]]) -> float:
    x, y = np.array(loop).T
    return 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def signed_areas(face: FaceMesh) -> np.ndarray:
    """Of the triangles, positive where they are counter-clockwise seen from the front."""
    a, b, c = (face.vertices[face.triangles[:, i]] for i in range(3))
    return 0.5 * np.cross(b - a, c - a) @ face.normal


def test_triangles_cover_the_face_without_its_holes_and_turn_to_its_front(build) -> None:
    rng = np.random.default_rng(0)
    loops = {f"f{i}": [star(rng, n)] for i, n in enumerate((3, 4, 7, 12, 20))} | {"holed": [SQUARE, HOLE, OTHER_HOLE], "backwards": [SQUARE[::-1], HOLE[::-1]]}
    scene, atlas = build(loops, rng)
    model = build_model(scene, atlas)
    assert model.notes == ()
    assert [face.id for face in model.faces] == list(loops)
    for face, (border, *holes) in zip(model.faces, loops.values(), strict=True):
        areas = signed_areas(face)
        assert (areas > 0).all()
        assert_allclose(areas.sum(), area_of_loop(border) - sum(area_of_loop(hole) for hole in holes), rtol=1e-9)


def test_vertices_are_the_corners_exactly_and_show_their_own_texels(build) -> None:
    rng = np.random.default_rng(1)
    scene, atlas = build({"a": [SQUARE, HOLE], "b": [star(rng, 6)], "c": [SQUARE]}, rng)
    model = build_model(scene, atlas)
    assert_array_equal(np.concatenate([face.vertices for face in model.faces]), scene.points)
    height, width = atlas.inferred.shape
    for row, face in enumerate(model.faces):
        assert (face.uv >= 0).all() and (face.uv <= 1).all()
        # Anywhere inside a triangle the texture shows this face.
        weights = rng.dirichlet(np.ones(3), size=200) * 0.94 + 0.02
        for triangle in face.triangles:
            x, y = (weights @ face.uv[triangle] * [width, height]).astype(int).T
            assert (atlas.image[y, x, 0] == 200 + row).mean() > 0.97


def test_texture_coordinates_keep_shapes(build) -> None:
    rng = np.random.default_rng(2)
    scene, atlas = build({"a": [star(rng, 9)]}, rng)
    (face,) = build_model(scene, atlas).faces
    texels = face.uv * [atlas.image.shape[1], atlas.image.shape[0]]
    in_texels = np.linalg.norm(texels[:, None] - texels, axis=2) * atlas.charts[0].texel
    assert_allclose(in_texels, np.linalg.norm(face.vertices[:, None] - face.vertices, axis=2), atol=1e-9)


def test_collinear_corners_do_no_harm(build) -> None:
    feet = [(0.0, 0.0), (0.5, 0.0), (0.5, 1.0), (1.0, 1.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (2.0, 2.0), (0.0, 2.0)]
    scene, atlas = build({"wall": [feet]}, np.random.default_rng(3))
    model = build_model(scene, atlas)
    assert_allclose(signed_areas(model.faces[0]).sum(), 3.5)
    assert model.notes == ()


def test_what_cannot_be_built_is_left_out_with_a_note_and_never_fails(build) -> None:
    rng = np.random.default_rng(4)
    line, bowtie, spot = [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)], [(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)], [(1.0, 1.0)] * 4
    scene, atlas = build({"good": [SQUARE], "line": [line], "bowtie": [bowtie], "spot": [spot], "unknown": [SQUARE], "holed": [SQUARE, HOLE]}, rng)
    known = scene.point_known.copy()
    known[[16, 24]] = False  # a corner of "unknown", and one of the hole
    points = np.where(known[:, None], scene.points, np.nan)
    model = build_model(replace(scene, points=points, point_known=known), atlas)
    assert {"good", "holed"} <= {face.id for face in model.faces} <= {"good", "bowtie", "holed"}
    for name in ("line", "bowtie", "spot", "unknown", "holed"):
        assert any(f"ace {name} " in note for note in model.notes), name
    assert all(np.isfinite(face.vertices).all() for face in model.faces)
    face_known = np.zeros(6, dtype=bool)
    assert build_model(replace(scene, face_known=face_known), atlas).faces == ()


def test_up_is_up_however_far_the_camera_looked_down() -> None:
    cameras = true_cameras(demo_scene(40))
    looked_down = np.degrees(np.arcsin(-cameras.rotation[:, 2, 2])).mean()
    assert looked_down > 10
    assert np.degrees(np.arccos(average_up(cameras)[2])) < 2


def test_where_the_camera_hardly_turned_up_is_the_images_own() -> None:
    cameras = true_cameras(demo_scene(40))
    first = replace(cameras, rotation=np.repeat(cameras.rotation[:1], len(cameras.rotation), axis=0))
    assert_allclose(average_up(first), -first.rotation[0, 1], atol=1e-9)
    assert_allclose(average_up(replace(first, posed=np.zeros_like(first.posed))), [0, -1, 0])
