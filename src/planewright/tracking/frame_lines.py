"""The lines of drawn edges in every frame, each near where the model shows the edge and where the model hides no part of it."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Bool, Float, GrayImage, Int
from planewright.geometry.raster import FaceBuffer
from planewright.planes.planar_scene import PlanarScene
from planewright.sfm.cameras import Cameras
from planewright.tracking.edges import drawn_edges
from planewright.tracking.fusion import FrameLines
from planewright.tracking.kernels import frame_edges


@dataclass(frozen=True, kw_only=True)
class FrameLineOptions:
    """How lines are looked for in a frame."""

    search: float = 3.5
    """Edges are looked for this far from where the model shows them, pixels."""
    spacing: float = 3.0
    """Spacing of the samples along an edge, pixels."""
    min_step: float = 3.0
    """Weakest step across an edge that counts, grey levels over one pixel, or over the motion blur where that is longer."""
    min_share: float = 0.5
    """Share of an edge's samples that must lie on one line."""
    exposure: float = 0.5
    """Exposure time as a share of the time between frames, from which the length of the motion blur follows: half of it is what most cameras choose."""
    near: float = 0.02
    """Edges that pass the camera are cut where they are this share of the scene's size in front of it."""


@dataclass(frozen=True, eq=False)
class EdgeView:
    """Where the model shows its edges in all frames."""

    edges: Int[np.ndarray, "edges 2"]
    own: Bool[np.ndarray, "edges faces"]
    """The faces at each edge."""
    place: Float[np.ndarray, "rows edges 2 2"]
    """Of the ends, pixels; NaN where the whole edge is behind the camera."""
    inverse_depth: Float[np.ndarray, "rows edges 2"]
    at_corner: Bool[np.ndarray, "rows edges 2"]
    blur: Float[np.ndarray, "rows edges 2"]
    """Motion across the edge in the exposure, pixels."""
    tolerance: float
    """A face hides an edge when it is nearer by this, world units."""

    @property
    def normal(self) -> Float[np.ndarray, "rows edges 2"]:
        """Unit, (-dy, dx) / length."""
        along = self.place[:, :, 1] - self.place[:, :, 0]
        length = np.linalg.norm(along, axis=2, keepdims=True)
        return np.stack([-along[..., 1], along[..., 0]], axis=2) / np.maximum(length, 1e-9)


def view_edges(
    scene: PlanarScene, points: Float[np.ndarray, "points 3"], cameras: Cameras, rows: Int[np.ndarray, "rows"], tolerance: float, options: FrameLineOptions
) -> EdgeView:
    """The drawn edges between known corners as the cameras in `rows` see them. points: the corners, which may lie beside the scene's planes.

    A corner may be known where its face is not: its edges place it as well (a model house whose windows have no plane, 65 to 79 % within 2 px).
    """
    drawn = [(f, a, b) for f, a, b in drawn_edges(scene.sketch) if scene.point_known[a] and scene.point_known[b]]
    edges = np.array(sorted({(min(a, b), max(a, b)) for _, a, b in drawn}), dtype=np.int64).reshape(-1, 2)
    number = {(int(a), int(b)): e for e, (a, b) in enumerate(edges)}
    own = np.zeros((len(edges), max(len(scene.sketch.faces), 1)), bool)
    for f, a, b in drawn:
        own[number[min(a, b), max(a, b)], f] = True
    in_cam = np.einsum("kij,pj->kpi", cameras.rotation[rows], points) + cameras.translation[rows][:, None]
    ends = in_cam[:, edges]
    size = float(np.linalg.norm(np.ptp(points[scene.point_known], axis=0))) if scene.point_known.any() else 1.0
    near = options.near * size
    z = ends[..., 2]
    behind = z < near
    cut = np.zeros_like(ends)
    for side in range(2):
        a, b = ends[:, :, side], ends[:, :, 1 - side]
        share = (near - a[..., 2]) / np.where(np.abs(b[..., 2] - a[..., 2]) > 1e-12, b[..., 2] - a[..., 2], np.inf)
        cut[:, :, side] = np.where(behind[:, :, side, None], a + share[..., None] * (b - a), a)
    lost = behind.all(axis=2)
    cut[lost] = np.nan
    pinhole = cameras.intrinsics.pinhole()
    place = pinhole.principal_point + pinhole.focal * cut[..., :2] / cut[..., 2:]
    return EdgeView(edges, own, place, 1.0 / cut[..., 2], ~behind, _blur(place, cameras.frame[rows], options.exposure), tolerance)


def _blur(place: Float[np.ndarray, "rows edges 2 2"], numbers: Int[np.ndarray, "rows"], exposure: float) -> Float[np.ndarray, "rows edges 2"]:
    """Length of each edge end's motion across the edge while the shutter is open, from where the neighbouring frames show it."""
    if len(place) < 2:
        return np.zeros(place.shape[:3])
    before = np.maximum(np.arange(len(place)) - 1, 0)
    after = np.minimum(np.arange(len(place)) + 1, len(place) - 1)
    # Frames that were left out lie between: what is wanted is the motion in the time of one.
    motion = (place[after] - place[before]) / (numbers[after] - numbers[before])[:, None, None, None]
    along = place[:, :, 1] - place[:, :, 0]
    normal = np.stack([-along[..., 1], along[..., 0]], axis=2) / np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-9)
    return np.nan_to_num(exposure * np.abs(np.einsum("keai,kei->kea", motion, normal)))


def measure_frame(image: GrayImage, view: EdgeView, k: int, buffer: FaceBuffer, options: FrameLineOptions) -> Float[np.ndarray, "edges 6"]:
    """`kernels.frame_edges` of one frame. buffer: what the model shows there, of any size."""
    out = np.zeros((len(view.edges), 6))
    ends = view.place[k].reshape(-1, 4) - 0.5
    use = np.nonzero(np.isfinite(ends).all(axis=1))[0]
    found = np.zeros((len(use), 6))
    frame_edges(
        cv2.GaussianBlur(image, (0, 0), 0.8), ends[use], view.inverse_depth[k, use], view.own[use], view.blur[k, use], buffer.face, buffer.depth,
        view.tolerance, options.search, options.spacing, options.min_step, found,
    )  # fmt: skip
    found[found[:, 5] < options.min_share] = 0.0
    out[use] = found
    return out


def frame_lines(view: EdgeView, measured: Iterable[Float[np.ndarray, "edges 6"]]) -> FrameLines:
    """What was measured in all frames, ready to be fused."""
    rows = np.array(list(measured)).reshape(*view.place.shape[:2], 6)
    information = rows[..., [2, 3, 3, 4]].reshape(*rows.shape[:2], 2, 2)
    return FrameLines(view.edges, view.normal, view.place, view.at_corner, rows[..., :2], information)
