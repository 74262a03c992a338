"""The z-buffer of polygons against ray casting, one pixel at a time."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from planewright.geometry.camera import Intrinsics
from planewright.geometry.raster import PlanarPolygons, face_buffer, planar_polygons
from planewright.geometry.rigid import Rigid, rotations_from_vectors

CAMERA = Intrinsics(focal=60.0, principal_point=np.array([31.0, 23.5]), image_size=(64, 48))


def random_polygons(rng: np.random.Generator, num_faces: int) -> tuple[PlanarPolygons, list[list[np.ndarray]]]:
    """Star-shaped, mostly concave polygons with a hole, anywhere around the origin, some of them behind the camera."""
    normals, offsets, loops = [], [], []
    for _ in range(num_faces):
        frame = rotations_from_vectors(rng.normal(size=(1, 3)))[0]
        centre = rng.normal(size=3) * [2.0, 2.0, 3.0] + [0.0, 0.0, 2.0]
        angles = np.linspace(0, 2 * np.pi, 9, endpoint=False)
        ring = np.stack([np.cos(angles), np.sin(angles)], axis=1) * rng.uniform(0.8, 2.5, (9, 1))
        loops.append([centre + ring @ frame[:2], centre + 0.3 * ring[::-1] @ frame[:2]])
        normals.append(frame[2])
        offsets.append(frame[2] @ centre)
    return planar_polygons(np.array(normals), np.array(offsets), loops), loops


def inside(point: np.ndarray, loop: np.ndarray) -> bool:
    """By the winding of the borders, point and loop in a plane."""
    a, b = loop - point, np.roll(loop, -1, axis=0) - point
    return abs(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)).sum()) > np.pi


def test_every_pixel_shows_the_first_face_along_its_ray() -> None:
    rng = np.random.default_rng(3)
    num_seen = 0
    for _ in range(6):
        polygons, loops = random_polygons(rng, 5)
        pose = Rigid(rotations_from_vectors(rng.normal(size=(1, 3)) * 0.3)[0], rng.normal(size=3) * 0.5)
        buffer = face_buffer(polygons, CAMERA, pose, near=0.05)
        to_world = pose.inverse()
        for row, column in zip(rng.integers(0, 48, 150), rng.integers(0, 64, 150), strict=True):
            ray = np.append(CAMERA.normalize(np.array([[column + 0.5, row + 0.5]]))[0], 1.0)
            direction = to_world.rotation @ ray
            best, nearest = -1, np.inf
            for f, (border, hole) in enumerate(loops):
                normal = polygons.normals[f]
                depth = (polygons.offsets[f] - normal @ to_world.translation) / (normal @ direction)
                axis = [i for i in range(3) if i != np.argmax(np.abs(normal))]
                hit = (to_world.translation + depth * direction)[axis]
                if 0.05 < depth < nearest and inside(hit, border[:, axis]) and not inside(hit, hole[:, axis]):
                    best, nearest = f, depth
            assert buffer.face[row, column] == best
            if best >= 0:
                num_seen += 1
                assert_allclose(buffer.depth[row, column], nearest, rtol=1e-5)
            else:
                assert np.isinf(buffer.depth[row, column])
    assert num_seen > 200


def test_faces_that_share_a_border_leave_no_gap_and_no_overlap() -> None:
    rng = np.random.default_rng(4)
    corners = np.array([[-1.0, -1.0, 3.0], [1.0, -1.0, 3.0], [1.0, 1.0, 3.0], [-1.0, 1.0, 3.0]])
    middle = np.array([0.13, -0.21, 3.0])
    fan = [[np.array([middle, corners[i], corners[(i + 1) % 4]])] for i in range(4)]
    up, down = np.tile([0.0, 0.0, 1.0], (4, 1)), np.full(4, 3.0)
    for _ in range(10):
        pose = Rigid(rotations_from_vectors(rng.normal(size=(1, 3)) * 0.2)[0], rng.normal(size=3) * 0.2)
        whole = face_buffer(planar_polygons(up[:1], down[:1], [[corners]]), CAMERA, pose)
        parts = [face_buffer(planar_polygons(up[:1], down[:1], [part]), CAMERA, pose).face >= 0 for part in fan]
        assert_array_equal(np.sum(parts, axis=0), (whole.face >= 0).astype(int))


def test_scale_samples_the_same_scene_more_coarsely() -> None:
    polygons, _ = random_polygons(np.random.default_rng(5), 4)
    pose = Rigid(np.eye(3), np.array([0.0, 0.0, 1.0]))
    large, small = face_buffer(polygons, CAMERA, pose), face_buffer(polygons, CAMERA, pose, scale=0.5)
    assert small.face.shape == (24, 32)
    blocks = large.face.reshape(24, 2, 32, 2)
    uniform = (blocks == blocks[:, :1, :, :1]).all(axis=(1, 3))
    agree = blocks[:, 0, :, 0] == small.face
    assert agree[uniform].mean() > 0.98


def test_a_face_with_an_unknown_corner_is_not_seen() -> None:
    corners = np.array([[-1.0, -1.0, 3.0], [1.0, -1.0, 3.0], [np.nan, 1.0, 3.0]])
    polygons = planar_polygons(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]), np.array([3.0, 4.0]), [[corners], []])
    assert (face_buffer(polygons, CAMERA, Rigid(np.eye(3), np.zeros(3))).face == -1).all()
