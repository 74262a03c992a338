"""Planes that the pixels of a face agree with, looked for in single views."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from planewright.arrays import Bool, Float, Int, UInt8, Vec3
from planewright.geometry.plane import fit_plane
from planewright.lifting.corner_planes import planes_through
from planewright.lifting.hypothesis import Hypothesis, agreement
from planewright.lifting.located import Located, face_in_view, places_in_view
from planewright.lifting.photometric import (
    PhotometricPlane,
    Reference,
    hypotheses,
    plane_from_scene_points,
    plane_from_world,
    plane_to_world,
    reference_from_mask,
    relative_sigma,
)
from planewright.lifting.rays import meet, on_plane
from planewright.lifting.task import Task
from planewright.lifting.witnesses import Witnesses, plane_of_witnesses, seen_through, witnesses_in

LOOSE = 0.1
"""A plane on which the pixels leave a corner's depth open by more than this share says nothing about it: the front of a bare box hung by three
of its corners that way, and took the fourth a hundred pixels off its mark."""


@dataclass(eq=False)
class Searches:
    """What the searches of one lift leave behind for later ones; they add to it."""

    tried: set[tuple[int, int, int]] = field(default_factory=set[tuple[int, int, int]])
    """Face, view and how many of the face's corners were located there; view -1 where planes of the scene told where to look."""
    masks: dict[int, dict[int, UInt8[np.ndarray, "height width"]]] = field(default_factory=dict[int, dict[int, UInt8[np.ndarray, "height width"]]])
    """Polygons of faces that share pixels with a searched one: by view, then face; as the latest search drew them."""
    scene_planes: list[tuple[Vec3, float]] | None = None
    """Planes on which most of the scene lies, once they were needed."""


def search(task: Task, located: Located, searches: Searches, face: int, rng: np.random.Generator) -> list[Hypothesis]:
    """Hypotheses of a face from every view with marks in which three of its corners are located and which was not tried so."""
    out: list[Hypothesis] = []
    for view in _mark_views(task, task.corners[face])[:4]:
        there = len(places_in_view(task, located, view, task.loops[face]))
        if there >= 3 and (face, view, there) not in searches.tried:
            searches.tried.add((face, view, there))
            out += _search_view(task, located, searches, face, view, rng)
    return out


def search_scene(task: Task, located: Located, searches: Searches, face: int, rng: np.random.Generator) -> list[Hypothesis]:
    """Hypotheses of a face of which no view shows three located corners: the planes on which most of the scene lies tell where its
    corners would be, and so where to look."""
    rows = task.first_marks(task.loops[face])
    if len(rows) < 3 or any(f == face for f, *_ in searches.tried):
        return []
    searches.tried.add((face, -1, 0))
    if searches.scene_planes is None:
        searches.scene_planes = planes_of_scene(task, rng)
    corners, rays = task.rays.point[rows], task.rays
    out: list[Hypothesis] = []
    for normal, offset in searches.scene_planes:
        depth, _ = meet(rays, rows, normal, offset)
        low, high = np.percentile(np.linalg.norm(task.scene.xyz[:, None] - task.views.centers[None, ::20], axis=2), [0.5, 99.5])
        if (depth < 0.5 * low).any() or (depth > 3.0 * high).any():
            continue
        points, known = located.points.copy(), located.known.copy()
        points[corners], known[corners] = rays.origin[rows] + depth[:, None] * rays.direction[rows], True
        supposed = replace(located, points=points, known=known)
        areas = [0 if (drawn := face_in_view(task, supposed, v, face)) is None else int(drawn[0].sum()) for v in range(len(task.views.frame))]
        view = int(np.argmax(areas))
        if areas[view] > 400:
            out += _search_view(task, supposed, searches, face, view, rng)
    return out


