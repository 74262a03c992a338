"""From true cameras and clicks to corners, planes and relations: near the truth, within what is claimed, the same every time."""

from dataclasses import replace

import numpy as np
import pytest

from planewright.lifting.lift import LiftOptions
from planewright.lifting.photometric import PhotometricOptions
from planewright.lifting.rays import mark_rays
from planewright.lifting.views import ViewOptions, load_views
from planewright.refine.rounds import RefineOptions, Structure, _recalled, _state_of, refine_structure
from planewright.synthetic.observe import truth
from planewright.tracking.edges import drawn_edges

OPTIONS = RefineOptions(views=ViewOptions(max_views=30), lift=LiftOptions(photometric=PhotometricOptions(max_pixels=300)))
"""Half the pixels in fewer views than usual: twice as fast, and enough for the shed."""


def refined(filmed, options: RefineOptions = OPTIONS, sketch=None) -> Structure:
    return refine_structure(filmed.frames, sketch or filmed.sketch, filmed.cameras, filmed.cloud, options, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def structure(shed) -> Structure:
    return refined(shed)


def test_corners_are_where_they_are(shed, structure: Structure) -> None:
    scene = structure.scene
    assert scene.point_known.all()
    error = np.linalg.norm(scene.points - shed.scene.points, axis=1) / shed.clip.scene.diagonal
    assert np.median(error) < 0.004
    assert error.max() < 0.02


def test_corners_are_as_sure_as_they_say(shed, structure: Structure) -> None:
    off = structure.scene.points - shed.scene.points
    covariance = structure.scene.point_covariance + 1e-12 * np.eye(3)
    distance = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
    assert (distance < 16.3).mean() >= 0.8  # chi squared of three, 99.9 %
    sigma = np.sqrt(np.linalg.eigvalsh(covariance)[:, 2]) / shed.clip.scene.diagonal
    assert np.median(sigma) < 0.02


def test_corners_are_seen_where_they_are(shed, structure: Structure) -> None:
    off = np.linalg.norm(shed.pixels(structure.scene.points) - shed.pixels(shed.scene.points), axis=2)
    assert np.median(off) < 0.6
    assert np.percentile(off, 90) < 2.0


def test_planes_are_those_of_the_shed_with_their_normals_towards_the_cameras(shed, structure: Structure) -> None:
    assert structure.scene.face_known.all()
    cosine = (structure.scene.normals * shed.scene.normals).sum(axis=1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    assert np.median(angle) < 0.3
    assert angle.max() < 1.5


def test_corners_lie_exactly_on_their_planes(structure: Structure) -> None:
    scene = structure.scene
    row = scene.point_row()
    for f, face in enumerate(scene.sketch.faces):
        assert np.abs(scene.points[[row[c] for c in face.corners]] @ scene.normals[f] - scene.offsets[f]).max() < 1e-6


def test_relations_are_found_and_none_is_made_up(shed, structure: Structure) -> None:
    sketched = {face.id for face in shed.sketch.faces}
    true = truth(shed.clip)["relations"]
    for kind in ("parallel", "orthogonal", "coplanar"):
        pairs = {frozenset(pair) for pair in true[kind] if set(pair) <= sketched}
        enforced = {frozenset(r.faces) for r in structure.relations if r.kind == kind and r.state == "enforced"}
        assert enforced <= pairs, f"{kind}: made up {enforced - pairs}"
        assert len(enforced) >= 0.8 * len(pairs), f"{kind}: missed {pairs - enforced}"


def test_the_side_that_is_seven_degrees_off_is_let_be(structure: Structure) -> None:
    skew = [r for r in structure.relations if "lean_side" in r.faces and set(r.faces) & {"side", "front", "lean_front"}]
    assert all(r.state != "enforced" for r in skew)


def test_the_same_seed_gives_the_same_bytes(shed, structure: Structure) -> None:
    again = refined(shed)
    assert again.scene.points.tobytes() == structure.scene.points.tobytes()
    assert again.scene.point_covariance.tobytes() == structure.scene.point_covariance.tobytes()
    assert again.relations == structure.relations
    assert again.notes == structure.notes


def test_what_cannot_be_found_is_said(shed) -> None:
    """A corner that is marked nowhere, and the face that needs it."""
    options = replace(OPTIONS, rounds=0)
    points = tuple(replace(p, marks={}) if p.id in ("w0", "w1", "w2", "w3") else p for p in shed.sketch.points)
    found = refined(shed, options, replace(shed.sketch, points=points))
    assert any("pane" in note or "w0" in note for note in found.notes)


def test_a_corner_that_lost_its_mark_starts_anew_on_the_ray_of_it(shed, structure: Structure) -> None:
    # Where no plane of its own is met squarely enough to say where on the ray, it starts as far away as the corners it is joined to.
    marked = sorted({frame for point in shed.sketch.points for frame in point.marks})
    views = load_views(shed.frames, shed.cameras, shed.cloud, marked, OPTIONS.views)
    rays, edges = mark_rays(views, shed.sketch), drawn_edges(shed.sketch)
    state = _state_of(structure.scene)
    lost = next(c for _, c, _ in edges if state.known[c] and len(rays.of_point(c)))
    moved = state.points.copy()
    moved[lost] += 0.2 * shed.clip.scene.diagonal
    here = rays.of_point(lost)[0]
    direction = rays.direction[here] / np.linalg.norm(rays.direction[here])
    joined_to = sorted({b if a == lost else a for _, a, b in edges if lost in (a, b)})
    its_faces = [f for f, face in enumerate(shed.sketch.faces) if shed.sketch.points[lost].id in face.corners]
    for face_known in (state.face_known, np.zeros_like(state.face_known)):
        points = _recalled(shed.sketch, edges, rays, views, replace(state, points=moved, face_known=face_known))
        others = np.arange(len(points)) != lost
        np.testing.assert_array_equal(points[others], moved[others])
        seen = views.projections[rays.view[here]] @ np.append(points[lost], 1.0)
        np.testing.assert_allclose(seen[:2] / seen[2], rays.xy[here], atol=1e-6)
        if face_known.any():
            assert np.abs(state.normals[its_faces] @ points[lost] - state.offsets[its_faces]).min() < 1e-9
        else:
            away = (moved[joined_to] - rays.origin[here]) @ direction
            np.testing.assert_allclose((points[lost] - rays.origin[here]) @ direction, np.median(away))
