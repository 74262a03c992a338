"""What every test shares: one thread of linear algebra, and clips with known truth, each drawn once a test run."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from planewright.planes.planar_scene import PlanarScene
from planewright.sfm.cameras import Cameras, ScenePoints
from planewright.sketch.graph import Sketch
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.houses import demo_scene
from planewright.synthetic.observe import draw, face_planes, true_cameras
from planewright.synthetic.write import write_clip


@dataclass(frozen=True, eq=False)
class KeptFrames:
    """The frames of a clip; each is drawn when it is first asked for and kept."""

    clip: SyntheticClip
    kept: dict[int, np.ndarray] = field(default_factory=dict)

    @property
    def image_size(self) -> tuple[int, int]:
        return self.clip.intrinsics.image_size

    @property
    def numbers(self) -> Sequence[int]:
        return range(self.clip.num_frames)

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for number in numbers:
            if number not in self.kept:
                self.kept[number] = self.clip.renderer.frame(number)
            yield number, self.kept[number]

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
        for number, image in self.color(numbers):
            yield number, np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


@dataclass(frozen=True, eq=False)
class Filmed:
    """A clip, the sketch on it, and everything that is true about it."""

    clip: SyntheticClip
    click_noise: float

    @cached_property
    def frames(self) -> KeptFrames:
        return KeptFrames(self.clip)

    @cached_property
    def cameras(self) -> Cameras:
        return true_cameras(self.clip)

    @cached_property
    def sketch(self) -> Sketch:
        return draw(self.clip, np.random.default_rng(1), self.click_noise)

    @cached_property
    def scene(self) -> PlanarScene:
        """The true structure; corners have a standard deviation of a thousandth of the diagonal on each axis."""
        sketch, scene = self.sketch, self.clip.scene
        normals, offsets = face_planes(scene)
        order = {face.id: f for f, face in enumerate(scene.faces)}
        rows = [order[face.id] for face in sketch.faces]
        num_points, num_faces = len(sketch.points), len(rows)
        return PlanarScene(
            sketch=sketch, points=scene.corner_array([point.id for point in sketch.points]), point_known=np.ones(num_points, bool),
            point_covariance=np.tile(np.eye(3) * (1e-3 * scene.diagonal) ** 2, (num_points, 1, 1)), normals=normals[rows], offsets=offsets[rows],
            face_known=np.ones(num_faces, bool), plane_covariance=np.zeros((3 * num_faces, 3 * num_faces)),
        )  # fmt: skip

    @cached_property
    def cloud(self) -> ScenePoints:
        """What every twelfth pixel of four frames shows."""
        intrinsics, found, frames = self.clip.intrinsics, [], []
        for k in np.linspace(0, self.clip.num_frames - 1, 4).round().astype(int):
            shown = self.clip.renderer.surface_index(int(k))[6::12, 6::12]
            y, x = (12.0 * index + 6.5 for index in np.nonzero(shown >= 0))
            rays = np.column_stack([intrinsics.normalize(np.column_stack([x, y])), np.ones(len(x))]) @ self.cameras.rotation[k]
            center = self.cameras.centers[k]
            frames.append(np.full(len(x), k))
            surfaces = [self.clip.scene.surfaces[s] for s in shown[shown >= 0]]
            normals = np.array([surface.normal for surface in surfaces])
            corners = np.array([surface.loops[0][0] for surface in surfaces])
            found.append(center + rays * (((corners - center) * normals).sum(axis=1) / (rays * normals).sum(axis=1))[:, None])
        xyz, seen = np.concatenate(found), np.repeat(np.concatenate(frames)[:, None], 2, axis=1)
        return ScenePoints(xyz, np.arange(len(xyz)), np.tile(1e-6 * np.eye(3), (len(xyz), 1, 1)), seen)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(frames, points, 2): where world points are seen."""
        return np.stack([self.clip.intrinsics.project(self.cameras.cam_from_world(k).apply(points)) for k in range(self.clip.num_frames)])


@pytest.fixture(scope="session", autouse=True)
def one_thread_of_linear_algebra() -> Iterator[None]:
    """As `reconstruct` does it: on two busy cores the small systems of the structured adjustment take 55 s with two threads and 2.2 s with one."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="session")
def film() -> Callable[..., Filmed]:
    """Films a synthetic clip: `film(clip, click_noise=1.0)`."""

    def film(clip: SyntheticClip, click_noise: float = 1.0) -> Filmed:
        return Filmed(clip, click_noise)

    return film


@pytest.fixture(scope="session")
def shed() -> Filmed:
    """The shed in 40 frames of 320x180 along an arc of 48 degrees; seven of its eight faces are sketched, the eighth is never seen."""
    return Filmed(demo_scene(40, (320, 180)), 1.0)


@pytest.fixture(scope="session")
def small_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with clip.mp4, sketch.json and truth.json: the shed in 24 frames of 320x180, which is enough for all but two corners."""
    folder = tmp_path_factory.mktemp("small_clip")
    write_clip(demo_scene(24, (320, 180)), folder)
    return folder
