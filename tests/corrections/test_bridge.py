"""A mark obeyed in the image: between which frames, and how the surroundings of its corner turn there."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.corrections.bridge import bridges
from planewright.corrections.session import Mark
from planewright.sketch.graph import PointId


def test_patches_turn_as_the_plane_of_a_face_does(stage) -> None:
    staged = stage()
    session = staged.session
    corner = session.row(PointId("m3"))
    found = bridges(session, corner, Mark(PointId("m3"), 20, staged.at("m3", 20, (25.0, -18.0))))
    assert found
    scene, cameras = session.model.structure.scene, session.model.cameras
    faces = [f for f, face in enumerate(scene.sketch.faces) if "m3" in face.corners]
    for bridge in found:
        gap = bridge.gap
        assert gap.affine is not None
        assert_allclose(gap.affine[0], np.eye(2), atol=1e-9)
        # A step in the plane of one of its faces, seen in the first frame, becomes the same step seen in the others.
        off = []
        for f in faces:
            step = np.cross(scene.normals[f], [0.3, 0.5, 0.8])
            step *= 1e-4 / np.linalg.norm(step)
            ends = np.array([scene.points[corner], scene.points[corner] + step])
            seen = [cameras.intrinsics.project(cameras.cam_from_world(cameras.row(int(n))).apply(ends)) for n in gap.frame]
            moved = np.array([b - a for a, b in seen])
            off.append(np.abs(gap.affine @ moved[0] - moved).max() / np.abs(moved).max())
        assert min(off) < 1e-2


def test_a_bridge_ends_where_the_mark_is(stage) -> None:
    staged = stage()
    corner, mark = staged.session.row(PointId("m3")), Mark(PointId("m3"), 20, staged.at("m3", 20, (25.0, -18.0)))
    for bridge in bridges(staged.session, corner, mark):
        anchor = bridge.gap.forward[0] if bridge.gap.frame[0] == 20 else bridge.gap.backward[-1]
        assert 20 in (bridge.gap.frame[0], bridge.gap.frame[-1])
        assert_allclose(anchor, mark.xy)
