"""Each face's plane from several reference views, with the other faces of the model as occluders.

One reference is not enough: what hides the face there, a shadow's edge or soft focus are common to all that it is compared with.
Several, far apart, also show how far the planes differ, which says more about their error than the formal covariance does.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Bool, Float, Int, UInt8, Vec3
from planewright.lifting.photometric import (
    PhotometricOptions,
    PhotometricPlane,
    Reference,
    common_growth,
    plane_from_world,
    plane_to_world,
    reference_from_mask,
    refine,
)
from planewright.lifting.views import Views
from planewright.planes.evidence import PlanePoints


@dataclass(frozen=True, kw_only=True)
class MultiviewOptions:
    """How faces are measured in many views."""

    references: int = 4
    """Reference views a face, spread over those that see it well."""
    min_pixels: int = 60
    """A face must cover this many working pixels in a reference."""
    min_zncc: float = 0.25
    """Estimates whose views agree less are dropped."""
    start: float = 0.075
    """The first views compared see this share of the largest motion there is."""
    floor: float = 0.12
    """Least depth sigma of a face in all, in pixels of motion: what cameras and images have in common however many views are compared."""
    thin: float = 5.0
    """How far a face one working pixel thin may be off along its normal, working pixels (of the camera's distance, however square it is to
    the view); it falls with the thickness and the cube of the ZNCC. What shows at a face's border belongs to its neighbour when the border is
    a pixel off, and tilts it the more the thinner it is. On four clips with truth, faces of 5, 11, 16 and 24 pixels were 1.3, .6, 1.2
    and .5 off."""
    gray_error: float = 0.3
    """Error of grey values that all pixels of a face may have in common (coding, light), grey levels: bare faces cannot be located
    better than this over their mean slope, however many pixels they have."""
    max_tilt_deg: float = 12.0
    """Estimates that turn further away from the present plane followed something else."""
    max_shift: float = 16.0
    """So did those that move the face by more than this, in pixels of motion."""
    unmoved: float = 1.0
    """A face that is nearer than this to where the same view saw it in the round before, in pixels of motion, is compared in the views that show it
    moved most: the others only lead there, and images blurred by .7 pixels pull together what is a pixel apart."""


@dataclass(frozen=True, eq=False)
class FaceEstimate:
    """One face as one reference view sees it."""

    face: int
    found: PhotometricPlane
    normal: Vec3
    offset: float


def visible_shares(views: Views, owners: Int[np.ndarray, "views height width"], num_faces: int) -> Float[np.ndarray, "views faces"]:
    """Working pixels of each face that are seen in each view."""
    scale = owners.shape[1] / views.images.shape[1]
    counts = np.stack([np.bincount(owner.ravel() + 1, minlength=num_faces + 1)[1:] for owner in owners])
    return counts / scale**2


def measure_faces(
    views: Views,
    normals: Float[np.ndarray, "faces 3"],
    offsets: Float[np.ndarray, "faces"],
    known: Bool[np.ndarray, "faces"],
    owners: Int[np.ndarray, "views height width"],
    options: MultiviewOptions = MultiviewOptions(),
    photometric: PhotometricOptions = PhotometricOptions(),
    *,
    last: Sequence[FaceEstimate] = (),
) -> list[FaceEstimate]:
    """Every known face measured again from its best reference views, starting from the present planes.

    last: the estimates of an earlier round. A face that is still where such a view saw it is compared at the largest baselines alone.
    """
    areas = visible_shares(views, owners, len(normals))
    seen_before = {(estimate.face, estimate.found.reference.view): estimate for estimate in last}
    jobs = [(int(f), view) for f in np.nonzero(known)[0] for view in _references(areas[:, f], (views.centers @ normals[f] - offsets[f]) > 0, options)]

    def measure(job: tuple[int, int]) -> FaceEstimate | None:
        f, view = job
        return _measure(views, f, view, normals[f], float(offsets[f]), owners, seen_before.get(job), options, photometric)

    # Each face in each view is measured on its own, so the number of threads cannot change a result.
    with ThreadPoolExecutor(2) as threads:
        return _consistent([estimate for estimate in threads.map(measure, jobs) if estimate is not None])


def _measure(
    views: Views,
    face: int,
    view: int,
    normal: Vec3,
    offset: float,
    owners: Int[np.ndarray, "views height width"],
    last: FaceEstimate | None,
    options: MultiviewOptions,
    photometric: PhotometricOptions,
) -> FaceEstimate | None:
    """One face as one reference view sees it; None where it does not see it, or followed something else."""
    mask = _mask(owners[view], face, views.images.shape[1:])
    reference = reference_from_mask(views, view, mask > 0, photometric)
    if reference is None:
        return None
    start = plane_from_world(views, reference, normal, offset)
    if start is None or start[2] <= 0:
        return None
    first = options.start / views.depth_per_pixel
    if last is not None and _moved(views, reference, start, last) < options.unmoved:
        first *= photometric.growth**3
    found = refine(views, reference, start, first, photometric, owners=owners, face=face)
    if found is None or found.zncc < options.min_zncc or _apart(views, reference, found.plane, start) > options.max_shift:
        return None
    found_normal, found_offset = plane_to_world(views, reference, found.plane)
    if found_normal @ normal < np.cos(np.radians(options.max_tilt_deg)):
        return None
    return FaceEstimate(face, found, found_normal, found_offset)


def _moved(views: Views, reference: Reference, plane: Vec3, last: FaceEstimate) -> float:
    """How far a plane is from an earlier estimate, over the face, in pixels of motion."""
    before = plane_from_world(views, reference, last.normal, last.offset)
    return np.inf if before is None else _apart(views, reference, plane, before)


def _apart(views: Views, reference: Reference, a: Vec3, b: Vec3) -> float:
    """Mean over the face of how far apart two planes are, in pixels of motion."""
    return float(np.abs(np.log((reference.basis @ a).clip(1e-12) / (reference.basis @ b).clip(1e-12))).mean()) / views.depth_per_pixel


def _consistent(estimates: list[FaceEstimate]) -> list[FaceEstimate]:
    """Without those that stand alone: where a face has three or more, an estimate must agree with their median."""
    kept: list[FaceEstimate] = []
    for f in dict.fromkeys(estimate.face for estimate in estimates):
        own = [estimate for estimate in estimates if estimate.face == f]
        if len(own) >= 3:
            normal = np.median([e.normal for e in own], axis=0)
            tilt = np.array([np.linalg.norm(e.normal - normal) for e in own])
            own = [e for e, t in zip(own, tilt, strict=True) if t <= max(4.0 * float(np.median(tilt)), np.radians(0.3))]
        kept += own
    return kept


def _references(area: Float[np.ndarray, "views"], facing: Bool[np.ndarray, "views"], options: MultiviewOptions) -> list[int]:
    """Views that show at least 40 % of the largest seen area, spread in time."""
    area = np.where(facing, area, 0.0)
    if area.max() < options.min_pixels:
        return []
    good = np.nonzero(area >= max(0.4 * area.max(), options.min_pixels))[0]
    parts = np.array_split(good, min(options.references, len(good)))
    return [int(part[np.argmax(area[part])]) for part in parts]


def _mask(owner: Int[np.ndarray, "h w"], face: int, shape: tuple[int, ...]) -> UInt8[np.ndarray, "height width"]:
    mask = cv2.resize((owner == face).astype(np.uint8), (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST)
    for size in (11, 9, 7, 5, 3):
        inner = cv2.erode(mask, np.ones((size, size), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
        if inner.sum() > 0.45 * mask.sum():
            return inner
    return mask


def plane_points(views: Views, estimates: Sequence[FaceEstimate], options: MultiviewOptions = MultiviewOptions()) -> PlanePoints:
    """The estimates as three virtual points each on their face.

    The information about rho = basis . plane has the form of the moments of points (x, y, 1), so three points of equal weight at the
    corners of its ellipse carry it exactly. Sigmas grow by the scatter between references of a face, and have a floor.
    """
    faces: list[int] = []
    points: list[Vec3] = []
    sigmas: list[float] = []
    by_face: dict[int, list[FaceEstimate]] = {}
    for estimate in estimates:
        by_face.setdefault(estimate.face, []).append(estimate)
    for f, own in sorted(by_face.items()):
        growth = _scatter(views, own)
        per_face = views.depth_per_pixel * np.sqrt(len(own))  # together they are no surer than that
        for estimate in own:
            common = common_growth(estimate.found, options.gray_error) - 1.0
            border = options.thin / thickness(estimate.found.reference) / estimate.found.zncc**3 / views.calibration[0, 0]
            xyz, sigma = _virtual_points(
                views,
                estimate,
                (options.floor * per_face, border * np.sqrt(len(own))),
                float(np.sqrt(growth**2 + common * len(own))),
            )
            faces += [f] * 3
            points += list(xyz)
            sigmas += list(sigma)
    return PlanePoints(np.array(faces, int), np.array(points, float).reshape(-1, 3), np.array(sigmas, float))


def thickness(reference: Reference) -> float:
    """Across its thinnest direction, working pixels: that of a rectangle with the same second moments, and at least 1."""
    return max(float(np.sqrt(12.0 * np.linalg.eigvalsh(np.cov(reference.pixels.T))[0])), 1.0)


def _virtual_points(
    views: Views, estimate: FaceEstimate, floors: tuple[float, float], growth: float
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    found = estimate.found
    reference = found.reference
    h = found.information
    weight = max(float(h[2, 2]), 1e-12)
    middle = h[:2, 2] / weight
    spread = h[:2, :2] / weight - np.outer(middle, middle)
    values, vectors = np.linalg.eigh(spread)
    root = vectors * np.sqrt(np.maximum(values, 1e-4))
    turns = 2 * np.pi * np.arange(3) / 3
    unit = np.stack([np.cos(turns), np.sin(turns)])
    at = middle[:, None] + np.sqrt(2.0) * root @ unit  # basis coordinates, moments 1/3 each
    basis = np.concatenate([at, np.ones((1, 3))]).T
    rho = basis @ found.plane
    rho = np.where(rho > 0.1 * found.plane[2], rho, 0.1 * found.plane[2])
    pixels = reference.center + reference.radius * at.T + 0.5
    rays = np.concatenate([pixels, np.ones((3, 1))], axis=1) @ np.linalg.inv(views.calibration).T
    world = (rays / rho[:, None] - views.translation[reference.view]) @ views.rotation[reference.view]
    # a change of rho moves the point along its ray; what counts is how far it leaves the plane
    distance = abs(float(estimate.normal @ views.centers[reference.view]) - estimate.offset)
    rho_sigma = np.sqrt(3.0 / weight) * growth
    along = np.linalg.norm(world - views.centers[reference.view], axis=1)
    return world, np.hypot(np.hypot(rho_sigma / rho, floors[0]) * distance, floors[1] * along)


def _scatter(views: Views, own: Sequence[FaceEstimate]) -> float:
    """How much larger than formal the differences between a face's references are; at least 2, at most 30."""
    if len(own) < 2:
        return 5.0
    ratios: list[float] = []
    for i, a in enumerate(own):
        for b in own[i + 1 :]:
            xyz, sigma = _virtual_points(views, a, (0.0, 0.0), 1.0)
            other, other_sigma = _virtual_points(views, b, (0.0, 0.0), 1.0)
            ratios += list(((xyz @ b.normal - b.offset) / np.hypot(sigma, other_sigma)) ** 2)
            ratios += list(((other @ a.normal - a.offset) / np.hypot(sigma, other_sigma)) ** 2)
    return float(np.clip(np.sqrt(np.mean(ratios)), 2.0, 30.0))
