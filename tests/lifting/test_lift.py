"""The sketch lifted: corners and planes near the truth."""

import numpy as np
import pytest

from planewright.lifting.lift import Lifted
from planewright.sketch.graph import FaceId


@pytest.fixture(scope="module")
def lifted(shed, lift) -> Lifted:
    return lift(shed, shed.sketch)


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


def test_the_same_seed_lifts_the_same(shed, lift, lifted: Lifted) -> None:
    again = lift(shed, shed.sketch)
    assert again.points.tobytes() == lifted.points.tobytes()
    assert again.normals.tobytes() == lifted.normals.tobytes()
