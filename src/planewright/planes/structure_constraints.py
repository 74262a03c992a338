"""What holds exactly between faces and corners: shared directions and planes, angles, lengths; and what the drawing alone forces."""

from dataclasses import dataclass, field

import numpy as np

from planewright.arrays import Float, Int


def _no_rows(width: int) -> Int[np.ndarray, "rows width"]:
    return np.zeros((0, width), dtype=np.int64)


@dataclass(frozen=True, eq=False, kw_only=True)
class StructureConstraints:
    """Exact relations; numbers are rows of faces and corners. Signs of normals do not matter in any of them."""

    same_direction: Int[np.ndarray, "parallel 2"] = field(default_factory=lambda: _no_rows(2))
    """Parallel faces."""
    same_plane: Int[np.ndarray, "coplanar 2"] = field(default_factory=lambda: _no_rows(2))
    """Coplanar faces."""
    angle_faces: Int[np.ndarray, "angles 2"] = field(default_factory=lambda: _no_rows(2))
    """Faces at a fixed angle."""
    angle_cosine: Float[np.ndarray, "angles"] = field(default_factory=lambda: np.zeros(0))
    """Cosine of the angle between the normals, up to its sign: the sign nearer to the start is kept; 0 is a right angle."""
    equal_length: Int[np.ndarray, "lengths 4"] = field(default_factory=lambda: _no_rows(4))
    """Corners i, j, k, l with |i - j| = |k - l|."""
    across_face: Int[np.ndarray, "across"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    across_vector: Float[np.ndarray, "across 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    """Unit vectors in the world at right angles to the normal of `across_face`."""
    across_edge: Int[np.ndarray, "edges 3"] = field(default_factory=lambda: _no_rows(3))
    """Face and two corners: the normal is at right angles to the edge."""
    along_edge: Int[np.ndarray, "edges 3"] = field(default_factory=lambda: _no_rows(3))
    """Face and two corners: the normal points along the edge."""
    mirror: Int[np.ndarray, "mirrors 3"] = field(default_factory=lambda: _no_rows(3))
    """Faces a, b, c: the plane of b is that of a mirrored in the plane of c."""


class Groups:
    """Disjoint sets of 0 .. size - 1; the root of a set is its smallest member, so numbering is the only order there is."""

    def __init__(self, size: int) -> None:
        self._parent = list(range(size))

    def root(self, item: int) -> int:
        while self._parent[item] != item:
            self._parent[item] = self._parent[self._parent[item]]
            item = self._parent[item]
        return item

    def join(self, a: int, b: int) -> bool:
        """Make one set of two; False where they were one already."""
        a, b = sorted((self.root(a), self.root(b)))
        self._parent[b] = a
        return a != b

    def roots(self) -> Int[np.ndarray, "size"]:
        """The root of every item."""
        return np.array([self.root(i) for i in range(len(self._parent))], dtype=np.int64)


def group_faces(
    points: Float[np.ndarray, "points 3"],
    normals: Float[np.ndarray, "faces 3"],
    incidences: Int[np.ndarray, "incidences 2"],
    constraints: StructureConstraints = StructureConstraints(),
) -> tuple[Int[np.ndarray, "faces"], Int[np.ndarray, "faces"]]:
    """Root of every face's direction and of every face's plane, after closing the given relations under what the drawing forces.

    Two planes that share three corners not on a line are one plane, and so are two parallel planes that share a corner. Without any relation given this
    tells which faces the drawing alone makes coplanar (a window and the wall it stands in). Left apart, such planes make the constraints' rank drop exactly
    at the solution.

    Args:
        points: first values, to tell corners on a line from others; any unit.
        normals: first values, for the doubtful cases of thin strips.
        incidences: face row, corner row.
    """
    num_faces = len(normals)
    direction, plane = Groups(num_faces), Groups(num_faces)
    for a, b in constraints.same_plane.tolist():
        plane.join(a, b)
        direction.join(a, b)
    for a, b in constraints.same_direction.tolist():
        direction.join(a, b)
    corners: list[set[int]] = [set() for _ in range(num_faces)]
    for face, corner in incidences.tolist():
        corners[face].add(corner)
    changed = True
    while changed:
        changed = False
        roots = plane.roots()
        distinct = np.unique(roots).tolist()
        pooled = {root: set().union(*(corners[f] for f in np.flatnonzero(roots == root).tolist())) for root in distinct}
        for i, a in enumerate(distinct):
            for b in distinct[i + 1 :]:
                shared = sorted(pooled[a] & pooled[b])
                parallel = direction.root(a) == direction.root(b)
                if (parallel and shared) or _span_a_plane(points[shared], normals[a], normals[b]):
                    direction.join(a, b)
                    changed |= plane.join(a, b)
    return direction.roots(), plane.roots()


def _span_a_plane(shared: Float[np.ndarray, "shared 3"], a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> bool:
    """Whether shared corners span a plane: plainly, or as a thin strip between planes that look alike anyway.

    Corners on a line (a wall's foot with the feet of its doors) scatter by about a pixel in some hundreds; a strip less than a tenth as wide as long is
    therefore believed only where the first values of the planes are within 20 degrees of each other.
    """
    if len(shared) < 3:
        return False
    values = np.linalg.svd(shared - shared.mean(axis=0), compute_uv=False)
    if values[1] > 0.1 * values[0]:
        return True
    return bool(values[1] > 0.02 * values[0] and abs(a @ b) > np.cos(np.radians(20.0)))
