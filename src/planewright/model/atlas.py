"""The texture atlas: one image for all faces, and where each face lies in it."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, ColorImage, Float, Vec3


@dataclass(frozen=True, eq=False)
class FaceChart:
    """A rectangle of texels laid on the plane of a face. Texel coordinates are like pixels: (0, 0) is the outer corner of the top-left texel."""

    face: int
    """Row of the face in the scene."""
    origin: Vec3
    """World: where texel coordinates (0, 0) lie on the plane."""
    axis_u: Vec3
    """World, unit: to the right in the chart, seen from the front of the face."""
    axis_v: Vec3
    """World, unit: down in the chart; `axis_u` x `axis_v` is minus the face's normal."""
    texel: float
    """Side of a texel, world units."""
    width: int
    height: int
    """Texels."""
    column: int = 0
    row: int = 0
    """Where the chart's top-left texel is in the atlas."""

    def to_texels(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 2"]:
        """Texel coordinates in the chart of points on the plane."""
        return (points - self.origin) @ np.stack([self.axis_u, self.axis_v], axis=1) / self.texel

    def to_world(self, texels: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 3"]:
        """World points on the plane of texel coordinates in the chart."""
        return self.origin + self.texel * (texels @ np.stack([self.axis_u, self.axis_v]))


@dataclass(frozen=True, eq=False)
class Atlas:
    """The texture of all faces."""

    image: ColorImage
    inferred: Bool[np.ndarray, "height width"]
    """Texels inside a face that no frame saw and that were filled in from their neighbours."""
    charts: tuple[FaceChart, ...]
    """One for each face that has a place in the atlas, by increasing row."""

    def uv(self, chart: FaceChart, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 2"]:
        """Texture coordinates in [0, 1] of points on a face; the origin is the atlas's top-left corner, v down."""
        height, width = self.inferred.shape
        return (chart.to_texels(points) + np.array([chart.column, chart.row])) / np.array([width, height])
