"""Corners and planes with known truth, and evidence about them with honest noise: what the structured adjustment is tested on, without any image."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Float, Int
from planewright.geometry.plane import fit_plane, tangent_basis
from planewright.planes.evidence import CornerLines, CornerMarks, CornerPriors, Evidence, PlanePoints
from planewright.planes.planar_start import PlanarStart
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint


@dataclass(frozen=True, eq=False)
class StructureTruth:
    """A planar object and the cameras around it."""

    sketch: Sketch
    points: Float[np.ndarray, "points 3"]
    normals: Float[np.ndarray, "faces 3"]
    """Unit, outwards."""
    offsets: Float[np.ndarray, "faces"]
    attached: Int[np.ndarray, "attached 2"]
    """Face row and corner row of corners that lie on faces they do not belong to (the feet of a chimney)."""
    projections: Float[np.ndarray, "cameras 3 4"]
    """K [R | t], pixels."""

    @property
    def incidences(self) -> Int[np.ndarray, "incidences 2"]:
        """Face row and corner row of every drawn corner."""
        row = {point.id: i for i, point in enumerate(self.sketch.points)}
        return np.array([(f, row[corner]) for f, face in enumerate(self.sketch.faces) for corner in face.corners], dtype=np.int64)

    @property
    def diagonal(self) -> float:
        """Of the bounding box of the corners."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    def pairs(self, kind: str, tolerance: float = 1e-6) -> set[frozenset[FaceId]]:
        """Pairs of faces that are parallel, orthogonal or coplanar in truth; tolerance on the sine or cosine, and on the offset."""
        out: set[frozenset[FaceId]] = set()
        cosine = np.abs(self.normals @ self.normals.T)
        for a, first in enumerate(self.sketch.faces):
            for b in range(a):
                gap = abs(self.offsets[a] - np.sign(self.normals[a] @ self.normals[b]) * self.offsets[b])
                parallel = cosine[a, b] > 1.0 - tolerance
                if (
                    (kind == "parallel" and parallel)
                    or (kind == "coplanar" and parallel and gap < tolerance)
                    or (kind == "orthogonal" and cosine[a, b] < tolerance)
                ):
                    out.add(frozenset((first.id, self.sketch.faces[b].id)))
        return out


@dataclass(frozen=True, kw_only=True)
class EvidenceNoise:
    """How good the simulated evidence is. All noise is Gaussian and as large as the evidence claims, but for what is said."""

    tilt_deg: tuple[float, float] = (0.1, 1.5)
    """Standard deviation of a face's measured normal: drawn log-uniformly from this range, per axis."""
    bare: float = 0.15
    """Share of faces without any measured plane."""
    click: float = 1.0
    """Pixels."""
    line: float = 0.4
    """Pixels; the share of drawn edges that is found is `line_share`."""
    line_share: float = 0.8
    as_built_deg: float = 0.0
    """Each face is built this far off (standard deviation, per axis); the evidence does not know."""
    understated: float = 1.0
    """True noise over claimed noise."""


def evidence_of(truth: StructureTruth, noise: EvidenceNoise, rng: np.random.Generator) -> Evidence:
    """Measured planes, clicks and relocated edges of an object."""
    factor = noise.understated
    faces, clouds, sigmas = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))], [np.zeros(0)]
    for f, normal in enumerate(truth.normals):
        corners = truth.points[truth.incidences[truth.incidences[:, 0] == f, 1]]
        tilt = np.exp(rng.uniform(*np.log(noise.tilt_deg)))
        tilt_off = np.radians(rng.normal(0.0, noise.as_built_deg, 2)) if noise.as_built_deg else np.zeros(2)
        measured = rng.random() >= noise.bare
        errors = rng.normal(size=3)
        if not measured:
            continue
        center, basis = corners.mean(axis=0), tangent_basis(normal[None])[0]
        radius = float(np.sqrt(((corners - center) ** 2).sum(axis=1).mean()))
        turn = np.radians([0.0, 120.0, 240.0])
        spots = radius * np.column_stack([np.cos(turn), np.sin(turn)])
        # Three points on a circle: the slope about any axis has variance sigma^2 / (1.5 radius^2).
        sigma = np.radians(tilt) * radius * np.sqrt(1.5)
        clouds.append(center + spots @ basis + np.outer(sigma * factor * errors + spots @ tilt_off, normal))
        faces.append(np.full(3, f))
        sigmas.append(np.full(3, sigma))
    return Evidence(
        PlanePoints(np.concatenate(faces), np.concatenate(clouds), np.concatenate(sigmas)),
        _clicks(truth, noise, rng),
        _lines(truth, noise, rng),
        CornerPriors(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3))),
    )


