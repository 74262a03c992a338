"""Where a hand holds the camera: a slow sweep around the scene with the tremor of an arm, smooth in time."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from planewright.arrays import Float, Vec3
from planewright.geometry.rigid import Rigid, rotations_from_vectors


@dataclass(frozen=True, eq=False)
class Tremor:
    """A sum of sines for each of six numbers: three of position, three of the turn. Continuous, so that motion blur has its sub-frames."""

    frequency: Float[np.ndarray, "waves"]
    """Cycles a frame."""
    amplitude: Float[np.ndarray, "waves 6"]
    """Scene units, then radians."""
    phase: Float[np.ndarray, "waves 6"]

    def at(self, time: float) -> Float[np.ndarray, "6"]:
        """Offset at a time in frames."""
        return (self.amplitude * np.sin(2 * np.pi * self.frequency[:, None] * time + self.phase)).sum(axis=0)


def draw_shake(turn_deg: float, rng: np.random.Generator) -> Tremor:
    """Fast shakes: turns alone, whose deviation is `turn_deg` (degrees) on each axis, at 3 to 7 cycles a second at 30 frames a second, swelling and fading."""
    frequency = np.linspace(0.1, 0.23, 7) * rng.uniform(0.95, 1.05, 7)
    amplitude = np.zeros((7, 6))
    amplitude[:, 3:] = np.radians(turn_deg) * np.sqrt(2 / 7) * rng.uniform(0.7, 1.3, (7, 3))
    return Tremor(frequency, amplitude, rng.uniform(0, 2 * np.pi, (7, 6)))


def both(a: Tremor, b: Tremor) -> Tremor:
    """One on top of the other."""
    return Tremor(*(np.concatenate(parts) for parts in ((a.frequency, b.frequency), (a.amplitude, b.amplitude), (a.phase, b.phase))))


def draw_tremor(position: float, turn_deg: float, rng: np.random.Generator) -> Tremor:
    """A tremor whose deviation is `position` (scene units) and `turn_deg` (degrees) on each axis.

    Waves from 0.3 to 9 cycles a second at 30 frames a second; amplitude falls with frequency, as the hand's sway outweighs its shake.
    """
    frequency = np.geomspace(0.01, 0.3, 9) * rng.uniform(0.85, 1.15, 9)
    share = frequency**-0.5
    share = share / np.sqrt((0.5 * share**2).sum())
    scale = np.array([position] * 3 + [np.radians(turn_deg)] * 3)
    return Tremor(frequency, share[:, None] * scale * rng.uniform(0.7, 1.3, (9, 6)), rng.uniform(0, 2 * np.pi, (9, 6)))


def look_at(center: Vec3, target: Vec3) -> Rigid:
    """cam_from_world of an upright camera at `center` that looks at `target` (world z up, camera y down)."""
    forward = (target - center) / np.linalg.norm(target - center)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Rigid(rotation, -rotation @ center)


@dataclass(frozen=True, eq=False)
class Path:
    """A camera path in continuous time: an arc around a target, with tremor. The moving object, if there is one, turns on its own."""

    num_frames: int
    target: Vec3
    radius: float
    """Horizontal distance from the target, scene units."""
    height: tuple[float, float]
    """Height at the start and at the end, scene units."""
    azimuth_deg: tuple[float, float]
    """Where the camera stands at the start and at the end, counted from the x axis."""
    tremor: Tremor
    pan_deg: tuple[float, float] = (0.0, 0.0)
    """Turn about the vertical, at the start and at the end, on top of looking at the target."""
    turntable_deg: tuple[float, float] = (0.0, 0.0)
    """Turn of the moving object about the vertical through the origin, at the start and at the end."""
    sweeps: int = 1
    """How often the arc is walked, there and back."""

    def _along(self, ends: tuple[float, float], time: float) -> float:
        """From one end to the other, somewhat slower near the ends; there and back when the path has more sweeps."""
        share = (time + 0.5) / self.num_frames
        if self.sweeps > 1:
            share = 0.5 - 0.5 * np.cos(np.pi * self.sweeps * share)
        else:
            share -= 0.35 * np.sin(2 * np.pi * share) / (2 * np.pi)
        return ends[0] + (ends[1] - ends[0]) * share

    def cam_from_world(self, time: float) -> Rigid:
        """Pose at a time in frames."""
        azimuth = np.radians(self._along(self.azimuth_deg, time))
        offset = self.tremor.at(time)
        center = self.target + self.radius * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]) + offset[:3]
        center[2] = self._along(self.height, time) + offset[2]
        still = look_at(center, self.target)
        pan = np.radians(self._along(self.pan_deg, time))
        shake = rotations_from_vectors(np.stack([offset[3:], np.array([0.0, pan, 0.0])]))
        rotation = shake[0] @ shake[1] @ still.rotation
        return Rigid(rotation, -rotation @ center)

    def world_from_object(self, time: float) -> Rigid:
        """Where the moving object stands at a time in frames."""
        turn = np.radians(self._along(self.turntable_deg, time))
        return Rigid(rotations_from_vectors(np.array([[0.0, 0.0, turn]]))[0], np.zeros(3))


@dataclass(frozen=True, eq=False)
class Walk:
    """A camera path through given places, each with what the camera looks at there; places follow each other at equal times. With tremor."""

    num_frames: int
    places: Float[np.ndarray, "places 3"]
    """Where the camera is, scene units."""
    targets: Float[np.ndarray, "places 3"]
    """What it looks at, scene units."""
    tremor: Tremor

    @cached_property
    def _smooth(self) -> CubicSpline:
        """Place and target over the share of the clip; natural at both ends."""
        return CubicSpline(np.linspace(0.0, 1.0, len(self.places)), np.column_stack([self.places, self.targets]), bc_type="natural")

    def cam_from_world(self, time: float) -> Rigid:
        """Pose at a time in frames."""
        at = np.asarray(self._smooth((time + 0.5) / self.num_frames), float)
        offset = self.tremor.at(time)
        center = at[:3] + offset[:3]
        rotation = rotations_from_vectors(offset[None, 3:])[0] @ look_at(center, at[3:]).rotation
        return Rigid(rotation, -rotation @ center)

    def world_from_object(self, time: float) -> Rigid:
        """Nothing moves but the camera."""
        del time
        return Rigid(np.eye(3), np.zeros(3))


@dataclass(frozen=True, eq=False)
class Pass:
    """One way of the visitor through the scene: in and out again, or straight through."""

    time: float
    """Frame at the middle of the pass."""
    half: float
    """Frames from there to the end of it."""
    turn: Float[np.ndarray, "3 3"]
    """Rotation world_from_visitor, the same all along."""
    middle: Vec3
    """Where its origin is at the middle, scene units."""
    away: Vec3
    """How far from there it is at the end, scene units."""
    back: bool
    """It came the way it goes; otherwise it came from the other side."""


@dataclass(frozen=True, eq=False)
class Visit:
    """All passes of a clip's visitor. Continuous in time, so that it blurs."""

    passes: tuple[Pass, ...]

    def world_from_visitor(self, time: float) -> Rigid | None:
        """Where it is at a time in frames; None when it is not there."""
        for p in self.passes:
            share = (time - p.time) / p.half
            if abs(share) < 1.0:
                # A reaching hand slows down at its goal and where it came from; who walks by keeps the pace.
                way = 0.5 - 0.5 * np.cos(np.pi * share) if p.back else share
                return Rigid(p.turn, p.middle + way * p.away)
        return None


Motion = Path | Walk
"""How a camera, and the moving object if there is one, go through a clip; in continuous time."""
