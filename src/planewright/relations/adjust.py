"""The walk of the structure: solve freely, find relations, enforce them, solve again, give up what costs too much."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2
from threadpoolctl import threadpool_limits

from planewright.arrays import Bool, Float, Int
from planewright.planes.basis import Basis
from planewright.planes.evidence import Evidence, PlanePoints
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.planar_start import PlanarStart
from planewright.planes.structure_constraints import StructureConstraints
from planewright.planes.structure_problem import EvidenceScale
from planewright.planes.structured_bundle import StructureOptions, StructureSolution, solve_structure
from planewright.progress import Progress, silent
from planewright.relations.adjacency import Adjacency, adjacent_faces
from planewright.relations.detect import Detection, DetectOptions, Pair, PairTest, detect_relations
from planewright.relations.enforce import join_constraints, pair_constraints
from planewright.relations.explain import list_relations
from planewright.relations.relation import Relation
from planewright.relations.require import Requirements, obey_requirements
from planewright.relations.supports import SupportOptions, height_over, supported_corners
from planewright.sketch.graph import FaceId, Sketch


@dataclass(frozen=True, kw_only=True)
class AdjustOptions:
    """The structured adjustment and its relations."""

    structure: StructureOptions = field(default_factory=StructureOptions)
    """The adjustment itself."""
    detect: DetectOptions = field(default_factory=DetectOptions)
    """What counts as a relation."""
    supports: SupportOptions = field(default_factory=SupportOptions)
    """What counts as a corner that stands on a plane beyond its drawn border."""
    find_relations: bool = True
    """False enforces only what the person requires and what the drawing forces, and puts no corner on a plane beyond its border."""
    rescale_above: float = 1.25
    """Sigmas of a kind of evidence are enlarged where its residuals are this many times larger than claimed. The estimate scatters by a tenth."""
    largest_rescale: float = 4.0
    """Never enlarged by more than this."""
    overrule_above: float = 25.0
    """The measured plane of a face is left out where it adds this much more to twice the cost than its noise explains. True ones stay below 8 in
    simulation, planes measured 15 degrees off (of what stands in front of a face) are above 40."""
    max_overruled: int = 3
    """Most faces whose measured plane is left out."""
    max_releases: int = 4
    """Most relations given up after the fact, each followed by a new search without it."""


@dataclass(frozen=True, eq=False)
class Structured:
    """What the structured adjustment found."""

    scene: PlanarScene
    relations: tuple[Relation, ...]
    adjacency: tuple[Adjacency, ...]
    incidences: Int[np.ndarray, "incidences 2"]
    """Face row and corner row of all incidences that hold exactly: the drawn ones, those proposed ones that agree with the views, then corners
    that stand on planes beyond their drawn border."""
    refused_incidences: Int[np.ndarray, "refused 2"]
    """Proposed ones that do not."""
    overruled_planes: tuple[FaceId, ...]
    """Faces whose measured plane contradicts their corners and neighbours and was left out."""
    solution: StructureSolution
    """The final solution, with residuals and the joint covariance."""
    free: StructureSolution
    """The solution before any relation."""
    basis: Basis
    """What the final solution was solved from."""
    cost_of_relations: float
    """What all relations together add to twice the cost; about the number of things they fix where they are true."""
    warnings: tuple[str, ...]


def adjust_structure(
    sketch: Sketch,
    start: PlanarStart,
    evidence: Evidence,
    incidences: Int[np.ndarray, "incidences 2"],
    options: AdjustOptions = AdjustOptions(),
    *,
    progress: Progress = silent,
) -> Structured:
    """Corners, planes and relations of a sketch.

    Args:
        sketch: with all its faces; rows of everything else are its rows.
        start: first values of corners and planes, with flags for what is known.
        evidence: what the images say.
        incidences: face row and corner row of corners that lie on planes. Corners of a face's own loop and holes always do; further pairs are proposals, kept
            where they agree with the views.
    """
    title = "Adjusting corners and planes"
    # Small dense matrices: more threads only wait for each other (7.8 s against .33 s on busy cores), and their number would show in the last bits.
    with threadpool_limits(limits=1, user_api="blas"):
        progress(title, 0, 4)
        walk = _Walk(start, evidence, options.structure)
        drawn = _drawn_incidences(sketch)
        walk.incidences = drawn
        free = walk.solve(StructureConstraints())
        refused = np.zeros((0, 2), dtype=np.int64)
        proposed = np.array(sorted(set(map(tuple, incidences.tolist())) - set(map(tuple, drawn.tolist()))), dtype=np.int64).reshape(-1, 2)
        if len(proposed):
            agree = _agree(proposed, free, options.detect)
            refused = proposed[~agree]
            walk.incidences = np.concatenate([drawn, proposed[agree]])
            free = walk.solve(StructureConstraints())
        standing = (
            supported_corners(free, walk.incidences, options.detect.as_built_offset * free.diagonal, options.supports) if options.find_relations else drawn[:0]
        )
        if len(standing):
            walk.incidences = np.concatenate([walk.incidences, standing])
            free = walk.solve(StructureConstraints())
        scale = _enlarged(free.estimated_scale, options)
        if scale != free.scale:
            walk.scale = scale
            free = walk.solve(StructureConstraints())
        free, overruled = _overrule_planes(walk, free, options)
        progress(title, 1, 4)
        required, base = obey_requirements(sketch, free, walk.solve, walk.feasible, options.detect)
        progress(title, 2, 4)
        found, final, released = _consolidate(walk, base, required, options)
        progress(title, 3, 4)
        relations = list_relations(sketch, free, final, required, found, released, options.detect)
        scene = _scene(sketch, final)
        adjacency = adjacent_faces(sketch, final)
        steps = () if found is None else found.accepted
        constraints = join_constraints([required.constraints, pair_constraints((step.kind, step.a, step.b) for step in steps)])
        progress(title, 4, 4)
    return Structured(
        scene=scene,
        relations=relations,
        adjacency=adjacency,
        incidences=walk.incidences,
        refused_incidences=refused,
        overruled_planes=tuple(sketch.faces[f].id for f in overruled),
        solution=final,
        free=free,
        basis=Basis(walk.evidence, walk.incidences, constraints, (final.scale.plane_points, final.scale.marks, final.scale.lines, final.scale.priors)),
        cost_of_relations=2.0 * (final.cost - free.cost),
        warnings=_warnings(sketch, free, final, required, refused, overruled),
    )


class _Walk:
    """The solver with its evidence; each solution is the next one's start."""

    def __init__(self, start: PlanarStart, evidence: Evidence, options: StructureOptions) -> None:
        self._evidence, self._options = evidence, options
        self._start = start
        self.incidences = np.zeros((0, 2), dtype=np.int64)
        self.scale = EvidenceScale()

    def solve(self, constraints: StructureConstraints) -> StructureSolution:
        """The optimum; the start moves there where it is feasible."""
        solution = solve_structure(self._start, self.incidences, self._evidence, constraints, self._options, scale=self.scale)
        if solution.feasible:
            self.start_from(solution, solution.normals, solution.offsets)
        return solution

    def start_from(self, solution: StructureSolution, normals: Float[np.ndarray, "faces 3"], offsets: Float[np.ndarray, "faces"]) -> None:
        """Begin the next solution at the corners of this one and at the given planes; what is unknown is completed afresh."""
        self._start = PlanarStart(solution.points, solution.point_known, normals, offsets, solution.face_known)

    @property
    def evidence(self) -> Evidence:
        return self._evidence

    def leave_out_plane(self, face: int) -> "_Walk":
        """The same walk without the points of evidence of a face."""
        points = self._evidence.plane_points
        keep = points.face != face
        evidence = replace(self._evidence, plane_points=PlanePoints(points.face[keep], points.point[keep], points.sigma[keep]))
        other = _Walk(self._start, evidence, self._options)
        other.incidences, other.scale = self.incidences, self.scale
        return other

    def use_evidence_of(self, other: "_Walk") -> None:
        self._evidence = other._evidence

    def feasible(self, constraints: StructureConstraints) -> bool:
        """Whether the constraints can hold together, without looking for the optimum."""
        options = replace(self._options, max_iterations=0)
        return solve_structure(self._start, self.incidences, self._evidence, constraints, options, scale=self.scale).feasible


