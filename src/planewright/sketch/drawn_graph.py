"""The drawn edges as a graph: its blocks and the short cycles in them. Points are their row numbers in the sketch."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

Cycle = tuple[int, ...]
"""Corners in order, starting with the smallest, towards the smaller of its neighbours."""
Link = tuple[int, int]
"""An edge, smaller end first."""


@dataclass(frozen=True, eq=False)
class Block:
    """A biconnected part of the graph: any two of its edges lie on a common cycle, so a face never leaves it."""

    neighbours: Mapping[int, tuple[int, ...]]
    """Ascending."""
    links: tuple[Link, ...]

    @property
    def num_faces(self) -> int:
        """Faces of the block when it is drawn in a plane, the outer one left out (Euler): edges - points + 1."""
        return len(self.links) - len(self.neighbours) + 1

    @property
    def may_be_planar(self) -> bool:
        """False for certain when there are more than 3 x points - 6 edges (Euler)."""
        return len(self.links) <= 3 * len(self.neighbours) - 6 or len(self.neighbours) < 3


def canonical(cycle: Sequence[int]) -> Cycle:
    """The one way to write a cycle."""
    start = cycle.index(min(cycle))
    forward = tuple(cycle[start:]) + tuple(cycle[:start])
    backward = (forward[0], *forward[:0:-1])
    return min(forward, backward)


def cycle_links(cycle: Cycle) -> tuple[Link, ...]:
    """The edges of a cycle."""
    return tuple((min(a, b), max(a, b)) for a, b in zip(cycle, (*cycle[1:], cycle[0]), strict=True))


def blocks(links: Sequence[Link]) -> tuple[Block, ...]:
    """The biconnected blocks with a cycle in them, by their smallest edge (Hopcroft and Tarjan 1973, without recursion)."""
    neighbours = _neighbours(links)
    order: dict[int, int] = {}
    low: dict[int, int] = {}
    found: list[list[Link]] = []
    for root in neighbours:
        if root in order:
            continue
        order[root] = low[root] = len(order)
        open_links: list[Link] = []
        stack: list[tuple[int, int, Iterator[int]]] = [(root, -1, iter(neighbours[root]))]
        while stack:
            point, parent, rest = stack[-1]
            following = next(rest, None)
            if following is not None:
                if following == parent:
                    continue
                if following not in order:
                    open_links.append((point, following))
                    order[following] = low[following] = len(order)
                    stack.append((following, point, iter(neighbours[following])))
                elif order[following] < order[point]:
                    open_links.append((point, following))
                    low[point] = min(low[point], order[following])
                continue
            stack.pop()
            if not stack:
                break
            low[parent] = min(low[parent], low[point])
            if low[point] >= order[parent]:
                cut = open_links.index((parent, point))
                found.append(open_links[cut:])
                del open_links[cut:]
    made = [tuple(sorted((min(link), max(link)) for link in block)) for block in found]
    return tuple(Block(_neighbours(block), block) for block in sorted(made) if len(block) >= 3)


def shortest_cycles(block: Block, max_corners: int, most: int = 8) -> set[Cycle]:
    """For each pair of edges at a point the shortest cycles through both (at most `most` of equal length).

    In a three-connected planar graph every face that is a shortest way round one of its corners is among them.
    """
    found: set[Cycle] = set()
    for middle, around in block.neighbours.items():
        for start, end in combinations(around, 2):
            for path in _shortest_paths(block, start, end, middle, max_corners - 1, most):
                found.add(canonical((middle, *path)))
    return found


def traversed_cycles(block: Block, xy: Mapping[int, tuple[float, float]]) -> set[Cycle]:
    """Faces of the drawing by walking along half-edges and turning the same way at each point; points without a place are left out.

    Walks that pass a point twice are dropped. The outer face is among the results where it is a simple cycle.
    """
    placed = {point: [other for other in around if other in xy] for point, around in block.neighbours.items() if point in xy}
    following: dict[tuple[int, int], int] = {}
    for point, around in placed.items():
        here = np.array(xy[point])
        angles = {other: float(np.arctan2(*(np.array(xy[other]) - here)[::-1])) for other in around}
        ordered = sorted(around, key=lambda other: (angles[other], other))
        for index, other in enumerate(ordered):
            following[(other, point)] = ordered[index - 1]
    found: set[Cycle] = set()
    walked: set[tuple[int, int]] = set()
    for half_edge in following:
        if half_edge in walked:
            continue
        walk: list[int] = []
        a, b = half_edge
        while (a, b) not in walked:
            walked.add((a, b))
            walk.append(a)
            a, b = b, following[(a, b)]
        if len(walk) >= 3 and len(set(walk)) == len(walk):
            found.add(canonical(walk))
    return found


def _neighbours(links: Sequence[Link]) -> dict[int, tuple[int, ...]]:
    around: dict[int, list[int]] = {}
    for a, b in links:
        around.setdefault(a, []).append(b)
        around.setdefault(b, []).append(a)
    return {point: tuple(sorted(around[point])) for point in sorted(around)}


def _shortest_paths(block: Block, start: int, end: int, without: int, max_points: int, most: int) -> list[list[int]]:
    """Shortest paths from start to end around one point, breadth first; empty where the shortest has more than `max_points` points."""
    distance = {start: 0}
    layer = [start]
    while layer and end not in distance and distance[layer[0]] + 2 <= max_points:
        following: list[int] = []
        for point in layer:
            for other in block.neighbours[point]:
                if other != without and other not in distance:
                    distance[other] = distance[point] + 1
                    following.append(other)
        layer = following
    if end not in distance:
        return []
    paths = [[end]]
    for step in range(distance[end] - 1, -1, -1):
        paths = [[*path, other] for path in paths for other in block.neighbours[path[-1]] if distance.get(other) == step and other != without][:most]
    return paths
