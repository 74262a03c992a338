"""Relations as exact constraints of the structured adjustment."""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from planewright.geometry.plane import tangent_basis
from planewright.planes.structure_constraints import StructureConstraints
from planewright.relations.detect import Pair
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchRelation


@dataclass(frozen=True)
class NotExpressible:
    """A required relation that says too little to be enforced."""

    reason: str


def pair_constraints(pairs: Iterable[Pair]) -> StructureConstraints:
    """Constraints of detected relations between face rows."""
    rows: dict[str, list[tuple[int, int]]] = {"parallel": [], "orthogonal": [], "coplanar": []}
    for kind, a, b in pairs:
        rows[kind].append((a, b))
    table = {kind: np.array(pairs, dtype=np.int64).reshape(-1, 2) for kind, pairs in rows.items()}
    return StructureConstraints(
        same_direction=table["parallel"],
        same_plane=table["coplanar"],
        angle_faces=table["orthogonal"],
        angle_cosine=np.zeros(len(table["orthogonal"])),
    )


def join_constraints(parts: Iterable[StructureConstraints]) -> StructureConstraints:
    """All constraints of all parts."""
    parts = [StructureConstraints(), *parts]
    return StructureConstraints(**{field.name: np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(StructureConstraints)})


def required_constraints(sketch: Sketch, relation: SketchRelation) -> StructureConstraints | NotExpressible:
    """Constraints of a relation that the person requires.

    A face is `vertical` where its normal is at right angles to up, and `horizontal` where its normal points up.
    """
    face_row = {face.id: f for f, face in enumerate(sketch.faces)}
    point_row = {point.id: i for i, point in enumerate(sketch.points)}
    missing = [name for name in (*relation.faces, *([relation.about] if relation.about else [])) if name not in face_row]
    missing += [name for edge in relation.edges for name in edge if name not in point_row]
    if missing:
        return NotExpressible(f"The drawing has no {', '.join(missing)}.")
    faces = [face_row[face] for face in relation.faces]
    if relation.kind in ("vertical", "horizontal"):
        return _against_up(sketch, relation.kind, faces, face_row, point_row) if faces else NotExpressible("It names no face.")
    if relation.kind == "equal_length":
        if len(relation.edges) < 2:
            return NotExpressible("Equal lengths need two edges.")
        ends = [(point_row[a], point_row[b]) for a, b in relation.edges]
        return StructureConstraints(equal_length=np.array([(*ends[0], *other) for other in ends[1:]], dtype=np.int64))
    if len(set(faces)) < 2:
        return NotExpressible("It needs two faces.")
    first, others = faces[0], faces[1:]
    pairs = np.array([(first, other) for other in others], dtype=np.int64)
    if relation.kind == "symmetric":
        if relation.about is None:
            return NotExpressible("It does not say about which face.")
        return StructureConstraints(mirror=np.array([(first, other, face_row[relation.about]) for other in others], dtype=np.int64))
    if relation.kind == "parallel":
        return StructureConstraints(same_direction=pairs)
    if relation.kind == "coplanar":
        return StructureConstraints(same_plane=pairs)
    degrees = 90.0 if relation.kind == "orthogonal" else relation.degrees
    if degrees is None:
        return NotExpressible("It does not say which angle.")
    if degrees % 180.0 == 0.0:
        return StructureConstraints(same_direction=pairs)
    cosine = 0.0 if degrees % 180.0 == 90.0 else abs(float(np.cos(np.radians(degrees))))
    return StructureConstraints(angle_faces=pairs, angle_cosine=np.full(len(pairs), cosine))


def _against_up(
    sketch: Sketch, kind: str, faces: list[int], face_row: dict[FaceId, int], point_row: dict[PointId, int]
) -> StructureConstraints | NotExpressible:
    up = sketch.up
    if up is not None and up.face is not None and up.face in face_row:
        pairs = np.array([(face, face_row[up.face]) for face in faces], dtype=np.int64)
        if kind == "horizontal":
            return StructureConstraints(same_direction=pairs)
        return StructureConstraints(angle_faces=pairs, angle_cosine=np.zeros(len(pairs)))
    if up is not None and up.edge is not None and all(end in point_row for end in up.edge):
        rows = np.array([(face, point_row[up.edge[0]], point_row[up.edge[1]]) for face in faces], dtype=np.int64)
        return StructureConstraints(along_edge=rows) if kind == "horizontal" else StructureConstraints(across_edge=rows)
    if up is not None and up.direction is not None and np.linalg.norm(up.direction) > 0.0:
        vector = np.array(up.direction) / np.linalg.norm(up.direction)
        vectors = tangent_basis(vector[None])[0] if kind == "horizontal" else vector[None]
        return StructureConstraints(across_face=np.repeat(np.array(faces, dtype=np.int64), len(vectors)), across_vector=np.tile(vectors, (len(faces), 1)))
    return NotExpressible("The sketch does not say what is up.")
