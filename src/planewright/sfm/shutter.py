"""The rolling shutter: how the camera moves within a frame, and where its features would be if all rows were exposed at once."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from planewright.arrays import Bool, Float, Int
from planewright.geometry.lens import RollingShutter, on_grid, rays_at_middle
from planewright.sfm.frame_table import FrameTable
from planewright.sfm.triangulate import normalize


@dataclass(frozen=True, kw_only=True)
class ShutterOptions:
    """How a rolling shutter is found."""

    max_rounds: int = 8
    """Of motion from poses, straight features from motion, and poses from straight features; three to six settle it."""
    tolerance: float = 0.002
    """Change of the readout, in frames, at which it has settled: 0.002 of a fast 20 pixels a frame are 0.02 pixels at the first and last row."""
    grid: tuple[int, int] = (9, 6)
    """Nodes of the surface of inverse depth across and down the frame."""
    smoothness: float = 1.0
    """Weight of a second difference of that surface against a scene point."""
    max_readout: float = 1.2
    """Frames: a sensor is read out before its next frame begins; the rest is for errors."""
    min_frames: int = 8
    """With a camera, below which the motion within a frame is not known."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Cameras of all frames as far as they are known."""

    rotation: Float[np.ndarray, "frames 3 3"]
    translation: Float[np.ndarray, "frames 3"]
    posed: Bool[np.ndarray, "frames"]

    def part(self, rows: Int[np.ndarray, "rows"]) -> "Poses":
        """Of some of the frames."""
        return Poses(self.rotation[rows], self.translation[rows], self.posed[rows])


def motion_within_frames(frame: Int[np.ndarray, "frames"], poses: Poses) -> tuple[Float[np.ndarray, "frames 3 3"], Float[np.ndarray, "frames 3 3"]]:
    """`turn` and `shift` of `RollingShutter`: the first three orders of a quintic spline through the poses; zero where there is none.

    A hand shakes with up to 9 Hz, 0.3 cycles a frame. There a central difference of neighbouring frames keeps half of the velocity, a cubic spline 0.90
    and a quintic one 0.97; and without the third order the motion over three quarters of a frame is 8 % too long.
    """
    at = np.nonzero(poses.posed)[0]
    rotation, translation = poses.rotation[at], poses.translation[at]
    time = frame[at].astype(np.float64)
    step = rotation[1:] @ rotation[:-1].transpose(0, 2, 1)
    # Angles add up along the path: between two frames the axes differ by the angle of one step, which leaves an error of its square.
    angles = np.concatenate([np.zeros((1, 3)), np.cumsum(_logs(step), axis=0)])
    centres = -np.einsum("kji,kj->ki", rotation, translation)
    path = make_interp_spline(time, np.concatenate([angles, centres], axis=1), k=5 if len(at) > 5 else 3)
    first, second, third = (np.asarray(path.derivative(order)(time)) for order in (1, 2, 3))
    omega = first[:, :3]
    velocity, change, jerk = (np.einsum("kij,kj->ki", rotation, part[:, 3:]) for part in (first, second, third))
    # x_row = R(s) x_world + t(s), R(s) = exp(omega s + omega' s^2 / 2 + ...) R and t(s) = -R(s) (c + c' s + c'' s^2 / 2 + ...).
    turn, shift = np.zeros((len(frame), 3, 3)), np.zeros((len(frame), 3, 3))
    turn[at] = np.stack([omega, second[:, :3] / 2, third[:, :3] / 6], axis=1)
    shift[at] = np.stack([-velocity, -change / 2 - np.cross(omega, velocity), -jerk / 6 - np.cross(omega, change) / 2], axis=1)
    return turn, shift


