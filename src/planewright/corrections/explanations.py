"""What a correction may mean: explanations of one mark, each solved exactly, and the likeliest of them.

A mark says that a corner is elsewhere. Either the corner alone was put wrong (a bad click, a line beside its edge) and slides in its faces; or one of its
faces was measured on something else, and the face moves with all its corners; or the evidence was only weak, and everything gives a little. Each
explanation leaves out the evidence that it calls wrong, at a price, and the cheapest one wins.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.optim.losses import cauchy
from planewright.planes.basis import Basis
from planewright.planes.evidence import CornerLines, CornerMarks, CornerPriors, Evidence, PlanePoints
from planewright.planes.held import Held
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.planar_start import PlanarStart
from planewright.planes.structure_problem import EvidenceScale
from planewright.planes.structured_bundle import StructureOptions, StructureSolution, solve_structure
from planewright.relations.relation import Relation
from planewright.tracking.edges import EdgeLine

Pairs = tuple[tuple[int, int], ...]


@dataclass(frozen=True, kw_only=True)
class ExplainOptions:
    """What it costs to call evidence wrong, in the units of twice a negative log-likelihood. The prices are chosen, not measured: an edge is given up
    sooner than a click or a face, and neither for a mark that is within three standard deviations."""

    price_of_edge: float = 5.0
    """An edge that was found on another line."""
    price_of_click: float = 8.0
    """A click far off its corner."""
    price_of_plane: float = 8.0
    """A face that was measured on what stands in front of it."""
    price_of_incidence: float = 7.0
    """A corner that lies on a face of which it was not drawn a corner. Of 73 such incidences that were found on thirteen clips, two were wrong: odds of
    one to 35, of which this is twice the logarithm."""
    price_of_track: float = 4.0
    """The track of another corner on such a face, at most: it followed the lines of the wrong face."""
    near: float = 3.0
    """A solution within this many standard deviations of the mark follows it."""
    overturned: float = 5.0
    """An explanation that moves another corner by more than this (standard deviations of what the frames said) from a track that is sure is none."""
    structure: StructureOptions = field(default_factory=lambda: StructureOptions(step_tolerance=1e-5, max_iterations=25))
    """The adjustment. A step of 1e-5 of the scene's diagonal is a hundredth of a pixel."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """One meaning of a mark, solved."""

    solution: StructureSolution
    basis: Basis
    """Without what it calls wrong."""
    held: Held
    price: float
    """Twice the cost of the solution, and the prices of what was left out."""
    alone: bool
    """Only the corner moved."""
    edges: Pairs
    """Edges (rows of their points) whose lines were left out."""
    faces: tuple[int, ...]
    """Faces whose measured plane was left out."""
    incidences: Pairs
    """Incidences (rows of face and corner) that had been found, not drawn, and were left out."""
    click: bool
    """The corner's own earlier clicks were left out."""
    off: float
    """How far the corner still is from the mark, pixels."""


def start_from(scene: PlanarScene) -> PlanarStart:
    """The present values."""
    known, face_known = scene.point_known, scene.face_known
    return PlanarStart(
        np.where(known[:, None], scene.points, 0.0),
        known,
        np.where(face_known[:, None], scene.normals, 0.0),
        np.where(face_known, scene.offsets, 0.0),
        face_known,
    )