def _drawn_incidences(sketch: Sketch) -> Int[np.ndarray, "incidences 2"]:
    row = {point.id: i for i, point in enumerate(sketch.points)}
    pairs = {(f, row[corner]) for f, face in enumerate(sketch.faces) for corner in face.corners}
    return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)


def _agree(proposed: Int[np.ndarray, "proposed 2"], free: StructureSolution, options: DetectOptions) -> Bool[np.ndarray, "proposed"]:
    """Whether each corner is on the plane within what the views and the as-built tolerance allow."""
    agree = np.ones(len(proposed), dtype=bool)
    for k, (face, corner) in enumerate(proposed.tolist()):
        gap, variance = height_over(free, face, corner)
        agree[k] = gap * gap < chi2.ppf(options.significance, 1) * (variance + (options.as_built_offset * free.diagonal) ** 2)
    return agree


def _overrule_planes(walk: _Walk, free: StructureSolution, options: AdjustOptions) -> tuple[StructureSolution, list[int]]:
    """Leave out measured planes that contradict everything else, the worst first: the test of Hausman (Econometrica 1978), by what leaving out saves.

    A patch plane may have been measured on what stands in front of a face; its own residuals do not show it. Only faces with a residual above two
    standard deviations, on themselves or on a corner, are tried.
    """
    overruled: list[int] = []
    while len(overruled) < options.max_overruled:
        faces, count = np.unique(walk.evidence.plane_points.face, return_counts=True)
        strain = free.face_residual.copy()
        np.maximum.at(strain, walk.incidences[:, 0], free.point_residual[walk.incidences[:, 1]])
        suspects = sorted(((-float(strain[f]), f, n) for f, n in zip(faces.tolist(), count.tolist(), strict=True) if strain[f] > 2.0))[:6]
        best: tuple[float, int, _Walk, StructureSolution] | None = None
        for _, face, terms in suspects:
            other = walk.leave_out_plane(face)
            solution = other.solve(StructureConstraints())
            inner = max(terms - 3, 0)
            saved = 2.0 * (free.cost - solution.cost) - inner - 3.0 * float(np.sqrt(2.0 * inner))
            if solution.feasible and saved > options.overrule_above and (best is None or saved > best[0]):
                best = saved, face, other, solution
        if best is None:
            break
        overruled.append(best[1])
        walk.use_evidence_of(best[2])
        free = best[3]
        walk.start_from(free, free.normals, free.offsets)
    return free, overruled


