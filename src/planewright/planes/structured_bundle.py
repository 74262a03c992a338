"""The structured adjustment: corners and planes from evidence, with incidences and relations exact; the cameras are given."""

from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.geometry.plane import tangent_basis
from planewright.optim.constrained import ConstrainedOptions, constrained_covariance, minimize_constrained
from planewright.optim.losses import robust_scale
from planewright.planes.evidence import CornerLines, CornerPriors, Evidence, PlanePoints
from planewright.planes.held import Held, part_of
from planewright.planes.planar_start import PlanarStart, complete_start
from planewright.planes.structure_constraints import StructureConstraints, group_faces
from planewright.planes.structure_problem import EvidenceScale, StructureProblem, StructureState, Terms


@dataclass(frozen=True, kw_only=True)
class StructureOptions:
    """How corners and planes are adjusted."""

    loss_scale: float = 3.0
    """Where the Cauchy loss of the evidence bends, in standard deviations. Two corners 6 px off then cost little (recall .99 against .9 without)."""
    step_tolerance: float = 1e-6
    """Stop below this step: radians, and shares of the scene's diagonal. A tenth of what the best planes are good for is 1e-5."""
    max_iterations: int = 60
    """Most steps."""
    unknown_point: float = 0.1
    """A corner whose standard deviation is above this share of the scene's diagonal counts as unknown."""
    unknown_tilt_deg: float = 12.0
    """A plane whose normal is less certain than this (standard deviation, degrees) counts as unknown."""


# Standard deviation of the weak prior about the start that keeps what no evidence holds: a hundred diagonals or radians. Beside the weakest useful evidence
# (a tenth of a diagonal) it moves nothing by more than 1e-6 of its sigma.
_WEAK_PRIOR = 100.0


@dataclass(frozen=True, eq=False)
class StructureSolution:
    """Corners and planes in the world, with their joint uncertainty."""

    points: Float[np.ndarray, "points 3"]
    point_known: Bool[np.ndarray, "points"]
    normals: Float[np.ndarray, "faces 3"]
    """Unit; every face has a finite value, which means nothing where `face_known` is False."""
    offsets: Float[np.ndarray, "faces"]
    face_known: Bool[np.ndarray, "faces"]
    centers: Float[np.ndarray, "faces 3"]
    """Mean of each face's known corners, put on its plane; offsets are uncertain by `covariance` there."""
    covariance: Float[np.ndarray, "unknowns unknowns"]
    """Joint: 3 rows a face (tilt in radians along each row of `tangent_basis(normal)`, offset at `centers`), then 3 rows a corner (world units)."""
    cost: float
    """Half the sum of robust losses of the whitened evidence; differences are comparable between solutions of the same evidence and scales."""
    point_residual: Float[np.ndarray, "points"]
    """Root mean square of each corner's whitened residuals (clicks, lines, priors); 0 without any."""
    face_residual: Float[np.ndarray, "faces"]
    """The same of each face's points of evidence."""
    face_plane: Int[np.ndarray, "faces"]
    """Smallest face row of those that share each face's plane."""
    face_direction: Int[np.ndarray, "faces"]
    """Smallest face row of those that share each face's direction."""
    scale: EvidenceScale
    """Factors on the sigmas of the evidence that this solution used."""
    estimated_scale: EvidenceScale
    """Factors at which the residuals would be as large as claimed, at least 1; 1 where there is too little redundancy to tell."""
    diagonal: float
    """Of the scene's bounding box, world units."""
    feasible: bool
    """False where the constraints contradict each other; values are then the least-squares compromise and no covariance is meant."""
    converged: bool
    iterations: int
    violation: float
    """Largest violation of a constraint in the scaled scene."""
    num_redundant: int
    """Constraints that follow from the others."""

    @property
    def plane_covariance(self) -> Float[np.ndarray, "planes3 planes3"]:
        """The planes' part of `covariance`."""
        return self.covariance[: 3 * len(self.normals), : 3 * len(self.normals)]

    @property
    def point_covariance(self) -> Float[np.ndarray, "points 3 3"]:
        """The corners' own blocks of `covariance`."""
        first = 3 * len(self.normals)
        blocks = self.covariance[first:, first:].reshape(len(self.points), 3, len(self.points), 3)
        return np.ascontiguousarray(np.einsum("iaib->iab", blocks))

    @property
    def normal_sigma(self) -> Float[np.ndarray, "faces"]:
        """Standard deviation of the normal along its worse axis, radians."""
        blocks = self.plane_covariance.reshape(len(self.normals), 3, len(self.normals), 3)
        return np.sqrt(np.maximum(np.linalg.eigvalsh(np.einsum("fafb->fab", blocks)[:, :2, :2])[:, 1], 0.0))


