"""The adjustment against an independent solver, and its invariances."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from planewright.geometry.rigid import rotations_from_vectors
from planewright.sfm.bundle import Bundle, FocalPrior, adjust, observations, robust_scale


def problem(seed: int = 0, cameras: int = 4, points: int = 16, noise: float = 0.3):
    rng = np.random.default_rng(seed)
    angle = np.linspace(-0.4, 0.4, cameras)
    rotation = rotations_from_vectors(np.stack([0.1 * np.sin(5 * angle), angle, 0.05 * np.cos(3 * angle)], axis=1))
    translation = np.stack([0.1 * angle, 0.2 * angle, 6 + 0.5 * angle], axis=1)
    xyz = rng.uniform(-1.5, 1.5, (points, 3))
    point, camera = np.divmod(np.arange(points * cameras), cameras)
    x = np.einsum("oij,oj->oi", rotation[camera], xyz[point]) + translation[camera]
    xy = np.array([480.0, 270.0]) + 700.0 * x[:, :2] / x[:, 2:] + rng.normal(0, noise, (len(point), 2))
    xy[[2, 21]] += rng.normal(0, 4, (2, 2))
    start = Bundle(
        intrinsics=np.array([740.0, 480.0, 270.0, 0.0, 0.0]),
        rotation=rotations_from_vectors(rng.normal(0, 0.01, (cameras, 3))) @ rotation,
        translation=translation + rng.normal(0, 0.05, (cameras, 3)),
        xyz=xyz + rng.normal(0, 0.05, xyz.shape),
    )
    return start, observations(point, camera, xy, points)


def test_it_finds_the_optimum_that_scipy_finds():
    start, seen = problem()
    scale = 0.8
    done = adjust(start, seen, scale=scale, radial_terms=1, max_iterations=200, tolerance=1e-13)

    def residuals(q: np.ndarray) -> np.ndarray:
        k, cameras = q[:2], q[2 : 2 + 6 * len(start.rotation)].reshape(-1, 6)
        rotation = Rotation.from_rotvec(cameras[:, :3]).as_matrix() @ start.rotation
        xyz = start.xyz + q[2 + cameras.size :].reshape(-1, 3)
        x = np.einsum("oij,oj->oi", rotation[seen.camera], xyz[seen.point]) + (start.translation + cameras[:, 3:])[seen.camera]
        uv = x[:, :2] / x[:, 2:]
        r = start.intrinsics[1:3] + start.intrinsics[0] * np.exp(k[0]) * (1 + k[1] * (uv**2).sum(axis=1, keepdims=True)) * uv - seen.xy
        # The square root of Cauchy's cost, with the residual's direction, makes a plain sum of squares of it.
        length = np.linalg.norm(r, axis=1, keepdims=True)
        return (r / np.maximum(length, 1e-12) * scale * np.sqrt(np.log1p(length**2 / scale**2))).ravel()

    free = 2 + 6 * len(start.rotation) + start.xyz.size
    found = least_squares(residuals, np.zeros(free), method="trf", x_scale="jac", xtol=1e-10, ftol=1e-12, gtol=1e-10, max_nfev=60)
    assert_allclose(done.cost, found.cost, rtol=1e-6)
    assert_allclose(np.log(done.bundle.intrinsics[0] / start.intrinsics[0]), found.x[0], atol=1e-4)
    assert_allclose(done.bundle.intrinsics[3], found.x[1], atol=1e-4)


def test_the_answer_does_not_depend_on_the_world_frame():
    start, seen = problem(noise=0.1)
    turn, shift, size = rotations_from_vectors(np.array([[0.3, -0.2, 0.5]]))[0], np.array([1.0, -2.0, 0.5]), 3.0
    moved = Bundle(
        start.intrinsics,
        start.rotation @ turn.T,
        size * (start.translation - np.einsum("kij,j->ki", start.rotation @ turn.T, shift)),
        size * (start.xyz @ turn.T + shift),
    )
    a, b = (adjust(s, seen, scale=0.5, max_iterations=100, tolerance=1e-13) for s in (start, moved))
    assert_allclose(a.cost, b.cost, rtol=1e-8)
    assert_allclose(a.bundle.intrinsics[0], b.bundle.intrinsics[0], rtol=1e-6)


def test_a_firm_prior_holds_the_focal():
    start, seen = problem()
    held = adjust(start, seen, scale=0.8, prior=FocalPrior(float(np.log(650.0)), 1e12), max_iterations=100)
    assert_allclose(held.bundle.intrinsics[0], 650.0, rtol=1e-4)


def test_the_robust_scale_ignores_a_tenth_of_outliers():
    rng = np.random.default_rng(0)
    residual = rng.normal(0, 0.2, (4000, 2))
    residual[:400] += 50
    assert_allclose(robust_scale(residual), 0.2, rtol=0.25)
