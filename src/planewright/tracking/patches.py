"""Small parts of the faces right at their corners: where to look whether a corner is covered by something that nobody sketched."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, ColorImage, Float, Int
from planewright.geometry.raster import FaceBuffer, PlanarPolygons
from planewright.planes.planar_scene import PlanarScene
from planewright.sfm.cameras import Cameras
from planewright.tracking.kernels import sample_patches
from planewright.tracking.visibility import inside_polygon


@dataclass(frozen=True, kw_only=True)
class PatchOptions:
    """Where a face is looked at near its corners."""

    radius: float = 9.0
    """Pixels around the corner, in a frame that shows the face about as large as most do."""
    spacing: float = 1.5
    """Between samples, the same pixels."""
    border: float = 1.6
    """Samples keep this far from the face's border, the same pixels."""
    most: int = 40
    """Samples of a patch; the nearest to the corner are taken."""
    fewest: int = 4
    """A patch with fewer is none."""


@dataclass(frozen=True, eq=False)
class Patches:
    """Samples on faces near corners; patch p has the samples `start[p]` to `start[p + 1]`."""

    corner: Int[np.ndarray, "patches"]
    face: Int[np.ndarray, "patches"]
    start: Int[np.ndarray, "patches_1"]
    points: Float[np.ndarray, "samples 3"]
    """World, on the plane of the face."""
    radius: Float[np.ndarray, "samples"]
    """From the corner, pixels of the frame in which the patch was laid out."""
    borders: Float[np.ndarray, "patches 5 2 3"]
    """Edges of the face next to the patch, world; NaN where there are fewer."""


def lay_patches(
    scene: PlanarScene,
    points: Float[np.ndarray, "points 3"],
    polygons: PlanarPolygons,
    cameras: Cameras,
    rows: Int[np.ndarray, "rows"],
    visible: Bool[np.ndarray, "rows points"],
    options: PatchOptions = PatchOptions(),
) -> Patches:
    """A patch for each corner of each known face that some frames show.

    points: the corners; visible: where the model hides none of them.
    """
    index = {point.id: i for i, point in enumerate(scene.sketch.points)}
    centers = cameras.centers[rows]
    corner, face, parts, radii, borders = [], [], [], [], []
    for f, drawn in enumerate(scene.sketch.faces):
        if not scene.face_known[f] or polygons.face_start[f] == polygons.face_start[f + 1]:
            continue
        facing = centers @ scene.normals[f] > scene.offsets[f]
        for c in sorted({index[name] for name in drawn.corners}):
            shown = np.nonzero(visible[:, c] & facing)[0]
            if not scene.point_known[c] or len(shown) == 0:
                continue
            ray = points[c] - centers[shown]
            size = np.abs(ray @ scene.normals[f]) / np.linalg.norm(ray, axis=1) ** 3
            # The frame whose view of the face is larger than that of 60 % of them.
            k = int(rows[shown[np.argsort(size, kind="stable")[int(0.6 * len(shown))]]])
            laid = _lay(scene, points[c], f, polygons, cameras, k, options)
            if laid is not None:
                corner.append(c)
                face.append(f)
                parts.append(laid[0])
                radii.append(laid[1])
                borders.append(laid[2])
    start = np.cumsum([0, *(len(part) for part in parts)])
    return Patches(
        np.array(corner, np.int64), np.array(face, np.int64), start.astype(np.int64),
        np.concatenate(parts) if parts else np.zeros((0, 3)), np.concatenate(radii) if radii else np.zeros(0), np.array(borders).reshape(-1, 5, 2, 3),
    )  # fmt: skip


def _lay(
    scene: PlanarScene, corner: Float[np.ndarray, "3"], f: int, polygons: PlanarPolygons, cameras: Cameras, k: int, options: PatchOptions
) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples"], Float[np.ndarray, "5 2 3"]] | None:
    """The samples, nearest first, their distances from the corner, and the borders, of one patch laid out in the camera of row `k`."""
    pose, lens = cameras.cam_from_world(k), cameras.intrinsics.pinhole()
    middle = lens.project(pose.apply(corner[None]))[0]
    steps = np.arange(-options.radius, options.radius + 1e-6, options.spacing)
    x, y = np.meshgrid(steps, steps)
    around = np.column_stack([x.ravel(), y.ravel()])
    radius = np.hypot(around[:, 0], around[:, 1])
    around, radius = around[radius <= options.radius], radius[radius <= options.radius]
    rays = np.column_stack([lens.normalize(middle + around), np.ones(len(around))]) @ pose.rotation
    center = cameras.centers[k]
    slope = rays @ scene.normals[f]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (scene.offsets[f] - center @ scene.normals[f]) / slope
    ahead = np.isfinite(reach) & (reach > 1e-9)
    points = center + np.where(ahead, reach, 1.0)[:, None] * rays
    loops = [polygons.corners[polygons.loop_start[n] : polygons.loop_start[n + 1]] for n in range(polygons.face_start[f], polygons.face_start[f + 1])]
    a, b = np.concatenate(loops), np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    # Borders that pass the camera are no nearer than the ones that do not: a patch is small.
    ahead_too = (pose.apply(a)[:, 2] > 1e-9) & (pose.apply(b)[:, 2] > 1e-9)
    a, b = a[ahead_too], b[ahead_too]
    start, along = lens.project(pose.apply(a)), lens.project(pose.apply(b)) - lens.project(pose.apply(a))
    away = (middle + around)[:, None] - start
    share = np.clip((away * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12), 0.0, 1.0)
    distance = np.linalg.norm(away - share[..., None] * along, axis=2)
    free = ahead & inside_polygon(polygons, f, points) & (distance.min(axis=1, initial=np.inf) > options.border)
    order = np.argsort(radius[free], kind="stable")[: options.most]
    if len(order) < options.fewest:
        return None
    near = np.argsort(distance[free].min(axis=0), kind="stable")[:5]
    borders = np.full((5, 2, 3), np.nan)
    borders[: len(near), 0], borders[: len(near), 1] = a[near], b[near]
    return points[free][order], radius[free][order], borders


def sample_frame(
    image: ColorImage, patches: Patches, cameras: Cameras, row: int, usable: Bool[np.ndarray, "patches"], buffer: FaceBuffer, tolerance: float
) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples"]]:
    """`kernels.sample_patches` of one frame: colours (NaN where the place is not seen), and pixels to the nearest border."""
    values, distance = np.empty((len(patches.points), 3), np.float32), np.empty(len(patches.points), np.float32)
    patch = np.repeat(np.arange(len(patches.corner)), np.diff(patches.start))
    lens = cameras.intrinsics
    cx, cy = (float(c) - 0.5 for c in lens.principal_point)
    sample_patches(
        image, patches.points, patch, usable, patches.face, patches.borders, cameras.rotation[row], cameras.translation[row], float(lens.focal), cx, cy,
        buffer.face, buffer.depth, tolerance, values, distance,
    )  # fmt: skip
    return values, distance
