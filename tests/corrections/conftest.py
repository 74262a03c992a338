"""Sessions on the shed: evidence made from the truth, with one thing wrong, solved; tracks as a run would have them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest

from planewright.corrections.session import Model, Session
from planewright.planes.basis import Basis
from planewright.planes.evidence import CornerLines, CornerMarks, CornerPriors, Evidence, PlanePoints
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.planar_start import PlanarStart
from planewright.planes.structured_bundle import solve_structure
from planewright.refine.rounds import Structure
from planewright.relations.enforce import pair_constraints
from planewright.relations.relation import Relation
from planewright.sketch.graph import FaceId, PointId
from planewright.synthetic.observe import true_tracks
from planewright.tracking.edges import Anchor, EdgeLine, corner_lines, drawn_edges
from planewright.tracking.tracks import State, Tracks

Shift = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Staged:
    """A session and what is true."""

    session: Session
    true_xy: np.ndarray
    """(frames, points, 2)."""

    def errors(self, session: Session, point: str) -> np.ndarray:
        """Pixels off in each frame in which the point has a row."""
        row = session.row(PointId(point))
        mine = session.tracks.point_index == row
        return np.linalg.norm(session.tracks.xy[mine] - self.true_xy[session.tracks.frame[mine], row], axis=1)

    def at(self, point: str, frame: int, off: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
        """Where the point is in a frame."""
        x, y = self.true_xy[frame, self.session.row(PointId(point))] + off
        return float(x), float(y)


@pytest.fixture(scope="session")
def stage(shed) -> Callable[..., Staged]:
    """`stage(clicks={point: pixels off}, plane={face: world units off}, relations=[(kind, face, face)], found=[(face, point)],
    beside={(point, point): pixels off})`: `found` are incidences that hold nowhere but in the model, `beside` edges that were taken
    for a line beside them; `sigma` is what tracks claim, pixels.
    """

    def stage(
        clicks: Shift | None = None,
        plane: Mapping[str, float] | None = None,
        relations: tuple[tuple[str, str, str], ...] = (),
        found: tuple[tuple[str, str], ...] = (),
        beside: Mapping[tuple[str, str], float] | None = None,
        sigma: float = 0.45,
    ) -> Staged:
        return _stage(shed, clicks or {}, plane or {}, relations, found, beside or {}, sigma)

    return stage


def _stage(
    shed,
    clicks: Shift,
    plane: Mapping[str, float],
    wanted: tuple[tuple[str, str, str], ...],
    found: tuple[tuple[str, str], ...],
    beside: Mapping[tuple[str, str], float],
    sigma: float,
) -> Staged:
    rng = np.random.default_rng(3)
    truth: PlanarScene = shed.scene
    cameras, sketch = shed.cameras, truth.sketch
    row, face_row = truth.point_row(), truth.face_row()
    pixel = 2e-3 * shed.clip.scene.diagonal  # about one pixel of 320, where the shed is

    points = tuple(
        replace(p, marks={f: (x + clicks[p.id][0], y + clicks[p.id][1]) for f, (x, y) in p.marks.items()}) if p.id in clicks else p for p in sketch.points
    )
    sketch = replace(sketch, points=points)
    corner, projection, xy = [], [], []
    for i, point in enumerate(sketch.points):
        for frame, place in point.marks.items():
            corner.append(i)
            projection.append(cameras.intrinsics.matrix @ np.column_stack([cameras.rotation[frame], cameras.translation[frame]]))
            xy.append(place)
    on_face, at = [], []
    for f, face in enumerate(sketch.faces):
        cloud = truth.points[[row[c] for c in face.loop]]
        for k in range(9):
            place = rng.dirichlet(np.ones(len(cloud))) @ cloud
            on_face.append(f)
            at.append(place + (plane.get(face.id, 0.0) + rng.normal(0.0, 0.3 * pixel)) * truth.normals[f])
            del k
    lines = tuple(
        EdgeLine((min(a, b), max(a, b)), f, across, across, (off * pixel, off * pixel), ((0.5 if off == 0.0 else 0.1) * pixel,) * 2, pixel, 3.0, False, None)
        for f, a, b in drawn_edges(sketch)
        if sketch.faces[f].id not in plane and not {sketch.points[a].id, sketch.points[b].id} & set(clicks)
        for across in [_across(truth, f, a, b)]
        for off in [beside.get((sketch.points[a].id, sketch.points[b].id), 0.0)]
    )
    evidence = Evidence(
        PlanePoints(np.array(on_face), np.array(at), np.full(len(at), 0.3 * pixel)),
        CornerMarks(np.array(corner), np.array(projection), np.array(xy), np.ones(len(xy))),
        corner_lines(lines, truth.points),
        CornerPriors(np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 3, 3))),
    )
    drawn = [(f, row[c]) for f, face in enumerate(sketch.faces) for c in face.corners]
    incidences = np.array(sorted({*drawn, *((face_row[FaceId(face)], row[PointId(point)]) for face, point in found)}))
    constraints = pair_constraints((kind, face_row[FaceId(a)], face_row[FaceId(b)]) for kind, a, b in wanted)
    start = PlanarStart(truth.points, truth.point_known, truth.normals, truth.offsets, truth.face_known)
    solved = solve_structure(start, incidences, evidence, constraints)
    scene = PlanarScene(
        sketch, solved.points, solved.point_known, solved.point_covariance, solved.normals, solved.offsets, solved.face_known, solved.plane_covariance
    )
    relations = tuple(Relation(kind, (FaceId(a), FaceId(b)), "enforced", "detected", 0.0, 0.1, None, 9.0, 1, "") for kind, a, b in wanted)
    no_lines = CornerLines(np.zeros(0, int), np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    unaided = solve_structure(start, incidences, replace(evidence, lines=no_lines), constraints)
    structure = Structure(
        scene, relations, (), (), Basis(evidence, incidences, constraints, tuple(solved.scale)), lines, Anchor(unaided.points, unaided.point_covariance)
    )
    # Where faces and edges disagree about a corner, a run's sigmas say so.
    vague = [row[c] for face in sketch.faces if face.id in plane for c in face.corners]
    session = Session(shed.frames, sketch, _tracks(shed, scene, rng, vague, sigma), Model(cameras, structure))
    return Staged(session, shed.pixels(truth.points))


def _across(truth: PlanarScene, face: int, a: int, b: int) -> np.ndarray:
    along = truth.points[max(a, b)] - truth.points[min(a, b)]
    across = np.cross(truth.normals[face], along / np.linalg.norm(along))
    return across / np.linalg.norm(across)


def _tracks(shed, scene: PlanarScene, rng: np.random.Generator, vague: list[int], sigma: float) -> Tracks:
    """The model's projection with a little noise, in the frames in which a corner can be seen or is hidden inside the image."""
    seen_at = shed.pixels(scene.points)
    _, visible, inside = true_tracks(shed.clip)
    ids = list(shed.clip.scene.points)
    rows = []
    for i, point in enumerate(scene.sketch.points):
        for frame in np.flatnonzero(inside[ids.index(point.id)]).tolist():
            state = State.MARKED if frame in point.marks else State.TRACKED if visible[ids.index(point.id), frame] else State.HIDDEN
            rows.append((i, frame, *(seen_at[frame, i] + rng.normal(0.0, 0.15, 2)), int(state)))
    table = np.array(rows)
    covariance = np.where(np.isin(table[:, 0], vague), 1.2, sigma)[:, None, None] ** 2 * np.eye(2)
    return Tracks(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:4], covariance, table[:, 4].astype(int))
