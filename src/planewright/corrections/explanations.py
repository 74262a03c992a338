"""What a correction may mean: explanations of one mark, each solved exactly, and the likeliest of them.

A mark says that a corner is elsewhere. Either the corner alone was put wrong (a bad click, a line beside its edge) and slides in its faces; or one of its
faces was measured on something else, and the face moves with all its corners; or the evidence was only weak, and everything gives a little. Each
explanation leaves out the evidence that it calls wrong, at a price, and the cheapest one wins.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.planes.basis import Basis
from planewright.planes.evidence import CornerLines, CornerMarks, Evidence, PlanePoints
from planewright.planes.held import Held
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.planar_start import PlanarStart
from planewright.planes.structure_problem import EvidenceScale
from planewright.planes.structured_bundle import StructureOptions, StructureSolution, solve_structure
from planewright.relations.relation import Relation
from planewright.tracking.edges import EdgeLine


@dataclass(frozen=True, kw_only=True)
class ExplainOptions:
    """What it costs to call evidence wrong, as twice the logarithm of the odds against it: 2 ln(1 / share of such evidence that is wrong)."""

    price_of_edge: float = 5.0
    """An edge that was found on another line: about one in twelve of those at corners that need a correction."""
    price_of_click: float = 8.0
    """A click far off its corner: one in fifty."""
    price_of_plane: float = 8.0
    """A face that was measured on what stands in front of it: one in fifty."""
    structure: StructureOptions = field(default_factory=StructureOptions)
    """The adjustment."""


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
    edges: tuple[tuple[int, int], ...]
    """Edges (rows of their points) whose lines were left out."""
    faces: tuple[int, ...]
    """Faces whose measured plane was left out."""
    click: bool
    """The corner's own earlier clicks were left out."""


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
) -> list[Explanation]:
    """All explanations of a mark, the cheapest first.

    mark: one firm term of `corner`; it is part of the evidence of every explanation, and of its `basis`.
    """
    start = start_from(scene)
    nearby = reach(scene, basis, relations, corner)
    alone = Held(points=scene.point_known & (np.arange(len(scene.points)) != corner), faces=scene.face_known)
    edges = tuple(sorted({line.edge for line in lines if corner in line.edge}))
    faces = [int(f) for f in np.unique(basis.incidences[basis.incidences[:, 1] == corner, 0]) if f in basis.evidence.plane_points.face]
    given = with_marks(basis, mark)
    found: list[Explanation] = []

    def solve(held: Held, left: tuple[tuple[int, int], ...], planes: tuple[int, ...], click: bool) -> None:
        stands = _without(given, lines, left, planes, corner if click else None)
        own_clicks = click and len(stands.evidence.marks.corner) < len(given.evidence.marks.corner)
        if click and not own_clicks:
            return
        solution = solve_structure(
            start, stands.incidences, stands.evidence, stands.constraints, options.structure, scale=EvidenceScale(*stands.scale), held=held
        )
        if not solution.feasible:
            return
        price = 2.0 * solution.cost + options.price_of_edge * len(left) + options.price_of_plane * len(planes) + options.price_of_click * click
        found.append(Explanation(solution, stands, held, price, held is alone, left, planes, click))

    solve(nearby, (), (), False)
    solve(nearby, edges, (), False)
    solve(alone, edges, (), False)
    solve(alone, edges, (), True)
    for face in faces:
        solve(nearby, edges, (face,), False)
    if len(faces) > 1:
        solve(nearby, edges, tuple(faces), False)
    return sorted(found, key=lambda explanation: explanation.price)


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
            same = np.abs(lines.direction - line.across).max(axis=1, initial=0.0) < 1e-9
            out |= same & np.isin(lines.corner, line.edge)
    return out


def without_edges(basis: Basis, lines: Sequence[EdgeLine], edges: Sequence[tuple[int, int]]) -> Basis:
    """The basis without the lines of some edges."""
    old = basis.evidence.lines
    keep = ~rows_of_edges(old, lines, edges)
    kept = CornerLines(old.corner[keep], old.direction[keep], old.offset[keep], old.sigma[keep])
    return replace(basis, evidence=replace(basis.evidence, lines=kept))


def _without(basis: Basis, lines: Sequence[EdgeLine], edges: Sequence[tuple[int, int]], planes: Sequence[int], click_of: int | None) -> Basis:
    """The basis without what an explanation calls wrong. A wrong plane takes the lines with it that were looked for in it."""
    evidence = without_edges(basis, lines, edges).evidence
    points, marks, drawn = evidence.plane_points, evidence.marks, evidence.lines
    keep = ~np.isin(points.face, planes)
    in_planes = [line for line in lines if line.face in planes]
    stay = ~rows_of_edges(drawn, in_planes, [line.edge for line in in_planes])
    own = _firm(marks) | (marks.corner != (-1 if click_of is None else click_of))
    return replace(
        basis,
        evidence=Evidence(
            plane_points=PlanePoints(points.face[keep], points.point[keep], points.sigma[keep]),
            marks=CornerMarks(marks.corner[own], marks.projection[own], marks.xy[own], marks.sigma[own], _firm(marks)[own]),
            lines=CornerLines(drawn.corner[stay], drawn.direction[stay], drawn.offset[stay], drawn.sigma[stay]),
            priors=evidence.priors,
        ),
    )


def residuals(solution: StructureSolution, marks: CornerMarks, corner: int) -> Iterator[tuple[int, Float[np.ndarray, "2"]]]:
    """Row and pixels off, of every firm mark of a corner."""
    firm: Int[np.ndarray, "firm"] = np.flatnonzero(_firm(marks) & (marks.corner == corner))
    for row in firm.tolist():
        seen = marks.projection[row] @ np.append(solution.points[corner], 1.0)
        yield row, seen[:2] / seen[2] - marks.xy[row]