def _enlarged(estimated: EvidenceScale, options: AdjustOptions) -> EvidenceScale:
    return EvidenceScale(*(min(value, options.largest_rescale) if value > options.rescale_above else 1.0 for value in estimated))


def _consolidate(
    walk: _Walk, base: StructureSolution, required: Requirements, options: AdjustOptions
) -> tuple[Detection | None, StructureSolution, tuple[PairTest, ...]]:
    """Find relations, enforce them, and look again from the new solution until nothing is added.

    Where enforcing costs far more than the tests promised, the step that broke the promise is given up, with all after it, and the search goes on from the
    solution of the steps before.
    """
    if not options.find_relations:
        return None, base, ()
    current, kept = base, list[PairTest]()
    released: list[PairTest] = []
    while True:
        orthogonal = [*required.orthogonal, *((test.a, test.b) for test in kept if test.kind == "orthogonal")]
        forbidden: list[Pair] = [*required.forbidden, *((test.kind, test.a, test.b) for test in released)]
        found = detect_relations(current, options.detect, orthogonal=orthogonal, forbidden=forbidden)
        accepted = [*kept, *found.accepted]
        if not found.accepted:
            return replace(found, accepted=tuple(accepted)), current, tuple(released)
        final = _enforced(walk, current, required, found, accepted)
        if not _broken(base, final, accepted):
            current, kept = final, accepted
            continue
        broken = _first_broken(walk, base, current, required, found, kept)
        released.append(accepted[broken - 1])
        if broken - 1 > len(kept):
            kept = accepted[: broken - 1]
            current = _enforced(walk, current, required, found, kept)
        if len(released) >= options.max_releases:
            return replace(found, accepted=tuple(kept), refused=(), ambiguous=()), current, tuple(released)