def _clicks(truth: StructureTruth, noise: EvidenceNoise, rng: np.random.Generator) -> CornerMarks:
    """One click a corner, in the camera that sees its faces best."""
    centers = -np.linalg.solve(truth.projections[:, :, :3], truth.projections[:, :, 3:])[:, :, 0]
    camera = np.zeros(len(truth.points), dtype=np.int64)
    for i, point in enumerate(truth.points):
        normals = truth.normals[truth.incidences[truth.incidences[:, 1] == i, 0]]
        towards = (centers - point) / np.linalg.norm(centers - point, axis=1, keepdims=True)
        camera[i] = int(np.argmax((towards @ normals.T).min(axis=1)))
    projection = truth.projections[camera]
    projected = np.einsum("tij,tj->ti", projection[:, :, :3], truth.points) + projection[:, :, 3]
    xy = projected[:, :2] / projected[:, 2:] + rng.normal(0.0, noise.click * noise.understated, (len(camera), 2))
    return CornerMarks(np.arange(len(camera)), projection, xy, np.full(len(camera), noise.click))


def _lines(truth: StructureTruth, noise: EvidenceNoise, rng: np.random.Generator) -> CornerLines:
    """Both ends of the drawn edges that are found: at right angles to the edge within its face, off by a number of pixels."""
    row = {point.id: i for i, point in enumerate(truth.sketch.points)}
    pixel = float(np.median(truth.projections[:, 2, :3] @ truth.points.mean(axis=0) + truth.projections[:, 2, 3])) / float(
        np.linalg.norm(truth.projections[0, 0, :3])
    )
    corner, direction, offset = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))], [np.zeros(0)]
    done: set[frozenset[int]] = set()
    for f, face in enumerate(truth.sketch.faces):
        for loop in (face.loop, *face.holes):
            for a, b in zip(loop, (*loop[1:], loop[0]), strict=True):
                i, j = row[a], row[b]
                found = rng.random() < noise.line_share
                errors = rng.normal(0.0, noise.line * noise.understated * pixel, 2)
                if frozenset((i, j)) in done or not found:
                    continue
                done.add(frozenset((i, j)))
                across = np.cross(truth.normals[f], truth.points[j] - truth.points[i])
                across /= np.linalg.norm(across)
                corner.append(np.array([i, j]))
                direction.append(np.stack([across, across]))
                offset.append(truth.points[[i, j]] @ across + errors)
    corners = np.concatenate(corner)
    return CornerLines(corners, np.concatenate(direction), np.concatenate(offset), np.full(len(corners), noise.line * pixel))


def start_of(truth: StructureTruth, rng: np.random.Generator, point_error: float = 0.01, tilt_deg: float = 3.0) -> PlanarStart:
    """A start off by a share of the diagonal and some degrees."""
    normals = truth.normals + np.einsum("fk,fkj->fj", np.radians(rng.normal(0.0, tilt_deg, (len(truth.normals), 2))), tangent_basis(truth.normals))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = truth.points + rng.normal(0.0, point_error * truth.diagonal, truth.points.shape)
    faces = truth.incidences
    centers = np.stack([points[faces[faces[:, 0] == f, 1]].mean(axis=0) for f in range(len(normals))])
    return PlanarStart(points, np.ones(len(points), dtype=bool), normals, (normals * centers).sum(axis=1), np.ones(len(normals), dtype=bool))


