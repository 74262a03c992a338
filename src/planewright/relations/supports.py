"""Corners that stand on a plane beyond the border drawn of it: the feet of a house on the ground of which a square was drawn before it."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.geometry.plane import tangent_basis
from planewright.planes.structured_bundle import StructureSolution


@dataclass(frozen=True, kw_only=True)
class SupportOptions:
    """When a corner counts as standing on the plane of a face that it was not drawn on."""

    chance: float = 0.1
    """Of a corner to stand on a plane before anything is known of the plane. It is weighed as `weight` corners; those that clearly do or do
    not stand there say the rest."""
    weight: float = 5.0
    """So many corners outweigh that chance."""
    sure: float = 0.8
    """Probability from which a corner is put on the plane."""
    reach: float = 2.5
    """Never where it is further off than this many standard deviations."""
    precise: float = 0.004
    """Corners whose height is at least this sure say whether a plane carries others at all, as a share of the scene's diagonal."""
    witnesses: int = 3
    """So many of them must agree, from at least two faces: one wall more may stand there by chance."""
    share: float = 0.2
    """And so large a share of the corners that might stand on it must: a wall's plane runs by chance through some corner of everything around."""
    behind: float = 0.1
    """Share of corners that may lie behind the plane: one with many on both sides carries nothing."""
    of_face: float = 0.2
    """The height must be surer than this share of how high the corner's faces rise: what might be either end of a face is put nowhere."""
    slant: float = 0.34
    """Sine of the smallest angle between the plane and a face that stands on it; flatter ones are tested as coplanar instead."""


def supported_corners(
    solution: StructureSolution, incidences: Int[np.ndarray, "incidences 2"], as_built: float, options: SupportOptions = SupportOptions()
) -> Int[np.ndarray, "supported 2"]:
    """(face, corner) of corners that stand on the plane of a face; each on one plane only, the surest.

    A plane carries others where all of the scene is on one side of it and several corners that are well located agree with it. How many
    of them do is the prior probability for the rest (a mixture of heights: on the plane, or anywhere in the scene), so that one far corner
    of an uncertain height may be put on the ground where everything else stands, and is not where nothing does.

    Args:
        solution: without these incidences.
        incidences: face row and corner row of those that hold already.
        as_built: standard deviation of a true one, world units.
    """
    num_faces, num_points = len(solution.normals), len(solution.points)
    if not solution.point_known.any() or not np.isfinite(solution.diagonal) or solution.diagonal <= 0:
        return np.zeros((0, 2), dtype=np.int64)
    on = np.zeros((num_faces, num_points), dtype=bool)
    on[incidences[:, 0], incidences[:, 1]] = True
    best = np.full(num_points, options.sure)
    chosen = np.full(num_points, -1)
    for face in np.flatnonzero(solution.face_known).tolist():
        height, sigma = _heights(solution, face, as_built)
        probability = _standing(solution, on, face, height, sigma, options)
        better = probability > best
        best[better], chosen[better] = probability[better], face
    corners = np.flatnonzero(chosen >= 0)
    return np.stack([chosen[corners], corners], axis=1).astype(np.int64)


def height_over(solution: StructureSolution, face: int, corner: int) -> tuple[float, float]:
    """Signed distance of a known corner from the plane of a face, and its variance by the joint covariance; world units."""
    normal, num_faces = solution.normals[face], len(solution.normals)
    reach = solution.points[corner] - solution.centers[face]
    slope = np.concatenate([tangent_basis(normal[None])[0] @ reach, [-1.0], normal])
    columns = np.concatenate([3 * face + np.arange(3), 3 * (num_faces + corner) + np.arange(3)])
    return float(normal @ solution.points[corner] - solution.offsets[face]), float(slope @ solution.covariance[np.ix_(columns, columns)] @ slope)


def _heights(solution: StructureSolution, face: int, as_built: float) -> tuple[Float[np.ndarray, "points"], Float[np.ndarray, "points"]]:
    """Of every corner over the plane of a face, and its standard deviation with the as-built tolerance; infinite where unknown."""
    height, sigma = np.zeros(len(solution.points)), np.full(len(solution.points), np.inf)
    for corner in np.flatnonzero(solution.point_known).tolist():
        gap, variance = height_over(solution, face, corner)
        if np.isfinite(gap) and np.isfinite(variance):
            height[corner], sigma[corner] = gap, np.sqrt(max(variance + as_built**2, 1e-30))
    return height, sigma


def _standing(
    solution: StructureSolution,
    on: Bool[np.ndarray, "faces points"],
    face: int,
    height: Float[np.ndarray, "points"],
    sigma: Float[np.ndarray, "points"],
    options: SupportOptions,
) -> Float[np.ndarray, "points"]:
    """The probability of every corner to stand on the plane of a face; 0 where that is not for this test to say."""
    out = np.zeros(len(height))
    known = np.isfinite(sigma)
    clear = known & (np.abs(height) > 3.0 * sigma) & ~on[face]
    side = np.sign(np.sum(np.sign(height[clear]))) if clear.any() else 0.0
    if side == 0.0 or np.sum(clear & (side * height < 0)) > options.behind * np.sum(clear):
        return out
    parallel = np.abs(solution.normals @ solution.normals[face]) > np.sqrt(1.0 - options.slant**2)
    standing = solution.face_known & ~parallel
    rise = np.array([float(np.abs(height[on[g] & known]).max(initial=0.0)) for g in range(len(on))])
    lowest = np.array([float(np.min(rise[standing & on[:, c]], initial=np.inf)) for c in range(len(height))])
    # corners of a face that is parallel to this one are on this plane or they are not, all together
    may = known & ~on[parallel].any(axis=0) & np.isfinite(lowest) & (sigma < options.of_face * lowest)
    if not may.any():
        return out
    like = np.exp(-0.5 * (height[may] / sigma[may]) ** 2) / (sigma[may] * np.sqrt(2.0 * np.pi))
    other = 1.0 / solution.diagonal
    share, probability = options.chance, np.zeros(int(may.sum()))
    for _ in range(30):
        probability = share * like / (share * like + (1.0 - share) * other)
        share = (options.weight * options.chance + float(probability.sum())) / (options.weight + len(probability))
    probability = np.where(np.abs(height[may]) < options.reach * sigma[may], probability, 0.0)
    witnesses = np.flatnonzero(may)[(probability > options.sure) & (sigma[may] < options.precise * solution.diagonal)]
    faces = np.flatnonzero(standing & on[:, witnesses].any(axis=1))
    if share < options.share or len(witnesses) < options.witnesses or len(faces) < 2:
        return out
    out[may] = probability
    return out
