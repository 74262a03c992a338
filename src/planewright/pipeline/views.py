"""Pictures of the model from a few sides, textured and shaded."""

import numpy as np

from planewright.arrays import Vec3
from planewright.geometry.camera import Intrinsics
from planewright.geometry.rigid import Rigid, rotations_from_vectors
from planewright.model.build import average_up
from planewright.model.planar_model import PlanarModel
from planewright.model.render import render_model
from planewright.pipeline.drawing import Picture, data_uri
from planewright.sfm.cameras import Cameras

SIZE = (720, 540)
FOCAL = 1100.0
"""A long lens, so that parallel edges look parallel."""
TURNS_DEG = (-38.0, 0.0, 38.0)
"""About the upright, from the middle of the way that the camera took: much further round lies what nobody filmed."""


def model_views(model: PlanarModel, cameras: Cameras) -> list[Picture]:
    """Three sides, first textured, then shaded. Empty for an empty model."""
    if not model.faces or not cameras.posed.any():
        return []
    lens, poses = model_poses(model, cameras)
    return [
        Picture(
            f"{mode.capitalize()}, {f'turned by {turn:+.0f} degrees' if turn else 'as filmed'}",
            float(SIZE[0]),
            float(SIZE[1]),
            image=data_uri(render_model(model, pose, lens, mode), SIZE[0]),
        )
        for mode in ("textured", "shaded")
        for turn, pose in zip(TURNS_DEG, poses, strict=True)
    ]


def model_poses(model: PlanarModel, cameras: Cameras) -> tuple[Intrinsics, list[Rigid]]:
    """A camera of `SIZE`, and `cam_from_world` for each of `TURNS_DEG`: the whole model is in the picture. For a model with faces."""
    vertices = np.concatenate([face.vertices for face in model.faces])
    target = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    radius = float(np.linalg.norm(vertices - target, axis=1).max())
    up = average_up(cameras) if model.world_up is None else model.world_up
    centers = cameras.centers[cameras.posed]
    from_target = centers[len(centers) // 2] - target
    # A little from above, as one looks at a thing on a table.
    side = from_target - (from_target @ up) * up
    length = float(np.linalg.norm(side))
    side = side / length if length > 1e-9 else any_right(up)
    lens = Intrinsics(focal=FOCAL, principal_point=np.array([SIZE[0] / 2, SIZE[1] / 2]), image_size=SIZE)
    distance = radius * FOCAL / (SIZE[1] / 2) * 1.06
    return lens, [look_at(target + distance * viewing_direction(side, up, np.radians(turn)), target, up) for turn in TURNS_DEG]


def viewing_direction(side: Vec3, up: Vec3, turn: float) -> Vec3:
    """Unit vector from the model to the camera: `side`, turned about `up` and raised by 22 degrees."""
    turned = rotations_from_vectors((up * turn)[None])[0] @ side
    return np.cos(np.radians(22.0)) * turned + np.sin(np.radians(22.0)) * up


def any_right(up: Vec3) -> Vec3:
    """Any unit vector at right angles to `up`."""
    right = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    return right / float(np.linalg.norm(right))


def look_at(center: Vec3, target: Vec3, up: Vec3) -> Rigid:
    """`cam_from_world` of a camera at `center` that looks at `target` and is held upright."""
    forward = (target - center) / float(np.linalg.norm(target - center))
    right = np.cross(forward, up)
    right /= float(np.linalg.norm(right))
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Rigid(rotation, -rotation @ center)
