"""Laws of joining pieces."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.geometry.rigid import rotations_from_vectors
from planewright.sfm.growth import Growth, join, similarity


def test_a_similarity_is_recovered_exactly():
    rng = np.random.default_rng(0)
    source, turn = rng.normal(0, 1, (10, 3)), rotations_from_vectors(np.array([[0.3, 1.2, -0.4]]))[0]
    scale, rotation, shift = similarity(source, 2.5 * source @ turn.T + [1.0, 2.0, 3.0])
    assert_allclose(scale, 2.5)
    assert_allclose(rotation, turn, atol=1e-12)
    assert_allclose(shift, [1, 2, 3], atol=1e-12)


def test_joined_pieces_agree_with_the_scene_they_were_cut_from():
    rng = np.random.default_rng(1)
    rotation, translation = rotations_from_vectors(rng.normal(0, 0.3, (6, 3))), rng.normal(0, 1, (6, 3)) + np.array([0.0, 0.0, 8.0])
    xyz = rng.uniform(-2, 2, (60, 3))
    turn, shift, size = rotations_from_vectors(np.array([[0.5, -0.7, 0.2]]))[0], np.array([3.0, -1.0, 2.0]), 0.4
    first, second = np.arange(6) < 3, np.arange(6) >= 3
    values = np.array([800.0, 480.0, 270.0, 0.0, 0.0])
    known_a, known_b = np.arange(60) < 35, np.arange(60) >= 25
    a = Growth(values, rotation, translation, first, np.where(known_a[:, None], xyz, np.nan), 0.3)
    other_rotation = rotation @ turn.T
    other = size * (xyz @ turn.T + shift)
    other[25:27] += 1.0
    other_translation = size * (translation - np.einsum("kij,j->ki", other_rotation, shift))
    b = Growth(values, other_rotation, other_translation, second, np.where(known_b[:, None], other, np.nan), 0.3)
    joined = join(a, b, 0)
    assert joined is not None and joined.posed.all()
    assert_allclose(joined.rotation, rotation, atol=1e-9)
    assert_allclose(joined.translation, translation, atol=1e-9)
    assert_allclose(joined.xyz[40:], xyz[40:], atol=1e-9)


def test_pieces_that_share_nothing_are_not_joined():
    nothing = Growth(np.zeros(5), np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), np.ones(2, bool), np.full((9, 3), np.nan), 0.3)
    assert join(nothing, nothing, 0) is None
