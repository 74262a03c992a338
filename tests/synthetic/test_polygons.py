"""What rays meet: covers, holes, light."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from planewright.arrays import Float
from planewright.synthetic.polygons import Polygons, flatten
from planewright.synthetic.scene import Surface, quad
from planewright.synthetic.textures import plaster

PAINT = plaster((100, 100, 100))


def frame_with_hole() -> Polygons:
    outer = quad((-1.0, 0.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0), PAINT, 10.0).loops[0]
    return flatten([Surface((outer, 0.5 * outer), PAINT, 10.0)])


def test_a_cover_hides_what_lies_behind_it_but_for_its_hole_and_the_slack() -> None:
    points = np.array([[0.75, 1.0, 0.75], [0.2, 1.0, -0.3], [1.5, 1.0, 0.0], [0.75, -0.5, 0.75], [0.7, 0.05, 0.7]])
    center = np.array([[0.0, -10.0, 0.0]])
    assert_array_equal(frame_with_hole().covered(points, center, 0.2)[:, 0], [True, False, False, False, False])
    assert_array_equal(frame_with_hole().covered(points, center, 0.001)[:, 0], [True, False, False, False, True])


def test_plane_coordinates_are_isometric_and_never_negative() -> None:
    polygons = frame_with_hole()
    for a in range(8):
        for b in range(a):
            assert_allclose(np.linalg.norm(polygons.corners[a] - polygons.corners[b]), np.linalg.norm(polygons.vertices[a] - polygons.vertices[b]))
    assert polygons.corners.min() >= -1e-12
    assert_allclose(polygons.extent(0), [2.0, 2.0])


def test_light_falls_where_nothing_is_in_its_way() -> None:
    roof = flatten([quad((-1.0, -1.0, 1.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0), PAINT, 10.0)])
    sun, sky = np.array([[0.0, 0.0, 5.0]]), np.array([[0.3, 0.0, 0.9], [-0.3, 0.2, 0.8]]) * 3
    up: Float[np.ndarray, "points 3"] = np.tile([0.0, 0.0, 1.0], (3, 1))
    below, beside, above = roof.light(np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 0.0, 2.0]]), up, sun, sky, 0.4)
    assert below == 0.0
    assert_allclose([beside, above], 1.0)
    tilted = np.array([[0.0, np.sin(1.0), np.cos(1.0)]])
    assert_allclose(roof.light(np.array([[9.0, 0.0, 0.0]]), tilted, sun, sky, 0.4), 0.4 + 0.6 * np.cos(1.0), rtol=1e-9)