def explain(
    scene: PlanarScene,
    basis: Basis,
    lines: Sequence[EdgeLine],
    relations: Sequence[Relation],
    corner: int,
    mark: CornerMarks,
    options: ExplainOptions = ExplainOptions(),
    *,
    said: CornerPriors | None = None,
    accused: bool = True,
    sure: frozenset[int] = frozenset(),
) -> list[Explanation]:
    """All explanations of a mark, the cheapest first.

    Args:
        mark: one firm term of `corner`; it is part of the evidence of every explanation, and of its `basis`.
        said: what the frames say of corners besides the evidence: it holds them where they are, against explanations that would move them. It is no
            part of any `basis`. What rests on a face that an explanation calls wrong is not held.
        accused: whether anything may be called wrong. A mark that its corner's track agrees with gives no reason to: where other evidence contradicts
            itself, an explanation that leaves some of it out would be cheap whatever the mark says.
        sure: corners whose tracks are so sure that they hold whatever they lie on.
    """
    start = start_from(scene)
    nearby = reach(scene, basis, relations, corner)
    alone = slide(scene, corner)
    edges = tuple(sorted({line.edge for line in lines if corner in line.edge}))
    faces = [int(f) for f in np.unique(basis.incidences[basis.incidences[:, 1] == corner, 0]) if f in basis.evidence.plane_points.face]
    given = with_marks(basis, mark)
    clicked = bool((~_firm(given.evidence.marks) & (given.evidence.marks.corner == corner)).any())
    row = scene.point_row()
    drawn = {(f, row[c]) for f, face in enumerate(scene.sketch.faces) for c in face.corners}
    drawn_on = np.array([(f, c) in drawn for f, c in basis.incidences.tolist()], dtype=bool)
    whole = _price_now(start, basis, options)
    found: list[Explanation] = []

    def solve(held: Held, left: Pairs, planes: tuple[int, ...] = (), click: bool = False, loose: Pairs = ()) -> None:
        stands = _without(given, drawn_on, lines, left, planes, corner if click else None, loose)
        begin = _shifted(start, stands, corner, planes) if planes else start
        evidence = stands.evidence if said is None else _held_by(stands, said, resting_on(stands, lines, planes, sure))
        solution = solve_structure(begin, stands.incidences, evidence, stands.constraints, options.structure, scale=EvidenceScale(*stands.scale), held=held)
        # What leaves the corner without a place explains nothing.
        if solution.feasible and solution.point_known[corner] and not (said is not None and _overturns(said, solution, sure, options)):
            # What is left out fitted before, and would fit whatever it was measured on: it saves nothing to leave it out.
            fitted = whole - _price_now(start, replace(stands, evidence=_without_mark(stands.evidence)), options)
            price = 2.0 * solution.cost + fitted + options.price_of_edge * len(left) + options.price_of_plane * len(planes) + options.price_of_click * click
            price += options.price_of_incidence * len(loose)
            price += 0.0 if said is None else _unseated(said, solution, resting_on(stands, lines, planes, sure), options)
            found.append(Explanation(solution, stands, held, price, held is alone, left, planes, loose, click, _off(solution, mark, corner)))

    solve(nearby, ())
    # What the model follows for less than the cheapest accusation accuses nothing.
    followed = bool(found) and found[0].off ** 2 <= options.near**2 * mark.sigma[0] ** 2 and found[0].price - whole <= options.price_of_edge
    if not accused or followed:
        return found
    if edges:
        solve(nearby, edges)
    solve(alone, edges)
    if clicked:
        solve(alone, edges, click=True)
    for face in faces:
        solve(nearby, edges, (face,))
    if len(faces) > 1:
        solve(nearby, edges, tuple(faces))
    for loose in _found_incidences(given, drawn_on, corner):
        solve(nearby, (), loose=loose)
        if edges:
            solve(nearby, edges, loose=loose)
        solve(alone, edges, loose=loose)
    return sorted(found, key=lambda explanation: explanation.price)


