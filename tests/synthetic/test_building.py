"""A thing as built: a little off everywhere, and exactly planar."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.synthetic import boxes, library, toy_house
from planewright.synthetic.building import BuildingOptions, build_off
from planewright.synthetic.observe import face_planes

SCENES = [make(4, (160, 90)).scene for make in (boxes, toy_house, library)]


@pytest.mark.parametrize("scene", SCENES, ids=["boxes", "toy_house", "library"])
@pytest.mark.parametrize("seed", range(3))
def test_corners_stay_on_their_faces_and_feet_on_the_floor(scene, seed: int) -> None:
    built = build_off(scene, np.random.default_rng(seed))
    normals, offsets = face_planes(built)
    for face, n, d in zip(built.faces, normals, offsets, strict=True):
        corners = built.corner_array([*face.loop, *(k for h in face.holes for k in h)])
        assert_allclose(corners @ n, d, atol=1e-11 * scene.diagonal, err_msg=face.id)
    meant, now = scene.corner_array(list(scene.points)), built.corner_array(list(scene.points))
    assert_allclose(now[meant[:, 2] == 0.0, 2], 0.0, atol=1e-10)
    assert 0.0 < np.linalg.norm(now - meant, axis=1).max() < 0.03 * scene.diagonal
    assert built.meant == scene.points
    for face, surface in zip(built.faces, built.surfaces, strict=False):
        assert_allclose(surface.loops[0], built.corner_array(face.loop), atol=1e-12)


@pytest.mark.parametrize("tilt", [0.05, 0.5])
def test_faces_are_turned_as_far_as_asked(tilt: float) -> None:
    scene = SCENES[0]
    built = build_off(scene, np.random.default_rng(4), BuildingOptions(tilt_deg=(tilt, tilt)))
    turned = np.degrees(np.arccos(np.clip((face_planes(scene)[0] * face_planes(built)[0]).sum(axis=1), -1.0, 1.0)))
    assert_allclose(turned, tilt, rtol=0.05)


def test_what_stands_on_a_face_still_stands_on_it() -> None:
    """The chimney's feet belong to no corner of the roof, and yet stay on it."""
    scene = SCENES[1]
    built = build_off(scene, np.random.default_rng(5))
    normals, offsets = face_planes(built)
    roof = [f.id for f in built.faces].index("slope_s")
    feet = built.corner_array(["stack_sw", "stack_se", "stack_ne", "stack_nw", "dorm_w", "dorm_e", "dorm_back"])
    assert_allclose(feet @ normals[roof], offsets[roof], atol=1e-11)
