"""The rounds: with the better model edges and faces are found again, nearer to where they are, and corners and planes solved again."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from planewright.arrays import Bool, Float
from planewright.lifting.lift import Lifted, LiftOptions, lift_sketch
from planewright.lifting.multiview import FaceEstimate, MultiviewOptions, measure_faces, plane_points, visible_shares
from planewright.lifting.rays import MarkRays, mark_rays
from planewright.lifting.views import ViewOptions, Views, load_views
from planewright.planes.basis import Basis
from planewright.planes.evidence import CornerMarks, CornerPriors, Evidence, PlanePoints
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.planar_start import PlanarStart
from planewright.planes.polygons import polygons_of
from planewright.progress import Progress, silent
from planewright.refine.incidences import propose_incidences
from planewright.refine.quads import fourth_corners, joined
from planewright.relations.adjacency import Adjacency
from planewright.relations.adjust import AdjustOptions, Structured, adjust_structure
from planewright.relations.relation import Relation
from planewright.sfm.cameras import Cameras, ScenePoints
from planewright.sketch.graph import Sketch
from planewright.tracking.edges import Anchor, EdgeLine, EdgeOptions, corner_lines, drawn_edges, measure_edges
from planewright.tracking.visibility import owners_in_views
from planewright.video.frames import Frames

MISSED = 5.0
"""A corner further from all its marks than this, pixels, starts anew where one of its planes meets one of them: few clicks are so bad, and a start
costs nothing where one is."""
STRAYED = 12.0
"""An incidence that takes a corner further from all its marks than this, pixels, is none."""
GLANCE = 0.1
"""Sine of the angle at which a ray must meet a plane to say where on it."""
UNSEEN = 60.0
"""A face that no view shows with more working pixels than this counts as never seen."""


@dataclass(frozen=True, kw_only=True)
class RefineOptions:
    """How the structure is found, from the first lift to the last adjustment."""

    views: ViewOptions = field(default_factory=ViewOptions)
    """Which frames are looked at."""
    lift: LiftOptions = field(default_factory=LiftOptions)
    """How the sketch is lifted."""
    faces: MultiviewOptions = field(default_factory=MultiviewOptions)
    """How faces are measured in many views."""
    edges: EdgeOptions = field(default_factory=EdgeOptions)
    """How edges are found."""
    rounds: int = 3
    """Rounds with edges, after two without."""
    click_sigma: float = 1.0
    """Standard deviation of a click an axis, pixels."""
    patch_sigma: float = 4.0
    """Depth sigma of a point located as a patch of its own, in pixels of motion (`Views.depth_per_pixel`)."""
    corner_patch_sigma: float = 40.0
    """The same of a corner whose faces found no plane: around it meet surfaces that no one depth holds for. Two such corners of a wall seen
    at a glance were 60 and 95 pixels of motion off, and pulled others after them."""
    on_plane: float = 8.0
    """A corner drawn inside a face is proposed to lie on it when it is this near to its plane, in pixels of motion."""
    open_above: float = 8.0
    """A corner less sure than this (standard deviation, in pixels of motion) by clicks and planes may be helped by its face's shape."""
    adjust: AdjustOptions = field(default_factory=lambda: AdjustOptions(max_overruled=0))
    """The structured adjustment and its relations."""


@dataclass(frozen=True, eq=False)
class Structure:
    """Corners, planes and relations, with what a person should know about them."""

    scene: PlanarScene
    relations: tuple[Relation, ...]
    adjacency: tuple[Adjacency, ...]
    notes: tuple[str, ...]
    basis: Basis | None = None
    """What it was solved from, for corrections; None where that was not kept."""
    lines: tuple[EdgeLine, ...] = ()
    """The edges as the last round found them."""
    anchor: Anchor | None = None
    """Corners as clicks and planes alone give them."""


@dataclass(frozen=True, eq=False)
class _State:
    points: Float[np.ndarray, "points 3"]
    known: Bool[np.ndarray, "points"]
    normals: Float[np.ndarray, "faces 3"]
    offsets: Float[np.ndarray, "faces"]
    face_known: Bool[np.ndarray, "faces"]
    covariance: Float[np.ndarray, "points 3 3"]
    """Infinite where nothing is known of it yet."""


