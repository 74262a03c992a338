"""Bundle adjustment of one moving camera, with the points eliminated: our own Levenberg-Marquardt over a dense system of the poses."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from planewright.arrays import Bool, Float, Int
from planewright.geometry.rigid import rotations_from_vectors
from planewright.sfm.kernels import SHARED, reduced_system, robust_cost


@dataclass(frozen=True, eq=False)
class Observations:
    """Where points were seen, sorted by point."""

    first: Int[np.ndarray, "points_plus_one"]
    """Row where each point's observations begin."""
    camera: Int[np.ndarray, "obs"]
    xy: Float[np.ndarray, "obs 2"]

    @property
    def point(self) -> Int[np.ndarray, "obs"]:
        """Row of each observation's point."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))


def observations(point: Int[np.ndarray, "obs"], camera: Int[np.ndarray, "obs"], xy: Float[np.ndarray, "obs 2"], num_points: int) -> Observations:
    """The same rows sorted by point, then camera."""
    order = np.lexsort((camera, point))
    first = np.concatenate([[0], np.cumsum(np.bincount(point, minlength=num_points))]).astype(np.int64)
    return Observations(first=first, camera=camera[order].astype(np.int64), xy=np.ascontiguousarray(xy[order], dtype=np.float64))


@dataclass(frozen=True, eq=False)
class Bundle:
    """All that an adjustment changes."""

    intrinsics: Float[np.ndarray, "5"]
    """Focal, principal point x and y, k1, k2."""
    rotation: Float[np.ndarray, "cameras 3 3"]
    translation: Float[np.ndarray, "cameras 3"]
    xyz: Float[np.ndarray, "points 3"]
    readout: float = 0.0
    """Change of the readout from the one with which the observations were straightened, frames."""


@dataclass(frozen=True, eq=False)
class FocalPrior:
    """A Gaussian on the logarithm of the focal length."""

    log_focal: float
    precision: float
    """Inverse variance times the variance of a pixel residual, so that it adds to a cost in pixels squared."""


@dataclass(frozen=True, eq=False)
class Adjusted:
    """Where an adjustment ended."""

    bundle: Bundle
    cost: float
    """Pixels squared; the prior's share is in it."""
    residual: Float[np.ndarray, "obs 2"]
    iterations: int


def adjust(
    bundle: Bundle,
    seen: Observations,
    *,
    scale: float,
    free_focal: bool = True,
    radial_terms: int = 0,
    prior: FocalPrior | None = None,
    drift: Float[np.ndarray, "obs 2"] | None = None,
    max_iterations: int = 15,
    tolerance: float = 1e-6,
) -> Adjusted:
    """Minimize the Cauchy reprojection cost (scale in pixels) over poses, points, and what is free of the intrinsics.

    With `drift`, pixels by which each straightened observation moves when the readout grows by one frame, the readout is free as well. The gauge stays
    free: damping keeps the system definite and the step small along it. Stops when the cost falls by less than `tolerance` of itself.
    """
    active = _active(len(bundle.rotation), free_focal, radial_terms, drift is not None)
    point, n = seen.point, SHARED + 6 * len(bundle.rotation)
    rolled = np.zeros((0, 2)) if drift is None else drift
    system, gradient = np.empty((n, n)), np.empty(n)
    cross, inverse = np.empty((len(point), SHARED + 6, 3)), np.empty((len(bundle.xyz), 3, 3))
    point_gradient = np.empty((len(bundle.xyz), 3))
    residual = np.empty((len(point), 2))

    def straight(b: Bundle) -> Float[np.ndarray, "obs 2"]:
        return seen.xy if drift is None else seen.xy + b.readout * drift

    def cost_of(b: Bundle) -> float:
        cost = float(robust_cost(b.intrinsics, b.rotation, b.translation, b.xyz, seen.camera, point, straight(b), scale, residual))
        return cost + (0.5 * prior.precision * (np.log(b.intrinsics[0]) - prior.log_focal) ** 2 if prior else 0.0)

    cost, damping, done = cost_of(bundle), 1e-4, 0
    for iteration in range(max_iterations):
        done = iteration + 1
        gain = 0.0
        while damping < 1e4:
            b = bundle
            reduced_system(
                b.intrinsics, b.rotation, b.translation, b.xyz, seen.first, seen.camera, straight(b), rolled,
                scale, damping, system, gradient, cross, inverse, point_gradient,
            )  # fmt: skip
            if prior:
                system[0, 0] += prior.precision
                gradient[0] += prior.precision * (np.log(b.intrinsics[0]) - prior.log_focal)
            trial = _step(b, seen, active, system, gradient, cross, inverse, point_gradient, damping)
            if trial is not None:
                fresh = cost_of(trial)
                if fresh < cost:
                    gain = cost - fresh
                    bundle, cost, damping = trial, fresh, max(damping / 5.0, 1e-7)
                    break
            damping *= 10.0
        if gain <= tolerance * cost:
            break
    cost = cost_of(bundle)
    return Adjusted(bundle=bundle, cost=cost, residual=residual, iterations=done)


