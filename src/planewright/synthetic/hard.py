"""Clips that are hard on purpose, each in one way: variants of the twins with other paint, other paths, other cameras."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from planewright.synthetic.boxes import boxes
from planewright.synthetic.building import build_off
from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.desktop import desktop
from planewright.synthetic.hall import hall
from planewright.synthetic.houses import toy_house
from planewright.synthetic.library import library
from planewright.synthetic.motion import Path, both, draw_shake, draw_tremor
from planewright.synthetic.observe import SLIVER, thickness, true_tracks
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Part, Scene, Surface, pillar
from planewright.synthetic.textures import Painter, parcel, plaster, print_on, speckled
from planewright.synthetic.visitors import alone, hand, pass_before, visited

_SIZE = (960, 540)


def bare_walls(num_frames: int = 150, size: tuple[int, int] = _SIZE, seed: int = 11) -> SyntheticClip:
    """A toy house of plain plaster: walls and chimney show less than the noise, so that little but their edges can be followed."""
    return replace(alone(toy_house(num_frames, size, seed, bare=True)), name="bare_walls")


def arc_10(num_frames: int = 200, size: tuple[int, int] = _SIZE, seed: int = 12) -> SyntheticClip:
    """The cartons from an arc of 10 degrees, as far as they are seen from there."""
    return seen_only(replace(_on_arc(alone(boxes(num_frames, size, seed)), (-63.0, -73.0), 2.2), name="arc_10"))


def arc_20(num_frames: int = 150, size: tuple[int, int] = _SIZE, seed: int = 13) -> SyntheticClip:
    """The toy house from an arc of 20 degrees, as far as it is seen from there."""
    return seen_only(replace(_on_arc(alone(toy_house(num_frames, size, seed)), (-60.0, -80.0), 3.8), name="arc_20"))


def low_bit_rate(num_frames: int = 150, size: tuple[int, int] = _SIZE, seed: int = 14) -> SyntheticClip:
    """The desk, compressed until blocks show (crf 36)."""
    clip = alone(desktop(num_frames, size, seed))
    return replace(clip, name="low_bit_rate", options=replace(clip.options, crf=36))


def as_built(num_frames: int = 150, size: tuple[int, int] = _SIZE, seed: int = 15) -> SyntheticClip:
    """The library as built: what was meant to be parallel or at right angles is off by 0.1 to 0.3 degrees. Its lens bends nothing."""
    clip = alone(library(num_frames, size, seed))
    built = build_off(clip.scene, np.random.default_rng((seed, 5)))
    return replace(clip, name="as_built", scene=built, intrinsics=centered_camera(size, 0.82))


def blending(num_frames: int = 150, size: tuple[int, int] = _SIZE, seed: int = 16) -> SyntheticClip:
    """Brown cartons on a brown floor before brown walls, in dull light: at many edges both sides have nearly one colour."""
    clip = alone(boxes(num_frames, size, seed))
    brown: dict[Part, Painter] = {"room": speckled((160, 120, 78), (176, 134, 90), 0.05), "clutter": print_on((166, 126, 84), 14, 0.3)}
    cardboard = parcel((168, 126, 82), (176, 142, 96))
    faces = {f.id: cardboard for f in clip.scene.faces}
    return replace(clip, name="blending", scene=replace(repainted(clip.scene, brown, faces), ambient=0.75))


def turntable(num_frames: int = 150, size: tuple[int, int] = _SIZE, seed: int = 17) -> SyntheticClip:
    """The cartons on a disc that turns by 116 degrees before a still camera and a still room. The truth is told in the cartons' own frame."""
    clip = alone(boxes(num_frames, size, seed))
    assert isinstance(clip.path, Path)  # the cartons are walked around
    thick = 0.06
    density = 0.3 * size[0]
    disc = pillar((0.1, -0.05, -thick), 1.75, thick, 60, plaster((186, 176, 160), 0.05, 0.2), density)
    turning = [replace(s, carrier="object") for s in clip.scene.surfaces if s.part == "thing"] + [replace(s, carrier="object", part="room") for s in disc]
    room = [replace(s, loops=tuple(loop - [0.0, 0.0, thick] for loop in s.loops)) for s in clip.scene.surfaces if s.part == "room"]
    path = replace(
        clip.path,
        radius=3.7,
        height=(2.3, 2.3),
        azimuth_deg=(-88.0, -88.0),
        tremor=draw_tremor(0.0, 0.0, np.random.default_rng(seed)),
        turntable_deg=(-58.0, 58.0),
        sweeps=1,
    )
    return replace(clip, name="turntable", scene=replace(clip.scene, surfaces=(*turning, *room)), path=path)


