"""Pictures of a model without a display."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from planewright.arrays import Bool, ColorImage, Float, Int
from planewright.geometry.camera import Intrinsics
from planewright.geometry.raster import FaceBuffer, face_buffer, planar_polygons
from planewright.geometry.rigid import Rigid
from planewright.model.kernels import paint_faces
from planewright.model.planar_model import FaceMesh, PlanarModel

RenderMode = Literal["textured", "shaded", "wire"]


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """How a picture of a model looks."""

    supersampling: int = 2
    """Samples along each side of a pixel."""
    top: tuple[int, int, int] = (250, 251, 252)
    """Background at the top (RGB)."""
    bottom: tuple[int, int, int] = (226, 230, 235)
    """Background at the bottom (RGB)."""
    line: tuple[int, int, int] = (38, 46, 58)
    """Colour of edges (RGB)."""
    line_width: float = 1.2
    """Pixels."""
    line_strength: float = 0.55
    """Opacity of the edges that are in sight when shaded or textured; 0 draws none."""


def render_model(
    model: PlanarModel, cam_from_world: Rigid, intrinsics: Intrinsics, mode: RenderMode = "textured", options: RenderOptions = RenderOptions()
) -> ColorImage:
    """What a pinhole camera sees of the model on a light background.

    `textured` shows the atlas as it is; `shaded` shows each face in one tone by its slant to a light over the camera's left shoulder, so that the shape can
    be judged without the texture; `wire` shows the edges alone, those out of sight faintly.
    """
    factor = options.supersampling
    polygons = planar_polygons(
        np.array([face.normal for face in model.faces]).reshape(-1, 3),
        np.array([face.normal @ face.vertices.mean(axis=0) for face in model.faces]).reshape(-1),
        # Triangles of a face share borders but no inside, so as loops they make up the face.
        [[face.vertices[triangle] for triangle in face.triangles] for face in model.faces],
    )
    buffer = face_buffer(polygons, intrinsics, cam_from_world, scale=float(factor))
    height, width = buffer.face.shape
    blend = np.linspace(0.0, 1.0, height)[:, None, None]
    image = np.broadcast_to(np.rint((1 - blend) * np.array(options.top) + blend * np.array(options.bottom)), (height, width, 3)).astype(np.uint8)
    if mode == "textured" and model.faces:
        _paint(image, model, cam_from_world, intrinsics, buffer, factor)
    elif mode == "shaded":
        tones = np.array([_tone(face, cam_from_world) for face in model.faces], dtype=np.uint8).reshape(-1, 3)
        image[buffer.face >= 0] = tones[buffer.face[buffer.face >= 0]]
    image = _with_edges(image, model, cam_from_world, intrinsics, buffer, mode, options)
    return cv2.resize(image, intrinsics.image_size, interpolation=cv2.INTER_AREA)


def _paint(image: ColorImage, model: PlanarModel, pose: Rigid, intrinsics: Intrinsics, buffer: FaceBuffer, factor: int) -> None:
    """The texture onto the image; faces that are seen much smaller than their texture take it from a smaller copy, which does not glitter."""
    warps = np.stack([_atlas_from_pixels(face, model, pose, intrinsics, factor) for face in model.faces])
    levels = np.array([_level(warp, buffer.face == f) for f, warp in enumerate(warps)])
    for level in np.unique(levels).tolist():
        height, width = (max(1, side >> level) for side in model.inferred.shape)
        atlas = cv2.resize(model.atlas, (width, height), interpolation=cv2.INTER_AREA) if level else model.atlas
        shrink = np.diag([width / model.inferred.shape[1], height / model.inferred.shape[0], 1.0])
        paint_faces(buffer.face, shrink @ warps, levels == level, atlas, image)


def _level(warp: Float[np.ndarray, "3 3"], covered: Bool[np.ndarray, "height width"]) -> int:
    """How many times to halve the atlas so that a pixel in the middle of what a face covers takes about one texel."""
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    if len(rows) == 0:
        return 0
    x, y = 0.5 * (columns[0] + columns[-1]) + 0.5, 0.5 * (rows[0] + rows[-1]) + 0.5
    texels = np.array([[x, y, 1.0], [x + 1, y, 1.0], [x, y + 1, 1.0]]) @ warp.T
    here, right, below = texels[:, :2] / texels[:, 2:]
    # The finer of the two directions: an oblique face is better a little restless than smeared.
    step = min(np.linalg.norm(right - here), np.linalg.norm(below - here))
    return int(np.clip(np.floor(np.log2(max(step, 1.0) * 1.2)), 0, 6))


def _atlas_from_pixels(face: FaceMesh, model: PlanarModel, pose: Rigid, intrinsics: Intrinsics, factor: int) -> Float[np.ndarray, "3 3"]:
    """The homography from pixels of the large picture to texels of the atlas (outer corner at 0)."""
    height, width = model.inferred.shape
    # Plane coordinates to texels is affine, and exact for the corners of a face: any three that are not on a line determine it.
    ones = np.ones((len(face.uv), 1))
    world_from_texels = np.linalg.lstsq(np.hstack([face.uv * [width, height], ones]), face.vertices, rcond=None)[0].T
    cam_from_texels = pose.rotation @ world_from_texels
    cam_from_texels[:, 2] += pose.translation
    pixels_from_texels = np.diag([factor, factor, 1.0]) @ intrinsics.matrix @ cam_from_texels
    determinant = float(np.linalg.det(pixels_from_texels))
    # Seen exactly edge-on a face covers no pixel.
    return np.linalg.inv(pixels_from_texels) if abs(determinant) > 1e-12 else np.eye(3)


def _tone(face: FaceMesh, pose: Rigid) -> Int[np.ndarray, "3"]:
    normal = pose.rotation @ face.normal
    toward = pose.apply(face.vertices.mean(axis=0, keepdims=True))[0]
    normal = -normal if normal @ toward > 0 else normal
    # Light from the upper left behind the camera; backs and fronts are lit alike, since a model need not be closed.
    light = np.array([-0.45, -0.75, -0.5]) / np.linalg.norm([0.45, 0.75, 0.5])
    brightness = 0.5 + 0.5 * float(normal @ light)
    return np.rint(np.array([112, 126, 146]) * (1 - brightness) + np.array([238, 241, 245]) * brightness).astype(np.int64)


def _with_edges(
    image: ColorImage, model: PlanarModel, pose: Rigid, intrinsics: Intrinsics, buffer: FaceBuffer, mode: RenderMode, options: RenderOptions
) -> ColorImage:
    if not model.faces:
        return image
    segments = np.concatenate([face.vertices[border_edges(face)] for face in model.faces])
    in_sight, hidden = _split_by_sight(segments, pose, intrinsics, buffer, options.supersampling)
    layers = [(in_sight, 1.0 if mode == "wire" else options.line_strength)]
    if mode == "wire":
        layers.insert(0, (hidden, 0.25))
    thickness = max(1, round(options.line_width * options.supersampling))
    for pieces, strength in layers:
        drawn = np.zeros(image.shape[:2], dtype=np.uint8)
        # 4 bits of fraction; OpenCV puts whole numbers at the centres of pixels.
        cv2.polylines(drawn, [np.rint((piece - 0.5) * 16).astype(np.int32) for piece in pieces], False, 255, thickness, cv2.LINE_AA, 4)
        alpha = drawn[..., None].astype(np.float32) * (strength / 255)
        image = np.rint(image * (1 - alpha) + np.array(options.line, dtype=np.float32) * alpha).astype(np.uint8)
    return image


def border_edges(face: FaceMesh) -> Int[np.ndarray, "edges 2"]:
    """The edges of a face's triangles that belong to one triangle only: its outline and those of its holes."""
    edges = np.sort(face.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, times = np.unique(edges, axis=0, return_counts=True)
    return unique[times == 1]


def _split_by_sight(
    segments: Float[np.ndarray, "segments 2 3"], pose: Rigid, intrinsics: Intrinsics, buffer: FaceBuffer, factor: int
) -> tuple[list[Float[np.ndarray, "... 2"]], list[Float[np.ndarray, "... 2"]]]:
    """The parts of edges that are in sight and those that something hides, as polylines in pixels of the large picture."""
    height, width = buffer.face.shape
    # The farthest depth within 2 pixels: an edge lies on its faces, and only half of its pixels are theirs.
    farthest = cv2.dilate(buffer.depth, np.ones((5, 5), np.uint8))
    seen: list[Float[np.ndarray, "... 2"]] = []
    hidden: list[Float[np.ndarray, "... 2"]] = []
    for segment in segments:
        ends = pose.apply(segment)
        near = 1e-3
        if (ends[:, 2] < near).all():
            continue
        if (ends[:, 2] < near).any():
            front, back = np.argsort(-ends[:, 2])
            ends[back] = ends[front] + (ends[front, 2] - near) / (ends[front, 2] - ends[back, 2]) * (ends[back] - ends[front])
        pixels = intrinsics.pinhole().project(ends) * factor
        length = float(np.linalg.norm(pixels[1] - pixels[0]))
        steps = int(np.clip(length / 3, 2, 2000))
        # Even steps in the image; the inverse depth is linear there.
        weight = np.linspace(0, 1, steps + 1)[:, None]
        xy = pixels[0] + weight * (pixels[1] - pixels[0])
        depth = 1 / (1 / ends[0, 2] + weight[:, 0] * (1 / ends[1, 2] - 1 / ends[0, 2]))
        inside = (xy >= 0).all(axis=1) & (xy[:, 0] < width) & (xy[:, 1] < height)
        x, y = np.where(inside, xy.T, 0).astype(int)
        visible = inside & (depth <= farthest[y, x] * 1.005)
        for a, b in zip(*_runs(visible), strict=True):
            seen.append(xy[max(a - 1, 0) : b + 1])
        for a, b in zip(*_runs(inside & ~visible), strict=True):
            hidden.append(xy[max(a - 1, 0) : b + 1])
    return seen, hidden


def _runs(flags: np.ndarray) -> tuple[list[int], list[int]]:
    """Starts and ends (exclusive) of runs of True."""
    change = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    return np.flatnonzero(change == 1).tolist(), np.flatnonzero(change == -1).tolist()
