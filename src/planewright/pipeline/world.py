"""The world of the result: z up once the sketch says what is up, metres once it gives a length. A similarity of everything, so nothing else changes."""

from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Float, Mat3, Vec3
from planewright.export.up import METRES
from planewright.geometry.plane import tangent_basis
from planewright.model.build import average_up
from planewright.planes.planar_scene import PlanarScene
from planewright.refine.rounds import Structure
from planewright.sfm.cameras import Cameras
from planewright.tracking.edges import Anchor, EdgeLine

DISAGREEMENT = 3.0
"""Sigmas between a length and the model at which a person should look; the model's own error counts as 0.5 % of the length."""
MODEL_ERROR = 0.005


@dataclass(frozen=True, eq=False)
class Placed:
    """Structure and cameras in the world of the result."""

    structure: Structure
    cameras: Cameras
    unit: str | None
    """"m" once a length is known."""
    world_up: Vec3 | None
    notes: tuple[str, ...]


def place(structure: Structure, cameras: Cameras) -> Placed:
    """Turned so that what the sketch calls up is z, and scaled to metres by the lengths that it gives."""
    scale, scale_notes = scale_from_lengths(structure.scene)
    up, up_notes = up_from_sketch(structure.scene)
    turn = np.eye(3) if up is None else rotation_to_z(up, cameras)
    factor = 1.0 if scale is None else scale
    return Placed(
        structure=_moved_structure(structure, turn, factor),
        cameras=replace(
            cameras,
            rotation=cameras.rotation @ turn.T,
            translation=factor * cameras.translation,
            shutter=None if cameras.shutter is None else cameras.shutter.scaled(factor),
        ),
        unit=None if scale is None else "m",
        world_up=None if up is None else np.array([0.0, 0.0, 1.0]),
        notes=(*scale_notes, *up_notes),
    )


def scale_from_lengths(scene: PlanarScene) -> tuple[float | None, tuple[str, ...]]:
    """Metres in a scene unit by weighted least squares over the known lengths, and what is wrong with them."""
    row = scene.point_row()
    unit = METRES[scene.sketch.unit or "m"]
    usable = [known for known in scene.sketch.lengths if all(scene.point_known[row[end]] for end in known.edge)]
    notes = [
        f"The length of {known.edge[0]}-{known.edge[1]} is not used: an end of it is not known in space."
        for known in scene.sketch.lengths
        if known not in usable
    ]
    ends = np.array([[row[a], row[b]] for a, b in (known.edge for known in usable)], dtype=np.int64).reshape(-1, 2)
    found = np.linalg.norm(scene.points[ends[:, 0]] - scene.points[ends[:, 1]], axis=1)
    true = unit * np.array([known.length for known in usable])
    sigma = np.hypot(unit * np.array([known.sigma for known in usable]), MODEL_ERROR * true)
    if not (found > 0).any():
        return None, tuple(notes)
    weight = 1.0 / sigma**2
    scale = float((weight * found * true).sum() / (weight * found**2).sum())
    for known, here, there, spread in zip(usable, scale * found, true, sigma, strict=True):
        if abs(here - there) > DISAGREEMENT * spread:
            notes.append(f"The length of {known.edge[0]}-{known.edge[1]} is {there:.4g} m by the sketch and {here:.4g} m in the model. Check the lengths.")
    return scale, tuple(notes)


def up_from_sketch(scene: PlanarScene) -> tuple[Vec3 | None, tuple[str, ...]]:
    """The unit vector that the sketch calls up, in the scene's present world."""
    up = scene.sketch.up
    if up is None:
        return None, ()
    vector: Vec3 | None = None
    if up.direction is not None:
        vector = np.array(up.direction, dtype=np.float64)
    elif up.face is not None and scene.face_known[scene.face_row()[up.face]]:
        vector = scene.normals[scene.face_row()[up.face]]
    elif up.edge is not None:
        bottom, top = (scene.point_row()[end] for end in up.edge)
        if scene.point_known[bottom] and scene.point_known[top]:
            vector = scene.points[top] - scene.points[bottom]
    length = 0.0 if vector is None else float(np.linalg.norm(vector))
    if vector is None or length == 0.0:
        return None, ("What the sketch calls up is not known in space, so the world is not turned upright.",)
    return vector / length, ()


def rotation_to_z(up: Vec3, cameras: Cameras) -> Mat3:
    """Rows x, y, z of the new world: z is up, y points away from the first camera as far as it can."""
    first = int(np.argmax(cameras.posed))
    for ahead in (cameras.rotation[first, 2], average_up(cameras), *np.eye(3)):
        level = ahead - (ahead @ up) * up
        length = float(np.linalg.norm(level))
        if length > 0.1:
            y = level / length
            return np.stack([np.cross(y, up), y, up])
    raise AssertionError("One of three axes is at an angle to any direction.")


def _moved_structure(structure: Structure, turn: Mat3, scale: float) -> Structure:
    relations = tuple(
        relation if relation.offset_deviation is None else replace(relation, offset_deviation=scale * relation.offset_deviation)
        for relation in structure.relations
    )
    return replace(
        structure,
        scene=_moved_scene(structure.scene, turn, scale),
        relations=relations,
        basis=None if structure.basis is None else structure.basis.moved(turn, scale),
        lines=tuple(_moved_line(line, turn, scale) for line in structure.lines),
        anchor=None if structure.anchor is None else Anchor(scale * structure.anchor.points @ turn.T, scale**2 * turn @ structure.anchor.covariance @ turn.T),
    )


def _moved_line(line: EdgeLine, turn: Mat3, scale: float) -> EdgeLine:
    offset, sigma, other = line.offset, line.sigma, line.other_offset
    return replace(
        line,
        across=turn @ line.across,
        facing=turn @ line.facing,
        offset=(scale * offset[0], scale * offset[1]),
        sigma=(scale * sigma[0], scale * sigma[1]),
        pixel=scale * line.pixel,
        other_offset=None if other is None else (scale * other[0], scale * other[1]),
    )


def _moved_scene(scene: PlanarScene, turn: Mat3, scale: float) -> PlanarScene:
    normals = scene.normals @ turn.T
    return replace(
        scene,
        points=scale * scene.points @ turn.T,
        point_covariance=scale**2 * turn @ scene.point_covariance @ turn.T,
        normals=normals,
        offsets=scale * scene.offsets,
        plane_covariance=_moved_plane_covariance(scene, normals, turn, scale),
    )


def _moved_plane_covariance(scene: PlanarScene, normals: Float[np.ndarray, "faces 3"], turn: Mat3, scale: float) -> Float[np.ndarray, "planes3 planes3"]:
    """Tilts are told along `tangent_basis` of each normal, and the basis does not turn with the world."""
    jacobian = np.zeros_like(scene.plane_covariance)
    known = np.flatnonzero(scene.face_known)
    old, new = tangent_basis(scene.normals[known]), tangent_basis(normals[known])
    for f, from_old, to_new in zip(known, old, new, strict=True):
        jacobian[3 * f : 3 * f + 2, 3 * f : 3 * f + 2] = to_new @ turn @ from_old.T
        jacobian[3 * f + 2, 3 * f + 2] = scale
    rows = np.repeat(scene.face_known, 3)
    return np.where(rows[:, None] & rows, jacobian @ np.where(rows[:, None] & rows, scene.plane_covariance, 0.0) @ jacobian.T, np.nan)