def with_lines(
    scene: PlanarScene,
    best: Explanation,
    lines: CornerLines,
    said: CornerPriors,
    doubted: Sequence[int],
    relations: Sequence[Relation],
    corner: int,
    options: ExplainOptions = ExplainOptions(),
) -> Explanation | None:
    """An explanation solved once more with lines that were found after it: the corners at both their ends are free to go there, and what is near them.

    Args:
        scene: the model before the mark.
        said: what the frames say of corners; those of `doubted` are not held by it.
    """
    old = best.basis.evidence.lines
    joined = CornerLines(
        np.concatenate([old.corner, lines.corner]),
        np.concatenate([old.direction, lines.direction]),
        np.concatenate([old.offset, lines.offset]),
        np.concatenate([old.sigma, lines.sigma]),
    )
    basis = replace(best.basis, evidence=replace(best.basis.evidence, lines=joined))
    held = reach(scene, basis, relations, corner)
    solution = solve_structure(
        _begun(scene, best),
        basis.incidences,
        _held_by(basis, said, np.array(sorted(doubted), dtype=np.int64)),
        basis.constraints,
        options.structure,
        scale=EvidenceScale(*basis.scale),
        held=held,
    )
    if not solution.feasible:
        return None
    marks = best.basis.evidence.marks
    last = CornerMarks(marks.corner[-1:], marks.projection[-1:], marks.xy[-1:], marks.sigma[-1:], _firm(marks)[-1:])
    return replace(best, solution=solution, basis=basis, held=held, alone=False, off=_off(solution, last, corner))


def _begun(scene: PlanarScene, best: Explanation) -> PlanarStart:
    """The values of an explanation; what it held, as it was."""
    solution, now = best.solution, start_from(scene)
    free, faces = ~best.held.points & solution.point_known, ~best.held.faces & solution.face_known
    return PlanarStart(
        np.where(free[:, None], solution.points, now.points),
        np.where(best.held.points, now.point_known, solution.point_known),
        np.where(faces[:, None], solution.normals, now.normals),
        np.where(faces, solution.offsets, now.offsets),
        np.where(best.held.faces, now.face_known, solution.face_known),
    )


def _found_incidences(basis: Basis, drawn_on: Bool[np.ndarray, "incidences"], corner: int) -> list[Pairs]:
    """Incidences that were found and may be wrong: the corner's own, and with them those of the other corners drawn on its faces, which were found in the
    same way from the same faces.
    """
    found = basis.incidences[~drawn_on]
    own = found[found[:, 1] == corner]
    if len(own) == 0:
        return []
    drawn = basis.incidences[drawn_on]
    beside = np.unique(drawn[np.isin(drawn[:, 0], drawn[drawn[:, 1] == corner, 0]), 1])
    all_of_them = found[np.isin(found[:, 1], beside) | (found[:, 1] == corner)]
    out = [_pairs(own)]
    return out if len(all_of_them) == len(own) else [*out, _pairs(all_of_them)]


def _pairs(rows: Int[np.ndarray, "rows 2"]) -> Pairs:
    return tuple((int(a), int(b)) for a, b in rows)


def _held_by(basis: Basis, said: CornerPriors, resting: Int[np.ndarray, "resting"]) -> Evidence:
    """The evidence, and what the frames said of corners that do not rest on the planes left out."""
    free = ~np.isin(said.corner, resting)
    priors, factor = basis.evidence.priors, EvidenceScale(*basis.scale).priors
    # The factor on the sigmas of priors was found for those of the structure.
    joined = CornerPriors(
        np.concatenate([priors.corner, said.corner[free]]),
        np.concatenate([priors.mean, said.mean[free]]),
        np.concatenate([priors.whitening, factor * said.whitening[free]]),
    )
    return replace(basis.evidence, priors=joined)


def _overturns(said: CornerPriors, solution: StructureSolution, sure: frozenset[int], options: ExplainOptions) -> bool:
    """Whether a solution takes a corner from where the frames are sure of it."""
    mine = np.isin(said.corner, sorted(sure))
    away = np.einsum("tij,tj->ti", said.whitening[mine], solution.points[said.corner[mine]] - said.mean[mine])
    return bool(((away**2).sum(axis=1) > options.overturned**2).any())


def _unseated(said: CornerPriors, solution: StructureSolution, resting: Int[np.ndarray, "resting"], options: ExplainOptions) -> float:
    """What it costs that tracks of corners on a wrong face are given up with it."""
    mine = np.isin(said.corner, resting)
    away = np.einsum("tij,tj->ti", said.whitening[mine], solution.points[said.corner[mine]] - said.mean[mine])
    return float(np.minimum((away**2).sum(axis=1), options.price_of_track).sum())


