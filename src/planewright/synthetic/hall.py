"""A walk down a hall: 12 planes, 38 points, seen from inside."""

import numpy as np

from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.motion import Walk, draw_tremor
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, Surface, TrueFace, blob, box, face_surfaces, pillar, quad
from planewright.synthetic.textures import Painter, books, bricks, door, plaster, print_on, speckled
from planewright.synthetic.visitors import pass_time, visited, walk_by, walker


def hall(num_frames: int = 350, size: tuple[int, int] = (960, 540), seed: int = 0) -> SyntheticClip:
    """From a lobby into a hall with three doors and one more at its end, a way to the side, a hanging sign, a pillar at a wall: 12 planes, 38 points.

    The end wall stands 2 degrees off, the sign 4, the front of the pillar 8.

    The camera walks forward. Where it starts, it looks about: no frame shows floor, ceiling or a side wall whole. Walls are nearly bare
    (tones deviate by 2 to 3 %); pictures, a bench and plants are not sketched. Somebody walks by.
    """
    rng = np.random.default_rng((seed, 1))
    w, end, top = 1.7, 11.0, 2.8
    off_2, off_4, off_8 = np.tan(np.radians([2.0, 4.0, 8.0]))

    def on_end(x: float) -> float:
        return float(end - off_2 * (x + w))

    def on_sign(x: float) -> float:
        return float(6.4 + off_4 * (x - 0.2))

    points = {
        "l_near": (-w, 0, 0), "r_near": (w, 0, 0), "l_near_top": (-w, 0, top), "r_near_top": (w, 0, top),
        "l_end": (-w, end, 0), "r_end": (w, on_end(w), 0), "l_end_top": (-w, end, top), "r_end_top": (w, on_end(w), top),
        "way_1": (-w, 2.4, 0), "way_2": (-w, 2.4, 2.25), "way_3": (-w, 3.7, 2.25), "way_4": (-w, 3.7, 0),
        "door_l_1": (-w, 5.6, 0), "door_l_2": (-w, 5.6, 2.1), "door_l_3": (-w, 6.6, 2.1), "door_l_4": (-w, 6.6, 0),
        "door_r_1": (w, 2.0, 0), "door_r_2": (w, 2.0, 2.1), "door_r_3": (w, 3.0, 2.1), "door_r_4": (w, 3.0, 0),
        "door_s_1": (w, 7.2, 0), "door_s_2": (w, 7.2, 2.1), "door_s_3": (w, 8.2, 2.1), "door_s_4": (w, 8.2, 0),
        "door_e_1": (-0.95, on_end(-0.95), 0), "door_e_2": (-0.95, on_end(-0.95), 2.15),
        "door_e_3": (0.15, on_end(0.15), 2.15), "door_e_4": (0.15, on_end(0.15), 0),
        "sign_1": (-0.5, on_sign(-0.5), 2.2), "sign_2": (0.9, on_sign(0.9), 2.2), "sign_3": (0.9, on_sign(0.9), 2.6), "sign_4": (-0.5, on_sign(-0.5), 2.6),
        "pillar_1": (w, 4.3, 0), "pillar_2": (w - 0.45, 4.3 + 0.45 * off_8, 0), "pillar_3": (w - 0.45, 4.8, 0),
        "pillar_1_top": (w, 4.3, top), "pillar_2_top": (w - 0.45, 4.3 + 0.45 * off_8, top), "pillar_3_top": (w - 0.45, 4.8, top),
    }  # fmt: skip
    points = {k: (float(x), float(y), float(z)) for k, (x, y, z) in points.items()}
    l_notches = ("way_1", "way_2", "way_3", "way_4", "door_l_1", "door_l_2", "door_l_3", "door_l_4")
    r_notches = ("door_s_4", "door_s_3", "door_s_2", "door_s_1", "door_r_4", "door_r_3", "door_r_2", "door_r_1")
    faces = (
        TrueFace("floor", ("l_near", "r_near", "r_end", "l_end")),
        # Where the hall begins no edge runs across its ceiling that one would draw: the lobby's front wall stands there.
        TrueFace("ceiling", ("l_near_top", "l_end_top", "r_end_top", "r_near_top"), open=True),
        TrueFace("left", ("l_near", *l_notches, "l_end", "l_end_top", "l_near_top")),
        TrueFace("right", ("r_end", *r_notches, "r_near", "r_near_top", "r_end_top")),
        TrueFace("end", ("l_end", "door_e_1", "door_e_2", "door_e_3", "door_e_4", "r_end", "r_end_top", "l_end_top")),
        TrueFace("door_l", ("door_l_1", "door_l_4", "door_l_3", "door_l_2")),
        TrueFace("door_r", ("door_r_4", "door_r_1", "door_r_2", "door_r_3")),
        TrueFace("door_s", ("door_s_4", "door_s_1", "door_s_2", "door_s_3")),
        TrueFace("door_e", ("door_e_1", "door_e_4", "door_e_3", "door_e_2")),
        TrueFace("sign", ("sign_1", "sign_2", "sign_3", "sign_4")),
        TrueFace("pillar_front", ("pillar_2", "pillar_1", "pillar_1_top", "pillar_2_top")),
        TrueFace("pillar_side", ("pillar_3", "pillar_2", "pillar_2_top", "pillar_3_top")),
    )
    density = 0.2 * size[0]
    wall, dark = plaster((196, 188, 170), 0.03, 0.5), door((104, 62, 40))
    paints: dict[str, Painter] = {
        "floor": bricks((128, 118, 106), (88, 82, 76), 0.6, 0.6, 0.1), "ceiling": bricks((178, 178, 174), (128, 128, 126), 0.6, 0.6, 0.03),
        "left": wall, "right": wall, "end": plaster((150, 164, 170), 0.03, 0.5), "door_l": dark, "door_r": door((60, 84, 104)), "door_s": dark,
        "door_e": door((70, 92, 70)), "sign": print_on((40, 92, 62), 50, 0.25), "pillar_front": bricks((150, 92, 74), (186, 176, 164), 0.3, 0.11),
        "pillar_side": bricks((150, 92, 74), (186, 176, 164), 0.3, 0.11),
    }  # fmt: skip
    around = [*_lobby(w, top, density), *_side_way(-w, (2.4, 3.7), 2.25, wall, density)]
    around += [
        quad((w, 4.8, 0.0), (-0.45, 0, 0), (0, 0, top), paints["pillar_side"], density),
        quad((0.9, on_sign(0.9) + 0.03, 2.2), (-1.4, -1.4 * off_4, 0), (0, 0, 0.4), paints["sign"], density),
        quad((-0.3, on_sign(-0.3), 2.6), (0.02, 0, 0), (0, 0, top - 2.6), plaster((60, 60, 64)), density),
        quad((0.7, on_sign(0.7), 2.6), (0.02, 0, 0), (0, 0, top - 2.6), plaster((60, 60, 64)), density),
        quad((-0.7, 4.6, 0.001), (1.5, 0, 0), (0, 3.2, 0), print_on((112, 48, 44), 30, 0.25), density),
    ]
    # Pictures and boards on the walls, 2 cm before them.
    for y, z, wide, high, paper, marks in ((0.7, 1.1, 1.1, 0.8, (206, 200, 184), 60), (4.1, 1.2, 0.9, 0.7, (120, 140, 150), 60),
                                           (7.3, 1.0, 1.6, 1.0, (176, 150, 110), 40), (9.4, 1.2, 0.8, 0.8, (206, 206, 196), 60)):  # fmt: skip
        around.append(quad((-w + 0.02, y, z), (0, wide, 0), (0, 0, high), print_on(paper, marks, 0.16), density))
    for y, z, wide, high, paper, marks in ((1.5, 1.1, 1.0, 0.8, (90, 110, 90), 60), (6.7, 1.1, 1.2, 0.9, (200, 176, 120), 60),
                                           (10.1, 1.2, 1.2, 0.7, (110, 100, 140), 60)):  # fmt: skip
        around.append(quad((w - 0.02, y, z), (0, -wide, 0), (0, 0, high), print_on(paper, marks, 0.16), density))
    around.append(quad((0.5, on_end(0.5) - 0.02, 1.2), (0.8, -0.8 * off_2, 0), (0, 0, 0.8), print_on((204, 190, 150), 60, 0.16), density))
    for y in (1.2, 3.6, 8.4):
        around.append(quad((-0.5, y, top - 0.01), (0, 0.9, 0), (1.0, 0, 0), plaster((236, 236, 226), 0.02), density))
    leaves = speckled((48, 92, 36), (108, 148, 62), 0.05)
    for x, y in ((-1.35, 4.8), (1.35, 5.6), (-1.45, 8.95), (-2.7, -0.6)):
        around += pillar((x, y, 0.0), 0.16, 0.32, 10, plaster((150, 90, 60), 0.08), 0.7 * density)
        around += blob((x, y, 0.62), (0.26, 0.26, 0.36), 0.16, leaves, 0.7 * density, rng)
    around += box((-1.42, 7.9, 0.0), (0.4, 1.3, 0.42), 0.0, bricks((140, 96, 60), (96, 64, 40), 0.5, 0.08), density)
    around += box((1.42, 9.0, 0.0), (0.4, 0.5, 0.7), 10.0, print_on((176, 176, 170), 30, 0.2), density)
    places = [(-0.2, -3.5, 1.5), (0.25, -3.35, 1.6), (0.3, -2.6, 1.65), (-0.3, -2.3, 1.6), (-0.3, -1.3, 1.5), (0.1, 0.1, 1.55), (0.35, 1.7, 1.6)]
    places += [(-0.2, 3.2, 1.55), (-0.35, 4.6, 1.6), (0.1, 5.7, 1.55)]
    targets = [(-0.7, 1.5, 1.0), (0.8, 1.5, 1.05), (1.2, 1.6, 2.3), (-1.3, 1.8, 2.35), (-0.2, 3.6, 1.5), (0.4, 5.4, 1.3), (-0.4, 7.2, 1.6)]
    targets += [(0.5, 9.2, 1.3), (0.0, 10.6, 1.7), (-0.2, 11.0, 1.4)]
    walk = Walk(num_frames, np.array(places), np.array(targets), draw_tremor(0.035, 0.7, rng))
    surfaces = (*face_surfaces(points, faces, paints, density), *around)
    # All light comes from around: a sun would not reach in.
    scene = Scene(points, faces, surfaces, (0.2, -0.7, 0.7), ambient=0.85, sky_reach=0.07)
    clip = SyntheticClip("hall", scene, walk, centered_camera(size, 0.78), RenderOptions(seed=seed))
    half = 2.3 * pass_time(num_frames)  # the walk begins and ends well beside what the camera sees
    by = walk_by((0.55, -1.2, 0.0), 180.0, 2.6 / half, float(round(0.19 * num_frames)), half)
    return visited(clip, walker(1.75, density, np.random.default_rng((seed, 6))), [by])


