"""Which planar face is seen at each pixel, and how far away it is: a z-buffer of polygons with holes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planewright.arrays import Float, Int
from planewright.geometry.camera import Intrinsics
from planewright.geometry.raster_kernels import fill_faces
from planewright.geometry.rigid import Rigid


@dataclass(frozen=True, eq=False)
class PlanarPolygons:
    """Polygons with holes, each on a plane of the world; made by `planar_polygons`."""

    normals: Float[np.ndarray, "faces 3"]
    offsets: Float[np.ndarray, "faces"]
    """normal . x = offset."""
    corners: Float[np.ndarray, "corners 3"]
    """World; all loops of all faces, one after the other."""
    loop_start: Int[np.ndarray, "loops_1"]
    """Loop i is `corners[loop_start[i]:loop_start[i + 1]]`."""
    face_start: Int[np.ndarray, "faces_1"]
    """Face f has the loops `face_start[f]` to `face_start[f + 1]`: its border first, then its holes."""


@dataclass(frozen=True, eq=False)
class FaceBuffer:
    """The nearest face at each pixel centre."""

    face: Int[np.ndarray, "height width"]
    """Row of the face, or -1 where there is none."""
    depth: Float[np.ndarray, "height width"]
    """z in the camera, world units; infinite where there is no face."""


def planar_polygons(
    normals: Float[np.ndarray, "faces 3"], offsets: Float[np.ndarray, "faces"], loops: Sequence[Sequence[Float[np.ndarray, "... 3"]]]
) -> PlanarPolygons:
    """Polygons from planes and, for each face, its loops in the world: the border first, then the holes.

    A face without loops, or with a number that is not finite, keeps its row and is never seen.
    """
    flat = [np.asarray(loop, dtype=np.float64).reshape(-1, 3) for face in loops for loop in face]
    return PlanarPolygons(
        normals=np.ascontiguousarray(normals, dtype=np.float64),
        offsets=np.ascontiguousarray(offsets, dtype=np.float64),
        corners=np.concatenate(flat) if flat else np.zeros((0, 3)),
        loop_start=np.concatenate([[0], np.cumsum([len(loop) for loop in flat])]).astype(np.int64),
        face_start=np.concatenate([[0], np.cumsum([len(face) for face in loops])]).astype(np.int64),
    )


def face_buffer(polygons: PlanarPolygons, intrinsics: Intrinsics, cam_from_world: Rigid, *, scale: float = 1.0, near: float = 1e-3) -> FaceBuffer:
    """What a pinhole camera sees of the polygons; both sides of a face are seen and hide what is behind them.

    Where two faces are equally far, the one with the lower row is seen. Pixels belong to a face when their centre is inside it.

    Args:
        intrinsics: its distortion is left out.
        scale: size of the buffer relative to the image; a pixel (x, y) of the image is at (scale x, scale y) in the buffer.
        near: what is nearer than this (z, world units) is cut off.
    """
    width, height = (max(1, round(side * scale)) for side in intrinsics.image_size)
    face = np.full((height, width), -1, dtype=np.int16)
    inverse_depth = np.zeros((height, width), dtype=np.float32)
    cx, cy = (float(c) * scale for c in intrinsics.principal_point)
    fill_faces(
        polygons.normals, polygons.offsets, polygons.corners, polygons.loop_start, polygons.face_start,
        np.ascontiguousarray(cam_from_world.rotation, dtype=np.float64), np.ascontiguousarray(cam_from_world.translation, dtype=np.float64),
        float(intrinsics.focal) * scale, cx, cy, float(near), face, inverse_depth,
    )  # fmt: skip
    with np.errstate(divide="ignore"):
        return FaceBuffer(face=face, depth=np.float32(1.0) / inverse_depth)