def planes_of_scene(task: Task, rng: np.random.Generator) -> list[tuple[Vec3, float]]:
    """Up to six planes on which many of the scene's features lie, most first."""
    out: list[tuple[Vec3, float]] = []
    left = task.scene.xyz
    distance = float(np.median(np.linalg.norm(left - task.views.centers.mean(axis=0), axis=1))) if len(left) else 1.0
    tolerance = 2.0 * task.views.depth_per_pixel * distance
    while len(out) < 6 and len(left) >= 30:
        best = np.zeros(len(left), bool)
        for _ in range(300):
            a, b, c = left[rng.choice(len(left), 3, replace=False)]
            normal = np.cross(b - a, c - a)
            size = float(np.linalg.norm(normal))
            if size > 1e-12:
                on = np.abs((left - a) @ normal) < tolerance * size
                best = on if on.sum() > best.sum() else best
        if best.sum() < max(20, 0.02 * len(task.scene.xyz)):
            break
        out.append(fit_plane(left[best], np.ones(int(best.sum()))))
        left = left[~best]
    return out


def _mark_views(task: Task, corners: Sequence[int]) -> list[int]:
    """Views in which any of the corners is marked, the one with most marks first."""
    of_corner = np.isin(task.rays.point, corners)
    views, counts = np.unique(task.rays.view[of_corner], return_counts=True)
    return [int(v) for v in views[np.argsort(-counts, kind="stable")]]


