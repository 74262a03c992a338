"""Clips that do not determine an answer, or not the usual way: small and quick, for tests of what is said then."""

from dataclasses import replace

import numpy as np

from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.houses import demo_scene
from planewright.synthetic.motion import Path, draw_tremor
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, TrueFace, box, face_surfaces, quad
from planewright.synthetic.textures import bricks, print_on, window

_SIZE = (320, 180)


def still_camera(num_frames: int = 24, size: tuple[int, int] = _SIZE, seed: int = 0) -> SyntheticClip:
    """The shed from a tripod: nothing moves but the noise."""
    clip = demo_scene(num_frames, size, seed)
    assert isinstance(clip.path, Path)  # the shed is walked around
    middle = 0.5 * sum(clip.path.azimuth_deg)
    still = draw_tremor(0.0, 0.0, np.random.default_rng(seed))
    return replace(clip, name="still_camera", path=replace(clip.path, azimuth_deg=(middle, middle), height=(2.6, 2.6), tremor=still))


def rotating_camera(num_frames: int = 24, size: tuple[int, int] = _SIZE, seed: int = 0) -> SyntheticClip:
    """The shed from one place, the camera panning by 16 degrees with a tremor of its turn only: no parallax."""
    clip = still_camera(num_frames, size, seed)
    assert isinstance(clip.path, Path)
    tremor = draw_tremor(0.0, 0.4, np.random.default_rng((seed, 3)))
    return replace(clip, name="rotating_camera", path=replace(clip.path, pan_deg=(-8.0, 8.0), tremor=tremor))


def single_plane(num_frames: int = 24, size: tuple[int, int] = _SIZE, seed: int = 0) -> SyntheticClip:
    """A wall that fills the image, with a sketched picture and window on it: all in one plane."""
    rng = np.random.default_rng((seed, 4))
    points = {
        "a0": (-1.2, 0.0, 0.3), "a1": (0.1, 0.0, 0.3), "a2": (0.1, 0.0, 1.3), "a3": (-1.2, 0.0, 1.3),
        "b0": (0.4, 0.0, 0.5), "b1": (1.2, 0.0, 0.5), "b2": (1.2, 0.0, 1.2), "b3": (0.4, 0.0, 1.2),
    }  # fmt: skip
    faces = (TrueFace("picture", ("a0", "a1", "a2", "a3")), TrueFace("pane", ("b0", "b1", "b2", "b3")))
    density = 0.3 * size[0]
    drawn = face_surfaces(points, faces, {"picture": print_on((210, 200, 180), 60, 0.3), "pane": window()}, density)
    outer = quad((-6.0, 0.0, -4.0), (12.0, 0, 0), (0, 0, 9.0), bricks((178, 96, 70), (205, 196, 184), 0.26, 0.1), density)
    wall = replace(outer, loops=(outer.loops[0], *(s.loops[0] for s in drawn)))
    path = Path(
        num_frames=num_frames,
        target=np.array([0.0, 0.0, 0.8]),
        radius=3.2,
        height=(0.9, 1.5),
        azimuth_deg=(-115.0, -75.0),
        tremor=draw_tremor(0.04, 0.6, rng),
    )
    return SyntheticClip("single_plane", Scene(points, faces, (*drawn, wall), (0.3, -0.8, 0.6)), path, centered_camera(size, 0.83), RenderOptions(seed=seed))


def object_on_turntable(num_frames: int = 40, size: tuple[int, int] = _SIZE, seed: int = 0) -> SyntheticClip:
    """A carton that turns by 60 degrees before a still camera and a still room: most of the image says that nothing moves.

    The truth is told in the carton's own frame.
    """
    points = {
        "a0": (-0.7, -0.5, 0.0), "a1": (0.7, -0.5, 0.0), "a2": (0.7, 0.5, 0.0),
        "b0": (-0.7, -0.5, 0.9), "b1": (0.7, -0.5, 0.9), "b2": (0.7, 0.5, 0.9), "b3": (-0.7, 0.5, 0.9),
    }  # fmt: skip
    faces = (TrueFace("front", ("a0", "a1", "b1", "b0")), TrueFace("side", ("a1", "a2", "b2", "b1")), TrueFace("top", ("b0", "b1", "b2", "b3")))
    density = 0.45 * size[0]
    labels = [print_on((190, 150, 100), 60, 0.25), print_on((170, 130, 84), 60, 0.25), print_on((200, 165, 120), 60, 0.25)]
    carton = face_surfaces(points, faces, dict(zip(("front", "side", "top"), labels, strict=True)), density, carrier="object")
    room = (
        quad((-4.0, -3.5, -0.01), (8.0, 0, 0), (0, 7.0, 0), print_on((150, 140, 120), 12, 0.3), 0.6 * density),
        quad((-4.0, 2.5, -0.01), (8.0, 0, 0), (0, 0, 4.0), bricks((160, 90, 70), (200, 190, 180)), 0.5 * density),
        *box((-1.9, 1.2, 0.0), (0.7, 0.7, 0.9), 20.0, print_on((70, 130, 120), 20, 0.3), 0.6 * density),
    )
    path = Path(
        num_frames=num_frames,
        target=np.array([0.0, 0.0, 0.4]),
        radius=3.0,
        height=(1.7, 1.7),
        azimuth_deg=(-70.0, -70.0),
        tremor=draw_tremor(0.0, 0.0, np.random.default_rng(seed)),
        turntable_deg=(20.0, -40.0),
    )
    return SyntheticClip(
        "object_on_turntable", Scene(points, faces, (*carton, *room), (0.3, -0.7, 0.7)), path, centered_camera(size, 0.83), RenderOptions(seed=seed)
    )
