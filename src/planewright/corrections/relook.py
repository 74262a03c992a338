"""The edges at one corner measured again, from where a mark puts the corner."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.corrections.explanations import meeting, ray_of
from planewright.corrections.said import show
from planewright.geometry.plane import tangent_basis
from planewright.geometry.raster import face_buffer
from planewright.lifting.views import ViewOptions, load_views
from planewright.planes.evidence import CornerMarks
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.polygons import polygons_of
from planewright.sfm.cameras import Cameras, ScenePoints
from planewright.tracking.edges import Anchor, EdgeLine, EdgeOptions, drawn_edges, measure_edges
from planewright.tracking.follow import CornerOptions
from planewright.tracking.frame_lines import EdgeView, frame_lines, measure_frame, view_edges
from planewright.tracking.fusion import FrameLines, MarkOffsets, refit_corners
from planewright.tracking.visibility import owners_in_views
from planewright.video.frames import Frames


@dataclass(frozen=True, kw_only=True)
class RelookOptions:
    """How far one looks."""

    frames: int = 24
    """Frames looked at, spread over those in which the corner is thought to be seen. An edge's common error is not made smaller by more of them."""
    rounds: int = 2
    """Looks; each starts where the one before ended."""
    least_frames: int = 5
    """Frames in which an edge must be found."""
    edges: EdgeOptions = field(default_factory=EdgeOptions)
    """How an edge that was another line is found anew."""


@dataclass(frozen=True, eq=False)
class Relooked:
    """A corner by its mark, the model and its edges."""

    place: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "3 3"]
    edges: tuple[tuple[int, int], ...]
    """Edges (rows of their points) that were found again."""


def lines_again(
    frames: Frames,
    scene: PlanarScene,
    cameras: Cameras,
    anchor: Anchor,
    edges: Sequence[tuple[int, int]],
    seen: Int[np.ndarray, "seen"],
    options: RelookOptions = RelookOptions(),
) -> tuple[EdgeLine, ...]:
    """Some drawn edges found anew in strips (`tracking.edges`), in each of their faces: a mark says that they are not the lines that were taken for them.

    Args:
        frames: straight.
        scene: the model after the mark.
        anchor: corners as marks and planes alone give them, the new mark among them: it says which of several parallel lines is meant, at both ends.
        seen: rows of the cameras in which the marked corner is thought to be seen, increasing.
    """
    wanted = [
        (f, a, b)
        for f, a, b in drawn_edges(scene.sketch)
        if (min(a, b), max(a, b)) in edges and scene.face_known[f] and scene.point_known[a] and scene.point_known[b]
    ]
    if not wanted or len(seen) < options.least_frames:
        return ()
    rows = seen[np.unique(np.linspace(0, len(seen) - 1, min(options.frames, len(seen))).round().astype(int))]
    these = replace(cameras, posed=np.isin(np.arange(len(cameras.frame)), rows))
    known = scene.points[scene.point_known]
    count = len(known)
    around = ScenePoints(known, np.arange(count), np.zeros((count, 3, 3)), np.zeros((count, 2), dtype=np.int64))
    normals = np.where(scene.face_known[:, None], scene.normals, np.nan)
    points = np.where(scene.point_known[:, None], scene.points, np.nan)
    polygons = polygons_of(scene.sketch, points, normals, np.where(scene.face_known, scene.offsets, np.nan))
    # Grey first: colour costs more time than all the rest, and is needed only where brick meets soil that is as bright.
    for color in (False, True):
        views = load_views(frames, these, around, (), ViewOptions(max_views=options.frames, color=color))
        lines = measure_edges(views, wanted, scene.points, anchor, scene.normals, owners_in_views(views, polygons), options.edges)
        if lines:
            return tuple(lines)
    return ()


def look_again(
    frames: Frames,
    scene: PlanarScene,
    cameras: Cameras,
    points: Float[np.ndarray, "points 3"],
    corner: int,
    seen: Int[np.ndarray, "seen"],
    corners: CornerOptions = CornerOptions(),
    options: RelookOptions = RelookOptions(),
) -> Relooked:
    """The corner moved by the lines of its edges, as a run would move it (`fusion.refit_corners`); the mark is in the scene already.

    Args:
        frames: straight.
        scene: the model after the mark; its covariance of the corner says how far lines may move it.
        points: where the corners' tracks are, for the other ends of the edges.
        seen: rows of the cameras in which the corner is thought to be seen, increasing.
    """
    place, covariance = scene.points[corner].copy(), scene.point_covariance[corner].copy()
    if len(seen) < options.least_frames or not np.isfinite(covariance).all():
        return Relooked(place, covariance, ())
    rows = seen[np.unique(np.linspace(0, len(seen) - 1, min(options.frames, len(seen))).round().astype(int))]
    size = float(np.linalg.norm(np.ptp(scene.points[scene.point_known], axis=0)))
    tolerance = corners.occluder_tolerance * size
    polygons = polygons_of(
        scene.sketch,
        np.where(scene.point_known[:, None], scene.points, np.nan),
        np.where(scene.face_known[:, None], scene.normals, np.nan),
        np.where(scene.face_known, scene.offsets, np.nan),
    )
    buffers = [face_buffer(polygons, cameras.intrinsics, cameras.cam_from_world(int(row)), scale=0.25) for row in rows]
    images = [image for _, image in frames.gray([int(n) for n in cameras.frame[rows]])]
    marks = MarkOffsets(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)))
    only = np.arange(len(points)) == corner
    found: tuple[tuple[int, int], ...] = ()
    base = scene.points[corner]
    for _ in range(options.rounds):
        here = np.where(only[:, None], place, np.where(np.isfinite(points), points, 0.0))
        view = _edges_at(view_edges(scene, here, cameras, rows, tolerance, corners.lines), corner)
        if len(view.edges) == 0:
            break
        measured = frame_lines(view, [measure_frame(image, view, k, buffers[k], corners.lines) for k, image in enumerate(images)])
        enough = measured.found.sum(axis=0) >= options.least_frames
        lines = replace(measured, information=np.where(enough[None, :, None, None], measured.information, 0.0))
        shown = show(np.where(only[:, None], base, here), cameras, rows)
        moved = show(place[None], cameras, rows).xy[:, 0] - shown.xy[:, corner]
        spread = np.where(only[:, None, None], scene.point_covariance, np.inf)
        shift, joint = refit_corners(_from_model(lines, moved, corner), marks, shown.jacobian, spread, corners.fusion)
        place, covariance = base + shift[corner], joint[corner]
        found = tuple((int(a), int(b)) for a, b in view.edges[enough])
    return Relooked(place, covariance, found)