def resting_on(basis: Basis, lines: Sequence[EdgeLine], planes: Sequence[int], sure: frozenset[int] = frozenset()) -> Int[np.ndarray, "resting"]:
    """Corners on some planes that little else holds, neither two other measured faces nor one in which an edge of theirs was found, nor a track that is
    sure by itself: where they were seen says as little as the planes do.
    """
    measured = np.unique(basis.evidence.plane_points.face)
    others = basis.incidences[np.isin(basis.incidences[:, 0], measured) & ~np.isin(basis.incidences[:, 0], planes)]
    on = np.unique(basis.incidences[np.isin(basis.incidences[:, 0], planes), 1])
    found = {(line.face, end) for line in lines for end in line.edge}
    held = [
        corner in sure or len(own) > 1 or any((int(face), corner) in found for face in own)
        for corner in on.tolist()
        for own in [others[others[:, 1] == corner, 0]]
    ]
    return on[~np.array(held, dtype=bool)]


def _without_mark(evidence: Evidence) -> Evidence:
    """Without the last mark, which is the one to be explained."""
    marks = evidence.marks
    firm = None if marks.firm is None else marks.firm[:-1]
    return replace(evidence, marks=CornerMarks(marks.corner[:-1], marks.projection[:-1], marks.xy[:-1], marks.sigma[:-1], firm))


def slide(scene: PlanarScene, corner: int) -> Held:
    """All but one corner stays, which leaves it to slide in its faces."""
    return Held(scene.point_known & (np.arange(len(scene.points)) != corner), scene.face_known)


def _shifted(start: PlanarStart, basis: Basis, corner: int, planes: Sequence[int]) -> PlanarStart:
    """A start for faces that were measured on something else: moved along their normals to where the corner's own marks meet, their corners with them
    along the rays of their marks.

    From the old planes the solver finds its way back to them: a mark of the old kind that is 60 px off hardly pulls any more (Cauchy).
    """
    marks, points, offsets = basis.evidence.marks, start.points.copy(), start.offsets.copy()
    met = meeting(marks, np.flatnonzero(marks.corner == corner))
    if met is None:
        return start
    points[corner] = met
    for face in planes:
        normal = start.normals[face]
        offsets[face] = normal @ met
        for other in np.unique(basis.incidences[basis.incidences[:, 0] == face, 1]).tolist():
            mine = np.flatnonzero(marks.corner == other)
            if other != corner and len(mine):
                projection = marks.projection[mine[0]]
                center, ray = ray_of(projection, marks.xy[mine[0]])
                along = float(normal @ ray)
                reach_of_ray = (offsets[face] - float(normal @ center)) / along if abs(along) > 1e-9 else -1.0
                if reach_of_ray > 0:
                    points[other] = center + reach_of_ray * ray
    return replace(start, points=points, offsets=offsets)


