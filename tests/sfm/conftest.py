"""Feature tracks with known truth: points seen by a moving camera, broken into tracks of limited life."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from planewright.features.features import Features


@dataclass(frozen=True, eq=False)
class TrackedScene:
    """Tracks and what they were made from."""

    features: Features
    numbers: np.ndarray
    image_size: tuple[int, int]
    focal: float
    rotation: np.ndarray
    translation: np.ndarray

    @property
    def centers(self) -> np.ndarray:
        return -np.einsum("kji,kj->ki", self.rotation, self.translation)


def looking(eyes: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses of cameras at `eyes` that look at `targets`, the world's z up."""
    rotation, translation = np.empty((len(eyes), 3, 3)), np.empty((len(eyes), 3))
    for k, (eye, target) in enumerate(zip(eyes, targets, strict=True)):
        z = (target - eye) / np.linalg.norm(target - eye)
        x = np.cross(z, [0.0, 0.0, 1.0])
        x /= np.linalg.norm(x)
        rotation[k] = [x, np.cross(z, x), z]
        translation[k] = -rotation[k] @ eye
    return rotation, translation


def paths(kind: str, num_frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Camera poses of a kind of motion around a scene of radius 2 at the origin."""
    s = np.linspace(0.0, 1.0, num_frames)
    origin = np.zeros((num_frames, 3))
    if kind == "rotation":
        angle = np.deg2rad(20.0) * (s - 0.5)
        eyes = np.tile([0.0, -8.0, 1.0], (num_frames, 1))
        return looking(eyes, eyes + np.stack([np.sin(angle), np.cos(angle), 0.1 * np.sin(7 * s)], axis=1))
    if kind == "static":
        return looking(np.tile([0.0, -8.0, 1.0], (num_frames, 1)), origin)
    if kind == "forward":
        eyes = np.stack([0.3 * np.sin(6 * s), -9.0 + 5.0 * s, 0.4 + 0.1 * np.cos(9 * s)], axis=1)
        return looking(eyes, eyes + np.stack([0.05 * np.sin(5 * s), np.ones(num_frames), 0.0 * s], axis=1))
    angle = np.deg2rad(50.0) * s
    eyes = np.stack([8.0 * np.sin(angle), -8.0 * np.cos(angle), 2.0 + 0.8 * np.sin(4 * s)], axis=1)
    return looking(eyes, origin + 0.2 * np.stack([np.sin(5 * s), np.cos(3 * s), np.sin(2 * s)], axis=1))


def make_tracks(
    kind: str = "orbit",
    *,
    num_frames: int = 60,
    num_points: int = 500,
    noise: float = 0.1,
    focal: float = 800.0,
    flat: bool = False,
    distortion: tuple[float, float] = (0.0, 0.0),
    life: int = 40,
    thin: tuple[int, int] | None = None,
    outliers: float = 0.02,
    away: float = 1.0,
    seed: int = 0,
) -> TrackedScene:
    """Tracks of a scene; `thin` names frames through which only 25 features are followed, and `away` multiplies distance and focal together."""
    rng = np.random.default_rng(seed)
    width, height = 960, 540
    rotation, translation = paths(kind, num_frames)
    translation = translation + np.array([0.0, 0.0, (away - 1.0) * 8.0])
    focal = focal * away
    low, high = ([-4, -3, -2], [4, 12, 3]) if kind == "forward" else ([-2.5, -2.5, -1.5], [2.5, 2.5, 1.5])
    xyz = rng.uniform(low, high, (num_points, 3))
    if flat:
        xyz[:, 2] = -1.0
    in_cam = np.einsum("kij,pj->kpi", rotation, xyz) + translation[:, None]
    z = np.where(in_cam[..., 2:] > 0.3, in_cam[..., 2:], np.nan)
    uv = in_cam[..., :2] / z
    r2 = (uv**2).sum(axis=2, keepdims=True)
    xy = focal * (1 + distortion[0] * r2 + distortion[1] * r2**2) * uv + [width / 2, height / 2]
    inside = (xy > 10).all(axis=2) & (xy[..., 0] < width - 10) & (xy[..., 1] < height - 10)
    strong = rng.permutation(num_points) < 25

    track, frame, seen = [], [], []
    count = 0
    for p in range(num_points):
        k = int(rng.integers(0, life // 2)) - life // 2
        while k < num_frames:
            span = np.arange(max(k, 0), min(k + int(rng.integers(life // 2, life + 1)), num_frames))
            k = int(span[-1]) + 1 if len(span) else k + 5
            if thin is not None and not strong[p]:
                span = span[(span < thin[0])] if len(span) and span[0] < thin[0] else span[span > thin[1]]
            span = span[np.cumprod(inside[span, p]).astype(bool)]
            if len(span) < 3:
                continue
            positions = xy[span, p] + rng.normal(0, noise, (len(span), 2)) + rng.normal(0, noise / 2, 2)
            if rng.random() < outliers:
                positions += np.arange(len(span))[:, None] * rng.normal(0, 1.0, 2)
            track += [count] * len(span)
            frame += span.tolist()
            seen.append(positions)
            count += 1
    order = np.lexsort((track, frame))
    features = Features(
        track_index=np.array(track, np.int32)[order],
        frame=np.array(frame, np.int32)[order],
        xy=np.concatenate(seen)[order].astype(np.float32),
        num_tracks=count,
    )
    return TrackedScene(features, np.arange(num_frames), (width, height), focal, rotation, translation)


@pytest.fixture(scope="session")
def tracked() -> Callable[..., TrackedScene]:
    return make_tracks
