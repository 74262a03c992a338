"""Which way is up, and how long a metre is, for formats that fix both."""

import numpy as np

from planewright.arrays import Mat3, Vec3
from planewright.model.planar_model import PlanarModel

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
"""Metres in a unit."""


def up_direction(model: PlanarModel) -> Vec3:
    """World up where it is known; else how the cameras were held; else the up of a camera at the world's axes (y down)."""
    for up in (model.world_up, model.view_up):
        if up is not None:
            return up / np.linalg.norm(up)
    return np.array([0.0, -1.0, 0.0])


def y_up_from_world(model: PlanarModel) -> Mat3:
    """The rotation that turns the world so that y is up. For a world with z up this is the usual (x, y, z) -> (x, z, -y)."""
    up = up_direction(model)
    # x stays where it is as far as it can; where x itself is (nearly) up, z takes its place.
    keep = np.eye(3)[0 if abs(up[0]) < 0.9 else 2]
    x = keep - (keep @ up) * up
    x /= np.linalg.norm(x)
    return np.stack([x, up, np.cross(x, up)])


def metres_per_unit(model: PlanarModel) -> float:
    """What a world coordinate is multiplied with to give metres; 1 where no length is known."""
    return 1.0 if model.unit is None else METRES.get(model.unit, 1.0)