def _search_view(task: Task, located: Located, searches: Searches, face: int, view: int, rng: np.random.Generator) -> list[Hypothesis]:
    """Planes that the face's pixels in a view agree with, and the one of the features seen through them."""
    drawn = face_in_view(task, located, view, face)
    rho_range = task.rho_range(view)
    if drawn is None or rho_range is None:
        return []
    mask, border = drawn
    others = _faces_drawn_over(task, located, view, face, mask)
    inner = _inner(mask, others.values())
    reference = reference_from_mask(task.views, view, inner, task.photometric)
    if reference is None:
        return []
    searches.masks.setdefault(view, {}).update(others)
    by_features = plane_from_scene_points(task.views, reference, border, task.scene.xyz, rng)
    starts = [] if by_features is None else [by_features]
    starts += [*_hinges(task, located, face, reference), *_through_corners(task, located, face, reference)]
    planes = hypotheses(task.views, reference, rho_range, starts, task.photometric)
    probes = reference.pixels[:: max(1, len(reference.pixels) // 24)].astype(int)
    covered = np.zeros((len(probes), task.num_faces), bool)
    for other, theirs in others.items():
        covered[:, other] = theirs[probes[:, 1], probes[:, 0]] > 0
    witnesses = witnesses_in(task, view, inner)
    out = _judged(task, face, reference, planes, witnesses, probes, covered)
    behind = plane_of_witnesses(witnesses, reference, task.tolerances.behind, rng)
    if behind is not None:
        plane, support, through = behind
        normal, offset = plane_to_world(task.views, reference, plane)
        probe = on_plane(task.views, view, probes + 0.5, normal, offset)
        out.append(Hypothesis(normal, offset, float("nan"), view, probe, covered, support=support, seen_through=through))
    return out


def _faces_drawn_over(
    task: Task, located: Located, view: int, face: int, mask: UInt8[np.ndarray, "height width"]
) -> dict[int, UInt8[np.ndarray, "height width"]]:
    """The polygons of other faces that share pixels with a face's."""
    out: dict[int, UInt8[np.ndarray, "height width"]] = {}
    for other in range(task.num_faces):
        if other != face and (theirs := face_in_view(task, located, view, other)) is not None and (theirs[0] & mask).any():
            out[other] = theirs[0]
    return out


def _inner(mask: UInt8[np.ndarray, "height width"], others: Iterable[UInt8[np.ndarray, "height width"]]) -> Bool[np.ndarray, "height width"]:
    """Pixels of a face away from its border and from what stands in front of it, where that leaves enough."""
    area = max(int(mask.sum()), 1)
    free = mask.copy()
    for theirs in others:
        # what is drawn smaller over this face stands in front of it, as a rule
        if theirs.sum() < 0.6 * area:
            free[np.asarray(cv2.dilate(theirs, np.ones((5, 5), np.uint8))) > 0] = 0
    if free.sum() < 0.25 * area:
        free = mask
    inner = cv2.erode(free, np.ones((5, 5), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    if inner.sum() < 60:
        inner = cv2.erode(free, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return inner > 0


def _judged(
    task: Task,
    face: int,
    reference: Reference,
    planes: Sequence[PhotometricPlane],
    witnesses: Witnesses,
    probes: Int[np.ndarray, "probe 2"],
    covered: Bool[np.ndarray, "probe faces"],
) -> list[Hypothesis]:
    """The planes of one reference with what the views and the witnesses say of them, less those that leave a corner's depth open."""
    through = [seen_through(witnesses, reference, found.plane, task.tolerances.behind) for found in planes]
    best = max((agreement(found) for found, count in zip(planes, through, strict=True) if count < 3), default=0.0)
    out: list[Hypothesis] = []
    for found, count in zip(planes, through, strict=True):
        normal, offset = plane_to_world(task.views, reference, found.plane)
        if _looseness(task, face, found, normal, offset) > LOOSE:
            continue
        # of two planes for the same pixels, a clearly worse one needs much to speak for it
        quality = agreement(found) - 3.0 * max(best - agreement(found), 0.0)
        probe = on_plane(task.views, reference.view, probes + 0.5, normal, offset)
        out.append(Hypothesis(normal, offset, quality, reference.view, probe, covered, found, seen_through=count))
    return out


def _looseness(task: Task, face: int, found: PhotometricPlane, normal: Vec3, offset: float) -> float:
    """Largest relative standard deviation of the depth of a marked corner on a plane, as its pixels know it."""
    rows = task.first_marks(task.corners[face])
    depth, _ = meet(task.rays, rows, normal, offset)
    corners: Float[np.ndarray, "rows 3"] = task.rays.origin[rows] + depth[:, None] * task.rays.direction[rows]
    return max((relative_sigma(task.views, found, at) for at in corners), default=0.0)


def _through_corners(task: Task, located: Located, face: int, reference: Reference) -> list[Vec3]:
    """The plane through the known corners of the face, as a start."""
    return [plane for guess in planes_through(task, located, face)[:1] if (plane := _before(task, reference, guess.normal, guess.offset)) is not None]


def _hinges(task: Task, located: Located, face: int, reference: Reference) -> list[Vec3]:
    """Planes through two known corners of the face, far apart, at a fan of tilts."""
    known = [c for c in task.corners[face] if located.known[c]]
    if len(known) < 2:
        return []
    pairs = [(a, b) for i, a in enumerate(known) for b in known[i + 1 :]]
    a, b = max(pairs, key=lambda pair: float(np.linalg.norm(located.points[pair[0]] - located.points[pair[1]])))
    start = located.points[a]
    axis = located.points[b] - start
    if np.linalg.norm(axis) < 1e-12:
        return []
    axis /= np.linalg.norm(axis)
    to_camera = task.views.centers[reference.view] - start
    u = to_camera - axis * (axis @ to_camera)
    u /= max(float(np.linalg.norm(u)), 1e-12)
    v = np.cross(axis, u)
    normals = [np.cos(angle) * u + np.sin(angle) * v for angle in np.radians(np.arange(-75, 76, 15))]
    return [plane for normal in normals if (plane := _before(task, reference, normal, float(normal @ start))) is not None]


def _before(task: Task, reference: Reference, normal: Vec3, offset: float) -> Vec3 | None:
    """A plane in the reference's basis; None where it is not before the camera at every pixel of the face."""
    plane = plane_from_world(task.views, reference, normal, offset)
    return plane if plane is not None and plane[2] > 0 and (reference.basis @ plane).min() > 0 else None
