"""The surfaces of a scene as flat arrays, and what rays meet among them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.synthetic import kernels
from planewright.synthetic.scene import Surface


@dataclass(frozen=True, eq=False)
class Polygons:
    """Geometry of many planar polygons, each with its own plane coordinates (u to the right, v down the plane)."""

    vertices: Float[np.ndarray, "vertices 3"]
    owner: Int[np.ndarray, "vertices"]
    """The polygon of each vertex."""
    loop_start: Int[np.ndarray, "loops_plus_one"]
    """Vertices of loop l are `loop_start[l]:loop_start[l + 1]`."""
    polygon_loop: Int[np.ndarray, "polygons_plus_one"]
    """Loops of polygon p are `polygon_loop[p]:polygon_loop[p + 1]`."""
    frames: Float[np.ndarray, "polygons 3 4"]
    """Rows u, v and height over the plane: plane coordinates of a world point x are `frames[..., :3] @ x + frames[..., 3]`."""
    corners: Float[np.ndarray, "vertices 2"]
    """Plane coordinates of the vertices, scene units, never negative."""
    spheres: Float[np.ndarray, "polygons 4"]
    """Centre and radius of a sphere around each polygon."""

    def extent(self, polygon: int) -> Float[np.ndarray, "2"]:
        """Largest plane coordinates of a polygon."""
        return self.corners[self.owner == polygon].max(axis=0)

    def covered(self, points: Float[np.ndarray, "points 3"], centers: Float[np.ndarray, "frames 3"], slack: float) -> Bool[np.ndarray, "points frames"]:
        """Whether anything stands between a centre and a point, nearer than the point by more than `slack` (scene units)."""
        out = np.zeros((len(points), len(centers)), np.bool_)
        kernels.covered(points, centers, slack, self.corners, self.loop_start, self.polygon_loop, self.frames, self.spheres, out)
        return out

    def light(
        self,
        points: Float[np.ndarray, "points 3"],
        normals: Float[np.ndarray, "points 3"],
        sun: Float[np.ndarray, "sun 3"],
        sky: Float[np.ndarray, "sky 3"],
        ambient: float,
    ) -> Float[np.ndarray, "points"]:
        """Light on points, 0 (none) to 1; see `kernels.light`."""
        out = np.zeros(len(points))
        kernels.light(points, normals, sun, sky, ambient, self.corners, self.loop_start, self.polygon_loop, self.frames, self.spheres, out)
        return out


def flatten(surfaces: Sequence[Surface], offsets: Float[np.ndarray, "polygons 2"] | None = None) -> Polygons:
    """The surfaces as arrays; `offsets` says where in its paint each begins (scene units)."""
    if offsets is None:
        offsets = np.zeros((len(surfaces), 2))
    loops = [loop for s in surfaces for loop in s.loops]
    vertices = np.concatenate(loops)
    owner = np.repeat(np.arange(len(surfaces)), [sum(len(loop) for loop in s.loops) for s in surfaces])
    frames = np.stack([_plane_frame(s, o) for s, o in zip(surfaces, offsets, strict=True)])
    flat = np.einsum("vij,vj->vi", frames[owner, :2, :3], vertices) + frames[owner, :2, 3]
    spheres = np.empty((len(surfaces), 4))
    for p, s in enumerate(surfaces):
        center = 0.5 * (s.loops[0].min(axis=0) + s.loops[0].max(axis=0))
        spheres[p] = (*center, 1e-6 + np.linalg.norm(s.loops[0] - center, axis=1).max())
    return Polygons(
        vertices=vertices,
        owner=owner,
        loop_start=np.concatenate([[0], np.cumsum([len(loop) for loop in loops])]),
        polygon_loop=np.concatenate([[0], np.cumsum([len(s.loops) for s in surfaces])]),
        frames=frames,
        corners=np.ascontiguousarray(flat),
        spheres=spheres,
    )


def subset(polygons: Polygons, keep: Bool[np.ndarray, "polygons"]) -> Polygons:
    """Some of the polygons."""
    kept = np.flatnonzero(keep)
    loop_polygon = np.repeat(np.arange(len(keep)), np.diff(polygons.polygon_loop))
    loops, vertices = np.flatnonzero(keep[loop_polygon]), np.flatnonzero(keep[polygons.owner])
    renamed = np.cumsum(keep) - 1
    return Polygons(
        vertices=polygons.vertices[vertices],
        owner=renamed[polygons.owner[vertices]],
        loop_start=np.concatenate([[0], np.cumsum(np.diff(polygons.loop_start)[loops])]),
        polygon_loop=np.concatenate([[0], np.cumsum(np.diff(polygons.polygon_loop)[kept])]),
        frames=polygons.frames[kept],
        corners=polygons.corners[vertices],
        spheres=polygons.spheres[kept],
    )


def _plane_frame(surface: Surface, offset: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3 4"]:
    """Axes u (level) and v (down the plane) with all plane coordinates at or above `offset`."""
    n = surface.normal
    u = np.array([1.0, 0.0, 0.0]) if abs(n[2]) > 0.98 else np.cross([0.0, 0.0, 1.0], n)
    u = u - (u @ n) * n
    u /= np.linalg.norm(u)
    axes = np.stack([u, -np.cross(n, u), n])
    flat = surface.loops[0] @ axes.T
    return np.column_stack([axes, [offset[0] - flat[:, 0].min(), offset[1] - flat[:, 1].min(), -flat[:, 2].mean()]])
