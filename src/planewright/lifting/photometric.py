"""One photometric plane a face: three unknowns for the whole clip.

With known cameras a plane carries the pixels of a reference view into every other view. In the reference view the inverse
depth of a plane is linear in the pixel, rho(u) = basis(u) . plane, so the search is a sweep over depths and slopes at a
short baseline, then Gauss-Newton with gain and bias of each view eliminated while the baseline grows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Bool, Float, Int, Mat3, Vec2, Vec3
from planewright.lifting.kernels import plane_equations, score_planes
from planewright.lifting.views import Views


@dataclass(frozen=True, kw_only=True)
class PhotometricOptions:
    """How a plane is searched and refined."""

    max_pixels: int = 600
    """Pixels of a face that are compared, picked by gradient over the whole face."""
    sweep_pixels: int = 220
    """Of them, pixels that take part in the sweep."""
    sweep_depths: int = 56
    """Inverse depths tried."""
    sweep_shift: float = 40.0
    """Displacement between the nearest and the farthest depth in the views of the sweep, working pixels."""
    growth: float = 2.5
    """Each stage looks at views with this much more displacement than the one before."""
    views_per_stage: int = 10
    """Target views compared in one stage."""
    noise: float = 1.5
    """Floor of the sigma of grey value differences."""
    keep: int = 3
    """Different planes a face may keep as hypotheses from one reference view."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A face's pixels in one view, and the basis in which its planes are written."""

    view: int
    pixels: Float[np.ndarray, "pixels 2"]
    """Array coordinates: the centre of the top-left pixel is (0, 0)."""
    basis: Float[np.ndarray, "pixels 3"]
    values: Float[np.ndarray, "pixels"]
    center: Vec2
    radius: float
    area: float
    """Of the mask, working pixels squared."""


@dataclass(frozen=True, eq=False)
class PhotometricPlane:
    """A plane and how well the pixels agree with it."""

    reference: Reference
    plane: Vec3
    """rho = basis . plane in the reference."""
    information: Float[np.ndarray, "3 3"]
    """Of `plane`, with gain and bias eliminated; formal: it knows nothing of common errors."""
    zncc: float
    """Mean over the target views of the last stage, weighted by the share of pixels used."""
    share: float
    """Mean share of the pixels used in the target views."""
    shift: float
    """Largest displacement that the views of the last stage give to the face when its depth is doubled, working pixels."""
    used: int
    """Pixels compared, over all target views of the last stage."""
    residual: float
    """Robust sigma of the grey value differences, the median over the target views."""


def reference_from_mask(views: Views, view: int, mask: Bool[np.ndarray, "height width"], options: PhotometricOptions) -> Reference | None:
    """Pixels with the steepest grey values, spread over the mask; None where the mask is too small for a plane (under 40 pixels)."""
    ys, xs = np.nonzero(mask)
    if len(xs) < 40:
        return None
    x0, x1, y0, y1 = xs.min(), xs.max(), ys.min(), ys.max()
    lo_y, lo_x = max(y0 - 1, 0), max(x0 - 1, 0)
    window = views.images[view][lo_y : y1 + 2, lo_x : x1 + 2].astype(np.float32)
    steep = np.abs(cv2.Sobel(window, cv2.CV_32F, 1, 0)) + np.abs(cv2.Sobel(window, cv2.CV_32F, 0, 1))
    score = steep[ys - lo_y, xs - lo_x]
    # the steepest of each small cell, so that one strong stain does not take all pixels; of equal ones the first
    cell = max(1.0, np.sqrt(len(xs) / options.max_pixels))
    columns = int((x1 - x0) / cell) + 1
    cells = ((ys - y0) / cell).astype(int) * columns + ((xs - x0) / cell).astype(int)
    best = np.full((int((y1 - y0) / cell) + 1) * columns, -1.0, np.float32)
    np.maximum.at(best, cells, score)
    leading = np.nonzero(score == best[cells])[0][::-1]
    first = np.full(len(best), -1)
    first[cells[leading]] = leading
    chosen = first[first >= 0]
    if len(chosen) > options.max_pixels:
        chosen = chosen[np.argsort(-score[chosen], kind="stable")[: options.max_pixels]]
    chosen = np.sort(chosen)
    pixels = np.stack([xs[chosen], ys[chosen]], axis=1).astype(float)
    center = np.array([xs.mean(), ys.mean()])
    radius = max(float(np.sqrt(((xs - center[0]) ** 2 + (ys - center[1]) ** 2).mean())), 1.0)
    basis = np.concatenate([(pixels - center) / radius, np.ones((len(pixels), 1))], axis=1)
    values = views.images[view][ys[chosen], xs[chosen]].astype(float)
    return Reference(view, pixels, basis, values, center, radius, float(len(xs)))


