"""Evening out the exposure of frames with known gains."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from planewright.texture.exposure import FaceSamples, even_out


def observed(rng: np.random.Generator, gain: np.ndarray, bias: np.ndarray, frame: np.ndarray, noise: float) -> FaceSamples:
    truth = rng.uniform(30, 190, (500, 3))
    color = gain[frame][:, None] * truth + bias[frame][:, None] + rng.normal(size=(len(frame), 500, 3)) * noise
    valid = rng.random((len(frame), 500)) < 0.8
    return FaceSamples(frame, np.clip(np.rint(color), 0, 255).astype(np.uint8), valid)


def test_known_gains_are_found_up_to_their_average() -> None:
    rng = np.random.default_rng(0)
    gain = 1.0 + 0.1 * rng.normal(size=(12, 3))
    # Faces that are seen from different frames are tied together by the frames they share.
    faces = [observed(rng, gain, np.zeros((12, 3)), frame, 3.0) for frame in (np.arange(0, 8), np.arange(5, 12), np.arange(2, 10))]
    found, _ = even_out(faces, 12)
    assert_allclose(found, gain / gain.mean(axis=0), atol=0.03)


def test_outliers_do_not_pull() -> None:
    rng = np.random.default_rng(1)
    gain = 1.0 + 0.08 * rng.normal(size=(9, 3))
    face = observed(rng, gain, np.zeros((9, 3)), np.arange(9), 3.0)
    face.color[4, :150] = 255
    found, _ = even_out([face], 9)
    assert_allclose(found, gain / gain.mean(axis=0), atol=0.04)


def test_without_evidence_nothing_changes() -> None:
    nobody = FaceSamples(np.arange(4), np.zeros((4, 10, 3), dtype=np.uint8), np.zeros((4, 10), dtype=bool))
    for faces in ([], [nobody]):
        gain, bias = even_out(faces, 4)
        assert_array_equal(gain, 1.0)
        assert_array_equal(bias, 0.0)