def solve_structure(
    start: PlanarStart,
    incidences: Int[np.ndarray, "incidences 2"],
    evidence: Evidence,
    constraints: StructureConstraints = StructureConstraints(),
    options: StructureOptions = StructureOptions(),
    *,
    scale: EvidenceScale = EvidenceScale(),
    held: Held | None = None,
) -> StructureSolution:
    """Corners and planes of least robust cost, with every incidence and relation exact.

    Faces that the drawing forces into one plane share one (`group_faces`). Corners and planes without evidence keep a value and a huge standard deviation,
    and are flagged unknown. The result does not depend on the scene's unit, origin or turn beyond rounding.

    Args:
        start: first values; unknown ones are completed from the evidence.
        incidences: face row and corner row of every corner that lies on a face, drawn or found.
        constraints: relations of faces and corners.
        scale: factors on the sigmas of the evidence.
        held: corners and faces that stay where `start` has them, up to rounding. The covariance is that of everything free.
    """
    incidences = np.unique(incidences, axis=0).reshape(-1, 2)
    full = complete_start(start, incidences, evidence)
    middle, diagonal = _extent(start, full, evidence)
    direction_root, plane_root = group_faces(full.points, full.normals, incidences, constraints)
    problem, state, face_plane, sign = _scaled_problem(full, incidences, evidence, constraints, options, scale, middle, diagonal, direction_root, plane_root)
    solver = ConstrainedOptions(step_tolerance=options.step_tolerance, max_iterations=options.max_iterations)
    found = minimize_constrained(problem if held is None else part_of(problem, held, face_plane), state, solver)
    state = found.state
    points = middle + diagonal * state.points
    normals = sign[:, None] * state.directions[problem.plane_direction[face_plane]]
    offsets = sign * diagonal * state.offsets[face_plane] + normals @ middle
    size = problem.num_unknowns
    inner = constrained_covariance(problem, state, solver) if found.feasible else np.zeros((size, size))
    terms = problem.terms(state)
    corner_sigma = np.sqrt(np.maximum([inner[c, c].sum() for c in problem.point_columns(np.arange(len(points)))], 0.0))
    point_known = (corner_sigma < options.unknown_point) & np.isfinite(points).all(axis=1)
    centers = _centers(points, point_known, normals, offsets, incidences, middle)
    covariance = _world_covariance(problem, inner, face_plane, sign, normals, (centers - middle) / diagonal, diagonal)
    solution = StructureSolution(
        points=points,
        point_known=point_known,
        normals=normals,
        offsets=offsets,
        face_known=np.ones(len(normals), dtype=bool),
        centers=centers,
        covariance=covariance,
        cost=found.cost,
        point_residual=_rms(terms[1:], len(points)),
        face_residual=_rms(terms[:1], len(state.offsets))[face_plane],
        face_plane=plane_root,
        face_direction=direction_root,
        scale=scale,
        estimated_scale=_estimated_scale(problem, inner, terms) if found.feasible else scale,
        diagonal=diagonal,
        feasible=found.feasible,
        converged=found.converged,
        iterations=found.iterations,
        violation=found.violation,
        num_redundant=found.num_redundant,
    )
    offset_sigma = np.sqrt(np.maximum(np.diag(covariance)[2 : 3 * len(normals) : 3], 0.0))
    known = (solution.normal_sigma < np.radians(options.unknown_tilt_deg)) & (offset_sigma < options.unknown_point * diagonal)
    return replace(solution, face_known=known)


def _extent(start: PlanarStart, full: PlanarStart, evidence: Evidence) -> tuple[Float[np.ndarray, "3"], float]:
    """Middle and diagonal of the bounding box of the known corners, or of the evidence where fewer than two are known."""
    known = start.point_known & np.isfinite(full.points).all(axis=1)
    cloud = full.points[known]
    if len(cloud) < 2:
        cloud = np.concatenate([cloud, evidence.plane_points.point, evidence.priors.mean, full.points])
    low, high = cloud.min(axis=0, initial=np.inf), cloud.max(axis=0, initial=-np.inf)
    if not np.isfinite(low).all():
        return np.zeros(3), 1.0
    return 0.5 * (low + high), float(np.linalg.norm(high - low)) or 1.0