def _basis_matrix(reference: Reference) -> Mat3:
    """B with basis(u) = B (u, 1)."""
    s = 1.0 / reference.radius
    return np.array([[s, 0.0, -reference.center[0] * s], [0.0, s, -reference.center[1] * s], [0.0, 0.0, 1.0]])


def _array_calibration(views: Views) -> Mat3:
    k = views.calibration.copy()
    k[:2, 2] -= 0.5
    return k


def plane_to_world(views: Views, reference: Reference, plane: Vec3) -> tuple[Vec3, float]:
    """Unit normal and offset of a plane given in a reference; the normal points towards the reference's camera."""
    k = _array_calibration(views)
    q = k.T @ (_basis_matrix(reference).T @ plane)  # n_cam / d_cam
    size = float(np.linalg.norm(q))
    n_cam, d_cam = -q / size, -1.0 / size
    r, t = views.rotation[reference.view], views.translation[reference.view]
    return n_cam @ r, float(d_cam - n_cam @ t)


def plane_from_world(views: Views, reference: Reference, normal: Vec3, offset: float) -> Vec3 | None:
    """The plane in the reference's basis; None where it passes too near the camera's centre."""
    r, t = views.rotation[reference.view], views.translation[reference.view]
    n_cam = r @ normal
    d_cam = offset + n_cam @ t
    if abs(d_cam) < 1e-9:
        return None
    k = _array_calibration(views)
    q = n_cam / d_cam
    return np.linalg.solve(_basis_matrix(reference).T, np.linalg.solve(k.T, q))


def transfers(views: Views, view: int, targets: Int[np.ndarray, "targets"]) -> tuple[Float[np.ndarray, "targets 3 3"], Float[np.ndarray, "targets 3"]]:
    """A and a of each target: a pixel u at inverse depth rho is seen at A (u, 1) + a rho."""
    k = _array_calibration(views)
    r = views.rotation[targets] @ views.rotation[view].T
    t = views.translation[targets] - r @ views.translation[view]
    return k @ r @ np.linalg.inv(k), t @ k.T


def shift_per_rho(views: Views, view: int, center: Vec2, rho: float) -> tuple[Float[np.ndarray, "views"], Bool[np.ndarray, "views"]]:
    """How far (pixels) the point at `center` moves in each view per unit of inverse depth, and where it is seen inside the image."""
    everyone = np.arange(len(views.frame))
    a, s = transfers(views, view, everyone)
    p = a @ np.array([*center, 1.0]) + s * rho
    z = np.maximum(p[:, 2], 1e-9)
    xy = p[:, :2] / z[:, None]
    move = (s[:, :2] - xy * s[:, 2:]) / z[:, None]
    height, width = views.images.shape[1:]
    inside = (p[:, 2] > 1e-9) & (xy[:, 0] > 0) & (xy[:, 1] > 0) & (xy[:, 0] < width - 1) & (xy[:, 1] < height - 1)
    inside[view] = False
    return np.linalg.norm(move, axis=1), inside


def photo_cost(views: Views, reference: Reference, plane: Vec3, options: PhotometricOptions) -> float:
    """Robust cost a pixel of a plane over views spread over all motions; infinite where too few pixels land in them."""
    move, inside = shift_per_rho(views, reference.view, reference.center, max(float(plane[2]), 1e-9))
    shift = move * abs(plane[2])
    if plane[2] <= 0 or not inside.any():
        return np.inf
    targets = _spread(np.nonzero(inside & (shift > 0.2 * shift[inside].max()))[0], options.views_per_stage)
    now = equations(views, reference, targets, plane, NOBODY, -1, options.noise)
    return now.cost / now.used if now.used >= 20 else np.inf


def common_growth(found: PhotometricPlane, gray_error: float) -> float:
    """How much larger than its formal variance a plane's variance is for an error of the grey values that all pixels have in common:
    no number of pixels locates a bare face better than that error over their mean slope."""
    return 1.0 + gray_error**2 * found.used / found.residual**2


