"""A scene of textured planar polygons with exact geometry: what the renderer draws and what the truth is read from."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from planewright.arrays import Float, Vec3
from planewright.geometry.rigid import rotations_from_vectors
from planewright.synthetic.textures import Painter

Part = Literal["thing", "room", "clutter"]
"""What is sketched and its unsketched sides; what stands around it for good; what merely lies about."""

Carrier = Literal["world", "object", "visitor"]
"""What carries a surface along: nothing; the turning object; a visitor that passes through the clip."""


@dataclass(frozen=True, eq=False)
class Surface:
    """One planar polygon with its paint."""

    loops: tuple[Float[np.ndarray, "_corners 3"], ...]
    """Outer loop, counter-clockwise when seen from outside, then the holes. World; scene units."""
    paint: Painter
    density: float
    """Texels a scene unit."""
    carrier: Carrier = "world"
    facet: bool = False
    """One small facet of a round thing: it shares its texture with the other facets of that paint and has one light all over."""
    part: Part = "thing"

    @property
    def normal(self) -> Vec3:
        """Unit normal towards the outside (Newell's sum over the outer loop)."""
        return loop_normal(self.loops[0])


@dataclass(frozen=True)
class TrueFace:
    """A face of the sketch: names of corners, counter-clockwise when seen from outside."""

    id: str
    loop: tuple[str, ...]
    holes: tuple[tuple[str, ...], ...] = ()
    open: bool = False
    """Sketched as a chain: the side from the last corner back to the first is not drawn."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Corners and faces that are sketched, and all surfaces that are drawn (those faces and everything around them)."""

    points: dict[str, tuple[float, float, float]]
    """Sketched corners, scene units, z up."""
    faces: tuple[TrueFace, ...]
    surfaces: tuple[Surface, ...]
    sun: tuple[float, float, float]
    """Direction towards the sun."""
    ambient: float = 0.5
    """Share of the light that comes from the whole sky."""
    sky_reach: float = 0.5
    """How far a surface shades others from the sky, as a share of the diagonal; small in a room, where walls would shut out all light."""
    background: tuple[float, float, float] = (150.0, 155.0, 160.0)
    """Colour where no surface is hit."""
    meant: dict[str, tuple[float, float, float]] | None = None
    """Where the corners were meant to be, when the thing was built a little off: relations are those of the intent."""

    def corner_array(self, ids: Sequence[str]) -> Float[np.ndarray, "corners 3"]:
        """World positions of corners."""
        return np.array([self.points[k] for k in ids])

    @property
    def diagonal(self) -> float:
        """Diagonal of the box around the sketched corners, scene units."""
        return float(np.linalg.norm(np.ptp(np.array(list(self.points.values())), axis=0)))


def opened(face: TrueFace, first: str) -> TrueFace:
    """The same face as a chain that begins at `first`: the side that leads there is not drawn."""
    at = face.loop.index(first)
    return replace(face, loop=(*face.loop[at:], *face.loop[:at]), open=True)


def loop_normal(loop: Float[np.ndarray, "corners 3"]) -> Vec3:
    """Unit normal of a planar loop; it points to where the loop runs counter-clockwise."""
    moved = loop - loop[0]
    total = np.cross(moved, np.roll(moved, -1, axis=0)).sum(axis=0)
    return total / np.linalg.norm(total)


def face_surfaces(
    points: dict[str, tuple[float, float, float]], faces: Sequence[TrueFace], paints: dict[str, Painter], density: float, carrier: Carrier = "world"
) -> tuple[Surface, ...]:
    """The sketched faces as surfaces; `paints` has one painter for each face id."""

    def loop(ids: Sequence[str]) -> Float[np.ndarray, "corners 3"]:
        return np.array([points[k] for k in ids])

    return tuple(Surface((loop(f.loop), *(loop(h) for h in f.holes)), paints[f.id], density, carrier) for f in faces)


def as_part(part: Part, surfaces: Iterable[Surface]) -> list[Surface]:
    """The same surfaces, told what they are part of."""
    return [replace(s, part=part) for s in surfaces]


def quad(corner: Sequence[float | int], along: Sequence[float | int], up: Sequence[float | int], paint: Painter, density: float) -> Surface:
    """A parallelogram from a corner and two sides; its outside is `along` x `up`."""
    a, u, v = (np.asarray(x, float) for x in (corner, along, up))
    return Surface((np.stack([a, a + u, a + u + v, a + v]),), paint, density)


def box(center: Sequence[float | int], size: Sequence[float | int], turn_deg: float, paint: Painter, density: float) -> tuple[Surface, ...]:
    """Four sides and the top of a box that stands on z = `center[2]`, turned about the vertical."""
    turn = rotations_from_vectors(np.array([[0.0, 0.0, np.radians(turn_deg)]]))[0]
    low = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * np.asarray(size, float)[:2]
    ring = np.column_stack([low, np.zeros(4)]) @ turn.T + np.asarray(center, float)
    lift = np.array([0.0, 0.0, float(size[2])])
    sides = [Surface((np.stack([ring[i], ring[(i + 1) % 4], ring[(i + 1) % 4] + lift, ring[i] + lift]),), paint, density) for i in range(4)]
    return (*sides, Surface((ring + lift,), paint, density))


@dataclass(frozen=True, eq=False)
class SketchedBox:
    """A box that stands upright, of which some sides are sketched; the other sides are there to hide what is behind them."""

    points: dict[str, tuple[float, float, float]]
    """The corners of the sketched sides: NAME_0 to NAME_3 at the foot (south-west, then counter-clockwise from above), NAME_4 to NAME_7 above them."""
    faces: tuple[TrueFace, ...]
    """NAME_s, NAME_e, NAME_n, NAME_w, NAME_top: those that were asked for."""
    hidden: tuple[tuple[tuple[float, float, float], ...], ...]
    """Loops of the other upright sides."""


def sketched_box(
    name: str, center: Sequence[float | int], size: Sequence[float | int], turn_deg: float, sides: Sequence[str], lid_deg: float = 0.0
) -> SketchedBox:
    """A box on z = `center[2]`, turned about the vertical; `sides` are among s, e, n, w (before the turn) and top, which rises by `lid_deg` to the east."""
    turn = np.radians(turn_deg)
    low = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * np.asarray(size, float)[:2]
    ring = low @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) + np.asarray(center, float)[:2]
    rise = np.tan(np.radians(lid_deg)) * low[:, 0]
    corners = [(float(x), float(y), float(center[2])) for x, y in ring]
    corners += [(float(x), float(y), float(center[2]) + float(size[2]) + float(more)) for (x, y), more in zip(ring, rise, strict=True)]
    loops = {side: (i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i) for i, side in enumerate("senw")} | {"top": (4, 5, 6, 7)}
    used = sorted({i for side in sides for i in loops[side]})
    return SketchedBox(
        {f"{name}_{i}": corners[i] for i in used},
        tuple(TrueFace(f"{name}_{side}", tuple(f"{name}_{i}" for i in loops[side])) for side in sides),
        tuple(tuple(corners[i] for i in loop) for side, loop in loops.items() if side not in sides),
    )


