"""Corners and planes as a constrained least-squares problem, in a scene moved to the origin and scaled to a diagonal of one.

Parallel faces share a direction, coplanar faces a plane; everything else is an equation. The evidence never ties two unknown things to each other, so the
Hessian is made of 3x3 blocks, and the constraints alone couple planes and corners.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.geometry.plane import tangent_basis
from planewright.optim.losses import cauchy
from planewright.planes.evidence import CornerLines, CornerMarks, CornerPriors, Evidence, PlanePoints
from planewright.planes.structure_constraints import StructureConstraints

# Residual, in standard deviations, of a click whose corner lies behind the camera: finite, so that a bad start is left, and never worth entering.
_BEHIND = 1e3
_NEAREST = 1e-3


class EvidenceScale(NamedTuple):
    """Factors on the sigmas of the four kinds of evidence."""

    plane_points: float = 1.0
    marks: float = 1.0
    lines: float = 1.0
    priors: float = 1.0


@dataclass(frozen=True, eq=False)
class StructureState:
    """Values of the unknowns."""

    directions: Float[np.ndarray, "directions 3"]
    """Unit."""
    offsets: Float[np.ndarray, "planes"]
    """direction . x = offset."""
    points: Float[np.ndarray, "points 3"]

    @cached_property
    def bases(self) -> Float[np.ndarray, "directions 2 3"]:
        """Tangent basis of every direction; asked for several times a step."""
        return tangent_basis(self.directions)


class Terms(NamedTuple):
    """Whitened residuals of one kind of evidence, each of 1 to 3 numbers, and their derivatives by the plane or corner they belong to."""

    owner: Int[np.ndarray, "terms"]
    residual: Float[np.ndarray, "terms numbers"]
    jacobian: Float[np.ndarray, "terms numbers 3"]
    firm: Bool[np.ndarray, "terms"] | None = None
    """Terms with a plain square loss."""

    def losses(self, scale: float) -> tuple[Float[np.ndarray, "terms"], Float[np.ndarray, "terms"]]:
        """Loss and weight of every term: Cauchy's, which bends at `scale` standard deviations, or the square."""
        square = (self.residual**2).sum(axis=1)
        loss, weight = cauchy(square, scale)
        if self.firm is None:
            return loss, weight
        return np.where(self.firm, square, loss), np.where(self.firm, 1.0, weight)


@runtime_checkable
class _AddTilt(Protocol):
    def __call__(self, row: Int[np.ndarray, "k"], plane: Int[np.ndarray, "k"], by_normal: Float[np.ndarray, "k 3"]) -> None:
        """Add the derivative of rows by the normals of planes to the Jacobian."""
        ...