def relative_sigma(views: Views, found: PhotometricPlane, point: Vec3, gray_error: float = 0.6) -> float:
    """Relative standard deviation of the depth at which a plane meets the reference's ray through a world point; at most 1."""
    reference = found.reference
    cam = views.rotation[reference.view] @ point + views.translation[reference.view]
    if cam[2] <= 1e-9:
        return 1.0
    pixel = _array_calibration(views) @ cam / cam[2]
    basis = _basis_matrix(reference) @ pixel
    rho = float(basis @ found.plane)
    variance = float(basis @ np.linalg.pinv(found.information) @ basis) * (4.0 + common_growth(found, gray_error))
    return min(float(np.sqrt(max(variance, 0.0))) / rho, 1.0) if rho > 0 else 1.0


def _spread(candidates: Int[np.ndarray, "n"], count: int) -> Int[np.ndarray, "m"]:
    """At most `count` of them, evenly."""
    if len(candidates) <= count:
        return candidates
    return candidates[np.unique(np.linspace(0, len(candidates) - 1, count).round().astype(int))]


def _slopes(reference: Reference, views: Views) -> Float[np.ndarray, "slopes 2"]:
    """Relative slopes of rho over the basis for a fan of plane orientations about the viewing ray."""
    k = _array_calibration(views)
    ray = np.linalg.solve(k, np.array([*reference.center, 1.0]))
    axis = ray / np.linalg.norm(ray)
    u = np.cross(axis, [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    found = [axis]
    for tilt, count in ((32.0, 6), (52.0, 8), (66.0, 8)):
        for i in range(count):
            turn = 2 * np.pi * (i + 0.5 * (count == 8)) / count
            found.append(np.cos(np.radians(tilt)) * axis + np.sin(np.radians(tilt)) * (np.cos(turn) * u + np.sin(turn) * v))
    b_inv = np.linalg.inv(_basis_matrix(reference)).T
    planes = np.array([b_inv @ (np.linalg.inv(k).T @ n) for n in found])
    return planes[:, :2] / planes[:, 2:]


def sweep(views: Views, reference: Reference, rho_range: tuple[float, float], options: PhotometricOptions) -> list[Vec3]:
    """Planes at the best depths of a sweep over inverse depths and orientations, best first; at most 8."""
    low, high = rho_range
    middle = 0.5 * (low + high)
    move, inside = shift_per_rho(views, reference.view, reference.center, middle)
    shift = move * (high - low)
    allowed = np.nonzero(inside & (shift > 0.4 * options.sweep_shift) & (shift < 1.5 * options.sweep_shift))[0]
    if len(allowed) < 3:
        allowed = np.nonzero(inside)[0]
        allowed = allowed[np.argsort(np.abs(np.log(shift[allowed] / options.sweep_shift + 1e-9)), kind="stable")[:6]]
    if len(allowed) == 0:
        return []
    # near in time first: light and blur are alike there
    near = allowed[np.argsort(np.abs(allowed - reference.view), kind="stable")[:12]]
    targets = np.sort(_spread(np.sort(near), 6))
    slopes = _slopes(reference, views)
    # rho over the whole face must stay positive
    rhos = np.linspace(low, high, options.sweep_depths)
    planes = np.concatenate([rhos[:, None, None] * np.concatenate([slopes, np.ones((len(slopes), 1))], axis=1)[None]]).reshape(-1, 3)
    step = max(1, len(reference.pixels) // options.sweep_pixels)
    scores = np.empty((len(planes), len(targets)))
    shares = np.empty_like(scores)
    a, s = transfers(views, reference.view, targets)
    pixels, basis, values = reference.pixels[::step], reference.basis[::step], reference.values[::step]
    score_planes(views.images, targets, a, s, pixels, basis, values, planes, scores, shares)
    mean = np.where(scores > -1, scores, 0.0).mean(axis=1).reshape(len(rhos), len(slopes))
    best_slope = mean.argmax(axis=1)
    best = mean[np.arange(len(rhos)), best_slope]
    chosen: list[int] = []
    for i in np.argsort(-best, kind="stable"):
        if all(abs(int(i) - j) > 2 for j in chosen):
            chosen.append(int(i))
        if len(chosen) == 6:
            break
    top = np.unravel_index(np.argsort(-mean, axis=None, kind="stable")[:2], mean.shape)
    pairs = [(i, int(best_slope[i])) for i in chosen] + [(int(i), int(j)) for i, j in zip(*top, strict=True)]
    unique = list(dict.fromkeys(pairs))
    return [planes[i * len(slopes) + j] for i, j in unique]


@dataclass(eq=False)
class _Equations:
    cost: float
    used: int
    hessian: Float[np.ndarray, "3 3"]
    gradient: Vec3
    stats: Float[np.ndarray, "targets 3"]


NOBODY = np.full((1, 1, 1), -1, np.int16)


def equations(
    views: Views,
    reference: Reference,
    targets: Int[np.ndarray, "targets"],
    plane: Vec3,
    owners: Int[np.ndarray, "views h w"],
    face: int,
    noise: float,
    carried: tuple[Float[np.ndarray, "targets 3 3"], Float[np.ndarray, "targets 3"]] | None = None,
) -> _Equations:
    """Gauss-Newton equations of the plane over the targets; `carried` holds their `transfers` where these are known."""
    a, s = carried or transfers(views, reference.view, targets)
    hessian, gradient, stats = np.zeros((3, 3)), np.zeros(3), np.empty((len(targets), 3))
    scale = owners.shape[1] / views.images.shape[1] if owners.shape[1] > 1 else 1.0
    cost, used = plane_equations(
        views.images, targets, a, s, reference.pixels, reference.basis, reference.values, owners, face, scale, plane, noise, hessian, gradient, stats
    )
    return _Equations(cost, used, hessian, gradient, stats)


def descend(
    views: Views,
    reference: Reference,
    targets: Int[np.ndarray, "targets"],
    plane: Vec3,
    options: PhotometricOptions,
    *,
    owners: Int[np.ndarray, "views h w"] = NOBODY,
    face: int = -1,
    iterations: int = 8,
) -> tuple[Vec3, _Equations]:
    """Levenberg-Marquardt on the robust photometric cost a pixel."""
    carried = transfers(views, reference.view, targets)
    now = equations(views, reference, targets, plane, owners, face, options.noise, carried)
    damping = 1e-3
    for _ in range(iterations):
        if now.used < 40:
            break
        step = -np.linalg.solve(now.hessian + np.diag(damping * np.diag(now.hessian) + 1e-12 * np.trace(now.hessian)), now.gradient)
        # half the depth in one step is never right
        step *= min(1.0, 0.3 * abs(plane[2]) / (np.abs(step).max() + 1e-12))
        trial = plane + step
        then = equations(views, reference, targets, trial, owners, face, options.noise, carried)
        if then.used > 0.8 * now.used and then.cost / then.used < now.cost / now.used:
            small = np.abs(step).max() < 0.015 * views.depth_per_pixel * abs(plane[2])
            plane, now, damping = trial, then, max(damping * 0.2, 1e-6)
            if small:
                break
        else:
            damping *= 10.0
            if damping > 1e3:
                break
    return plane, now


def refine(
    views: Views,
    reference: Reference,
    start: Vec3,
    first_shift: float,
    options: PhotometricOptions,
    *,
    owners: Int[np.ndarray, "views h w"] = NOBODY,
    face: int = -1,
    last_shift: float = np.inf,
) -> PhotometricPlane | None:
    """Follow one start through growing baselines; None where the views never agree with it.

    first_shift: displacement (pixels, when the depth doubles) of the views of the first stage; each stage multiplies it by
    `options.growth` until all views take part or `last_shift` is reached.
    """
    plane = start.copy()
    limit = first_shift
    result: PhotometricPlane | None = None
    while True:
        move, inside = shift_per_rho(views, reference.view, reference.center, plane[2])
        shift = move * abs(plane[2])
        if not inside.any():
            return result
        reach = float(shift[inside].max())
        allowed = np.nonzero(inside & (shift <= limit) & (shift > 0.15 * limit))[0]
        if len(allowed) < 4:
            allowed = np.nonzero(inside & (shift <= limit))[0]
        final = bool(limit >= reach or limit >= last_shift)
        if len(allowed) >= 2:
            targets = _spread(allowed, options.views_per_stage + 4 * final)
            plane, now = descend(views, reference, targets, plane, options, owners=owners, face=face)
            weight = np.where(now.stats[:, 0] > -1, now.stats[:, 1], 0.0)
            zncc = float((weight * now.stats[:, 0]).sum() / max(weight.sum(), 1e-9))
            if now.used < 60 or plane[2] <= 0 or weight.sum() < 0.2 * min(len(targets), 6):
                return result
            if zncc < 0.25:
                return None if result is None else result
            residual = float(np.median(now.stats[weight > 0, 2]))
            result = PhotometricPlane(reference, plane, now.hessian, zncc, float(weight.mean()), float(shift[targets].max()), now.used, residual)
        if final:
            return result
        limit *= options.growth


def hypotheses(
    views: Views,
    reference: Reference,
    rho_range: tuple[float, float],
    scene_planes: Sequence[Vec3] = (),
    options: PhotometricOptions = PhotometricOptions(),
) -> list[PhotometricPlane]:
    """Up to `options.keep` different planes that the pixels agree with, best first.

    scene_planes: further starts in the reference's basis, e.g. from scene features inside the face.
    """
    low, high = rho_range
    starts = sweep(views, reference, rho_range, options)
    base = options.sweep_shift * 0.5 * (low + high) / (high - low)  # the sweep's views, as displacement when the depth doubles
    found: list[tuple[PhotometricPlane, Vec3]] = []
    for start in starts:
        if plane := refine(views, reference, start, base, options, last_shift=base * options.growth):
            found.append((plane, plane.plane))
    for start in scene_planes:
        if plane := refine(views, reference, start, base * options.growth, options, last_shift=base * options.growth):
            found.append((plane, plane.plane))
    found.sort(key=lambda pair: -pair[0].zncc * min(1.0, pair[0].share * 2))
    kept: list[PhotometricPlane] = []
    for _, start in _distinct(found, 16 * views.depth_per_pixel)[: options.keep + 1]:
        if plane := refine(views, reference, start, base * options.growth, options):
            kept.append(plane)
    kept.sort(key=lambda plane: -plane.zncc * min(1.0, plane.share * 2))
    return [plane for plane, _ in _distinct([(p, p.plane) for p in kept], 16 * views.depth_per_pixel)][: options.keep]


def _distinct(found: list[tuple[PhotometricPlane, Vec3]], tolerance: float) -> list[tuple[PhotometricPlane, Vec3]]:
    """Without those whose inverse depths lie within `tolerance` (relative) of a better one's all over the face."""
    kept: list[tuple[PhotometricPlane, Vec3]] = []
    for plane, values in found:
        if all(np.abs(values - other).sum() > tolerance * abs(other[2]) for _, other in kept):
            kept.append((plane, values))
    return kept


def plane_from_scene_points(
    views: Views, reference: Reference, polygon: Float[np.ndarray, "corners 2"], xyz: Float[np.ndarray, "points 3"], rng: np.random.Generator
) -> Vec3 | None:
    """The plane most scene features inside the polygon (array coordinates of the reference) lie on; None below five of them.

    Fitted in inverse depth, where a plane is linear; an inlier is within four pixels of motion.
    """
    cam = xyz @ views.rotation[reference.view].T + views.translation[reference.view]
    cam = cam[cam[:, 2] > 1e-6]
    k = _array_calibration(views)
    pixels = (cam[:, :2] / cam[:, 2:]) @ k[:2, :2].T + k[:2, 2]
    x, y = pixels[:, 0], pixels[:, 1]
    box = (x > polygon[:, 0].min()) & (x < polygon[:, 0].max()) & (y > polygon[:, 1].min()) & (y < polygon[:, 1].max())
    contour = polygon.astype(np.float32).reshape(-1, 1, 2)
    inside = np.array([i for i in np.nonzero(box)[0] if cv2.pointPolygonTest(contour, (float(x[i]), float(y[i])), False) > 0], int)
    if len(inside) < 5:
        return None
    basis = np.concatenate([(pixels[inside] - reference.center) / reference.radius, np.ones((len(inside), 1))], axis=1)
    plane = dominant_plane(basis, 1.0 / cam[inside, 2], 4 * views.depth_per_pixel, rng)
    return plane if plane is not None and plane[2] > 0 else None


def dominant_plane(basis: Float[np.ndarray, "n 3"], rho: Float[np.ndarray, "n"], tolerance: float, rng: np.random.Generator) -> Vec3 | None:
    """The plane rho = basis . plane that most points lie on, to a share `tolerance` of their inverse depth; None below five of them."""
    if len(rho) < 5:
        return None
    best, support = None, 0
    for _ in range(60):
        three = rng.choice(len(rho), 3, replace=False)
        if abs(np.linalg.det(basis[three])) < 0.05:
            continue
        plane = np.linalg.solve(basis[three], rho[three])
        agree = np.abs(basis @ plane - rho) < tolerance * rho
        if agree.sum() > support:
            best, support = agree, int(agree.sum())
    if best is None or support < 5:
        return None
    return np.linalg.lstsq(basis[best], rho[best], rcond=None)[0]