def pillar(center: Sequence[float | int], radius: float, height: float, sides: int, paint: Painter, density: float) -> tuple[Surface, ...]:
    """An upright prism with a top: a tin, a post, a roll."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(sides)]) + np.asarray(center, float)
    lift = np.array([0.0, 0.0, height])
    walls = [
        Surface((np.stack([ring[i], ring[(i + 1) % sides], ring[(i + 1) % sides] + lift, ring[i] + lift]),), paint, density, facet=True) for i in range(sides)
    ]
    return (*walls, Surface((ring + lift,), paint, density))


def blob(
    center: Sequence[float | int], radii: Sequence[float | int], roughness: float, paint: Painter, density: float, rng: np.random.Generator, finer: int = 2
) -> tuple[Surface, ...]:
    """A ball or a bush of triangles: an icosahedron split `finer` times, its corners pushed in and out by the share `roughness`."""
    golden = (1 + 5**0.5) / 2
    corners = [(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0), (0, -1, golden), (0, 1, golden)]
    corners += [(0, -1, -golden), (0, 1, -golden), (golden, 0, -1), (golden, 0, 1), (-golden, 0, -1), (-golden, 0, 1)]
    vertices = [np.array(c, float) / np.linalg.norm(c) for c in corners]
    distance = np.linalg.norm(np.array(vertices)[:, None] - np.array(vertices), axis=2)
    near = distance < 1.2 * np.sort(distance[0])[1]
    triangles = [(i, j, k) for i in range(12) for j in range(i + 1, 12) for k in range(j + 1, 12) if near[i, j] and near[j, k] and near[i, k]]
    for _ in range(finer - 1):
        middle: dict[tuple[int, int], int] = {}

        def between(i: int, j: int, middle: dict[tuple[int, int], int] = middle) -> int:
            key = (min(i, j), max(i, j))
            if key not in middle:
                m = vertices[i] + vertices[j]
                vertices.append(m / np.linalg.norm(m))
                middle[key] = len(vertices) - 1
            return middle[key]

        split: list[tuple[int, int, int]] = []
        for i, j, k in triangles:
            a, b, c = between(i, j), between(j, k), between(k, i)
            split += [(i, a, c), (a, j, b), (c, b, k), (a, b, c)]
        triangles = split
    shape = np.array(vertices) * (1 + roughness * rng.standard_normal((len(vertices), 1))) * np.asarray(radii, float)
    surfaces: list[Surface] = []
    for triangle in triangles:
        loop = shape[list(triangle)]
        if loop_normal(loop) @ loop.mean(axis=0) < 0:
            loop = loop[::-1].copy()
        surfaces.append(Surface((loop + np.asarray(center, float),), paint, density, facet=True))
    return tuple(surfaces)
