"""What hides what, against the renderer's own truth."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planewright.geometry.raster import planar_polygons
from planewright.lifting.views import load_views
from planewright.planes.polygons import polygons_of, scene_polygons
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint
from planewright.synthetic.houses import toy_house
from planewright.synthetic.observe import true_tracks
from planewright.tracking.visibility import corner_visibility, inside_polygon, owners_in_views


@pytest.fixture(scope="module")
def house(film):
    """The toy house without the things that nobody sketched; only its geometry is looked at, nothing is drawn."""
    clip = toy_house(40, (480, 270))
    return film(replace(clip, scene=replace(clip.scene, surfaces=clip.scene.surfaces[: len(clip.scene.faces)])))


def visibility(filmed, tolerance: float = 0.004, **changes) -> np.ndarray:
    scene = replace(filmed.scene, **changes)
    normals = np.where(scene.face_known[:, None], scene.normals, np.nan)
    offsets = np.where(scene.face_known, scene.offsets, np.nan)
    points = np.where(scene.point_known[:, None], scene.points, np.nan)
    return corner_visibility(scene.sketch, points, normals, offsets, filmed.cameras.centers, tolerance * filmed.clip.scene.diagonal)


def test_corners_are_visible_where_the_renderer_says_so(house) -> None:
    _, visible, in_image = true_tracks(house.clip)
    rows = [list(house.clip.scene.points).index(point.id) for point in house.sketch.points]
    found, visible, in_image = visibility(house).T, visible[rows], in_image[rows]
    agree = (found == visible)[in_image]
    assert 0.1 < visible[in_image].mean() < 0.9
    assert agree.mean() > 0.98


def test_a_corner_that_is_not_known_is_not_visible_and_faces_that_are_not_known_hide_nothing(house) -> None:
    known = np.ones(len(house.sketch.points), bool)
    known[3] = False
    assert not visibility(house, point_known=known)[:, 3].any()
    assert visibility(house, face_known=np.zeros(len(house.sketch.faces), bool)).all()


@pytest.fixture
def wall_and_spot() -> tuple[Sketch, np.ndarray, np.ndarray, np.ndarray]:
    """A wall with a window at z = 1, and a lone point behind it."""
    points = np.array([
        [-2, -2, 1], [2, -2, 1], [2, 2, 1], [-2, 2, 1], [-0.5, -0.5, 1], [0.5, -0.5, 1], [0.5, 0.5, 1], [-0.5, 0.5, 1], [0, 0, 3],
    ], float)  # fmt: skip
    names = [PointId(f"p{i}") for i in range(9)]
    sketch = Sketch(tuple(SketchPoint(n, {}) for n in names), faces=(SketchFace(FaceId("wall"), tuple(names[:4]), (tuple(names[4:8]),)),))
    return sketch, points, np.array([[0.0, 0.0, -1.0]]), np.array([-1.0])


def test_a_point_is_seen_through_a_hole_and_not_through_the_wall(wall_and_spot) -> None:
    sketch, points, normals, offsets = wall_and_spot
    centers = np.array([[0.0, 0.0, -2.0], [1.5, 1.5, -2.0], [40.0, 0.0, -2.0]])
    seen = corner_visibility(sketch, points, normals, offsets, centers, 0.01)
    assert_array_equal(seen[:, 8], [True, False, True])  # through the window, through the wall, past it
    assert seen[:, :8].all()


def test_what_is_before_the_corner_by_less_than_the_tolerance_does_not_hide_it(wall_and_spot) -> None:
    sketch, points, normals, offsets = wall_and_spot
    points = points.copy()
    points[8] = [1.0, 1.0, 1.05]
    center = np.array([[1.0, 1.0, -2.0]])
    assert corner_visibility(sketch, points, normals, offsets, center, 0.1)[0, 8]
    assert not corner_visibility(sketch, points, normals, offsets, center, 0.02)[0, 8]


def test_corners_of_a_face_that_looks_away_are_hidden(wall_and_spot) -> None:
    sketch, points, normals, offsets = wall_and_spot
    behind = np.array([[0.0, 0.0, 9.0]])
    assert_array_equal(corner_visibility(sketch, points, normals, offsets, behind, 0.01)[0], [False] * 8 + [True])


def test_inside_is_even_odd_over_all_loops_in_any_plane() -> None:
    rng = np.random.default_rng(0)
    square = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    for _ in range(20):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        flat = rng.uniform(-1.5, 1.5, (200, 2))
        polygons = planar_polygons(axes[2:], np.array([0.7]), [[square @ axes[:2] + 0.7 * axes[2], 0.4 * square @ axes[:2] + 0.7 * axes[2]]])
        size = np.abs(flat).max(axis=1)
        assert_array_equal(inside_polygon(polygons, 0, flat @ axes[:2] + 0.7 * axes[2]), (size < 1.0) & (size > 0.4))


def test_owners_are_the_faces_that_the_renderer_shows(shed) -> None:
    views = load_views(shed.frames, shed.cameras, shed.cloud, [])
    owners = owners_in_views(views, scene_polygons(shed.scene), scale=1.0)
    names = [face.id for face in shed.clip.scene.faces]
    number = {names.index(face.id): f for f, face in enumerate(shed.sketch.faces)}
    agree = []
    for k in (0, 20, 39):
        shown = shed.clip.renderer.surface_index(k)
        for surface, face in number.items():
            agree.append((owners[k][shown == surface] == face).mean() if (shown == surface).sum() > 50 else 1.0)
    assert min(agree) > 0.97
    half = owners_in_views(views, scene_polygons(shed.scene))
    assert half.shape == (len(views.frame), 90, 160)
    assert (half == owners[:, ::2, ::2]).mean() > 0.97


def test_a_face_that_lacks_a_corner_still_owns_pixels(shed) -> None:
    views = load_views(shed.frames, shed.cameras, shed.cloud, [])
    scene = shed.scene
    row = scene.point_row()
    face = next(f for f, face in enumerate(scene.sketch.faces) if face.id == "roof")
    points = scene.points.copy()
    points[row[scene.sketch.faces[face].loop[0]]] = np.nan
    polygons = polygons_of(scene.sketch, points, scene.normals, scene.offsets)
    share = (owners_in_views(views, polygons) == face).sum() / (owners_in_views(views, scene_polygons(scene)) == face).sum()
    assert 0.2 < share < 0.8
    assert_allclose(polygons.normals, scene.normals)


def test_a_face_does_not_hide_a_corner_that_was_seen_through_it(wall_and_spot) -> None:
    """It is the wall, or the corner, that is a little beside its place; a wall that is well before the corner hides it all the same."""
    sketch, points, normals, offsets = wall_and_spot
    points = points.copy()
    points[8] = [1.0, 1.0, 1.05]
    centers = np.array([[1.0, 1.0, -2.0], [1.2, 1.0, -2.0], [1.0, 1.0, -2.1]])
    assert not corner_visibility(sketch, points, normals, offsets, centers, 0.02)[:, 8].any()
    seen = np.zeros((3, 9), bool)
    seen[1, 8] = True
    assert corner_visibility(sketch, points, normals, offsets, centers, 0.02, seen)[:, 8].all()
    seen[:, 8], seen[0, 0] = False, True
    assert not corner_visibility(sketch, points, normals, offsets, centers, 0.02, seen)[:, 8].any()