def _state_of(scene: PlanarScene) -> _State:
    return _State(scene.points, scene.point_known, scene.normals, scene.offsets, scene.face_known, scene.point_covariance)


def refine_structure(
    frames: Frames,
    sketch: Sketch,
    cameras: Cameras,
    scene: ScenePoints,
    options: RefineOptions = RefineOptions(),
    *,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> Structure:
    """Corners, planes and relations of a sketch in a clip with known cameras.

    frames: without lens distortion (`video.undistort`); sketch: with its faces, its marks in the pixels of those frames.
    """
    marked = sorted({frame for point in sketch.points for frame in point.marks})
    views = load_views(frames, cameras, scene, marked, options.views, progress=progress)
    lifted = lift_sketch(views, sketch, scene, options.lift, rng=rng, progress=progress)
    rays = mark_rays(views, sketch)
    edges = drawn_edges(sketch)
    nothing = np.full((len(sketch.points), 3, 3), np.inf)
    state = _State(lifted.points, lifted.point_known, lifted.normals, lifted.offsets, lifted.face_known, nothing)
    priors = _patch_priors(views, rays, sketch, lifted, options)
    anchor: Anchor | None = None
    lines: list[EdgeLine] = []
    title, total = "Refining corners and planes", 2 + options.rounds
    progress(title, 0, total)
    # Clicks and planes alone, twice: what the first says of the corners' certainty, the second's incidences and shapes build on.
    structured, _, estimates = _round(views, sketch, rays, edges, lifted, priors, _oriented(views, sketch, state), None, (), options)
    priors = joined(
        priors, fourth_corners(sketch, structured.scene, open_above=options.open_above * views.depth_per_pixel * _distance(views, structured.scene))
    )
    for turn in range(1 + options.rounds):
        progress(title, 1 + turn, total)
        state = _oriented(views, sketch, _state_of(structured.scene))
        structured, lines, estimates = _round(views, sketch, rays, edges, lifted, priors, state, anchor, estimates, options)
        anchor = anchor or Anchor(structured.scene.points, structured.scene.point_covariance)
    progress(title, total, total)
    notes = (*_edge_notes(sketch, lines), *structured.warnings)
    return Structure(structured.scene, structured.relations, structured.adjacency, notes, structured.basis, tuple(lines), anchor)


def _round(
    views: Views,
    sketch: Sketch,
    rays: MarkRays,
    edges: Sequence[tuple[int, int, int]],
    lifted: Lifted,
    priors: CornerPriors,
    state: _State,
    anchor: Anchor | None,
    last: Sequence[FaceEstimate],
    options: RefineOptions,
) -> tuple[Structured, list[EdgeLine], list[FaceEstimate]]:
    owners = owners_in_views(views, polygons_of(sketch, state.points, _or_nan(state.normals, state.face_known), state.offsets))
    estimates = measure_faces(views, state.normals, state.offsets, state.face_known, owners, options.faces, options.lift.photometric, last=last)
    lines: list[EdgeLine] = []
    if anchor is not None:
        usable = [(f, a, b) for f, a, b in edges if state.face_known[f] and state.known[a] and state.known[b]]
        lines = measure_edges(views, usable, state.points, anchor, state.normals, owners, options.edges)
    proposed = propose_incidences(
        sketch, rays, state.points, state.covariance, state.known, state.normals, state.offsets, state.face_known, options.on_plane * views.depth_per_pixel
    )
    lifted_sigma = options.lift.plane_sigma * views.depth_per_pixel * _distance(views, state)
    evidence = Evidence(
        plane_points=_with_lifted(plane_points(views, estimates, options.faces), lifted, lifted_sigma, _distance(views, state)),
        marks=_marks(views, rays, options.click_sigma * views.scale),
        lines=corner_lines(lines, state.points),
        priors=priors,
    )
    start = PlanarStart(_recalled(sketch, edges, rays, views, state), state.known, state.normals, state.offsets, state.face_known)
    structured = adjust_structure(sketch, start, evidence, proposed, options.adjust)
    # an incidence that takes a corner away from all that was marked of it is none, however well the rest agrees
    wrong = (
        _strayed(rays, views, structured.scene.points, STRAYED * views.scale)[proposed[:, 1]]
        & ~_strayed(rays, views, start.points, STRAYED * views.scale)[proposed[:, 1]]
    )
    if wrong.any():
        structured = adjust_structure(sketch, start, evidence, proposed[~wrong], options.adjust)
    return structured, lines, estimates


def _recalled(sketch: Sketch, edges: Sequence[tuple[int, int, int]], rays: MarkRays, views: Views, state: _State) -> Float[np.ndarray, "points 3"]:
    """The corners, those that strayed from all of their marks (their robust loss has let go of them for good) back where the ray of a mark
    meets the face that it meets most squarely; where it meets none at more than `GLANCE`, where it passes nearest the corners they are joined to."""
    points, known = state.points.copy(), state.face_known
    for c in np.nonzero(_strayed(rays, views, state.points, MISSED * views.scale) & state.known)[0]:
        faces = [f for f, face in enumerate(sketch.faces) if known[f] and sketch.points[c].id in face.corners]
        best, found = GLANCE, False
        for r in rays.of_point(int(c)):
            direction = rays.direction[r] / np.linalg.norm(rays.direction[r])
            for f in faces:
                along = float(direction @ state.normals[f])
                distance = (state.offsets[f] - float(rays.origin[r] @ state.normals[f])) / along if abs(along) > best else -1.0
                if distance > 0:
                    best, found, points[c] = abs(along), True, rays.origin[r] + distance * direction
        near = state.points[sorted({b if a == c else a for _, a, b in edges if c in (a, b)} & set(np.nonzero(state.known)[0].tolist()))]
        if not found and len(near):
            r = rays.of_point(int(c))[0]
            direction = rays.direction[r] / np.linalg.norm(rays.direction[r])
            points[c] = rays.origin[r] + float(np.median((near - rays.origin[r]) @ direction)) * direction
    return points


def _strayed(rays: MarkRays, views: Views, points: Float[np.ndarray, "points 3"], limit: float) -> Bool[np.ndarray, "points"]:
    """Corners that lie further than `limit` (working pixels) from all of their marks."""
    projections = views.projections[rays.view]
    seen = np.einsum("nij,nj->ni", projections[:, :, :3], points[rays.point]) + projections[:, :, 3]
    off = np.linalg.norm(seen[:, :2] / np.where(np.abs(seen[:, 2:]) < 1e-9, 1e-9, seen[:, 2:]) - rays.xy, axis=1)
    nearest = np.full(len(points), np.inf)
    np.minimum.at(nearest, rays.point, np.where(np.isfinite(off), off, np.inf))
    return np.isfinite(nearest) & (nearest > limit)


def _with_lifted(measured: PlanePoints, lifted: Lifted, sigma: float, distance: float) -> PlanePoints:
    """The measured planes, and for faces that no reference view could measure again, the plane from which they were lifted."""
    missing = np.nonzero(lifted.from_pixels & ~np.isin(np.arange(len(lifted.normals)), measured.face))[0]
    faces, points, sigmas = [measured.face], [measured.point], [measured.sigma]
    for f in missing:
        corners = lifted.points[list(lifted.corners[f])]
        corners = corners[np.isfinite(corners).all(axis=1)]
        if len(corners) >= 3:
            center = corners.mean(axis=0)
            spread = corners - center
            onto = spread - np.outer(spread @ lifted.normals[f], lifted.normals[f])
            center = center - (center @ lifted.normals[f] - lifted.offsets[f]) * lifted.normals[f]
            _, size, axes = np.linalg.svd(onto / np.sqrt(len(corners)))
            turns = 2 * np.pi * np.arange(3) / 3
            faces.append(np.full(3, f))
            sigmas.append(np.full(3, float(np.hypot(sigma, lifted.plane_sigma[f] * distance))))
            points.append(center + np.sqrt(2.0) * (np.cos(turns)[:, None] * size[0] * axes[0] + np.sin(turns)[:, None] * size[1] * axes[1]))
    return PlanePoints(np.concatenate(faces), np.concatenate(points), np.concatenate(sigmas))


def _distance(views: Views, scene: PlanarScene | _State) -> float:
    """From the cameras to the sketched scene, about."""
    known = scene.points[scene.point_known if isinstance(scene, PlanarScene) else scene.known]
    return float(np.median(np.linalg.norm(views.centers[:, None] - known[None], axis=2))) if len(known) else 1.0


def _or_nan(normals: Float[np.ndarray, "faces 3"], known: Bool[np.ndarray, "faces"]) -> Float[np.ndarray, "faces 3"]:
    return np.where(known[:, None], normals, np.nan)


def _marks(views: Views, rays: MarkRays, sigma: float) -> CornerMarks:
    return CornerMarks(rays.point, views.projections[rays.view], rays.xy, np.full(len(rays.point), sigma))


def _patch_priors(views: Views, rays: MarkRays, sketch: Sketch, lifted: Lifted, options: RefineOptions) -> CornerPriors:
    """Points in no face with a plane: where their patch put them, sure in depth only as far as a patch is."""
    on_face, lone = np.zeros(len(sketch.points), bool), np.ones(len(sketch.points), bool)
    row = {point.id: i for i, point in enumerate(sketch.points)}
    for f, face in enumerate(sketch.faces):
        lone[[row[c] for c in face.corners]] = False
        if lifted.face_known[f]:
            on_face[[row[c] for c in face.corners]] = True
    corner, mean, whitening = [], [], []
    for c in np.nonzero(~on_face & lifted.point_known)[0]:
        mark = rays.of_point(int(c))[0]
        r = views.rotation[rays.view[mark]]
        depth = float((lifted.points[c] - rays.origin[mark]) @ r[2])
        across = 3.0 * depth / views.calibration[0, 0]  # the click itself says where across
        corner.append(int(c))
        mean.append(lifted.points[c])
        sigma = options.patch_sigma if lone[c] else options.corner_patch_sigma
        whitening.append(np.diag([1 / across, 1 / across, 1 / (sigma * views.depth_per_pixel * depth)]) @ r)
    return CornerPriors(np.array(corner, int), np.array(mean, float).reshape(-1, 3), np.array(whitening, float).reshape(-1, 3, 3))


def _oriented(views: Views, sketch: Sketch, state: _State) -> _State:
    """Normals towards the cameras that see the face, all other faces in place; a face that is never seen turns away from most cameras."""
    owners = owners_in_views(views, polygons_of(sketch, state.points, _or_nan(state.normals, state.face_known), state.offsets))
    areas = visible_shares(views, owners, len(state.normals))
    side = np.where(
        state.face_known, views.centers @ np.where(state.face_known[:, None], state.normals, 0.0).T - np.where(state.face_known, state.offsets, 0.0), 0.0
    )
    seen = areas.max(axis=0) > UNSEEN
    wrong = np.where(seen, (areas * np.sign(side)).sum(axis=0) < 0, np.sign(side).sum(axis=0) > 0)
    turn = np.where(wrong, -1.0, 1.0)
    return replace(state, normals=state.normals * turn[:, None], offsets=state.offsets * turn)


def _edge_notes(sketch: Sketch, lines: Sequence[EdgeLine]) -> list[str]:
    notes: list[str] = []
    for line in lines:
        if line.ambiguous and line.other_offset is not None:
            a, b = (sketch.points[i].id for i in line.edge)
            off = [abs(o) / line.pixel for o in line.other_offset]
            notes.append(
                f"Edge {a}-{b} is ambiguous on face {sketch.faces[line.face].id}: a second line runs {off[0]:.1f} and {off[1]:.1f} px "
                f"beside it at its ends. Mark {a} or {b} in another frame to say which one is meant."
            )
    return notes
