"""Views of the shed, and of one endless wall that no renderer drew."""

from collections.abc import Callable

import numpy as np
import pytest

from planewright.lifting.hypothesis import Hypothesis
from planewright.lifting.lift import Lifted, LiftOptions, lift_sketch, tolerances
from planewright.lifting.photometric import PhotometricOptions, Reference, reference_from_mask
from planewright.lifting.task import Task, task_of
from planewright.lifting.views import Views, load_views
from planewright.sketch.graph import Sketch
from planewright.synthetic.motion import look_at


@pytest.fixture(scope="session")
def shed_views(shed) -> Views:
    marked = {frame for point in shed.sketch.points for frame in point.marks}
    return load_views(shed.frames, shed.cameras, shed.cloud, marked)


def as_task(views: Views, filmed, sketch: Sketch) -> Task:
    return task_of(views, sketch, filmed.cloud, PhotometricOptions(), tolerances(LiftOptions(), views))


@pytest.fixture(scope="session")
def task(shed, shed_views: Views) -> Task:
    """The shed to lift."""
    return as_task(shed_views, shed, shed.sketch)


@pytest.fixture(scope="session")
def true_planes(shed) -> list[Hypothesis]:
    """The plane each face of the shed lies on, as if corners had told it."""
    nobody = np.zeros((1, len(shed.sketch.faces)), bool)
    return [
        Hypothesis(normal, float(offset), float("nan"), -1, offset * normal[None], nobody)
        for normal, offset in zip(shed.scene.normals, shed.scene.offsets, strict=True)
    ]


@pytest.fixture(scope="session")
def to_task() -> Callable[..., Task]:
    """What there is to lift of another sketch of a filmed scene: `to_task(filmed, sketch)`."""

    def build(filmed, sketch: Sketch) -> Task:
        marked = {frame for point in sketch.points for frame in point.marks}
        return as_task(load_views(filmed.frames, filmed.cameras, filmed.cloud, marked), filmed, sketch)

    return build


@pytest.fixture(scope="session")
def lift() -> Callable[..., Lifted]:
    """Lifts a sketch of a filmed scene: `lift(filmed, sketch)`."""

    def lift(filmed, sketch: Sketch) -> Lifted:
        marked = {frame for point in sketch.points for frame in point.marks}
        views = load_views(filmed.frames, filmed.cameras, filmed.cloud, marked)
        return lift_sketch(views, sketch, filmed.cloud, rng=np.random.default_rng(0))

    return lift


class Wall:
    """A plane with a smooth print, seen by nine cameras that walk away along an arc of 40 degrees; grey values are exact but for rounding.

    contrast: of the print, grey levels. noise: standard deviation of the pixels.
    """

    normal = np.array([0.1, -1.0, 0.15]) / np.linalg.norm([0.1, -1.0, 0.15])
    offset = 0.2
    size = (160, 120)

    def __init__(self, contrast: float = 60.0, noise: float = 0.0):
        rng = np.random.default_rng(3)
        calibration = np.array([[150.0, 0.0, 80.0], [0.0, 150.0, 60.0], [0.0, 0.0, 1.0]])
        y, x = np.mgrid[0:120, 0:160]
        rays = np.stack([x + 0.5, y + 0.5, np.ones(x.shape)], axis=-1) @ np.linalg.inv(calibration).T
        images, rotations, translations = [], [], []
        for angle, radius in zip(np.radians(np.linspace(-110, -70, 9)), np.linspace(2.6, 3.4, 9), strict=True):
            pose = look_at(np.array([radius * np.cos(angle), radius * np.sin(angle), 0.6]), np.zeros(3))
            center = -pose.rotation.T @ pose.translation
            directions = rays @ pose.rotation
            hits = center + directions * ((self.offset - center @ self.normal) / (directions @ self.normal))[..., None]
            image = 128.0 + contrast * self.print(hits) + noise * rng.standard_normal(x.shape)
            images.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
            rotations.append(pose.rotation)
            translations.append(pose.translation)
        self.views = Views(np.arange(9), np.stack(images), np.full((9, 2, len(images[0]) // 2, len(images[0][0]) // 2), 128, np.uint8), 1.0, calibration, np.array(rotations), np.array(translations), 0.01)

    @staticmethod
    def print(points: np.ndarray) -> np.ndarray:
        """Between -1 and 1; the shortest wave is ten pixels long in the middle view."""
        waves = np.array([[29.0, 3.0, 5.0], [-8.0, 2.0, 25.0], [14.0, 4.0, -17.0]])
        return np.sin(points @ waves.T + [0.3, 1.1, 2.0]).mean(axis=-1)

    def reference(self, view: int = 4, options: PhotometricOptions = PhotometricOptions(), half: tuple[int, int] = (40, 30)) -> Reference:
        """The middle of a view, twice `half` wide and high."""
        mask = np.zeros((120, 160), bool)
        mask[60 - half[1] : 60 + half[1], 80 - half[0] : 80 + half[0]] = True
        found = reference_from_mask(self.views, view, mask, options)
        assert found is not None
        return found


@pytest.fixture(scope="session")
def wall() -> Wall:
    return Wall()


@pytest.fixture(scope="session")
def bare_wall() -> Wall:
    """The same wall with a print as faint as the blotches of plain plaster, and noise."""
    return Wall(contrast=4.0, noise=0.7)
