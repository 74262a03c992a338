"""Faces from the drawn graph, for sketches that give none.

In a drawing of a solid a face is a cycle of edges, and an edge borders at most two faces. So the faces of a connected part form a set of cycles
in which each edge appears at most twice and no cycle is the sum of others (MacLane 1937): all faces of the graph drawn in a plane but one, the
outline. Which cycles are faces is decided for the whole part at once, by their looks in the frame where they are marked: few corners, no
crossing, nothing of the same part inside, no drawn edge across. This needs no view in which the drawing is free of crossings, so hidden edges
may be drawn and corners may be marked in other frames.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from planewright.arrays import Float
from planewright.sketch.drawn_graph import Block, Cycle, blocks, canonical, cycle_links, shortest_cycles, traversed_cycles
from planewright.sketch.graph import FaceId, Sketch, SketchFace


@dataclass(frozen=True, kw_only=True)
class FindFacesOptions:
    """What makes a cycle a face. The marks of a cycle are compared with each other only; they have no unit."""

    beside_given: bool = False
    """Find faces also where the sketch gives some; the given ones always count."""
    max_corners: int = 32
    """Longest loop that is looked for."""
    max_links: int = 600
    """A connected part with more edges than this is taken as drawn (half-edge traversal only): searching all short cycles takes edges squared."""
    corner_cost: float = 0.6
    """Marks off for each corner beyond three; a face starts with 10."""
    reflex_cost: float = 0.3
    """For each corner that points inwards."""
    inside_cost: float = 2.0
    """For each point of the same part that lies inside, up to four: a face has no corners of its neighbours in it."""
    chord_cost: float = 5.0
    """For each drawn edge that crosses the inside from corner to corner."""
    crossed_cost: float = 5.0
    """For a loop that crosses itself where it is marked; not the end of it, for clicks can fold a face that is seen edge on."""
    area_cost: float = 0.5
    """For a face as large as its whole part: of equal cycles the largest is the outline, which is dropped."""


def find_faces(sketch: Sketch, options: FindFacesOptions = FindFacesOptions()) -> Sketch:
    """The sketch with faces `f0`, `f1`, ... found in its edges (marked `found`).

    A single loop drawn strictly inside a face, joined to nothing, is a hole in that face and a face of its own, as a window in a wall is. Loops in
    `not_faces` are never found. A part that is closed all around (each edge already borders two faces) keeps its last face when it has four corners or
    more. Faces that were found earlier are replaced; a sketch that gives faces comes back as it is, unless `beside_given`.
    """
    given = tuple(face for face in sketch.faces if not face.found)
    if given and not options.beside_given:
        return sketch
    drawing = _Drawing(sketch)
    forbidden = {frozenset(drawing.rows(loop)) for loop in sketch.not_faces}
    fixed = {canonical(drawing.rows(face.loop)) for face in given}
    cycles: list[Cycle] = []
    loops: list[Cycle] = []
    for block in blocks(drawing.links):
        chosen = _faces_of(block, drawing, forbidden, fixed, options)
        cycles += [cycle for cycle in chosen if cycle not in fixed]
        if block.num_faces == 1 and drawing.is_alone(block):
            loops += chosen
    holes = _holes(sorted(cycles), loops, drawing)
    taken = {face.id for face in given}
    found: list[SketchFace] = []
    number = 0
    for cycle in sorted(cycles):
        while f"f{number}" in taken:
            number += 1
        ids = tuple(tuple(sketch.points[row].id for row in loop) for loop in (cycle, *holes.get(cycle, ())))
        found.append(SketchFace(FaceId(f"f{number}"), ids[0], ids[1:], found=True))
        number += 1
    return replace(sketch, faces=(*given, *found))


_NODES, _ROUNDS, _CANDIDATES = 50, 6, 600
"""Bounds of the exact choice: branches, repetitions, cycles. Drawings of solids take 1, 1 to 3 and 20 to 60; tangles of random edges, for ever."""


class _Drawing:
    """The sketch with points as row numbers."""

    def __init__(self, sketch: Sketch) -> None:
        self.sketch = sketch
        self.row_of = {point.id: row for row, point in enumerate(sketch.points)}
        self.links = tuple(sorted({(min(a, b), max(a, b)) for a, b in (self.rows(edge) for edge in sketch.edges)}))

    def rows(self, ids: Sequence[str]) -> tuple[int, ...]:
        """Row numbers of point ids."""
        return tuple(self.row_of[identity] for identity in ids)  # pyright: ignore[reportArgumentType]

    @cached_property
    def places(self) -> Mapping[int, Mapping[int, tuple[float, float]]]:
        """Frame -> row -> mark; the frames with most marks first."""
        frames: dict[int, dict[int, tuple[float, float]]] = {}
        for row, point in enumerate(self.sketch.points):
            for frame, xy in point.marks.items():
                frames.setdefault(frame, {})[row] = xy
        return {frame: frames[frame] for frame in sorted(frames, key=lambda frame: (-len(frames[frame]), frame))}

    @cached_property
    def degree(self) -> Mapping[int, int]:
        """Number of drawn edges at each point."""
        count = dict.fromkeys(range(len(self.sketch.points)), 0)
        for link in self.links:
            for row in link:
                count[row] += 1
        return count

    def is_alone(self, block: Block) -> bool:
        """No edge joins the block to anything else."""
        return all(self.degree[point] == len(around) for point, around in block.neighbours.items())

    def polygon(self, cycle: Cycle) -> tuple[int, Cycle]:
        """The frame that has most of the corners marked, and those corners."""
        best: tuple[int, Cycle] = (-1, ())
        for frame, marks in self.places.items():
            marked = tuple(row for row in cycle if row in marks)
            if len(marked) > len(best[1]):
                best = (frame, marked)
        return best


def _faces_of(block: Block, drawing: _Drawing, forbidden: set[frozenset[int]], fixed: set[Cycle], options: FindFacesOptions) -> list[Cycle]:
    """The cycles of one block that are faces, among them the fixed ones that lie in it."""
    own = set(block.links)
    kept = sorted(cycle for cycle in fixed if own.issuperset(cycle_links(cycle)))
    if block.num_faces == 1 and len(block.links) > options.max_corners:
        candidates = {canonical(_walk_round(block))}
    else:
        candidates = shortest_cycles(block, options.max_corners, 8 if block.may_be_planar else 1) if len(block.links) <= options.max_links else set[Cycle]()
        for marks in drawing.places.values():
            candidates |= traversed_cycles(block, marks)
    plausible = sorted(cycle for cycle in candidates if frozenset(cycle) not in forbidden and cycle not in fixed)
    scored = [(cycle, _score(cycle, block, drawing, options)) for cycle in plausible]
    cycles = [*kept, *(cycle for cycle, _ in scored)]
    if not cycles:
        return []
    # A given loop counts whatever it costs, so it is worth more than all others together.
    scores = np.array([1e3] * len(kept) + [score for _, score in scored])
    chosen = _best_independent(cycles, scores, block)
    return _closed(chosen, dict(scored), forbidden)


def _score(cycle: Cycle, block: Block, drawing: _Drawing, options: FindFacesOptions) -> float:
    """How much a cycle looks like a face, up to 10 and above 0."""
    corners = set(cycle)
    sides = set(cycle_links(cycle))
    chords = [link for link in block.links if link[0] in corners and link[1] in corners and link not in sides]
    score = 10.0 - options.corner_cost * (len(cycle) - 3)
    frame, marked = drawing.polygon(cycle)
    whole_loop = len(marked) == len(cycle)
    if len(marked) < max(3, 0.6 * len(cycle)):
        # Too little of it is marked in one frame; which side a chord lies on is not known, and the area counts as middling.
        return max(0.05, score - options.chord_cost * len(chords) - 0.5 * options.area_cost)
    xy = np.array([drawing.places[frame][row] for row in marked])
    polygon = shapely.Polygon(xy)
    if not polygon.is_valid or polygon.area < 1e-9:
        return max(0.05, score - (options.crossed_cost if whole_loop else 0.5 * options.area_cost))
    marks = drawing.places[frame]
    inside = _inside(polygon, block, marks, corners)
    middles = np.array([[(marks[a][0] + marks[b][0]) / 2, (marks[a][1] + marks[b][1]) / 2] for a, b in chords if a in marks and b in marks]).reshape(-1, 2)
    across = int(np.count_nonzero(shapely.contains_xy(polygon, middles[:, 0], middles[:, 1])))
    whole = float(shapely.area(shapely.convex_hull(shapely.multipoints(np.array([marks[row] for row in block.neighbours if row in marks])))))
    score -= options.inside_cost * min(inside, 4.0) + options.chord_cost * across + options.reflex_cost * _reflex(xy)
    return max(0.05, score - options.area_cost * (polygon.area / whole if whole_loop else 0.5))


def _inside(polygon: shapely.Polygon, block: Block, marks: Mapping[int, tuple[float, float]], corners: set[int]) -> float:
    """How many points of the block lie inside. Points whose edges leave across the border count a quarter: they are behind the face or before it."""
    others = [row for row in block.neighbours if row in marks and row not in corners]
    xy = np.array([marks[row] for row in others]).reshape(-1, 2)
    rest = {row for row, is_in in zip(others, shapely.contains_xy(polygon, xy[:, 0], xy[:, 1]), strict=True) if is_in}
    enclosed = set(rest)
    total = 0.0
    while rest:
        group = [min(rest)]
        rest.remove(group[0])
        leaves = False
        for row in group:
            for other in block.neighbours[row]:
                if other in rest:
                    rest.remove(other)
                    group.append(other)
                leaves |= other in marks and other not in enclosed and other not in corners
        total += len(group) * (0.25 if leaves else 1.0)
    return total


def _reflex(xy: Float[np.ndarray, "corners 2"]) -> int:
    """Corners that clearly point inwards (sine of the turn beyond 0.1: collinear corners scatter by the clicks)."""
    before, after = xy - np.roll(xy, 1, axis=0), np.roll(xy, -1, axis=0) - xy
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    sine = cross / np.maximum(np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1), 1e-12)
    area = np.sum(xy[:, 0] * np.roll(xy[:, 1], -1) - xy[:, 1] * np.roll(xy[:, 0], -1))
    return int(np.count_nonzero(sine * np.sign(area) < -0.1))


def _best_independent(cycles: Sequence[Cycle], scores: Float[np.ndarray, "cycles"], block: Block) -> list[Cycle]:
    """The cycles with the largest sum of scores among which every edge appears at most twice and none is the sum of others.

    An integer programme; independence is added where a solution lacks it. Where that does not end soon, the best are taken one after the other.
    """
    if len(cycles) > _CANDIDATES or not block.may_be_planar:
        return _greedy(cycles, scores, block)
    column_of = {link: row for row, link in enumerate(block.links)}
    rows = np.array([column_of[link] for cycle in cycles for link in cycle_links(cycle)])
    columns = np.array([index for index, cycle in enumerate(cycles) for _ in cycle])
    uses = csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(block.links), len(cycles)))
    limits = {"mip_rel_gap": 1e-6, "node_limit": _NODES}
    constraints = [LinearConstraint(uses, ub=2.0), LinearConstraint(np.ones((1, len(cycles))), ub=float(block.num_faces))]
    chosen: list[int] = []
    for _ in range(_ROUNDS):
        solved = milp(-scores, integrality=np.ones(len(cycles)), bounds=Bounds(0, 1), constraints=constraints, options=limits)
        if solved.x is None:
            break
        chosen = [index for index, value in enumerate(solved.x) if value > 0.5]
        dependent = _dependent([cycles[index] for index in chosen])
        if not dependent:
            return [cycles[index] for index in chosen]
        cut = np.zeros((1, len(cycles)))
        cut[0, [chosen[index] for index in dependent]] = 1.0
        constraints.append(LinearConstraint(cut, ub=len(dependent) - 1.0))
    return _greedy(cycles, scores, block)


def _greedy(cycles: Sequence[Cycle], scores: Float[np.ndarray, "cycles"], block: Block) -> list[Cycle]:
    """The best cycle, then the best that fits beside it, and so on."""
    uses = dict.fromkeys(block.links, 0)
    leading: dict[tuple[int, int], frozenset[tuple[int, int]]] = {}
    taken: list[Cycle] = []
    for index in np.argsort(-scores, kind="stable"):
        cycle = cycles[int(index)]
        links = frozenset(cycle_links(cycle))
        if any(uses[link] == 2 for link in links):
            continue
        # Gaussian elimination over GF(2): what is left of a cycle that is the sum of others is nothing.
        rest = links
        while rest and (known := leading.get(max(rest))) is not None:
            rest = rest ^ known
        if rest:
            leading[max(rest)] = rest
            taken.append(cycle)
            for link in links:
                uses[link] += 1
    return taken


def _dependent(cycles: Sequence[Cycle]) -> list[int]:
    """Some cycles that sum to nothing over GF(2); empty where all are independent."""
    basis: list[tuple[frozenset[tuple[int, int]], frozenset[int]]] = []
    for index, cycle in enumerate(cycles):
        links, members = frozenset(cycle_links(cycle)), frozenset([index])
        for other_links, other_members in basis:
            if max(other_links) in links:
                links, members = links ^ other_links, members ^ other_members
        if not links:
            return sorted(members)
        basis.append((links, members))
        basis.sort(key=lambda row: max(row[0]), reverse=True)
    return []


def _closed(chosen: list[Cycle], scores: Mapping[Cycle, float], forbidden: set[frozenset[int]]) -> list[Cycle]:
    """With the outline too, where it looks no worse than the faces, has no more corners than they and four at least: the drawn solid is closed.

    A triangle says nothing: any three points lie in a plane, and a roof over a triangle is drawn with the same edges as a tetrahedron.
    """
    border: frozenset[tuple[int, int]] = frozenset()
    for cycle in chosen:
        border ^= frozenset(cycle_links(cycle))
    outline = next((cycle for cycle in sorted(scores) if frozenset(cycle_links(cycle)) == border and cycle not in chosen), None)
    if outline is None or len(chosen) < 3 or not 4 <= len(outline) <= max(map(len, chosen)) or frozenset(outline) in forbidden:
        return chosen
    worst = min(scores.get(cycle, 10.0) for cycle in chosen)
    return [*chosen, outline] if scores[outline] >= worst - 0.5 else chosen


def _walk_round(block: Block) -> list[int]:
    """The points of a block that is one long cycle."""
    start = next(iter(block.neighbours))
    walk, previous, point = [start], start, block.neighbours[start][0]
    while point != start:
        walk.append(point)
        a, b = block.neighbours[point]
        previous, point = point, b if a == previous else a
    return walk


def _holes(cycles: Sequence[Cycle], loops: Sequence[Cycle], drawing: _Drawing) -> dict[Cycle, list[Cycle]]:
    """Which loops lie strictly inside which face: the smallest face around a loop has it as a hole."""
    holes: dict[Cycle, list[Cycle]] = {}
    for loop in sorted(loops):
        best: tuple[float, Cycle] | None = None
        for frame, marks in drawing.places.items():
            if not all(row in marks for row in loop):
                continue
            inner = shapely.Polygon([marks[row] for row in loop])
            if not inner.is_valid:
                continue
            for cycle in cycles:
                if cycle == loop or not all(row in marks for row in cycle):
                    continue
                outer = shapely.Polygon([drawing.places[frame][row] for row in cycle])
                if outer.is_valid and outer.contains_properly(inner) and (best is None or (outer.area, cycle) < best):
                    best = (outer.area, cycle)
            if best is not None:
                break
        if best is not None:
            holes.setdefault(best[1], []).append(loop)
    return holes
