"""Between the frames as displayed and the straight ones a pinhole with all rows exposed at once would show: the lens bends, the shutter rolls."""

from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Float, Int
from planewright.geometry.camera import Intrinsics


@dataclass(frozen=True, eq=False)
class RollingShutter:
    """How the camera moves while a frame is read out, and how far away is what it sees.

    Row y of frame k is exposed at the time k + s, s = readout (y / height - 1/2). What the camera sees at x in the middle of the frame is then at
    exp(turn[0] s + turn[1] s^2 + turn[2] s^3) x + shift[0] s + shift[1] s^2 + shift[2] s^3.
    """

    readout: float
    """Time from the first row to the last one, as a share of the time between two frames; negative where frames are read from below."""
    frame: Int[np.ndarray, "frames"]
    """Frame numbers, increasing. Frames that are not among them are left as they are."""
    turn: Float[np.ndarray, "frames 3 3"]
    """Rotation vectors, radians a frame, a frame squared and a frame cubed."""
    shift: Float[np.ndarray, "frames 3 3"]
    """Scene units likewise."""
    inverse_depth: Float[np.ndarray, "frames rows columns"]
    """One over scene units, at the nodes of a grid over the straight frame, the outer ones on its border; bilinear between them."""

    def scaled(self, factor: float) -> "RollingShutter":
        """The same in a world that is `factor` times as large."""
        return replace(self, shift=factor * self.shift, inverse_depth=self.inverse_depth / factor)

    def motion(self, row: Int[np.ndarray, "points"], time: Float[np.ndarray, "points"]) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
        """Rotation vector and shift from the middle of the frame in `row` to `time` frames later; none where the row is -1."""
        s = np.where(row >= 0, time, 0.0)[:, None]
        turn, shift = self.turn[row], self.shift[row]
        return s * (turn[:, 0] + s * (turn[:, 1] + s * turn[:, 2])), s * (shift[:, 0] + s * (shift[:, 1] + s * shift[:, 2]))

    def rows(self, frame: Int[np.ndarray, "points"]) -> Int[np.ndarray, "points"]:
        """Rows of frame numbers; -1 where there is none."""
        k = np.minimum(np.searchsorted(self.frame, frame), len(self.frame) - 1)
        return np.where(self.frame[k] == frame, k, -1)


@dataclass(frozen=True, eq=False)
class Lens:
    """Maps pixels to and fro. Straight pixels are those of `intrinsics.pinhole()` with all rows exposed at the middle row's time.

    `frame` is one frame number, or one for each point.
    """

    intrinsics: Intrinsics
    shutter: RollingShutter | None = None

    @property
    def straight(self) -> bool:
        """Nothing to do."""
        return self.shutter is None and not any(self.intrinsics.distortion)

    def to_displayed(
        self, frame: int | Int[np.ndarray, "points"], xy: Float[np.ndarray, "points 2"], depth: Float[np.ndarray, "points"] | None = None
    ) -> Float[np.ndarray, "points 2"]:
        """Where the frame as displayed shows what is at `xy` in the straight one.

        Args:
            depth: distance along the axis, scene units; by default that of the surface through the scene's points.
        """
        rays = (xy - self.intrinsics.principal_point) / self.intrinsics.focal
        shown = self.intrinsics.to_pixels(rays)
        if self.shutter is None:
            return shown
        row = self.shutter.rows(np.broadcast_to(np.asarray(frame), len(xy)))
        inverse = self._inverse_depth(row, xy) if depth is None else 1.0 / np.where(depth > 0, depth, np.inf)
        in_cam = np.column_stack([rays, np.ones(len(rays))])
        # The row decides when it is seen, and when decides the row: each round gains a factor of a frame's motion over its height, 30 and more.
        for _ in range(4):
            turn, shift = self.shutter.motion(row, self._time(shown))
            moved = turned(turn, in_cam) + shift * inverse[:, None]
            shown = self.intrinsics.to_pixels(moved[:, :2] / np.maximum(moved[:, 2:], 1e-6))
        return shown

    def to_straight(self, frame: int | Int[np.ndarray, "points"], xy: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
        """The inverse of `to_displayed` with the surface's depth."""
        rays = self.intrinsics.normalize(xy)
        straight = self.intrinsics.principal_point + self.intrinsics.focal * rays
        if self.shutter is None:
            return straight
        row = self.shutter.rows(np.broadcast_to(np.asarray(frame), len(xy)))
        turn, shift = self.shutter.motion(row, self._time(xy))
        for _ in range(4):
            middle = rays_at_middle(turn, shift, rays, self._inverse_depth(row, straight))
            straight = self.intrinsics.principal_point + self.intrinsics.focal * middle
        return straight

    def _time(self, shown: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points"]:
        assert self.shutter is not None
        # A row outside the image has no time; the margin keeps what a guess throws far off from being turned right round.
        return self.shutter.readout * np.clip(shown[:, 1] / self.intrinsics.image_size[1] - 0.5, -1.0, 1.0)

    def _inverse_depth(self, row: Int[np.ndarray, "points"], straight: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points"]:
        assert self.shutter is not None
        return on_grid(self.shutter.inverse_depth, row, straight / self.intrinsics.image_size)


def on_grid(
    values: Float[np.ndarray, "grids rows columns"], grid: Int[np.ndarray, "points"], place: Float[np.ndarray, "points 2"]
) -> Float[np.ndarray, "points"]:
    """Bilinear between the nodes of each point's grid, whose corners are (0, 0) and (1, 1); the border's values outside."""
    _, rows, columns = values.shape
    x = np.clip(place[:, 0], 0.0, 1.0) * (columns - 1)
    y = np.clip(place[:, 1], 0.0, 1.0) * (rows - 1)
    i, j = np.minimum(y.astype(np.intp), rows - 2), np.minimum(x.astype(np.intp), columns - 2)
    u, v = x - j, y - i
    upper = (1 - u) * values[grid, i, j] + u * values[grid, i, j + 1]
    lower = (1 - u) * values[grid, i + 1, j] + u * values[grid, i + 1, j + 1]
    return (1 - v) * upper + v * lower


def turned(vectors: Float[np.ndarray, "points 3"], points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
    """Each point turned by its rotation vector (radians): Rodrigues' formula."""
    angle = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))[:, None]
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    once = np.cross(vectors, points)
    return points + a * once + b * np.cross(vectors, once)


def rays_at_middle(
    turn: Float[np.ndarray, "points 3"], shift: Float[np.ndarray, "points 3"], rays: Float[np.ndarray, "points 2"], inverse_depth: Float[np.ndarray, "points"]
) -> Float[np.ndarray, "points 2"]:
    """Normalized coordinates at the middle of the frame of what is seen along `rays` when the camera has made `turn` and `shift`.

    inverse_depth: of the points at the middle of the frame. With x_row = R x_mid + t and x_row = a (ray, 1): x_mid = R^T (a (ray, 1) - t), and a follows
    from the depth of x_mid.
    """
    back = turned(-turn, np.column_stack([rays, np.ones(len(rays))]))
    moved = turned(-turn, shift) * inverse_depth[:, None]
    length = (1.0 + moved[:, 2:]) / np.maximum(back[:, 2:], 1e-6)
    return length * back[:, :2] - moved[:, :2]