@dataclass(frozen=True, eq=False)
class StructureProblem:
    """Implements `ConstrainedProblem`. Unknowns: two tilts a direction, an offset a plane, three coordinates a corner, in this order."""

    plane_direction: Int[np.ndarray, "planes"]
    """Direction row of each plane."""
    incidences: Int[np.ndarray, "incidences 2"]
    """Plane row and corner row, no pair twice."""
    evidence: Evidence
    """In the scaled scene; `plane_points.face` holds plane rows."""
    constraints_given: StructureConstraints
    """Rows of planes in place of rows of faces; cosines with their sign."""
    anchor: StructureState
    """Centre of the weak prior that keeps what nothing else holds."""
    ridge: float
    """Information of the weak prior, per unit squared."""
    loss_scale: float
    scale: EvidenceScale

    @property
    def num_unknowns(self) -> int:
        return 2 * len(self.anchor.directions) + len(self.anchor.offsets) + 3 * len(self.anchor.points)

    def tilt_columns(self, direction: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k 2"]:
        return 2 * direction[:, None] + np.arange(2)

    def offset_columns(self, plane: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k"]:
        return 2 * len(self.anchor.directions) + plane

    def point_columns(self, corner: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k 3"]:
        return 2 * len(self.anchor.directions) + len(self.anchor.offsets) + 3 * corner[:, None] + np.arange(3)

    def plane_columns(self) -> Int[np.ndarray, "planes 3"]:
        """Columns of the tilts and the offset of every plane."""
        planes = np.arange(len(self.plane_direction))
        return np.column_stack([self.tilt_columns(self.plane_direction), self.offset_columns(planes)])

    def move(self, state: StructureState, step: Float[np.ndarray, "n"]) -> StructureState:
        """Tilts turn the directions (renormalized), the rest is added."""
        num_directions, num_planes = len(state.directions), len(state.offsets)
        tilt = step[: 2 * num_directions].reshape(-1, 2)
        turned = state.directions + np.einsum("dk,dkj->dj", tilt, state.bases)
        return StructureState(
            directions=turned / np.linalg.norm(turned, axis=1, keepdims=True),
            offsets=state.offsets + step[2 * num_directions : 2 * num_directions + num_planes],
            points=state.points + step[2 * num_directions + num_planes :].reshape(-1, 3),
        )

    def terms(self, state: StructureState) -> tuple[Terms, Terms, Terms, Terms]:
        """All evidence at a state, in the order of `EvidenceScale`."""
        normals = state.directions[self.plane_direction]
        bases = state.bases[self.plane_direction]
        return (
            _plane_point_terms(self.evidence.plane_points, normals, bases, state.offsets, self.scale.plane_points),
            _mark_terms(self.evidence.marks, state.points, self.scale.marks),
            _line_terms(self.evidence.lines, state.points, self.scale.lines),
            _prior_terms(self.evidence.priors, state.points, self.scale.priors),
        )

    def cost(self, state: StructureState) -> float:
        """Half the sum of Cauchy losses, and the weak prior."""
        total = 0.0
        for term in self.terms(state):
            loss, _ = term.losses(self.loss_scale)
            total += float(loss.sum())
        away = self._away(state)
        return 0.5 * (total + self.ridge * float(away @ away))

    def _away(self, state: StructureState) -> Float[np.ndarray, "n"]:
        tilt = np.einsum("dj,dkj->dk", state.directions - self.anchor.directions, state.bases)
        return np.concatenate([tilt.ravel(), state.offsets - self.anchor.offsets, (state.points - self.anchor.points).ravel()])

    def normal_equations(self, state: StructureState) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n n"]]:
        """Gradient and reweighted Gauss-Newton Hessian."""
        n = self.num_unknowns
        gradient, hessian = self.ridge * self._away(state), np.diag(np.full(n, self.ridge))
        plane_terms, *corner_terms = self.terms(state)
        corners = np.arange(len(state.points))
        for columns, terms in [(self.plane_columns(), plane_terms), *((self.point_columns(corners), terms) for terms in corner_terms)]:
            if len(terms.owner) == 0:
                continue
            _, weight = terms.losses(self.loss_scale)
            slope = np.einsum("t,tr,tri->ti", weight, terms.residual, terms.jacobian)
            blocks = np.einsum("t,tri,trj->tij", weight, terms.jacobian, terms.jacobian)
            count = len(columns)
            for i in range(3):
                np.add.at(gradient, columns[:, i], np.bincount(terms.owner, slope[:, i], count))
                for j in range(3):
                    np.add.at(hessian, (columns[:, i], columns[:, j]), np.bincount(terms.owner, blocks[:, i, j], count))
        return gradient, hessian

    def constraints(self, state: StructureState) -> Float[np.ndarray, "rows"]:
        """Incidences, angles, lengths, fixed vectors, edges, mirrors, in this order."""
        given, points = self.constraints_given, state.points
        normals = state.directions[self.plane_direction]
        plane, corner = self.incidences.T
        rows = [(normals[plane] * points[corner]).sum(axis=1) - state.offsets[plane]]
        if len(given.angle_faces):
            a, b = given.angle_faces.T
            rows.append((normals[a] * normals[b]).sum(axis=1) - given.angle_cosine)
        if len(given.equal_length):
            i, j, k, m = given.equal_length.T
            rows.append(((points[i] - points[j]) ** 2).sum(axis=1) - ((points[k] - points[m]) ** 2).sum(axis=1))
        if len(given.across_face):
            rows.append((normals[given.across_face] * given.across_vector).sum(axis=1))
        if len(given.across_edge):
            face, i, j = given.across_edge.T
            rows.append((normals[face] * (points[j] - points[i])).sum(axis=1))
        if len(given.along_edge):
            face, i, j = given.along_edge.T
            rows.append(np.cross(normals[face], points[j] - points[i]).ravel())
        if len(given.mirror):
            a, b, c = given.mirror.T
            mirrored, offset = _mirrored(normals, state.offsets, a, c)
            rows.append(np.cross(normals[b], mirrored).ravel())
            rows.append((normals[b] * mirrored).sum(axis=1) * state.offsets[b] - offset)
        return np.concatenate(rows)

    def constraint_jacobian(self, state: StructureState) -> Float[np.ndarray, "rows n"]:
        """Derivative of `constraints`."""
        given, points = self.constraints_given, state.points
        normals = state.directions[self.plane_direction]
        bases = state.bases[self.plane_direction]
        counts = [len(self.incidences), len(given.angle_faces), len(given.equal_length), len(given.across_face), len(given.across_edge)]
        total = sum(counts) + 3 * len(given.along_edge) + 4 * len(given.mirror)
        out = np.zeros((total, self.num_unknowns))

        def add_tilt(row: Int[np.ndarray, "k"], plane: Int[np.ndarray, "k"], by_normal: Float[np.ndarray, "k 3"]) -> None:
            np.add.at(out, (row[:, None], self.tilt_columns(self.plane_direction[plane])), np.einsum("kij,kj->ki", bases[plane], by_normal))

        def add_point(row: Int[np.ndarray, "k"], corner: Int[np.ndarray, "k"], by_point: Float[np.ndarray, "k 3"]) -> None:
            np.add.at(out, (row[:, None], self.point_columns(corner)), by_point)

        starts = np.concatenate([[0], np.cumsum(counts)])
        rows = [np.arange(starts[i], starts[i + 1]) for i in range(len(counts))]
        plane, corner = self.incidences.T
        add_tilt(rows[0], plane, points[corner])
        add_point(rows[0], corner, normals[plane])
        out[rows[0], self.offset_columns(plane)] = -1.0
        if len(given.angle_faces):
            a, b = given.angle_faces.T
            add_tilt(rows[1], a, normals[b])
            add_tilt(rows[1], b, normals[a])
        if len(given.equal_length):
            i, j, k, m = given.equal_length.T
            first, second = 2.0 * (points[i] - points[j]), 2.0 * (points[k] - points[m])
            for end, by_point in ((i, first), (j, -first), (k, -second), (m, second)):
                add_point(rows[2], end, by_point)
        if len(given.across_face):
            add_tilt(rows[3], given.across_face, given.across_vector)
        if len(given.across_edge):
            face, i, j = given.across_edge.T
            add_tilt(rows[4], face, points[j] - points[i])
            add_point(rows[4], j, normals[face])
            add_point(rows[4], i, -normals[face])
        if len(given.along_edge):
            row = int(starts[-1]) + 3 * np.arange(len(given.along_edge))
            face, i, j = given.along_edge.T
            for axis in range(3):
                unit = np.eye(3)[axis]
                # (n x e) . unit = n . (e x unit) = e . (unit x n)
                add_tilt(row + axis, face, np.cross(points[j] - points[i], unit))
                add_point(row + axis, j, np.cross(unit, normals[face]))
                add_point(row + axis, i, -np.cross(unit, normals[face]))
        if len(given.mirror):
            self._mirror_jacobian(state, int(starts[-1]) + 3 * len(given.along_edge), add_tilt, out)
        return out

    def _mirror_jacobian(self, state: StructureState, first_row: int, add_tilt: _AddTilt, out: Float[np.ndarray, "rows n"]) -> None:
        given = self.constraints_given
        normals = state.directions[self.plane_direction]
        a, b, c = given.mirror.T
        mirrored, _ = _mirrored(normals, state.offsets, a, c)
        dot_ac = (normals[a] * normals[c]).sum(axis=1, keepdims=True)
        row = first_row + 3 * np.arange(len(a))
        for axis in range(3):
            unit = np.eye(3)[axis]
            add_tilt(row + axis, b, np.cross(mirrored, unit))
            by_mirrored = np.cross(unit, normals[b])
            by_c = (by_mirrored * normals[c]).sum(axis=1, keepdims=True)
            add_tilt(row + axis, a, by_mirrored - 2.0 * by_c * normals[c])
            add_tilt(row + axis, c, -2.0 * (by_c * normals[a] + dot_ac * by_mirrored))
        row = first_row + 3 * len(a) + np.arange(len(a))
        dot_b = (normals[b] * mirrored).sum(axis=1)
        offset_b, offset_c = state.offsets[b][:, None], state.offsets[c][:, None]
        add_tilt(row, b, offset_b * mirrored)
        by_c = (normals[b] * normals[c]).sum(axis=1, keepdims=True)
        add_tilt(row, a, offset_b * (normals[b] - 2.0 * by_c * normals[c]) + 2.0 * offset_c * normals[c])
        add_tilt(row, c, -2.0 * offset_b * (by_c * normals[a] + dot_ac * normals[b]) + 2.0 * offset_c * normals[a])
        np.add.at(out, (row, self.offset_columns(b)), dot_b)
        np.add.at(out, (row, self.offset_columns(a)), -1.0)
        np.add.at(out, (row, self.offset_columns(c)), 2.0 * dot_ac[:, 0])


def _mirrored(
    normals: Float[np.ndarray, "planes 3"], offsets: Float[np.ndarray, "planes"], a: Int[np.ndarray, "k"], c: Int[np.ndarray, "k"]
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k"]]:
    """Planes a mirrored in planes c: n_a - 2 (n_a . n_c) n_c and d_a - 2 (n_a . n_c) d_c."""
    dot = (normals[a] * normals[c]).sum(axis=1)
    return normals[a] - 2.0 * dot[:, None] * normals[c], offsets[a] - 2.0 * dot * offsets[c]


def _plane_point_terms(
    given: PlanePoints,
    normals: Float[np.ndarray, "planes 3"],
    bases: Float[np.ndarray, "planes 2 3"],
    offsets: Float[np.ndarray, "planes"],
    factor: float,
) -> Terms:
    sigma = factor * given.sigma
    residual = ((normals[given.face] * given.point).sum(axis=1) - offsets[given.face]) / sigma
    tilt = np.einsum("tij,tj->ti", bases[given.face], given.point)
    jacobian = np.column_stack([tilt, np.full(len(sigma), -1.0)]) / sigma[:, None]
    return Terms(given.face, residual[:, None], jacobian[:, None, :])


def _mark_terms(given: CornerMarks, points: Float[np.ndarray, "points 3"], factor: float) -> Terms:
    sigma = (factor * given.sigma)[:, None]
    projected = np.einsum("tij,tj->ti", given.projection[:, :, :3], points[given.corner]) + given.projection[:, :, 3]
    depth = projected[:, 2:]
    before = depth > _NEAREST
    safe = np.where(before, depth, 1.0)
    seen = projected[:, :2] / safe
    residual = np.where(before, (seen - given.xy) / sigma, np.array([_BEHIND, 0.0]))
    jacobian = (given.projection[:, :2, :3] - seen[:, :, None] * given.projection[:, 2:, :3]) / (safe * sigma)[:, :, None]
    return Terms(given.corner, residual, np.where(before[:, :, None], jacobian, 0.0), given.firm)


def _line_terms(given: CornerLines, points: Float[np.ndarray, "points 3"], factor: float) -> Terms:
    sigma = factor * given.sigma
    residual = ((given.direction * points[given.corner]).sum(axis=1) - given.offset) / sigma
    return Terms(given.corner, residual[:, None], (given.direction / sigma[:, None])[:, None, :])


def _prior_terms(given: CornerPriors, points: Float[np.ndarray, "points 3"], factor: float) -> Terms:
    residual = np.einsum("tij,tj->ti", given.whitening, points[given.corner] - given.mean) / factor
    return Terms(given.corner, residual, given.whitening / factor)