def _edges_at(view: EdgeView, corner: int) -> EdgeView:
    """The edges of one corner alone."""
    mine: Bool[np.ndarray, "edges"] = (view.edges == corner).any(axis=1)
    return replace(
        view,
        edges=view.edges[mine],
        own=view.own[mine],
        place=view.place[:, mine],
        inverse_depth=view.inverse_depth[:, mine],
        at_corner=view.at_corner[:, mine],
        blur=view.blur[:, mine],
    )


def _from_model(lines: FrameLines, moved: Float[np.ndarray, "rows 2"], corner: int) -> FrameLines:
    """Offsets told from the model's corner, where they were measured from `moved` beside it."""
    mine = lines.at_corner & (lines.edges == corner)[None]
    back = np.where(mine & lines.found[..., None], np.einsum("kj,kej->ke", np.where(np.isfinite(moved), moved, 0.0), lines.normal)[..., None], 0.0)
    return replace(lines, offset=lines.offset + back)


def constant_offset(offsets: Float[np.ndarray, "marks 2"], covariances: Float[np.ndarray, "marks 2 2"], limit: float = 1.5) -> bool:
    """Whether a corner is off by the same in all its marks: each lies within `limit` standard deviations of their weighted mean.

    Then it is the corner's place that is wrong, and in all frames, and not its track in some of them.

    Args:
        offsets: of the marks from the track, told in the plane of a face of the corner (world units), where what is constant in space is constant.
        covariances: of the offsets.
    """
    information = np.linalg.inv(covariances)
    mean = np.linalg.solve(information.sum(axis=0), np.einsum("mij,mj->i", information, offsets))
    away = offsets - mean
    return bool((np.einsum("mi,mij,mj->m", away, information, away) <= limit**2).all())


def offsets_in_plane(
    rays: Sequence[tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]],
    place: Float[np.ndarray, "3"],
    basis: Float[np.ndarray, "2 3"],
) -> Float[np.ndarray, "marks 2"]:
    """Where the rays (centre, direction) of marks meet the plane through `place`, from there, along its two directions; NaN where a ray misses it."""
    normal = np.cross(basis[0], basis[1])
    out = np.full((len(rays), 2), np.nan)
    for k, (center, ray) in enumerate(rays):
        along = float(normal @ ray)
        if abs(along) > 1e-9:
            length = float(normal @ (place - center)) / along
            if length > 0:
                out[k] = basis @ (center + length * ray - place)
    return out


def place_by_marks(
    marks: CornerMarks, place: Float[np.ndarray, "3"], normals: Float[np.ndarray, "faces 3"], limit: float = 1.5
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]] | None:
    """Where two or more marks of one corner have it, if that is one place: off by the same along one of its faces, or where their rays meet.

    The constant offset is that of `constant_offset`; the rays meet where every mark is within `limit` standard deviations of its ray. None where the marks
    do not agree on a place.

    Args:
        place: the corner as the model has it.
        normals: of its faces; the first along which the marks agree is taken.

    Returns:
        The place, and its covariance by the marks alone, along a face where they agree there.
    """
    if len(marks.corner) < 2:
        return None
    rays = [ray_of(p, xy) for p, xy in zip(marks.projection, marks.xy, strict=True)]
    for normal in normals:
        basis = tangent_basis(normal[None])[0]
        offsets = offsets_in_plane(rays, place, basis)
        if not np.isfinite(offsets).all():
            continue
        slopes = np.stack([_slope(p, place + o @ basis) @ basis.T for p, o in zip(marks.projection, offsets, strict=True)])
        if (np.abs(np.linalg.det(slopes)) < 1e-9).any():
            continue
        information = slopes.transpose(0, 2, 1) @ slopes / marks.sigma[:, None, None] ** 2
        if constant_offset(offsets, np.linalg.inv(information), limit):
            total = information.sum(axis=0)
            mean = np.linalg.solve(total, np.einsum("mij,mj->i", information, offsets))
            return place + mean @ basis, basis.T @ np.linalg.inv(total) @ basis
    met = meeting(marks, np.arange(len(marks.corner)))
    if met is None:
        return None
    seen = np.einsum("mij,j->mi", marks.projection, np.append(met, 1.0))
    off = np.linalg.norm(seen[:, :2] / seen[:, 2:] - marks.xy, axis=1)
    if (off > limit * marks.sigma).any():
        return None
    slopes = np.stack([_slope(p, met) for p in marks.projection])
    return met, np.linalg.inv(np.einsum("mia,mib->ab", slopes, slopes / marks.sigma[:, None, None] ** 2))


def _slope(projection: Float[np.ndarray, "3 4"], point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2 3"]:
    """Pixels per world unit."""
    seen = projection @ np.append(point, 1.0)
    return (projection[:2, :3] - (seen[:2] / seen[2])[:, None] * projection[2:, :3]) / seen[2]
