"""Planes n . x = d with unit normals."""

import numpy as np

from planewright.arrays import Float, Vec3


def tangent_basis(normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2 3"]:
    """Two unit vectors at right angles to each normal and to each other; they jump only where a normal passes an axis plane."""
    axis = np.argmin(np.abs(normals), axis=1)
    u = np.cross(normals, np.eye(3)[axis])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return np.stack([u, np.cross(normals, u)], axis=1)


def fit_plane(points: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n"]) -> tuple[Vec3, float]:
    """Unit normal and offset of the plane that minimizes the weighted squared distances (total least squares)."""
    total = weights.sum()
    centre = weights @ points / total
    moved = points - centre
    _, vectors = np.linalg.eigh(np.einsum("n,ni,nj->ij", weights, moved, moved))
    return vectors[:, 0], float(vectors[:, 0] @ centre)