def _logs(rotation: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3"]:
    """Rotation vectors of rotations below half a turn."""
    vector = np.stack([rotation[:, 2, 1] - rotation[:, 1, 2], rotation[:, 0, 2] - rotation[:, 2, 0], rotation[:, 1, 0] - rotation[:, 0, 1]], axis=1)
    size = np.linalg.norm(vector, axis=1)
    angle = np.arctan2(size, np.trace(rotation, axis1=1, axis2=2) - 1.0)
    return vector * np.where(size > 1e-12, angle / np.maximum(size, 1e-12), 0.5)[:, None]


def depth_surfaces(
    table: FrameTable,
    values: Float[np.ndarray, "5"],
    image_size: tuple[int, int],
    poses: Poses,
    xyz: Float[np.ndarray, "tracks 3"],
    options: ShutterOptions,
) -> Float[np.ndarray, "frames rows columns"]:
    """Inverse depth over each frame: a smooth surface through the scene's points that are seen there."""
    columns, rows = options.grid
    bend = _second_differences(rows, columns)
    stiff = options.smoothness * bend.T @ bend
    found = np.zeros((table.num_frames, rows, columns))
    everywhere = 0.1
    for index in np.nonzero(poses.posed)[0]:
        here = np.arange(int(table.start[index]), int(table.start[index + 1]))
        points = xyz[table.track[here]]
        in_cam = points @ poses.rotation[index].T + poses.translation[index]
        good = in_cam[:, 2] > 1e-6
        place = (values[1:3] + values[0] * in_cam[good, :2] / in_cam[good, 2:]) / image_size
        inside = ((place > -0.05) & (place < 1.05)).all(axis=1)
        place, inverse = place[inside], 1.0 / in_cam[good, 2][inside]
        everywhere = float(np.median(inverse)) if len(inverse) else everywhere
        b = _bilinear_rows(place, rows, columns)
        surface = np.full(rows * columns, everywhere)
        weight = np.ones(len(inverse))
        for _ in range(3):
            # A faint pull to the median keeps the system definite where no point is seen.
            system = (b.T * weight) @ b + stiff + 1e-4 * np.eye(rows * columns)
            surface = np.linalg.solve(system, (b.T * weight) @ inverse + 1e-4 * everywhere)
            off = np.abs(b @ surface - inverse)
            weight = 1.0 / (1.0 + (off / (3.0 * float(np.median(off)) + 1e-9)) ** 2) if len(off) else weight
        found[index] = np.maximum(surface, 0.0).reshape(rows, columns)
    return found


def _second_differences(rows: int, columns: int) -> Float[np.ndarray, "differences nodes"]:
    """Across, down and crosswise, of every node that has the neighbours."""
    node = np.arange(rows * columns).reshape(rows, columns)
    triples = [
        *zip(node[:, :-2].ravel(), node[:, 1:-1].ravel(), node[:, 2:].ravel(), strict=True),
        *zip(node[:-2].ravel(), node[1:-1].ravel(), node[2:].ravel(), strict=True),
    ]
    straight = np.zeros((len(triples), node.size))
    for k, (a, b, c) in enumerate(triples):
        straight[k, [a, b, c]] = [1.0, -2.0, 1.0]
    squares = list(zip(node[:-1, :-1].ravel(), node[:-1, 1:].ravel(), node[1:, :-1].ravel(), node[1:, 1:].ravel(), strict=True))
    crosswise = np.zeros((len(squares), node.size))
    for k, corners in enumerate(squares):
        crosswise[k, list(corners)] = [1.0, -1.0, -1.0, 1.0]
    return np.concatenate([straight, crosswise])


def _bilinear_rows(place: Float[np.ndarray, "points 2"], rows: int, columns: int) -> Float[np.ndarray, "points nodes"]:
    """Weights of the nodes at places in the unit square, as `on_grid` weighs them."""
    x, y = np.clip(place[:, 0], 0, 1) * (columns - 1), np.clip(place[:, 1], 0, 1) * (rows - 1)
    i, j = np.minimum(y.astype(np.intp), rows - 2), np.minimum(x.astype(np.intp), columns - 2)
    u, v = x - j, y - i
    b = np.zeros((len(place), rows * columns))
    every = np.arange(len(place))
    for di, dj, weight in ((0, 0, (1 - u) * (1 - v)), (0, 1, u * (1 - v)), (1, 0, (1 - u) * v), (1, 1, u * v)):
        b[every, (i + di) * columns + j + dj] = weight
    return b


def straighten(
    table: FrameTable,
    values: Float[np.ndarray, "5"],
    image_size: tuple[int, int],
    poses: Poses,
    xyz: Float[np.ndarray, "tracks 3"],
    shutter: RollingShutter,
) -> Float[np.ndarray, "obs 2"]:
    """Where the table's observations would be with all rows exposed at once; still bent by the lens. `shutter` has the frames of the table.

    Tracks with a point (rows of `xyz` that are not NaN) are moved by its own depth, the others by the surface's.
    """
    frame, xy = np.repeat(np.arange(table.num_frames), np.diff(table.start)), table.xy.astype(np.float64)
    depth = np.einsum("oj,oj->o", poses.rotation[frame, 2], xyz[table.track]) + poses.translation[frame, 2]
    known = depth > 1e-6
    rays = normalize(values, xy)
    inverse = 1.0 / np.where(known, depth, 1.0)
    place = (values[1:3] + values[0] * rays) / image_size
    inverse[~known] = on_grid(shutter.inverse_depth, frame[~known], place[~known])
    turn, shift = shutter.motion(frame, shutter.readout * (xy[:, 1] / image_size[1] - 0.5))
    middle = rays_at_middle(turn, shift, rays, inverse)
    r2 = (middle**2).sum(axis=1, keepdims=True)
    return values[1:3] + values[0] * (1 + values[3] * r2 + values[4] * r2**2) * middle
