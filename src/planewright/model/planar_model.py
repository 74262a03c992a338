"""The textured planar model: what leaves the house."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, ColorImage, Float, Int, Vec3


@dataclass(frozen=True, eq=False)
class FaceMesh:
    """One face as triangles with its place in the texture."""

    id: str
    normal: Vec3
    vertices: Float[np.ndarray, "vertices 3"]
    """World; loop first, then the holes."""
    triangles: Int[np.ndarray, "triangles 3"]
    """Counter-clockwise when seen against the normal."""
    uv: Float[np.ndarray, "vertices 2"]
    """Texture coordinates in [0, 1]; origin at the top-left corner of the atlas, v down (as glTF has it)."""


@dataclass(frozen=True, eq=False)
class PlanarModel:
    """Faces with one texture atlas."""

    faces: tuple[FaceMesh, ...]
    atlas: ColorImage
    unit: str | None
    """The unit of the vertices once a length is known, else None (scene units)."""
    world_up: Vec3 | None
    """The direction that is up in the world, where known."""
    inferred: Bool[np.ndarray, "height width"]
    """Texels of the atlas that no frame saw and that were filled in."""
    view_up: Vec3 | None = None
    """The direction that was up in the images on average; stands in where `world_up` is not known."""
    notes: tuple[str, ...] = ()
    """What was left out or mended, in plain sentences, by face."""
