"""Which faces meet along drawn edges, and at which angle."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Float
from planewright.geometry.plane import tangent_basis
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.structured_bundle import StructureSolution
from planewright.sketch.graph import Edge, FaceId, Sketch, SketchFace


@dataclass(frozen=True)
class Adjacency:
    """Two faces and an edge of both."""

    faces: tuple[FaceId, FaceId]
    edge: Edge
    dihedral_deg: float
    """Angle between the two faces at the edge: 180 degrees minus the angle between their normals. 180 is flat; a box has 90, from outside or inside."""
    sigma_deg: float
    """Standard deviation; zero where a relation fixes the angle."""


def adjacent_faces(sketch: Sketch, solution: StructureSolution | PlanarScene) -> tuple[Adjacency, ...]:
    """Pairs of known faces that share a drawn edge, in the order of the drawing; each pair once an edge."""
    point_row = {point.id: i for i, point in enumerate(sketch.points)}
    sides: dict[frozenset[str], list[tuple[int, Edge]]] = {}
    for f, face in enumerate(sketch.faces):
        if not solution.face_known[f]:
            continue
        for edge in _edges(face):
            sides.setdefault(frozenset(edge), []).append((f, edge))
    out: list[Adjacency] = []
    for meeting in sides.values():
        for i, (a, edge) in enumerate(meeting):
            for b, _ in meeting[i + 1 :]:
                if a == b:
                    continue
                ends = solution.points[[point_row[edge[0]], point_row[edge[1]]]]
                angle, sigma = _dihedral(solution, a, b, ends[1] - ends[0])
                out.append(Adjacency((sketch.faces[a].id, sketch.faces[b].id), edge, angle, sigma))
    return tuple(out)


def _edges(face: SketchFace) -> list[Edge]:
    """Drawn edges of a face; the chain of an open face is not closed."""
    out: list[Edge] = list(zip(face.loop[:-1], face.loop[1:], strict=True))
    if not face.open:
        out.append((face.loop[-1], face.loop[0]))
    for hole in face.holes:
        out += zip(hole, (*hole[1:], hole[0]), strict=True)
    return out


def _dihedral(solution: StructureSolution | PlanarScene, a: int, b: int, along: Float[np.ndarray, "3"]) -> tuple[float, float]:
    """Angle and its standard deviation, degrees: normals turn about the edge only, so one number each of their covariance counts."""
    first, second = solution.normals[a], solution.normals[b]
    cross = np.cross(first, second)
    sine = float(np.linalg.norm(cross))
    angle = float(np.arctan2(sine, first @ second))
    length = float(np.linalg.norm(along))
    axis = cross / sine if sine > 1e-6 else along / length if length > 0.0 else tangent_basis(first[None])[0, 0]
    slope = np.zeros(6)
    slope[0:2] = -tangent_basis(first[None])[0] @ np.cross(axis, first)
    slope[3:5] = tangent_basis(second[None])[0] @ np.cross(axis, second)
    columns = np.concatenate([3 * a + np.arange(3), 3 * b + np.arange(3)])
    variance = float(slope @ solution.plane_covariance[np.ix_(columns, columns)] @ slope)
    return 180.0 - float(np.degrees(angle)), float(np.degrees(np.sqrt(max(variance, 0.0))))