def _scaled_problem(
    full: PlanarStart,
    incidences: Int[np.ndarray, "incidences 2"],
    evidence: Evidence,
    constraints: StructureConstraints,
    options: StructureOptions,
    scale: EvidenceScale,
    middle: Float[np.ndarray, "3"],
    diagonal: float,
    direction_root: Int[np.ndarray, "faces"],
    plane_root: Int[np.ndarray, "faces"],
) -> tuple[StructureProblem, StructureState, Int[np.ndarray, "faces"], Float[np.ndarray, "faces"]]:
    """The problem, its first state, the plane row of every face and the sign of its normal against its direction."""
    roots, face_direction = np.unique(direction_root, return_inverse=True)
    plane_roots, face_plane = np.unique(plane_root, return_inverse=True)
    sign = np.where((full.normals * full.normals[direction_root]).sum(axis=1) < 0.0, -1.0, 1.0)
    directions = np.zeros((len(roots), 3))
    np.add.at(directions, face_direction, sign[:, None] * full.normals)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    _part(directions, face_direction[constraints.angle_faces].reshape(-1, 2), constraints.angle_cosine)
    heights = sign * (full.offsets - full.normals @ middle) / diagonal
    offsets = np.bincount(face_plane, heights, len(plane_roots)) / np.maximum(np.bincount(face_plane, minlength=len(plane_roots)), 1)
    state = StructureState(directions, offsets, (full.points - middle) / diagonal)
    plane_direction = face_direction[plane_roots]
    cosine = constraints.angle_cosine.copy()
    a, b = face_plane[constraints.angle_faces].reshape(-1, 2).T
    cosine *= np.where((directions[plane_direction[a]] * directions[plane_direction[b]]).sum(axis=1) < 0.0, -1.0, 1.0)
    on_plane = np.unique(np.column_stack([face_plane[incidences[:, 0]], incidences[:, 1]]), axis=0).reshape(-1, 2)
    problem = StructureProblem(
        plane_direction=plane_direction,
        incidences=on_plane,
        evidence=_scaled_evidence(evidence, face_plane, middle, diagonal),
        constraints_given=replace(
            constraints,
            angle_faces=np.column_stack([a, b]),
            angle_cosine=cosine,
            across_face=face_plane[constraints.across_face],
            across_edge=_with_planes(constraints.across_edge, face_plane),
            along_edge=_with_planes(constraints.along_edge, face_plane),
            mirror=face_plane[constraints.mirror].reshape(-1, 3),
        ),
        anchor=state,
        ridge=_WEAK_PRIOR**-2,
        loss_scale=options.loss_scale,
        scale=scale,
    )
    return problem, state, face_plane, sign


def _part(directions: Float[np.ndarray, "directions 3"], pairs: Int[np.ndarray, "angles 2"], cosine: Float[np.ndarray, "angles"]) -> None:
    """Turn directions that start parallel and are to enclose an angle apart by 40 degrees, in place: the angle has no slope where it is zero."""
    for (a, b), wanted in zip(pairs.tolist(), cosine.tolist(), strict=True):
        if a != b and abs(directions[a] @ directions[b]) > 0.95 and wanted < 0.8:
            side = tangent_basis(directions[a][None])[0, 0]
            directions[b] = np.cos(np.radians(40.0)) * directions[b] + np.sin(np.radians(40.0)) * side
            directions[b] /= np.linalg.norm(directions[b])


def _with_planes(rows: Int[np.ndarray, "k 3"], face_plane: Int[np.ndarray, "faces"]) -> Int[np.ndarray, "k 3"]:
    return np.column_stack([face_plane[rows[:, 0]], rows[:, 1:]])


def _scaled_evidence(evidence: Evidence, face_plane: Int[np.ndarray, "faces"], middle: Float[np.ndarray, "3"], diagonal: float) -> Evidence:
    """The evidence in the scaled scene: x_world = middle + diagonal * x."""
    points, marks, lines, priors = evidence.plane_points, evidence.marks, evidence.lines, evidence.priors
    # Scaled so that the third coordinate is the depth, whatever factor the projection came with.
    projection = marks.projection / np.linalg.norm(marks.projection[:, 2, :3], axis=1)[:, None, None]
    shifted = (projection[:, :, :3] @ middle + projection[:, :, 3]) / diagonal
    projection = np.concatenate([projection[:, :, :3], shifted[:, :, None]], axis=2)
    return Evidence(
        PlanePoints(face_plane[points.face], (points.point - middle) / diagonal, points.sigma / diagonal),
        replace(marks, projection=projection),
        CornerLines(lines.corner, lines.direction, (lines.offset - lines.direction @ middle) / diagonal, lines.sigma / diagonal),
        CornerPriors(priors.corner, (priors.mean - middle) / diagonal, priors.whitening * diagonal),
    )


