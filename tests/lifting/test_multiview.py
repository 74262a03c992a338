"""Faces measured from several views, and what of it is handed on."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planewright.geometry.rigid import rotations_from_vectors
from planewright.lifting.multiview import FaceEstimate, MultiviewOptions, measure_faces, plane_points, thickness, visible_shares
from planewright.lifting.photometric import PhotometricPlane, plane_from_world, plane_to_world
from planewright.planes.polygons import scene_polygons
from planewright.tracking.visibility import owners_in_views


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def estimate(wall, view: int, information: np.ndarray, off: np.ndarray | None = None, face: int = 0) -> FaceEstimate:
    reference = wall.reference(view)
    plane = plane_from_world(wall.views, reference, wall.normal, wall.offset)
    assert plane is not None
    plane = plane if off is None else plane + off
    normal, offset = plane_to_world(wall.views, reference, plane)
    return FaceEstimate(face, PhotometricPlane(reference, plane, information, 0.9, 1.0, 100.0, 2000, 1.5), normal, offset)


@pytest.fixture(scope="module")
def owners(shed, shed_views) -> np.ndarray:
    return owners_in_views(shed_views, scene_polygons(shed.scene))


def test_visible_shares_count_working_pixels(wall) -> None:
    owners = np.full((9, 2, 4), -1, np.int16)
    owners[0] = [[0, 0, -1, 1], [0, 0, 1, 1]]
    owners[1, 1] = 2
    views = replace(wall.views, images=np.zeros((9, 4, 8), np.uint8))
    assert_array_equal(visible_shares(views, owners, 3)[:3], [[16, 12, 0], [0, 0, 16], [0, 0, 0]])


def test_faces_are_measured_to_a_fraction_of_what_they_start_off(shed, shed_views, owners: np.ndarray) -> None:
    scene, rng = shed.scene, np.random.default_rng(2)
    turned, offsets = np.empty_like(scene.normals), np.empty_like(scene.offsets)
    row = scene.point_row()
    for f, face in enumerate(scene.sketch.faces):
        center = scene.points[[row[c] for c in face.loop]].mean(axis=0)
        axis = rng.normal(size=3)
        turned[f] = rotations_from_vectors(np.radians(1.5) * axis[None] / np.linalg.norm(axis))[0] @ scene.normals[f]
        offsets[f] = turned[f] @ center + rng.choice([-0.01, 0.01])
    found = measure_faces(shed_views, turned, offsets, scene.face_known, owners)
    measured = {e.face for e in found}
    assert len(measured) >= len(scene.sketch.faces) - 1
    tilt = [np.median([angle_deg(e.normal, scene.normals[f]) for e in found if e.face == f]) for f in measured]
    assert np.median(tilt) < 0.5
    points = plane_points(shed_views, found)
    error = (points.point * scene.normals[points.face]).sum(axis=1) - scene.offsets[points.face]
    assert (np.abs(error) < 3 * points.sigma).all()
    assert np.median(np.abs(error)) < 0.002 * shed.clip.scene.diagonal


def test_faces_measured_again_where_they_are_come_out_as_from_the_beginning(shed, shed_views, owners: np.ndarray) -> None:
    scene = shed.scene
    first = measure_faces(shed_views, scene.normals, scene.offsets, scene.face_known, owners)
    # half a pixel of motion further off
    moved = scene.offsets - 0.5 * shed_views.depth_per_pixel * (scene.normals @ shed_views.centers.mean(axis=0) - scene.offsets)
    afresh = measure_faces(shed_views, scene.normals, moved, scene.face_known, owners)
    again = measure_faces(shed_views, scene.normals, moved, scene.face_known, owners, last=first)
    assert [e.face for e in again] == [e.face for e in afresh]
    apart = [angle_deg(a.normal, b.normal) for a, b in zip(again, afresh, strict=True)]
    assert max(apart) > 0.0  # they took another way
    assert np.median(apart) < 0.02


def test_a_face_that_is_not_known_is_not_measured_and_neither_is_one_that_shows_its_back(shed, shed_views, owners: np.ndarray) -> None:
    scene = shed.scene
    known = scene.face_known.copy()
    known[0] = False
    assert 0 not in {e.face for e in measure_faces(shed_views, scene.normals, scene.offsets, known, owners)}
    assert measure_faces(shed_views, -scene.normals, -scene.offsets, scene.face_known, owners) == []


def test_three_points_carry_the_information_about_the_plane(wall) -> None:
    """Sum over the points of the squared, whitened slopes is the information matrix of the three numbers of the plane, scaled alike."""
    rng = np.random.default_rng(0)
    for _ in range(10):
        root = rng.normal(size=(40, 3)) * [1.0, 0.4, 0.0] + [rng.normal(0, 0.5), 0.2, 1.0]
        information = root.T @ root * 1e5
        one = estimate(wall, 4, information)
        points = plane_points(wall.views, [one], MultiviewOptions(floor=0.0, thin=0.0, gray_error=0.0))
        assert_array_equal(points.face, [0, 0, 0])
        assert_allclose(points.point @ one.normal, one.offset, atol=1e-9)
        jacobian = np.empty((3, 3))
        for c in range(3):
            step = 1e-5 * np.eye(3)[c]
            values = []
            for sign in (1, -1):
                normal, offset = plane_to_world(wall.views, one.found.reference, one.found.plane + sign * step)
                values.append((points.point @ normal - offset) / points.sigma)
            jacobian[:, c] = (values[0] - values[1]) / 2e-5
        carried = jacobian.T @ jacobian
        scale = carried[2, 2] / information[2, 2]
        # A face with a single reference is trusted five times less than the pixels claim.
        assert_allclose(scale, 1 / 25, rtol=0.01)
        size = np.sqrt(np.diag(information))
        assert_allclose(carried / np.outer(size, size) / scale, information / np.outer(size, size), atol=0.02)


def test_references_that_differ_more_than_they_claim_are_trusted_less(wall) -> None:
    information = 1e7 * np.diag([0.3, 0.3, 1.0])
    options = MultiviewOptions(floor=0.0, thin=0.0, gray_error=0.0)
    sigma = 1 / np.sqrt(1e7)
    sizes = []
    for off in (0.0, 20.0, 80.0):
        pair = [estimate(wall, view, information, np.array([0.0, 0.0, sign * off * sigma])) for view, sign in ((2, 1), (6, -1))]
        sizes.append(float(np.median(plane_points(wall.views, pair, options).sigma)))
    assert sizes[1] > 1.5 * sizes[0]
    assert sizes[2] >= sizes[1]


def test_no_face_is_surer_than_the_floor_however_many_references_it_has(wall) -> None:
    information = 1e12 * np.diag([0.3, 0.3, 1.0])
    options = MultiviewOptions(floor=0.2, thin=0.0)
    combined = []
    for views in ([4], [2, 6], [1, 3, 5, 7]):
        points = plane_points(wall.views, [estimate(wall, v, information) for v in views], options)
        combined.append(1 / np.sqrt((1 / points.sigma**2).sum() / 3))
    # The floor is in relative depth; seen obliquely, depth errors count less along the normal.
    assert_allclose(combined, combined[0], rtol=0.25)
    distance = wall.normal @ wall.views.centers[4] - wall.offset
    assert_allclose(combined[0], 0.2 * wall.views.depth_per_pixel * abs(distance), rtol=0.2)


def test_a_thin_face_is_as_unsure_as_its_border(wall) -> None:
    """A hundred pixels of information more do not make up for a border that is a pixel off."""
    information = 1e12 * np.diag([0.3, 0.3, 1.0])
    one = estimate(wall, 4, information)
    sigmas = [float(np.median(plane_points(wall.views, [one], MultiviewOptions(floor=0.0, thin=thin)).sigma)) for thin in (10.0, 20.0)]
    distance = np.linalg.norm(wall.views.centers[4] - one.normal * one.offset)
    assert_allclose(sigmas[1], 2 * sigmas[0], rtol=0.01)
    expected = 10.0 / thickness(one.found.reference) / one.found.zncc * wall.views.depth_per_pixel * distance
    assert 0.5 * expected < sigmas[0] < 2 * expected


def test_a_nearly_bare_face_has_a_large_sigma_and_is_within_it(wall, bare_wall) -> None:
    sigmas = []
    for one in (wall, bare_wall):
        owner = np.zeros(one.views.images.shape, np.int16)
        found = measure_faces(one.views, one.normal[None], np.array([one.offset]), np.array([True]), owner)
        points = plane_points(one.views, found)
        assert len(points.sigma) == 12
        assert (np.abs(points.point @ one.normal - one.offset) < 2 * points.sigma).all()
        sigmas.append(float(np.median(points.sigma)))
    assert sigmas[0] < 0.005 * 3.0  # half a percent of the distance
    # the print is 15 times fainter; on the printed wall, 70 pixels thin, it is its border that sets the sigma
    assert sigmas[1] > 5 * sigmas[0]


def test_an_estimate_that_stands_alone_is_left_out(shed, shed_views, owners: np.ndarray) -> None:
    """Measured from a start that is 40 pixels of motion off, nothing that follows something else is handed on as the face."""
    scene = shed.scene
    far = scene.offsets - 40 * shed_views.depth_per_pixel * 5.0
    found = measure_faces(shed_views, scene.normals, far, scene.face_known, owners)
    for e in found:
        depth = abs(e.offset - far[e.face]) / abs(shed_views.centers[e.found.reference.view] @ scene.normals[e.face] - far[e.face])
        assert depth < 2 * MultiviewOptions().max_shift * shed_views.depth_per_pixel


def test_the_same_is_measured_twice(shed, shed_views, owners: np.ndarray) -> None:
    scene = shed.scene
    known = np.arange(len(scene.normals)) < 2
    runs = [plane_points(shed_views, measure_faces(shed_views, scene.normals, scene.offsets, known, owners)) for _ in range(2)]
    assert len(runs[0].sigma) > 0
    assert runs[0].point.tobytes() == runs[1].point.tobytes()
    assert runs[0].sigma.tobytes() == runs[1].sigma.tobytes()
