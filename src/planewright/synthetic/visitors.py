"""Who passes through a clip: a hand that reaches in, a person who walks by, a bird."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planewright.geometry.camera import Intrinsics
from planewright.geometry.rigid import Rigid, rotations_from_vectors
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.motion import Motion, Pass, Visit
from planewright.synthetic.scene import Surface, blob, box, pillar
from planewright.synthetic.textures import Painter, plaster, print_on


def _carried(surfaces: Sequence[Surface], move: Rigid) -> list[Surface]:
    """The surfaces moved, and told that the visitor carries them."""
    return [replace(s, loops=tuple(move.apply(loop) for loop in s.loops), carrier="visitor", part="clutter") for s in surfaces]


def hand(length: float, density: float, rng: np.random.Generator, sleeve: Painter | None = None) -> list[Surface]:
    """A hand with its forearm in a checked sleeve. Its origin is the middle of the palm, the forearm runs along +x, the back of the hand looks to +z.

    length: from the wrist to the finger tips, scene units. density: texels a scene unit.
    """
    skin = plaster((196, 148, 120), 0.1, 0.1 * length)
    cloth = sleeve or print_on((70, 84, 120), round(60 / length**2), 0.3 * length)
    # Lying along x: what stands upright along z is turned about y.
    lie = rotations_from_vectors(np.array([[0.0, np.pi / 2, 0.0]]))[0]
    still = Rigid(np.eye(3), np.zeros(3))
    parts = _carried(blob((0.0, 0.0, 0.0), (0.32 * length, 0.24 * length, 0.11 * length), 0.03, skin, density, rng), still)
    for k, reach in enumerate((0.36, 0.42, 0.4, 0.3)):
        y = (0.165 - 0.11 * k) * length
        parts += _carried(
            blob((-(0.17 + 0.5 * reach) * length, y, 0.0), (0.5 * reach * length, 0.055 * length, 0.055 * length), 0.02, skin, density, rng), still
        )
    thumb = Rigid(rotations_from_vectors(np.array([[0.0, 0.0, -0.8]]))[0], length * np.array([-0.12, -0.24, 0.0]))
    parts += _carried(blob((0.0, 0.0, 0.0), (0.2 * length, 0.06 * length, 0.06 * length), 0.02, skin, density, rng), thumb)
    parts += _carried(pillar((0.0, 0.0, 0.0), 0.105 * length, 0.7 * length, 10, skin, density), Rigid(lie, length * np.array([0.03, 0.0, 0.0])))
    parts += _carried(pillar((0.0, 0.0, 0.0), 0.24 * length, 7.0 * length, 12, cloth, density), Rigid(lie, length * np.array([0.55, 0.0, 0.0])))
    return parts


def walker(height: float, density: float, rng: np.random.Generator) -> list[Surface]:
    """A person who walks along +x. The origin is between the feet; z is up."""
    skin, hair = plaster((190, 146, 118), 0.1, 0.1), plaster((60, 44, 34), 0.25, 0.04)
    shirt, cloth = print_on((150, 60, 52), 60, 0.12), plaster((52, 58, 78), 0.12, 0.1)
    still = Rigid(np.eye(3), np.zeros(3))
    h = height
    parts = _carried(blob((0.0, 0.0, 0.62 * h), (0.11 * h, 0.15 * h, 0.24 * h), 0.04, shirt, density, rng), still)
    parts += _carried(blob((0.01 * h, 0.0, 0.93 * h), (0.06 * h, 0.05 * h, 0.075 * h), 0.02, skin, density, rng), still)
    parts += _carried(blob((-0.015 * h, 0.0, 0.955 * h), (0.058 * h, 0.054 * h, 0.06 * h), 0.05, hair, density, rng), still)
    for side, step in ((0.07, 0.22), (-0.07, -0.22)):
        lean = Rigid(rotations_from_vectors(np.array([[0.0, step, 0.0]]))[0], np.array([-step * 0.48 * h, side * h, 0.0]))
        parts += _carried(pillar((0.0, 0.0, 0.0), 0.055 * h, 0.5 * h, 10, cloth, density), lean)
        swing = Rigid(rotations_from_vectors(np.array([[0.0, -step, 0.0]]))[0], np.array([step * 0.78 * h, 2.2 * side * h, 0.42 * h]))
        parts += _carried(pillar((0.0, 0.0, 0.0), 0.032 * h, 0.38 * h, 8, shirt, density), swing)
    return parts


def bird(span: float, density: float, rng: np.random.Generator) -> list[Surface]:
    """A gull that glides along +x, wings along y, its back to +z."""
    white, grey = plaster((226, 226, 222), 0.06, 0.05 * span), plaster((126, 132, 140), 0.16, 0.05 * span)
    still = Rigid(np.eye(3), np.zeros(3))
    parts = _carried(blob((0.0, 0.0, 0.0), (0.2 * span, 0.07 * span, 0.06 * span), 0.03, white, density, rng), still)
    parts += _carried(blob((0.2 * span, 0.0, 0.02 * span), (0.06 * span, 0.045 * span, 0.045 * span), 0.02, white, density, rng), still)
    for side in (-1.0, 1.0):
        wing = Rigid(rotations_from_vectors(np.array([[0.3 * side, 0.0, -0.25 * side]]))[0], span * np.array([-0.02, 0.27 * side, 0.07]))
        parts += _carried(blob((0.0, 0.0, 0.0), (0.09 * span, 0.26 * span, 0.012 * span), 0.04, grey, density, rng), wing)
    tail = Rigid(np.eye(3), span * np.array([-0.24, 0.0, 0.0]))
    return parts + _carried(box((0.0, 0.0, -0.008 * span), (0.14 * span, 0.1 * span, 0.016 * span), 0.0, grey, density), tail)


def pass_time(num_frames: int) -> float:
    """Frames from the middle to the end of a pass that covers something in about 5 % of a clip; a hand does not come and go within half a second."""
    return max(7.0, num_frames / 24)


def pass_before(
    path: Motion, intrinsics: Intrinsics, over: Sequence[float], time: float, half: float, nearness: float, toward_deg: float, back: bool = True
) -> Pass:
    """A pass between camera and thing: at its middle the visitor's origin covers the point `over`, at its ends it is out of the image.

    over: scene units. nearness: its distance from the camera as a share of the point's. toward_deg: where it goes in the image, from +x towards +y (down).
    Its +x points that way, its +z at the camera.
    """
    pose = path.cam_from_world(time)
    place = nearness * pose.apply(np.array([over], float))[0]
    angle = np.radians(toward_deg)
    way = np.array([np.cos(angle), np.sin(angle), 0.0])
    world_from_cam = pose.inverse()
    in_cam = np.stack([way, np.cross([0.0, 0.0, -1.0], way), [0.0, 0.0, -1.0]], axis=1)
    # Past the corner of the image from anywhere near its middle, with a hand's length to spare.
    far = 0.75 * float(np.hypot(*intrinsics.image_size)) * place[2] / intrinsics.focal
    return Pass(time, half, world_from_cam.rotation @ in_cam, world_from_cam.apply(place[None])[0], world_from_cam.rotation @ (far * way), back)


def walk_by(middle: Sequence[float], heading_deg: float, pace: float, time: float, half: float) -> Pass:
    """A walk on level ground: `pace` scene units a frame in the direction `heading_deg`, counted from the x axis."""
    turn = np.radians(heading_deg)
    way = np.array([np.cos(turn), np.sin(turn), 0.0])
    return Pass(time, half, rotations_from_vectors(np.array([[0.0, 0.0, turn]]))[0], np.array(middle, float), pace * half * way, back=False)


def alone(clip: SyntheticClip) -> SyntheticClip:
    """The clip without its visitor."""
    kept = tuple(s for s in clip.scene.surfaces if s.carrier != "visitor")
    return replace(clip, scene=replace(clip.scene, surfaces=kept), visit=None)


def visited(clip: SyntheticClip, visitor: Sequence[Surface], passes: Sequence[Pass]) -> SyntheticClip:
    """The clip with somebody passing through."""
    return replace(clip, scene=replace(clip.scene, surfaces=(*clip.scene.surfaces, *visitor)), visit=Visit(tuple(passes)))
