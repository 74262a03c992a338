"""A small world with known colours: a wall with a window, a side wall, a panel that hides a part of the wall, and a wall that nobody sees."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest

from planewright.geometry.camera import Intrinsics
from planewright.planes.planar_scene import PlanarScene
from planewright.sfm.cameras import Cameras
from planewright.sketch.graph import FaceId, PointId, Sketch, SketchFace, SketchPoint

POINTS = {
    "a0": (-1, -1, 0), "a1": (1, -1, 0), "a2": (1, 1, 0), "a3": (-1, 1, 0),
    "w0": (-0.6, -0.6, 0), "w1": (-0.1, -0.6, 0), "w2": (-0.1, 0, 0), "w3": (-0.6, 0, 0),
    "b1": (1.8, -1, 1), "b2": (1.8, 1, 1),
    "p0": (0.2, 0.1, -0.4), "p1": (0.7, 0.1, -0.4), "p2": (0.7, 0.6, -0.4), "p3": (0.2, 0.6, -0.4),
    "h0": (-1, -1, 2), "h1": (1, -1, 2), "h2": (1, 1, 2),
}  # fmt: skip
FACES = {
    "wall": (("a0", "a1", "a2", "a3"), (("w0", "w1", "w2", "w3"),)),
    "window": (("w0", "w1", "w2", "w3"), ()),
    "side": (("a1", "b1", "b2", "a2"), ()),
    "panel": (("p0", "p1", "p2", "p3"), ()),
    "unseen": (("h0", "h1", "h2"), ()),
}
INTRINSICS = Intrinsics(focal=260.0, principal_point=np.array([160.0, 120.0]), image_size=(320, 240))


def true_color(face: int, points: np.ndarray) -> np.ndarray:
    """Smooth colours, different on each face, that no pixel aliases; points (..., 3) in the world."""
    phase = points @ np.array([[9.0, 2.0, 4.0], [-3.0, 11.0, 5.0], [5.0, -6.0, 7.0]]).T + face
    return 120.0 + 55.0 * np.sin(phase) + 12.0 * face


@dataclass(frozen=True)
class Clip:
    """Frames cast ray by ray from the true colours."""

    world: "World"
    gains: np.ndarray
    spoil: Callable[[int, np.ndarray], np.ndarray]

    @property
    def image_size(self) -> tuple[int, int]:
        return INTRINSICS.image_size

    @property
    def numbers(self) -> Sequence[int]:
        return self.world.cameras.frame.tolist()

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for number in numbers:
            image = self.world.casts[number] * self.gains[number]
            yield number, self.spoil(number, np.clip(np.rint(image), 0, 255).astype(np.uint8))

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for number, image in self.color(numbers):
            yield number, image.mean(axis=2).astype(np.uint8)


@dataclass(frozen=True)
class World:
    scene: PlanarScene
    cameras: Cameras

    @cached_property
    def casts(self) -> list[np.ndarray]:
        return [self.cast(row) for row in range(len(self.cameras.frame))]

    def clip(self, gains: np.ndarray | None = None, spoil: Callable[[int, np.ndarray], np.ndarray] = lambda _, image: image) -> Clip:
        return Clip(self, np.ones(len(self.cameras.frame)) if gains is None else gains, spoil)

    @staticmethod
    def true_color(face: int, points: np.ndarray) -> np.ndarray:
        return true_color(face, points)

    def cast(self, row: int) -> np.ndarray:
        """The colours a camera sees, before a dark background."""
        rotation, translation = self.cameras.rotation[row], self.cameras.translation[row]
        y, x = np.mgrid[0:240, 0:320]
        rays = np.stack([(x + 0.5 - 160) / 260, (y + 0.5 - 120) / 260, np.ones(x.shape)], axis=-1) @ rotation
        centre = -rotation.T @ translation
        nearest, image = np.full(x.shape, np.inf), np.full((*x.shape, 3), 10.0)
        points = {point.id: self.scene.points[i] for i, point in enumerate(self.scene.sketch.points)}
        for f, face in enumerate(self.scene.sketch.faces):
            depth = (self.scene.offsets[f] - self.scene.normals[f] @ centre) / (rays @ self.scene.normals[f])
            hits = centre + depth[..., None] * rays
            corners = np.array([points[corner] for corner in face.loop])
            inside = np.ones(x.shape, dtype=bool)
            turns = [np.cross(b - a, hits - a) @ self.scene.normals[f] for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
            inside = np.all(np.array(turns) > 0, axis=0) | np.all(np.array(turns) < 0, axis=0)
            # The window is listed after the wall and lies in its plane, hence "not farther".
            shown = inside & (depth > 0) & (depth <= nearest + 1e-9)
            nearest = np.where(shown, depth, nearest)
            image = np.where(shown[..., None], true_color(f, hits), image)
        return image


@pytest.fixture(scope="session")
def world() -> World:
    rows = {name: i for i, name in enumerate(POINTS)}
    points = np.array(list(POINTS.values()), dtype=np.float64)
    faces = tuple(
        SketchFace(FaceId(name), tuple(map(PointId, loop)), tuple(tuple(map(PointId, hole)) for hole in holes)) for name, (loop, holes) in FACES.items()
    )
    normals, offsets = [], []
    for loop, _ in FACES.values():
        a, b, c = (points[rows[corner]] for corner in loop[:3])
        normal = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
        # The cameras are at negative z; the unseen wall looks the other way.
        normal = normal if (normal[2] < 0) != (loop[0] == "h0") else -normal
        normals.append(normal)
        offsets.append(normal @ a)
    num_points, num_faces, num_frames = len(points), len(faces), 20
    scene = PlanarScene(
        sketch=Sketch(tuple(SketchPoint(PointId(name), {}) for name in POINTS), faces=faces), points=points, point_known=np.ones(num_points, dtype=bool),
        point_covariance=np.zeros((num_points, 3, 3)), normals=np.array(normals), offsets=np.array(offsets), face_known=np.ones(num_faces, dtype=bool),
        plane_covariance=np.zeros((3 * num_faces, 3 * num_faces)),
    )  # fmt: skip
    rotation, translation = np.zeros((num_frames, 3, 3)), np.zeros((num_frames, 3))
    for k, angle in enumerate(np.linspace(-0.5, 0.6, num_frames)):
        centre = np.array([-3.2 * np.sin(angle), -0.6 + 0.5 * np.cos(3 * angle), -3.2 * np.cos(angle)])
        forward = np.array([0.3, 0.0, 0.2]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross([0.0, 1.0, 0.0], forward)
        right /= np.linalg.norm(right)
        rotation[k] = np.stack([right, np.cross(forward, right), forward])
        translation[k] = -rotation[k] @ centre
    frames = np.arange(num_frames)
    return World(scene, Cameras(INTRINSICS, frames, rotation, translation, np.ones(num_frames, dtype=bool), 1.0, (258.0, 262.0)))