def _centers(
    points: Float[np.ndarray, "points 3"],
    known: Bool[np.ndarray, "points"],
    normals: Float[np.ndarray, "faces 3"],
    offsets: Float[np.ndarray, "faces"],
    incidences: Int[np.ndarray, "incidences 2"],
    middle: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "faces 3"]:
    """Mean of every face's known corners (the middle of the scene where it has none), put on its plane."""
    use = incidences[known[incidences[:, 1]]]
    count = np.bincount(use[:, 0], minlength=len(normals))
    mean = np.zeros_like(normals)
    np.add.at(mean, use[:, 0], points[use[:, 1]])
    mean = np.where(count[:, None] > 0, mean / np.maximum(count, 1)[:, None], middle)
    return mean - ((mean * normals).sum(axis=1) - offsets)[:, None] * normals


def _world_covariance(
    problem: StructureProblem,
    inner: Float[np.ndarray, "n n"],
    face_plane: Int[np.ndarray, "faces"],
    sign: Float[np.ndarray, "faces"],
    normals: Float[np.ndarray, "faces 3"],
    centers: Float[np.ndarray, "faces 3"],
    diagonal: float,
) -> Float[np.ndarray, "unknowns unknowns"]:
    """The covariance of faces and corners from that of the unknowns; a face's offset is taken at its centre (scaled scene)."""
    num_faces, num_points = len(normals), len(problem.anchor.points)
    out_from_inner = np.zeros((3 * (num_faces + num_points), problem.num_unknowns))
    own, shared = tangent_basis(normals), tangent_basis(sign[:, None] * normals)
    columns = problem.plane_columns()[face_plane]
    for f in range(num_faces):
        by_tilt = sign[f] * shared[f].T
        out_from_inner[3 * f : 3 * f + 2, columns[f, :2]] = own[f] @ by_tilt
        out_from_inner[3 * f + 2, columns[f, :2]] = -diagonal * (centers[f] @ by_tilt)
        out_from_inner[3 * f + 2, columns[f, 2]] = diagonal * sign[f]
    point_columns = problem.point_columns(np.arange(num_points)).ravel()
    out_from_inner[3 * num_faces + np.arange(3 * num_points), point_columns] = diagonal
    return out_from_inner @ inner @ out_from_inner.T


def _rms(kinds: tuple[Terms, ...], count: int) -> Float[np.ndarray, "count"]:
    """Root mean square of the numbers of the terms of each owner."""
    total, numbers = np.zeros(count), np.zeros(count)
    for terms in kinds:
        total += np.bincount(terms.owner, (terms.residual**2).sum(axis=1), count)
        numbers += np.bincount(terms.owner, minlength=count) * terms.residual.shape[1]
    return np.sqrt(total / np.maximum(numbers, 1.0))


def _estimated_scale(problem: StructureProblem, inner: Float[np.ndarray, "n n"], terms: tuple[Terms, Terms, Terms, Terms]) -> EvidenceScale:
    """Robust scale of each kind of evidence from the residuals and the freedom the fit left them, times the scale used."""
    corners = problem.point_columns(np.arange(len(problem.anchor.points)))
    scales: list[float] = []
    for columns, kind, used in zip([problem.plane_columns(), corners, corners, corners], terms, problem.scale, strict=True):
        size = kind.residual.shape[1]
        block = inner[columns[:, :, None], columns[:, None, :]]
        freedom = 1.0 - np.einsum("tri,tij,trj->t", kind.jacobian, block[kind.owner], kind.jacobian) / size
        # Terms that the fit absorbs almost wholly say nothing about the noise.
        use = freedom > 0.3
        if np.count_nonzero(use) < 12:
            scales.append(used)
            continue
        scales.append(max(1.0, used * robust_scale((kind.residual[use] ** 2).sum(axis=1), freedom[use], size)))
    return EvidenceScale(*scales)