def ray_of(projection: Float[np.ndarray, "3 4"], xy: Float[np.ndarray, "2"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Centre of a camera and the direction of a pixel, forwards."""
    inverse = np.linalg.inv(projection[:, :3])
    ray = inverse @ np.append(xy, 1.0)
    ray *= np.sign(projection[2, :3] @ ray) / np.linalg.norm(ray)
    return -inverse @ projection[:, 3], ray


def meeting(marks: CornerMarks, rows: Int[np.ndarray, "rows"]) -> Float[np.ndarray, "3"] | None:
    """Where the rays of two or more marks meet, in pixels' least squares; None where they are nearly parallel or meet behind a camera."""
    if len(rows) < 2:
        return None
    depth = np.ones(len(rows))
    point = np.zeros(3)
    rays = np.array([ray_of(marks.projection[row], marks.xy[row])[1] for row in rows])
    if float((rays @ rays.T).min()) > np.cos(np.radians(1.0)):
        return None
    for _ in range(3):
        p, xy = marks.projection[rows], marks.xy[rows]
        weight = 1.0 / (depth * marks.sigma[rows])
        system = ((xy[:, :, None] * p[:, 2:] - p[:, :2]) * weight[:, None, None]).reshape(-1, 4)
        point = np.linalg.lstsq(system[:, :3], -system[:, 3], rcond=None)[0]
        depth = p[:, 2, :3] @ point + p[:, 2, 3]
        if (depth <= 0).any():
            return None
    return point


def with_marks(basis: Basis, marks: CornerMarks) -> Basis:
    """The basis with more marks."""
    old = basis.evidence.marks
    joined = CornerMarks(
        np.concatenate([old.corner, marks.corner]),
        np.concatenate([old.projection, marks.projection]),
        np.concatenate([old.xy, marks.xy]),
        np.concatenate([old.sigma, marks.sigma]),
        np.concatenate([_firm(old), _firm(marks)]),
    )
    return replace(basis, evidence=replace(basis.evidence, marks=joined))


def _firm(marks: CornerMarks) -> Bool[np.ndarray, "terms"]:
    return np.zeros(len(marks.corner), dtype=bool) if marks.firm is None else marks.firm


def reach(scene: PlanarScene, basis: Basis, relations: Sequence[Relation], corner: int) -> Held:
    """What a mark on a corner cannot move: everything but its faces, the faces that share an enforced relation with one of them, and their corners.

    What is not known has no value that could be held.
    """
    ids = [face.id for face in scene.sketch.faces]
    row = {face: f for f, face in enumerate(ids)}
    faces = np.zeros(len(ids), dtype=bool)
    faces[basis.incidences[basis.incidences[:, 1] == corner, 0]] = True
    own = faces.copy()
    for relation in relations:
        rows = [row[face] for face in relation.faces if face in row]
        if relation.state == "enforced" and own[rows].any():
            faces[rows] = True
    points = np.ones(len(scene.points), dtype=bool)
    points[basis.incidences[faces[basis.incidences[:, 0]], 1]] = False
    points[corner] = False
    return Held(points & scene.point_known, ~faces & scene.face_known)


def rows_of_edges(lines: CornerLines, found: Sequence[EdgeLine], edges: Sequence[tuple[int, int]]) -> Bool[np.ndarray, "terms"]:
    """Which terms come from the lines of the given edges."""
    out = np.zeros(len(lines.corner), dtype=bool)
    for line in found:
        if line.edge in edges:
            same = np.abs(lines.direction - line.facing).max(axis=1, initial=0.0) < 1e-9
            out |= same & np.isin(lines.corner, line.edge)
    return out


def without_edges(basis: Basis, lines: Sequence[EdgeLine], edges: Sequence[tuple[int, int]]) -> Basis:
    """The basis without the lines of some edges."""
    old = basis.evidence.lines
    keep = ~rows_of_edges(old, lines, edges)
    kept = CornerLines(old.corner[keep], old.direction[keep], old.offset[keep], old.sigma[keep])
    return replace(basis, evidence=replace(basis.evidence, lines=kept))


def _without(
    basis: Basis,
    drawn_on: Bool[np.ndarray, "incidences"],
    lines: Sequence[EdgeLine],
    edges: Sequence[tuple[int, int]],
    planes: Sequence[int],
    click_of: int | None,
    loose: Pairs = (),
) -> Basis:
    """The basis without what an explanation calls wrong.

    A wrong plane takes with it what rests on it: the lines that were looked for in it, the corners that were only found to lie on it, and the guesses
    at its corners from its shape. A corner that was wrongly found on a face takes with it what was guessed of it, for the guess agreed with that.
    """
    evidence = without_edges(basis, lines, edges).evidence
    points, marks, drawn = evidence.plane_points, evidence.marks, evidence.lines
    keep = ~np.isin(points.face, planes)
    in_planes = [line for line in lines if line.face in planes]
    stay = ~rows_of_edges(drawn, in_planes, [line.edge for line in in_planes])
    priors = evidence.priors
    resting = np.unique(basis.incidences[np.isin(basis.incidences[:, 0], planes) & drawn_on, 1])
    free = ~np.isin(priors.corner, [*resting.tolist(), *(point for _, point in loose)])
    given_up = np.array([(f, c) in loose for f, c in basis.incidences.tolist()], dtype=bool)
    own = _firm(marks) | (marks.corner != (-1 if click_of is None else click_of))
    return replace(
        basis,
        evidence=Evidence(
            plane_points=PlanePoints(points.face[keep], points.point[keep], points.sigma[keep]),
            marks=CornerMarks(marks.corner[own], marks.projection[own], marks.xy[own], marks.sigma[own], _firm(marks)[own]),
            lines=CornerLines(drawn.corner[stay], drawn.direction[stay], drawn.offset[stay], drawn.sigma[stay]),
            priors=CornerPriors(priors.corner[free], priors.mean[free], priors.whitening[free]),
        ),
        incidences=basis.incidences[(drawn_on | ~np.isin(basis.incidences[:, 0], planes)) & ~given_up],
    )


def _off(solution: StructureSolution, mark: CornerMarks, corner: int) -> float:
    seen = mark.projection[0] @ np.append(solution.points[corner], 1.0)
    return float(np.linalg.norm(seen[:2] / seen[2] - mark.xy[0])) if seen[2] > 0 else float("inf")


def alone_at(
    scene: PlanarScene, basis: Basis, lines: Sequence[EdgeLine], corner: int, mark: CornerMarks, options: ExplainOptions = ExplainOptions()
) -> Explanation | None:
    """The corner by itself, slid to the mark: one small solution, for a first answer."""
    edges = tuple(sorted({line.edge for line in lines if corner in line.edge}))
    stands = without_edges(with_marks(basis, mark), lines, edges)
    held = slide(scene, corner)
    solution = solve_structure(
        start_from(scene), stands.incidences, stands.evidence, stands.constraints, options.structure, scale=EvidenceScale(*stands.scale), held=held
    )
    if not solution.feasible:
        return None
    return Explanation(solution, stands, held, 2.0 * solution.cost, True, edges, (), (), False, _off(solution, mark, corner))


def present_price(scene: PlanarScene, basis: Basis, options: ExplainOptions = ExplainOptions()) -> float:
    """Twice the cost of the scene as it is."""
    return _price_now(start_from(scene), basis, options)


def _price_now(now: PlanarStart, basis: Basis, options: ExplainOptions) -> float:
    """The same, of any values; evidence about what is not known costs nothing."""
    evidence, scale = basis.evidence, EvidenceScale(*basis.scale)
    points, marks, lines, priors = evidence.plane_points, evidence.marks, evidence.lines, evidence.priors
    seen = np.einsum("tij,tj->ti", marks.projection[:, :, :3], now.points[marks.corner]) + marks.projection[:, :, 3]
    depth = np.where(seen[:, 2:] > 1e-12, seen[:, 2:], np.inf)
    away = np.einsum("tij,tj->ti", priors.whitening, now.points[priors.corner] - priors.mean)
    squares = (
        (now.face_known[points.face], (((now.normals[points.face] * points.point).sum(axis=1) - now.offsets[points.face]) / points.sigma) ** 2),
        (now.point_known[marks.corner] & ~_firm(marks), (((seen[:, :2] / depth - marks.xy) / marks.sigma[:, None]) ** 2).sum(axis=1)),
        (now.point_known[lines.corner], (((lines.direction * now.points[lines.corner]).sum(axis=1) - lines.offset) / lines.sigma) ** 2),
        (now.point_known[priors.corner], (away**2).sum(axis=1)),
    )
    total = sum(float(cauchy(square[known] / factor**2, options.structure.loss_scale)[0].sum()) for (known, square), factor in zip(squares, scale, strict=True))
    firm = now.point_known[marks.corner] & _firm(marks)
    return total + float((((seen[firm, :2] / depth[firm] - marks.xy[firm]) / (scale.marks * marks.sigma[firm, None])) ** 2).sum())