def _lobby(w: float, top: float, density: float) -> list[Surface]:
    """The room before the hall: wider, higher, with another floor; its front wall leaves the hall's opening free."""
    wide, back, high = 4.2, -6.5, 3.7
    front = bricks((168, 120, 92), (190, 180, 168), 0.4, 0.14)
    return [
        quad((-wide, back, 0.0), (2 * wide, 0, 0), (0, -back, 0), speckled((120, 96, 70), (150, 128, 98), 0.12), 0.8 * density),
        quad((-wide, back, high), (0, -back, 0), (2 * wide, 0, 0), plaster((186, 186, 180), 0.04), 0.5 * density),
        quad((-wide, 0.0, 0.0), (wide - w, 0, 0), (0, 0, high), front, density),
        quad((w, 0.0, 0.0), (wide - w, 0, 0), (0, 0, high), front, density),
        quad((-w, 0.0, top), (2 * w, 0, 0), (0, 0, high - top), front, density),
        quad((-wide, back, 0.0), (0, -back, 0), (0, 0, high), books(0.8), 0.5 * density),
        quad((wide, 0.0, 0.0), (0, back, 0), (0, 0, high), print_on((186, 180, 160), 10, 0.4), 0.5 * density),
    ]


def _side_way(x: float, span: tuple[float, float], high: float, wall: Painter, density: float) -> list[Surface]:
    """What is seen through the opening in the left wall."""
    a, b = span
    deep = 2.4
    return [
        quad((x - deep, a, 0.0), (deep, 0, 0), (0, b - a, 0), speckled((110, 92, 74), (142, 124, 100), 0.1), density),
        quad((x - deep, a, high), (0, b - a, 0), (deep, 0, 0), plaster((170, 170, 166), 0.04), density),
        quad((x, a, 0.0), (-deep, 0, 0), (0, 0, high), wall, density),
        quad((x - deep, b, 0.0), (deep, 0, 0), (0, 0, high), wall, density),
        quad((x - deep, a, 0.0), (0, b - a, 0), (0, 0, high), print_on((150, 160, 150), 20, 0.3), density),
    ]
