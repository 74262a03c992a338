"""A thing as it was built: faces a little off from what was meant, corners still exactly on them."""

from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Float, Int
from planewright.geometry.plane import tangent_basis
from planewright.synthetic.scene import Scene, loop_normal


@dataclass(frozen=True, kw_only=True)
class BuildingOptions:
    """How carelessly it was built."""

    tilt_deg: tuple[float, float] = (0.1, 0.22)
    """How far each face is turned, drawn evenly between these, about an axis within the face. Two faces add up to 0.05 to 0.23 degrees (quartiles) off
    what was meant, 0.36 at most; faces hold each other by their corners, so some may turn a little less.
    """
    rounds: int = 20
    """Newton steps; 2 reach the rounding of the arithmetic, but where faces share four corners (a pane in a wall) they come near it slowly: 20 reach 2e-13."""


def _incidences(scene: Scene) -> Int[np.ndarray, "incidences 2"]:
    """Face row and corner row of every corner that lies on a face: drawn there, or standing on it as a chimney's foot does."""
    order = {k: i for i, k in enumerate(scene.points)}
    corners = scene.corner_array(list(scene.points))
    rows: list[tuple[int, int]] = []
    for f, face in enumerate(scene.faces):
        loop = scene.corner_array(face.loop)
        own = {order[k] for k in (*face.loop, *(k for hole in face.holes for k in hole))}
        near = np.abs((corners - loop[0]) @ loop_normal(loop)) < 1e-9 * scene.diagonal
        inside = near & np.all((corners > loop.min(axis=0) - 1e-9) & (corners < loop.max(axis=0) + 1e-9), axis=1)
        rows += [(f, i) for i in sorted(own | set(np.flatnonzero(inside).tolist()))]
    return np.array(rows)


def build_off(scene: Scene, rng: np.random.Generator, options: BuildingOptions = BuildingOptions()) -> Scene:
    """The scene with every face turned a little, and every corner moved as little as keeps it on its faces.

    Corners at z = 0 stay there: the thing stands on the floor. Faces that share three corners off a line stay coplanar, whatever was drawn for them.
    Surfaces that nobody sketched follow where they share a corner. The scene remembers what was meant.

    Least squares with constraints: planes near the turned ones, corners near the meant ones, n . x = d exactly (Newton's steps on the KKT system).
    """
    meant = scene.corner_array(list(scene.points))
    at = _incidences(scene)
    normals = np.array([loop_normal(scene.corner_array(f.loop)) for f in scene.faces])
    basis = tangent_basis(normals)
    middles = np.array([scene.corner_array(f.loop).mean(axis=0) for f in scene.faces])
    num_faces, num_points = len(normals), len(meant)
    way = rng.uniform(0.0, 2 * np.pi, num_faces)
    turn = np.radians(rng.uniform(*options.tilt_deg, num_faces))[:, None] * np.column_stack([np.cos(way), np.sin(way)])
    # A plane is n0 + a b0 + b b1 and an offset c from its face's middle: linear in a, b, c, and never far from a unit normal.
    wanted = np.concatenate([np.column_stack([turn, np.zeros(num_faces)]).ravel(), meant.ravel()])
    # A corner that moves by a share of the diagonal costs as much as a face that turns by a thirtieth of that in radians: the faces lead.
    weight = np.concatenate([np.tile([1.0, 1.0, 1e-3], num_faces), np.full(3 * num_points, 1e-3 / scene.diagonal**2)])
    feet = np.flatnonzero(np.abs(meant[:, 2]) < 1e-12)
    value = np.concatenate([np.zeros(3 * num_faces), meant.ravel()])
    f, p = at.T
    rows = np.arange(len(at))
    for _ in range(options.rounds):
        plane, corner = value[: 3 * num_faces].reshape(-1, 3), value[3 * num_faces :].reshape(-1, 3)
        normal = normals + np.einsum("fk,fkj->fj", plane[:, :2], basis)
        away = corner[p] - middles[f]
        wrong = np.concatenate([(normal[f] * away).sum(axis=1) - plane[f, 2], corner[feet, 2]])
        slope = np.zeros((len(at) + len(feet), len(value)))
        for k in range(2):
            slope[rows, 3 * f + k] = (basis[f, k] * away).sum(axis=1)
        slope[rows, 3 * f + 2] = -1.0
        for k in range(3):
            slope[rows, 3 * num_faces + 3 * p + k] = normal[f, k]
        slope[len(at) + np.arange(len(feet)), 3 * num_faces + 3 * feet + 2] = 1.0
        # Minimum of the weighted square under the linearised constraints; redundant ones (faces that share many corners) do no harm to lstsq.
        spread = slope / weight
        multiplier = np.linalg.lstsq(spread @ slope.T, wrong + slope @ (wanted - value), rcond=1e-11)[0]
        value = wanted - spread.T @ multiplier
    return _moved(scene, value[3 * num_faces :].reshape(-1, 3))


def _moved(scene: Scene, corners: Float[np.ndarray, "points 3"]) -> Scene:
    """The scene with its corners elsewhere, and every surface that used one of them."""
    meant = scene.corner_array(list(scene.points))

    def moved(loop: Float[np.ndarray, "corners 3"]) -> Float[np.ndarray, "corners 3"]:
        distance = np.linalg.norm(loop[:, None] - meant, axis=2)
        nearest = distance.argmin(axis=1)
        return np.where((distance.min(axis=1) < 1e-9 * scene.diagonal)[:, None], corners[nearest], loop)

    surfaces = tuple(replace(s, loops=tuple(moved(loop) for loop in s.loops)) if s.part == "thing" else s for s in scene.surfaces)
    points = {k: (float(x), float(y), float(z)) for k, (x, y, z) in zip(scene.points, corners, strict=True)}
    return replace(scene, points=points, surfaces=surfaces, meant=scene.points)