def bare_background(num_frames: int = 150, size: tuple[int, int] = _SIZE, seed: int = 18) -> SyntheticClip:
    """The toy house alone on a plain table under a plain sky: only it has texture."""
    clip = alone(toy_house(num_frames, size, seed))
    plain: dict[Part, Painter] = {"room": plaster((206, 204, 198), 0.003, 0.5)}
    scene = repainted(clip.scene, plain, {})
    table = next(s for s in scene.surfaces if s.part == "room")
    surfaces = (*(s for s in scene.surfaces if s.part == "thing"), table)
    return replace(clip, name="bare_background", scene=replace(scene, surfaces=surfaces, background=(188.0, 196.0, 204.0)))


def blur(num_frames: int = 200, size: tuple[int, int] = _SIZE, seed: int = 19) -> SyntheticClip:
    """The cartons by a hand that shakes, in dim light: the shutter stays open for three quarters of the time, and corners smear over 8 pixels."""
    return _shaken(replace(alone(boxes(num_frames, size, seed)), name="blur"), 0.12, RenderOptions(shutter=0.75, samples=8, seed=seed))


def occluder(num_frames: int = 150, size: tuple[int, int] = _SIZE, seed: int = 20) -> SyntheticClip:
    """The toy house, and a hand that reaches in three times: it covers corners in 15 % of the frames."""
    clip = alone(toy_house(num_frames, size, seed))
    clip = replace(clip, name="occluder", options=replace(clip.options, samples=8))
    arm = hand(1.15, 0.24 * size[0], np.random.default_rng((seed, 6)))
    reaches = (((1.4, -1.2, 0.8), 0.2, 80.0), ((-0.6, -1.2, 1.0), 0.5, 140.0), ((1.0, -0.6, 1.9), 0.8, 35.0))
    passes = [pass_before(clip.path, clip.intrinsics, over, float(round(at * num_frames)), 10.0, 0.6, way) for over, at, way in reaches]
    return visited(clip, arm, passes)


def rolling_shutter(num_frames: int = 240, size: tuple[int, int] = _SIZE, seed: int = 21) -> SyntheticClip:
    """The hall, by a hand that shakes, through a sensor that takes seven tenths of the time between frames to read its rows."""
    return _shaken(replace(alone(hall(num_frames, size, seed)), name="rolling_shutter"), 0.12, RenderOptions(shutter=0.3, readout=0.7, seed=seed))


def _shaken(clip: SyntheticClip, turn_deg: float, options: RenderOptions) -> SyntheticClip:
    """The clip with fast shakes on top of the hand's tremor, and with another camera."""
    shake = draw_shake(turn_deg, np.random.default_rng((clip.options.seed, 7)))
    return replace(clip, path=replace(clip.path, tremor=both(clip.path.tremor, shake)), options=options)


def _on_arc(clip: SyntheticClip, azimuth_deg: tuple[float, float], height: float) -> SyntheticClip:
    """The same scene from another arc, walked once at one height."""
    assert isinstance(clip.path, Path)  # desks and halls have no arc
    return replace(clip, path=replace(clip.path, azimuth_deg=azimuth_deg, height=(height, height), sweeps=1))


def repainted(scene: Scene, parts: Mapping[Part, Painter], faces: Mapping[str, Painter]) -> Scene:
    """The scene with other paint on whole parts, and on single faces."""
    drawn = [replace(s, paint=faces.get(f.id, s.paint)) for f, s in zip(scene.faces, scene.surfaces[: len(scene.faces)], strict=True)]
    others = [s if s.facet else replace(s, paint=parts.get(s.part, s.paint)) for s in scene.surfaces[len(scene.faces) :]]
    return replace(scene, surfaces=(*drawn, *others))


def seen_only(clip: SyntheticClip, share: float = 0.1) -> SyntheticClip:
    """The clip without the faces that a person could not draw: each corner of a face is in sight, and the face more than a line, in that
    share of the frames or more."""
    xy, visible, _ = true_tracks(clip)
    seen = {k for k, row in zip(clip.scene.points, visible, strict=True) if row.mean() >= share}
    scene = clip.scene
    thick = (thickness(scene, xy) > SLIVER).mean(axis=1) >= share
    kept = [bool(t) and seen.issuperset((*f.loop, *(k for hole in f.holes for k in hole))) for f, t in zip(scene.faces, thick, strict=True)]
    faces = tuple(f for f, keep in zip(scene.faces, kept, strict=True) if keep)
    used = {k for f in faces for k in (*f.loop, *(k for hole in f.holes for k in hole))}
    drawn: list[Surface] = [s for s, keep in zip(scene.surfaces, kept, strict=False) if keep]
    others = [s for s, keep in zip(scene.surfaces, kept, strict=False) if not keep] + list(scene.surfaces[len(kept) :])
    points = {k: p for k, p in scene.points.items() if k in used}
    return replace(clip, scene=replace(scene, points=points, faces=faces, surfaces=(*drawn, *others)))


HARD = (bare_walls, arc_10, arc_20, low_bit_rate, as_built, blending, turntable, bare_background, blur, occluder, rolling_shutter)
"""All of them."""