class _Builder:
    """Collects named corners and faces; planes follow from the corners, outwards from a given inner point."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.points: list[Float[np.ndarray, "3"]] = []
        self.faces: list[SketchFace] = []
        self.inside: list[Float[np.ndarray, "3"]] = []
        self.attached: list[tuple[str, str]] = []

    def corner(self, name: str, *xyz: float | int) -> None:
        self.names.append(name)
        self.points.append(np.array(xyz, dtype=np.float64))

    def at(self, name: str) -> Float[np.ndarray, "3"]:
        return self.points[self.names.index(name)]

    def face(self, name: str, loop: str, inside: Sequence[float | int], *holes: str) -> None:
        split = [tuple(PointId(corner) for corner in text.split()) for text in (loop, *holes)]
        self.faces.append(SketchFace(FaceId(name), split[0], tuple(split[1:])))
        self.inside.append(np.array(inside, dtype=np.float64))

    def box(self, name: str, center: Sequence[float | int], size: Sequence[float | int], yaw_deg: float | int, faces: str = "front left right top") -> None:
        """A box standing at `center` (middle of its bottom), turned about the vertical."""
        c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
        for k, (x, y, z) in enumerate([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]):
            u, v = 0.5 * x * size[0], 0.5 * y * size[1]
            self.corner(f"{name}{k}", center[0] + c * u - s * v, center[1] + s * u + c * v, center[2] + z * size[2])
        loops = {"front": "0 1 5 4", "right": "1 2 6 5", "left": "0 3 7 4", "back": "2 3 7 6", "top": "4 5 6 7"}
        inner = (center[0], center[1], center[2] + 0.5 * size[2])
        for side in faces.split():
            self.face(f"{name}_{side}", " ".join(name + k for k in loops[side].split()), inner)

    def build(self, target: Sequence[float | int], distance: float | int) -> StructureTruth:
        used = {corner for face in self.faces for corner in face.corners}
        keep = [i for i, name in enumerate(self.names) if name in used]
        points = np.stack([self.points[i] for i in keep])
        names = [self.names[i] for i in keep]
        sketch = Sketch(points=tuple(SketchPoint(PointId(name), {}) for name in names), faces=tuple(self.faces), image_size=(960, 540))
        planes = [fit_plane(points[[names.index(c) for c in face.corners]], np.ones(len(face.corners))) for face in self.faces]
        sign = [1.0 if normal @ inside < offset else -1.0 for (normal, offset), inside in zip(planes, self.inside, strict=True)]
        face_names = [face.id for face in self.faces]
        return StructureTruth(
            sketch=sketch,
            points=points,
            normals=np.stack([s * normal for s, (normal, _) in zip(sign, planes, strict=True)]),
            offsets=np.array([s * offset for s, (_, offset) in zip(sign, planes, strict=True)]),
            attached=np.array([(face_names.index(FaceId(f)), names.index(c)) for f, c in self.attached], dtype=np.int64).reshape(-1, 2),
            projections=_orbit(np.array(target, dtype=np.float64), distance),
        )


def _orbit(target: Float[np.ndarray, "3"], distance: float | int) -> Float[np.ndarray, "cameras 3 4"]:
    """Twelve cameras on a wide arc, a little above, looking at the target."""
    out: list[Float[np.ndarray, "3 4"]] = []
    for turn in np.radians(np.linspace(-100.0, 100.0, 12)):
        center = target + distance * np.array([np.sin(turn), -np.cos(turn), 0.45])
        forward = (target - center) / np.linalg.norm(target - center)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        calibration = np.array([[900.0, 0.0, 480.0], [0.0, 900.0, 270.0], [0.0, 0.0, 1.0]])
        out.append(calibration @ np.column_stack([rotation, -rotation @ center]))
    return np.stack(out)


def house_truth(wing_deg: float = 6.0, pitch_deg: float = 42.0) -> StructureTruth:
    """A gabled house with a door, a window, a wing whose side wall stands `wing_deg` off, a chimney and a dormer: 18 faces.

    The wing's wall is a near miss to four faces as parallel and to many as orthogonal; with a pitch near 45 degrees the roofs are nearly at right angles.
    """
    build, inside = _Builder(), (-0.5, 0.0, 0.5)
    half, eaves = 1.1, 1.4
    ridge = eaves + half * np.tan(np.radians(pitch_deg))
    for name, x, y, z in [("FL", -1.8, -half, 0), ("FR", 0.9, -half, 0), ("BL", -1.8, half, 0), ("eFL", -1.8, -half, eaves), ("eFR", 0.9, -half, eaves)]:
        build.corner(name, x, y, z)
    for name, x, y, z in [("eBL", -1.8, half, eaves), ("eBR", 0.9, half, eaves), ("rL", -1.8, 0, ridge), ("rR", 0.9, 0, ridge)]:
        build.corner(name, x, y, z)
    for k, (x, z) in enumerate([(-0.6, 0), (-0.6, 0.8), (-0.15, 0.8), (-0.15, 0)]):
        build.corner(f"d{k}", x, -half, z)
    for k, (x, z) in enumerate([(-1.5, 0.5), (-0.9, 0.5), (-0.9, 1.0), (-1.5, 1.0)]):
        build.corner(f"w{k}", x, -half, z)
    build.corner("tfl", 0.9, -half, 1.2)
    build.corner("tbl", 0.9, half, 1.2)
    shift, drop = 2.0 * half * np.tan(np.radians(wing_deg)), 0.32
    for name, x, y, z in [("bfr", 2.1, -half, 0.0), ("bbr", 2.1 - shift, half, 0.0)]:
        build.corner(name, x, y, z)
    for name, x, y in [("tfr", 2.1, -half), ("tbr", 2.1 - shift, half)]:
        build.corner(name, x, y, 1.2 - drop * (x - 0.9))
    build.face("front", "FL d0 d1 d2 d3 FR tfl eFR eFL", inside, "w0 w1 w2 w3")
    build.face("window", "w0 w1 w2 w3", inside)
    build.face("door", "d0 d1 d2 d3", inside)
    build.face("left", "FL eFL eBL BL", inside)
    build.face("left_gable", "eFL rL eBL", inside)
    build.face("right_gable", "tfl tbl eBR rR eFR", inside)
    build.face("roof_front", "eFL eFR rR rL", inside)
    build.face("roof_back", "eBL eBR rR rL", inside)
    build.face("wing_front", "FR bfr tfr tfl", inside)
    build.face("wing_right", "bfr bbr tbr tfr", inside)
    build.face("wing_roof", "tfl tfr tbr tbl", inside)
    slope = np.tan(np.radians(pitch_deg))
    for k, (x, y) in enumerate([(0.0, -0.7), (0.4, -0.7), (0.4, -0.35), (0.0, -0.35)]):
        build.corner(f"cb{k}", x, y, ridge + slope * y)
        build.corner(f"ct{k}", x, y, ridge + 0.35)
        build.attached.append(("roof_front", f"cb{k}"))
    core = (0.2, -0.5, ridge + 0.1)
    build.face("chimney_front", "cb0 cb1 ct1 ct0", core)
    build.face("chimney_right", "cb1 cb2 ct2 ct1", core)
    build.face("chimney_left", "cb3 cb0 ct0 ct3", core)
    build.face("chimney_top", "ct0 ct1 ct2 ct3", core)
    foot, top = ridge - slope * 0.85, ridge - slope * 0.3
    for name, x, y, z in [("m0", -1.4, -0.85, foot), ("m1", -0.7, -0.85, foot), ("m2", -1.05, -0.85, top), ("m3", -1.05, -0.3, top)]:
        build.corner(name, x, y, z)
    build.attached += [("roof_front", name) for name in ("m0", "m1", "m3")]
    core = (-1.05, -0.7, foot + 0.1)
    build.face("dormer_front", "m0 m1 m2", core)
    build.face("dormer_left", "m0 m2 m3", core)
    build.face("dormer_right", "m1 m3 m2", core)
    return build.build((0.0, 0.0, 1.0), 7.0)


def boxes_truth(turn_deg: float = 4.0) -> StructureTruth:
    """Three boxes on the ground and one on top; the second and third are turned by `turn_deg` and by 30 degrees: 17 faces."""
    build = _Builder()
    for name, x, y in [("g0", -2.5, -1.6), ("g1", 2.5, -1.6), ("g2", 2.5, 1.6), ("g3", -2.5, 1.6)]:
        build.corner(name, x, y, 0.0)
    build.face("ground", "g0 g1 g2 g3", (0.0, 0.0, -1.0))
    build.box("a", (-1.2, 0.0, 0.0), (1.4, 1.0, 0.9), 0.0)
    build.box("b", (0.9, 0.3, 0.0), (1.1, 0.9, 1.3), turn_deg)
    build.box("c", (0.2, -1.1, 0.0), (0.6, 0.5, 0.45), 30.0)
    build.box("d", (-1.2, 0.05, 0.9), (0.7, 0.5, 0.4), -12.0)
    build.attached += [("ground", f"{name}{k}") for name in "abc" for k in range(4)] + [("a_top", f"d{k}") for k in range(4)]
    return build.build((0.0, 0.0, 0.5), 7.0)


def yard_truth() -> StructureTruth:
    """Twelve boxes on the ground, most in line, some turned by 4 to 30 degrees: 45 faces, hundreds of relations, and near misses 3 to 8 degrees off."""
    build = _Builder()
    for name, x, y in [("g0", -3, -3), ("g1", 3, -3), ("g2", 3, 3), ("g3", -3, 3)]:
        build.corner(name, x, y, 0)
    build.face("ground", "g0 g1 g2 g3", (0, 0, -1))
    for k, turn_deg in enumerate([0, 0, 4, 0, 30, 0, 12, 0, 0, 90, 7, 0]):
        name, sides = f"b{k}_", "front left right top" if k % 3 else "front right top"
        build.box(name, (-2.2 + 1.5 * (k % 4), -2 + 1.8 * (k // 4), 0), (0.8, 0.7, 0.5 + 0.1 * k), turn_deg, sides)
        build.attached += [("ground", f"{name}{corner}") for corner in range(4 if k % 3 else 3)]
    return build.build((0.0, 0.0, 0.5), 9.0)


def renumbered(truth: StructureTruth, evidence: Evidence, start: PlanarStart, rng: np.random.Generator) -> tuple[StructureTruth, Evidence, PlanarStart]:
    """The same object with its faces and corners in another order; their names stay."""
    face_order, point_order = rng.permutation(len(truth.normals)), rng.permutation(len(truth.points))
    face_rank, point_rank = np.argsort(face_order), np.argsort(point_order)
    sketch = replace(truth.sketch, faces=tuple(truth.sketch.faces[f] for f in face_order), points=tuple(truth.sketch.points[i] for i in point_order))
    attached = np.column_stack([face_rank[truth.attached[:, 0]], point_rank[truth.attached[:, 1]]])
    moved = replace(
        truth, sketch=sketch, points=truth.points[point_order], normals=truth.normals[face_order], offsets=truth.offsets[face_order], attached=attached
    )
    return (
        moved,
        Evidence(
            replace(evidence.plane_points, face=face_rank[evidence.plane_points.face]),
            replace(evidence.marks, corner=point_rank[evidence.marks.corner]),
            replace(evidence.lines, corner=point_rank[evidence.lines.corner]),
            replace(evidence.priors, corner=point_rank[evidence.priors.corner]),
        ),
        PlanarStart(
            start.points[point_order], start.point_known[point_order], start.normals[face_order], start.offsets[face_order], start.face_known[face_order]
        ),
    )
