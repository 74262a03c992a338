"""Laws of the solver's kernels: derivatives against differences, normal equations against dense algebra."""

import numpy as np
from numpy.testing import assert_allclose

from planewright.geometry.rigid import rotations_from_vectors
from planewright.sfm.bundle import observations
from planewright.sfm.kernels import SHARED, observation_jacobian, observation_pulls, reduced_system, robust_cost, rotation_of, solve_spd, triangulate_points

VALUES = np.array([700.0, 480.0, 270.0, -0.07, 0.02])


def small_problem(seed: int = 0, cameras: int = 4, points: int = 12):
    rng = np.random.default_rng(seed)
    rotation = rotations_from_vectors(rng.normal(0, 0.1, (cameras, 3)))
    translation = rng.normal(0, 0.5, (cameras, 3)) + np.array([0.0, 0.0, 6.0])
    xyz = rng.uniform(-1.5, 1.5, (points, 3))
    point, camera = np.divmod(np.arange(points * cameras), cameras)
    keep = camera != point % (cameras + 1)
    point, camera = point[keep], camera[keep]
    x = np.einsum("oij,oj->oi", rotation[camera], xyz[point]) + translation[camera]
    uv = x[:, :2] / x[:, 2:]
    r2 = (uv**2).sum(axis=1, keepdims=True)
    xy = VALUES[1:3] + VALUES[0] * (1 + VALUES[3] * r2 + VALUES[4] * r2**2) * uv + rng.normal(0, 0.5, (len(point), 2))
    return rotation, translation, xyz, observations(point, camera, xy, points)


def test_the_exponential_is_that_of_the_geometry_package():
    for vector in np.random.default_rng(0).normal(0, 1, (20, 3)) * np.geomspace(1e-8, 1, 20)[:, None]:
        assert_allclose(rotation_of(*vector), rotations_from_vectors(vector[None])[0], atol=1e-15)


def test_the_jacobian_is_the_limit_of_differences():
    rotation, translation, xyz, _ = small_problem()
    jc, jp = np.zeros((2, 10)), np.empty((2, 3))
    r, t, x = rotation[1], translation[1], xyz[3]
    u, v, z = observation_jacobian(VALUES, r, t, x, jc, jp)
    assert z > 0

    def pixel(delta: np.ndarray) -> np.ndarray:
        values = VALUES.copy()
        values[0] *= np.exp(delta[0])
        values[3:] += delta[1:3]
        step = rotation_of(*delta[3:6])
        scratch_c, scratch_p = np.zeros((2, 10)), np.empty((2, 3))
        return np.array(observation_jacobian(values, step @ r, step @ t + delta[6:9], x + delta[9:], scratch_c, scratch_p)[:2])

    assert_allclose(pixel(np.zeros(12)), [u, v])
    h = 1e-6
    differences = np.stack([(pixel(h * e) - pixel(-h * e)) / (2 * h) for e in np.eye(12)], axis=1)
    moving = np.delete(jc, 3, axis=1)  # the readout moves the observation, not the projection
    assert_allclose(np.concatenate([moving, jp], axis=1), differences, rtol=1e-6, atol=1e-5)


def test_eliminating_the_points_is_the_schur_complement():
    rotation, translation, xyz, seen = small_problem()
    scale, cameras, points, obs = 1.3, len(rotation), len(xyz), len(seen.camera)
    n = SHARED + 6 * cameras
    drift = np.random.default_rng(7).normal(0, 1, (obs, 2))
    full, g = np.zeros((n + 3 * points, n + 3 * points)), np.zeros(n + 3 * points)
    jc, jp = np.zeros((2, 10)), np.empty((2, 3))
    per_observation = []
    for i, (c, p) in enumerate(zip(seen.camera, seen.point, strict=True)):
        u, v, _ = observation_jacobian(VALUES, rotation[c], translation[c], xyz[p], jc, jp)
        row = np.zeros((2, n + 3 * points))
        jc[:, 3] = -drift[i]
        row[:, :SHARED], row[:, SHARED + 6 * c : SHARED + 6 * c + 6], row[:, n + 3 * p : n + 3 * p + 3] = jc[:, :SHARED], jc[:, SHARED:], jp
        r = np.array([u, v]) - seen.xy[i]
        w = 1 / (1 + r @ r / scale**2)
        full += w * row.T @ row
        g += w * row.T @ r
        per_observation.append(w * row.T @ r)
    cross_block, inverse_block = full[:n, n:], np.linalg.inv(full[n:, n:])
    system, gradient = np.empty((n, n)), np.empty(n)
    cross, inverse = np.empty((obs, SHARED + 6, 3)), np.empty((points, 3, 3))
    pose = (VALUES, rotation, translation, xyz, seen.first, seen.camera)
    reduced_system(*pose, seen.xy, drift, scale, 0.0, system, gradient, cross, inverse, np.empty((points, 3)))
    assert_allclose(system, full[:n, :n] - cross_block @ inverse_block @ cross_block.T, rtol=1e-7, atol=1e-6 * np.abs(full).max())
    assert_allclose(gradient, g[:n] - cross_block @ inverse_block @ g[n:], rtol=1e-7, atol=1e-7 * np.abs(g).max())

    # Pulls are for an adjustment whose readout is fixed.
    direction = np.random.default_rng(1).normal(0, 1, n)
    direction[3] = 0.0
    pulls = np.empty(obs)
    observation_pulls(VALUES, rotation, translation, xyz, seen.first, seen.camera, seen.xy, scale, direction, cross, inverse, pulls)
    expected = [direction @ (s[:n] - cross_block @ inverse_block @ s[n:]) for s in per_observation]
    assert_allclose(pulls, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_the_cost_is_cauchys():
    rotation, translation, xyz, seen = small_problem()
    residual = np.empty((len(seen.camera), 2))
    cost = robust_cost(VALUES, rotation, translation, xyz, seen.camera, seen.point, seen.xy, 0.7, residual)
    assert_allclose(cost, 0.5 * 0.49 * np.log(1 + (residual**2).sum(axis=1) / 0.49).sum())


def test_small_systems_are_solved_and_indefinite_ones_refused():
    rng = np.random.default_rng(2)
    m = rng.normal(0, 1, (6, 6))
    a, b = m @ m.T + np.eye(6), rng.normal(0, 1, 6)
    x = b.copy()
    assert solve_spd(a.copy(), x, 6)
    assert_allclose(a @ x, b)
    assert not solve_spd(-a, b.copy(), 6)


def test_points_come_back_from_their_rays():
    rotation, translation, xyz, seen = small_problem(seed=3)
    x = np.einsum("oij,oj->oi", rotation[seen.camera], xyz[seen.point]) + translation[seen.camera]
    rays = x[:, :2] / x[:, 2:]
    r2 = (rays**2).sum(axis=1, keepdims=True)
    xy = VALUES[1:3] + VALUES[0] * (1 + VALUES[3] * r2 + VALUES[4] * r2**2) * rays
    found, covariance, quality = np.full_like(xyz, np.nan), np.empty((len(xyz), 3, 3)), np.empty((len(xyz), 3))
    triangulate_points(VALUES, rotation, translation, seen.first, seen.camera, xy, rays, 1.0, 10, found, covariance, quality)
    assert_allclose(found, xyz, atol=1e-7)
    assert (quality[:, 0] < 1e-6).all() and (quality[:, 1] > 0).all()
    assert (np.linalg.eigvalsh(covariance) > 0).all()
