"""Laws of the focal length's uncertainty."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.geometry.rigid import rotations_from_vectors
from planewright.sfm.bundle import Bundle, adjust, observations
from planewright.sfm.focal import focal_uncertainty, with_focal


def seen_problem(noise: float, seed: int, common: float = 0.0):
    """An orbit of eight cameras; `common` pixels of error are shared by all observations of a point."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(-0.35, 0.35, 8)
    rotation = rotations_from_vectors(np.stack([0.1 * np.sin(5 * angle), angle, 0.05 * np.cos(3 * angle)], axis=1))
    translation = np.stack([0.1 * angle, 0.2 * angle, 6 + 0.5 * angle], axis=1)
    xyz = rng.uniform(-1.5, 1.5, (80, 3))
    point, camera = np.divmod(np.arange(80 * 8), 8)
    x = np.einsum("oij,oj->oi", rotation[camera], xyz[point]) + translation[camera]
    # A shared error that turns with the view, so that no shift of the point can take it up.
    bent = common * rng.normal(0, 1, (80, 2))[point] * np.sign(angle[camera])[:, None]
    xy = np.array([480.0, 270.0]) + 700.0 * x[:, :2] / x[:, 2:] + rng.normal(0, noise, (len(point), 2)) + bent
    start = Bundle(np.array([700.0, 480.0, 270.0, 0.0, 0.0]), rotation, translation, xyz)
    seen = observations(point, camera, xy, 80)
    return adjust(start, seen, scale=5 * noise, max_iterations=60, tolerance=1e-9).bundle, seen


def weigh(bundle: Bundle, seen, noise: float):
    return focal_uncertainty(bundle, seen, scale=5 * noise, radial_terms=0, image_size=(960, 540), prior=None)


@pytest.mark.parametrize("common", [0.0, 0.4])
def test_the_claimed_sigma_covers_the_truth_also_where_errors_stick_to_their_track(common):
    ratios = []
    for seed in range(12):
        bundle, seen = seen_problem(0.2, seed, common)
        found = weigh(bundle, seen, 0.2)
        assert found.interval[1] is not None and found.interval[0] < bundle.intrinsics[0] < found.interval[1]
        ratios.append((bundle.intrinsics[0] - 700.0) / found.sigma)
    # Twelve draws: the root mean square of honest ratios lies between .55 and 1.5 with 99 %; the claim is cautious by design (the worst kind of clusters).
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_a_change_of_focal_keeps_the_picture_near_its_middle():
    bundle, _ = seen_problem(0.2, 0)
    moved = with_focal(bundle, 1400.0)
    near = np.argsort(np.linalg.norm(bundle.xyz - bundle.xyz.mean(axis=0), axis=1))[:5]
    for b in (bundle, moved):
        assert (b.xyz @ b.rotation[0][2] + b.translation[0, 2] > 0).all()

    def pixels(b: Bundle) -> np.ndarray:
        x = b.xyz[near] @ b.rotation[0].T + b.translation[0]
        return b.intrinsics[0] * x[:, :2] / x[:, 2:]

    assert_allclose(pixels(moved), pixels(bundle), atol=12.0)
    assert moved.intrinsics[0] == 1400.0
