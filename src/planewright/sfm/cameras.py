"""Where the camera was in every frame, and the cloud of scene points that says so."""

from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.geometry.camera import Intrinsics
from planewright.geometry.lens import Lens, RollingShutter
from planewright.geometry.rigid import Rigid


@dataclass(frozen=True, eq=False)
class Cameras:
    """One camera, moving: `x_cam = rotation @ x_world + translation`; x right, y down, z forward."""

    intrinsics: Intrinsics
    frame: Int[np.ndarray, "frames"]
    """Frame numbers in the clip, increasing."""
    rotation: Float[np.ndarray, "frames 3 3"]
    translation: Float[np.ndarray, "frames 3"]
    posed: Bool[np.ndarray, "frames"]
    """False where no pose could be had; rotation and translation are then the identity's."""
    focal_sigma: float
    """Standard deviation of the focal length, in pixels."""
    focal_interval: tuple[float, float | None]
    """95 % interval, pixels; the upper end is None where the views set none."""
    shutter: RollingShutter | None = None
    """What the rows' different times do to the frames; None where they are exposed at once. Poses are those of the middle row."""

    @property
    def lens(self) -> Lens:
        """Between the frames as displayed and those that obey `intrinsics.pinhole()` and the poses."""
        return Lens(self.intrinsics, self.shutter)

    def row(self, frame: int) -> int | None:
        """The row of a frame number, or None where the frame has no pose."""
        k = int(np.searchsorted(self.frame, frame))
        return k if k < len(self.frame) and self.frame[k] == frame and self.posed[k] else None

    def cam_from_world(self, row: int) -> Rigid:
        """The pose of a row."""
        return Rigid(self.rotation[row], self.translation[row])

    @property
    def centers(self) -> Float[np.ndarray, "frames 3"]:
        """Camera centres in the world."""
        return -np.einsum("kji,kj->ki", self.rotation, self.translation)


@dataclass(frozen=True, eq=False)
class ScenePoints:
    """The triangulated scene features."""

    xyz: Float[np.ndarray, "points 3"]
    track_index: Int[np.ndarray, "points"]
    """Row of the feature table's track each point came from."""
    covariance: Float[np.ndarray, "points 3 3"]
    """Of each point with the cameras held fixed, scene units squared."""
    seen: Int[np.ndarray, "points 2"]
    """First and last frame (its number) in which each point was observed."""