def _enforced(walk: _Walk, current: StructureSolution, required: Requirements, found: Detection, accepted: Sequence[PairTest]) -> StructureSolution:
    """The solution with the given relations, from where the search saw the planes."""
    walk.start_from(current, found.normals, found.offsets)
    return walk.solve(join_constraints([required.constraints, pair_constraints((test.kind, test.a, test.b) for test in accepted)]))


def _first_broken(walk: _Walk, base: StructureSolution, current: StructureSolution, required: Requirements, found: Detection, kept: Sequence[PairTest]) -> int:
    """How many relations it takes, in the order of their acceptance, until they cost too much.

    True relations add about one to twice the cost for each thing they fix, plus what their as-built deviation is worth; each test has promised how much. In
    simulation a wrong one 6 degrees off adds 800 or more. Constraints only add up, so the cost grows from step to step, and halving finds the place.
    """
    accepted = [*kept, *found.accepted]
    good, bad = len(kept), len(accepted)
    while bad - good > 1:
        middle = (good + bad) // 2
        if _broken(base, _enforced(walk, current, required, found, accepted[:middle]), accepted[:middle]):
            bad = middle
        else:
            good = middle
    return bad


def _broken(base: StructureSolution, solution: StructureSolution, steps: Sequence[PairTest]) -> bool:
    """Whether a solution with the given relations costs far more than their tests promised, or does not exist."""
    if not solution.feasible:
        return True
    rank = sum(2 if test.kind == "parallel" else 1 for test in steps)
    promised = sum(test.plain_wald for test in steps)
    return bool(2.0 * (solution.cost - base.cost) > max(2.0 * promised, promised + float(chi2.ppf(0.999, max(rank, 1)))))


def _scene(sketch: Sketch, final: StructureSolution) -> PlanarScene:
    known = final.point_known
    return PlanarScene(
        sketch=sketch,
        points=np.where(known[:, None], final.points, np.nan),
        point_known=known,
        point_covariance=final.point_covariance,
        normals=np.where(final.face_known[:, None], final.normals, np.nan),
        offsets=np.where(final.face_known, final.offsets, np.nan),
        face_known=final.face_known,
        plane_covariance=final.plane_covariance,
    )


def _warnings(
    sketch: Sketch, free: StructureSolution, final: StructureSolution, required: Requirements, refused: Int[np.ndarray, "refused 2"], overruled: list[int]
) -> tuple[str, ...]:
    out = list(required.warnings)
    for f in overruled:
        out.append(f"The plane measured on face {sketch.faces[f].id} contradicts its corners and was left out. Something may stand in front of it.")
    for i in np.flatnonzero(~final.point_known).tolist():
        out.append(f"Point {sketch.points[i].id} is not determined by the views. Mark it in another frame, or draw it into a face.")
    for f in np.flatnonzero(~final.face_known).tolist():
        out.append(f"The plane of face {sketch.faces[f].id} is not determined by the views. Mark its corners in frames that see it better.")
    for i in np.flatnonzero(free.point_known & (free.point_residual > 4.0)).tolist():
        out.append(f"Point {sketch.points[i].id} does not fit: its clicks and edges are {free.point_residual[i]:.1f} sigma off. Check where it is marked.")
    for f, i in refused.tolist():
        out.append(f"Point {sketch.points[i].id} seems to lie on face {sketch.faces[f].id} in the image, but not in space.")
    if not final.converged:
        out.append("The structured adjustment stopped before it had converged.")
    return tuple(out)
