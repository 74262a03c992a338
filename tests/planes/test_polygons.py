"""Faces of a scene as polygons."""

import numpy as np
from numpy.testing import assert_array_equal

from planewright.planes.planar_scene import PlanarScene
from planewright.planes.polygons import face_loops, polygons_of, scene_polygons
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint


def test_loops_hold_the_corners_in_order_and_unknown_faces_keep_their_row_without_any() -> None:
    names = [PointId(f"p{i}") for i in range(10)]
    faces = (
        SketchFace(FaceId("whole"), tuple(names[:4]), (tuple(names[4:7]),)),
        SketchFace(FaceId("without a corner"), (names[0], names[9], names[1])),
        SketchFace(FaceId("without a plane"), tuple(names[:3])),
        SketchFace(FaceId("without a hole"), tuple(names[:4]), ((names[7], names[8], names[9]),)),
    )
    points = np.random.default_rng(0).normal(size=(10, 3))
    points[9] = np.nan
    scene = PlanarScene(
        sketch=Sketch(tuple(SketchPoint(name, {}) for name in names), faces=faces), points=points, point_known=np.arange(10) != 9,
        point_covariance=np.zeros((10, 3, 3)), normals=np.tile([0.0, 0.0, 1.0], (4, 1)), offsets=np.zeros(4), face_known=np.array([True, True, False, True]),
        plane_covariance=np.zeros((12, 12)),
    )  # fmt: skip
    loops = face_loops(scene)
    assert [len(face) for face in loops] == [2, 0, 0, 1]
    assert_array_equal(loops[0][0], points[:4])
    assert_array_equal(loops[0][1], points[4:7])
    polygons = scene_polygons(scene)
    assert_array_equal(polygons.face_start, [0, 2, 2, 2, 3])
    assert_array_equal(polygons.corners[polygons.loop_start[2] :], points[:4])


def test_a_face_that_lacks_a_corner_keeps_the_others_while_the_structure_is_being_found() -> None:
    names = [PointId(f"p{i}") for i in range(8)]
    faces = (
        SketchFace(FaceId("lacks one"), tuple(names[:4]), (tuple(names[4:7]), (names[3], names[5], names[6]))),
        SketchFace(FaceId("lacks too many"), (names[0], names[1], names[3]), (tuple(names[4:7]),)),
        SketchFace(FaceId("without a plane"), tuple(names[4:7])),
    )
    points = np.random.default_rng(0).normal(size=(8, 3))
    points[3] = np.nan
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [np.nan] * 3])
    polygons = polygons_of(Sketch(tuple(SketchPoint(name, {}) for name in names), faces=faces), points, normals, np.array([0.0, 0.0, np.nan]))
    assert_array_equal(polygons.face_start, [0, 2, 2, 2])
    assert_array_equal(polygons.corners, points[[0, 1, 2, 4, 5, 6]])