def _active(num_cameras: int, free_focal: bool, radial_terms: int, free_readout: bool) -> Bool[np.ndarray, "unknowns"]:
    active = np.ones(SHARED + 6 * num_cameras, bool)
    active[:SHARED] = [free_focal, radial_terms >= 1, radial_terms >= 2, free_readout]
    return active


def _step(
    b: Bundle,
    seen: Observations,
    active: Bool[np.ndarray, "unknowns"],
    system: Float[np.ndarray, "unknowns unknowns"],
    gradient: Float[np.ndarray, "unknowns"],
    cross: Float[np.ndarray, "obs unknowns_each 3"],
    inverse: Float[np.ndarray, "points 3 3"],
    point_gradient: Float[np.ndarray, "points 3"],
    damping: float,
) -> Bundle | None:
    """The damped step, or None where the system is not definite."""
    use = np.nonzero(active)[0]
    s = system[np.ix_(use, use)]
    diagonal = np.einsum("ii->i", s)
    diagonal *= 1.0 + damping
    diagonal += 1e-9 * np.abs(diagonal).max()
    try:
        solution = scipy.linalg.cho_solve(scipy.linalg.cho_factor(s, lower=True, overwrite_a=True, check_finite=False), -gradient[use], check_finite=False)
    except scipy.linalg.LinAlgError:
        return None
    delta = np.zeros(len(active))
    delta[use] = solution
    per_camera = delta[SHARED:].reshape(-1, 6)
    of_observation = np.concatenate([np.broadcast_to(delta[:SHARED], (len(seen.camera), SHARED)), per_camera[seen.camera]], axis=1)
    pulled = np.einsum("oij,oi->oj", cross, of_observation)
    summed = np.stack([np.bincount(seen.point, pulled[:, k], minlength=len(b.xyz)) for k in range(3)], axis=1)
    rotation = rotations_from_vectors(per_camera[:, :3])
    intrinsics = b.intrinsics.copy()
    zoom = float(np.clip(delta[0], -0.5, 0.5))
    intrinsics[0] *= np.exp(zoom)
    intrinsics[3:] += delta[1:3]
    # Focal and distance trade off along a curve (f / z stays): the second order of the zoom, which a straight step leaves out, goes to the distance. Without
    # it a nearly affine clip creeps by 3 % an iteration.
    middle = b.xyz.mean(axis=0)
    along = np.zeros_like(b.translation)
    along[:, 2] = (np.exp(zoom) - 1.0 - zoom) * (b.rotation[:, 2] @ middle + b.translation[:, 2])
    return replace(
        b,
        intrinsics=intrinsics,
        rotation=rotation @ b.rotation,
        translation=np.einsum("kij,kj->ki", rotation, b.translation) + per_camera[:, 3:] + along,
        xyz=b.xyz - np.einsum("pij,pj->pi", inverse, point_gradient + summed),
        readout=b.readout + float(delta[3]),
    )


def robust_scale(residual: Float[np.ndarray, "obs 2"]) -> float:
    """Standard deviation of a pixel coordinate by the median absolute deviation."""
    return float(1.4826 * np.median(np.abs(residual)))
