"""Two clips with known truth: a quick one (a shed with a lean-to), and a toy house of 18 planes and 35 points."""

import numpy as np

from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.motion import Path, draw_tremor
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, Surface, TrueFace, as_part, blob, box, face_surfaces, pillar, quad
from planewright.synthetic.textures import Painter, books, bricks, door, planks, plaster, print_on, shingles, siding, speckled, window
from planewright.synthetic.visitors import hand, pass_before, pass_time, visited

_SUN = (0.35, -0.65, 0.8)


def demo_scene(num_frames: int = 80, size: tuple[int, int] = (640, 360), seed: int = 0) -> SyntheticClip:
    """A shed with a window and a lean-to whose far side stands 7 degrees off: 8 faces, 17 points. Quick to draw; any number of frames."""
    rng = np.random.default_rng((seed, 1))
    z = 1.35
    skew = 1.8 * np.tan(np.radians(7.0))
    points = {
        "a0": (-1.3, -0.9, 0.0), "a1": (1.1, -0.9, 0.0), "a3": (-1.3, 0.9, 0.0),
        "b0": (-1.3, -0.9, z), "b1": (1.1, -0.9, z), "b2": (1.1, 0.9, z + 0.62), "b3": (-1.3, 0.9, z + 0.62),
        "w0": (-0.75, -0.9, 0.45), "w1": (0.15, -0.9, 0.45), "w2": (0.15, -0.9, 1.05), "w3": (-0.75, -0.9, 1.05),
        "l0": (2.0, -0.9, 0.0), "l1": (2.0 - skew, 0.9, 0.0),
        "m0": (2.0, -0.9, 0.7), "m1": (2.0 - skew, 0.9, 0.7), "m2": (1.1, 0.9, 0.7), "m3": (1.1, -0.9, 0.7),
    }  # fmt: skip
    faces = (
        TrueFace("front", ("a0", "a1", "m3", "b1", "b0"), (("w0", "w1", "w2", "w3"),)),
        TrueFace("pane", ("w0", "w1", "w2", "w3")),
        TrueFace("side", ("m3", "m2", "b2", "b1")),
        TrueFace("far_side", ("a3", "a0", "b0", "b3")),
        TrueFace("roof", ("b0", "b1", "b2", "b3")),
        TrueFace("lean_front", ("a1", "l0", "m0", "m3")),
        TrueFace("lean_side", ("l0", "l1", "m1", "m0")),
        TrueFace("lean_top", ("m3", "m0", "m1", "m2")),
    )
    density = 0.28 * size[0]
    brick = bricks((178, 96, 70), (205, 196, 184), 0.26, 0.1)
    paints: dict[str, Painter] = {
        "front": brick, "pane": window(), "side": siding((196, 190, 160)), "far_side": siding((196, 190, 160)), "roof": shingles((104, 70, 62)),
        "lean_front": planks((150, 112, 74), 0.16, upright=True), "lean_side": planks((140, 104, 70), 0.16, upright=True),
        "lean_top": print_on((196, 200, 190), 30, 0.16),
    }  # fmt: skip
    around: list[Surface] = [
        quad((-4.5, -4.0, 0.0), (9.0, 0, 0), (0, 8.0, 0), planks((158, 122, 84), 0.32, 0.16), 0.7 * density),
        quad((-4.5, 3.2, 0.0), (9.0, 0, 0), (0, 0, 4.0), print_on((206, 204, 196), 14, 0.4), 0.5 * density),
        quad((-4.4, -4.0, 0.0), (0, 8.0, 0), (0, 0, 4.0), print_on((188, 196, 200), 10, 0.4), 0.5 * density),
        quad((4.4, 4.0, 0.0), (0, -8.0, 0), (0, 0, 4.0), books(0.75), 0.4 * density),
        *box((-2.6, 1.6, 0.0), (0.9, 0.7, 0.8), 20.0, print_on((70, 130, 120), 20, 0.3), 0.8 * density),
        *box((3.0, 1.7, 0.0), (0.8, 0.9, 1.2), -15.0, print_on((190, 140, 70), 20, 0.3), 0.8 * density),
        *blob((0.3, -1.75, 0.2), (0.22, 0.22, 0.2), 0.0, plaster((200, 40, 34), 0.05), 0.7 * density, rng),
        *blob((2.35, -1.7, 0.3), (0.34, 0.34, 0.34), 0.16, speckled((52, 98, 34), (118, 158, 62), 0.05), 0.8 * density, rng),
    ]
    scene = Scene(points, faces, (*face_surfaces(points, faces, paints, density), _back((1.1, 0.9), (-1.3, 0.9), z + 0.62, brick, density),
                                  _back((2.0 - skew, 0.9), (1.1, 0.9), 0.7, paints["lean_side"], density), *around), _SUN)  # fmt: skip
    arc = min(96.0, 1.2 * num_frames)
    path = Path(
        num_frames=num_frames,
        target=np.array([0.25, 0.0, 0.7]),
        radius=4.6,
        height=(2.3, 2.9),
        azimuth_deg=(-82.0 - 0.5 * arc, -82.0 + 0.5 * arc),
        tremor=draw_tremor(0.06, 0.9, rng),
        sweeps=max(1, round(num_frames / 150)),
    )
    return SyntheticClip("demo", scene, path, centered_camera(size, 0.83), RenderOptions(seed=seed))


def toy_house(
    num_frames: int = 300, size: tuple[int, int] = (960, 540), seed: int = 0, *, bare: bool = False, distortion: tuple[float, ...] = ()
) -> SyntheticClip:
    """A toy house on a play mat: 18 planes, 35 points.

    Window and door lie in the front wall (a hole; a notch whose feet stand on the wall's line), a wing at the left end has a side that stands
    8 degrees off, the right end stands 2 off, the roof planes meet at 84 degrees, a dormer stands on the front slope and a chimney that is turned
    by 4 degrees. Things that nobody sketched stand before and behind it, and a hand reaches in.

    bare: the walls are plain plaster (tones deviate by 2 %, as much as the noise), so that little but their edges can be followed.
    distortion: radial terms of the lens, as in `Intrinsics`.
    """
    rng = np.random.default_rng((seed, 1))
    west, east, south, north, eaves = -0.7, 2.3, -1.25, 1.15, 1.45
    ridge_y = 0.5 * (south + north)
    rise = np.tan(np.radians(42.0))  # two slopes of 42 degrees: their normals are 84 degrees apart
    ridge_z = eaves + rise * (north - ridge_y)

    def on_roof(x: float, y: float) -> tuple[float, float, float]:
        return (x, y, float(eaves + rise * (y - south)))

    wing_x, wing_top, wing_low = -2.05, 1.2, 0.72
    skew = (north - 0.35 - south) * np.tan(np.radians(8.0))
    back = north - 0.35
    slope = (wing_top - wing_low) / (west - wing_x)

    def on_wing(x: float, y: float) -> tuple[float, float, float]:
        return (x, y, float(wing_top + slope * (x - west)))

    base, peak, mid = on_roof(0.25, -0.8), 0.52, 0.72
    dormer_top = base[2] + peak
    stack_top = ridge_z + 0.62
    twist = np.radians(4.0)
    ring = np.array([[-0.21, -0.17], [0.21, -0.17], [0.21, 0.17], [-0.21, 0.17]]) @ np.array([[np.cos(twist), np.sin(twist)], [-np.sin(twist), np.cos(twist)]])
    stack = dict(zip(("sw", "se", "ne", "nw"), (ring + np.array([1.66, -0.35])).tolist(), strict=True))

    def on_end(y: float) -> float:
        return float(east - np.tan(np.radians(2.0)) * (y - south))

    points = {
        "sw": (west, south, 0.0), "se": (east, south, 0.0), "ne": (on_end(north), north, 0.0),
        "sw_eave": (west, south, eaves), "se_eave": (east, south, eaves), "ne_eave": (on_end(north), north, eaves), "nw_eave": (west, north, eaves),
        "ridge_w": (west, ridge_y, ridge_z), "ridge_e": (on_end(ridge_y), ridge_y, ridge_z),
        "wing_s_high": on_wing(west, south), "wing_n_high": on_wing(west, back),
        "wing_s_foot": (wing_x, south, 0.0), "wing_n_foot": (wing_x + skew, back, 0.0),
        "wing_s_low": on_wing(wing_x, south), "wing_n_low": on_wing(wing_x + skew, back),
        "door_1": (0.05, south, 0.0), "door_2": (0.05, south, 0.98), "door_3": (0.6, south, 0.98), "door_4": (0.6, south, 0.0),
        "win_1": (1.0, south, 0.5), "win_2": (1.95, south, 0.5), "win_3": (1.95, south, 1.12), "win_4": (1.0, south, 1.12),
        "dorm_w": base, "dorm_e": on_roof(0.25 + 2 * (mid - 0.25), -0.8), "dorm_top": (mid, -0.8, dormer_top),
        "dorm_back": (mid, float(-0.8 + peak / rise), dormer_top),
        **{f"stack_{k}": on_roof(x, y) for k, (x, y) in stack.items()},
        **{f"cap_{k}": (x, y, stack_top) for k, (x, y) in stack.items()},
    }  # fmt: skip
    points = {k: (float(x), float(y), float(z)) for k, (x, y, z) in points.items()}
    faces = (
        TrueFace("front", ("sw", "door_1", "door_2", "door_3", "door_4", "se", "se_eave", "sw_eave", "wing_s_high"), (("win_1", "win_2", "win_3", "win_4"),)),
        TrueFace("pane", ("win_1", "win_2", "win_3", "win_4")),
        TrueFace("door", ("door_1", "door_4", "door_3", "door_2")),
        TrueFace("end", ("se", "ne", "ne_eave", "se_eave")),
        TrueFace("gable", ("se_eave", "ne_eave", "ridge_e")),
        TrueFace("far_gable", ("wing_n_high", "wing_s_high", "sw_eave", "ridge_w", "nw_eave")),
        TrueFace("slope_s", ("sw_eave", "se_eave", "ridge_e", "ridge_w")),
        # Its eave is seen from no place on the path: who draws leaves it out.
        TrueFace("slope_n", ("nw_eave", "ridge_w", "ridge_e", "ne_eave"), open=True),
        TrueFace("wing_front", ("wing_s_foot", "sw", "wing_s_high", "wing_s_low")),
        TrueFace("wing_side", ("wing_n_foot", "wing_s_foot", "wing_s_low", "wing_n_low")),
        TrueFace("wing_roof", ("wing_s_low", "wing_s_high", "wing_n_high", "wing_n_low")),
        TrueFace("stack_s", ("stack_sw", "stack_se", "cap_se", "cap_sw")),
        TrueFace("stack_e", ("stack_se", "stack_ne", "cap_ne", "cap_se")),
        TrueFace("stack_w", ("stack_nw", "stack_sw", "cap_sw", "cap_nw")),
        TrueFace("cap", ("cap_sw", "cap_se", "cap_ne", "cap_nw")),
        TrueFace("dorm_front", ("dorm_w", "dorm_e", "dorm_top")),
        TrueFace("dorm_left", ("dorm_w", "dorm_top", "dorm_back")),
        TrueFace("dorm_right", ("dorm_e", "dorm_back", "dorm_top")),
    )
    density = 0.24 * size[0]
    brick, stone = bricks((150, 74, 54), (198, 188, 172), 0.2, 0.08), bricks((150, 142, 128), (96, 92, 84), 0.16, 0.1)
    tiles, boards = shingles((92, 84, 92), 0.15, 0.1), siding((214, 206, 178), 0.1)
    paints: dict[str, Painter] = {
        "front": brick, "pane": window(across=2), "door": door((36, 74, 60)), "end": brick, "gable": boards, "far_gable": boards,
        "slope_s": tiles, "slope_n": tiles, "wing_front": plaster((196, 176, 140), 0.07), "wing_side": planks((120, 88, 62), 0.14, upright=True),
        "wing_roof": shingles((134, 96, 66), 0.2, 0.14), "stack_s": stone, "stack_e": stone, "stack_w": stone, "cap": plaster((70, 66, 62), 0.1),
        "dorm_front": boards, "dorm_left": tiles, "dorm_right": tiles,
    }  # fmt: skip
    if bare:
        pale, dark = plaster((206, 198, 184), 0.02), plaster((150, 144, 138), 0.02)
        paints |= {k: pale for k in ("front", "end", "wing_front", "wing_side")} | {
            k: dark for k in ("gable", "far_gable", "dorm_front", "stack_s", "stack_e", "stack_w")
        }
    bush = speckled((46, 88, 32), (112, 150, 58), 0.05)
    room = [
        quad((-6.0, -5.5, -0.01), (12.0, 0, 0), (0, 11.0, 0), planks((150, 108, 70), 0.5), 0.75 * density),
        quad((-3.2, -2.3, 0.0), (6.5, 0, 0), (0, 4.4, 0), speckled((84, 112, 52), (140, 138, 74), 0.07), 0.9 * density),
        quad((-6.0, 4.6, 0.0), (12.0, 0, 0), (0, 0, 6.0), print_on((204, 198, 186), 3, 0.7), 0.45 * density),
        quad((-5.9, -5.5, 0.0), (0, 11.0, 0), (0, 0, 6.0), books(0.9), 0.4 * density),
        quad((5.9, 5.5, 0.0), (0, -11.0, 0), (0, 0, 6.0), print_on((176, 190, 196), 4, 0.6), 0.4 * density),
    ]
    clutter: list[Surface] = [
        *box((-3.6, 2.6, 0.0), (1.3, 1.0, 1.1), 25.0, print_on((60, 110, 130), 12, 0.4), 0.7 * density),
        *box((3.9, 2.6, 0.0), (1.0, 1.2, 1.7), -20.0, print_on((186, 120, 60), 12, 0.4), 0.7 * density),
        *box((0.6, 3.4, 0.0), (1.6, 0.8, 1.3), 5.0, print_on((120, 70, 110), 12, 0.4), 0.7 * density),
        *pillar((4.0, 0.4, 0.0), 0.3, 1.3, 14, print_on((214, 190, 90), 40, 0.2), 0.7 * density),
        *blob((1.3, -2.35, 0.22), (0.24, 0.24, 0.22), 0.0, plaster((196, 44, 38), 0.06), 0.8 * density, rng),
        *blob((-1.2, -2.2, 0.28), (0.34, 0.3, 0.34), 0.15, bush, 0.8 * density, rng),
        *blob((3.0, -1.9, 0.45), (0.42, 0.42, 0.55), 0.14, bush, 0.8 * density, rng),
        *blob((-2.9, 0.9, 0.25), (0.3, 0.3, 0.3), 0.14, bush, 0.8 * density, rng),
    ]
    hidden = (
        _back((on_end(north), north), (west, north), eaves, brick, density),
        _back((wing_x + skew, back), (west, back), wing_low, paints["wing_side"], density),
        _back((west, back), (west, south), wing_top, brick, density),
        quad(
            (*stack["ne"], ridge_z - 0.6),
            (stack["nw"][0] - stack["ne"][0], stack["nw"][1] - stack["ne"][1], 0),
            (0, 0, stack_top - ridge_z + 0.6),
            stone,
            density,
        ),
    )
    around = (*as_part("room", room), *as_part("clutter", clutter))
    scene = Scene(points, faces, (*face_surfaces(points, faces, paints, density), *hidden, *around), (0.3, -0.7, 0.8))
    path = Path(
        num_frames=num_frames,
        target=np.array([0.25, -0.05, 1.05]),
        radius=6.1,
        height=(3.3, 4.4),
        azimuth_deg=(-35.0, -145.0),
        tremor=draw_tremor(0.06, 0.8, rng),
        sweeps=max(1, round(num_frames / 450)),
    )
    clip = SyntheticClip("toy_house", scene, path, centered_camera(size, 0.81, distortion), RenderOptions(seed=seed))
    reach = pass_before(path, clip.intrinsics, (1.2, -1.2, 1.3), float(round(0.3 * num_frames)), pass_time(num_frames), 0.6, 75.0)
    return visited(clip, hand(1.3, density, np.random.default_rng((seed, 6))), [reach])


def _back(start: tuple[float, float], end: tuple[float, float], height: float, paint: Painter, density: float) -> Surface:
    """An upright wall that nobody sketched."""
    return quad((*start, 0.0), (end[0] - start[0], end[1] - start[1], 0.0), (0.0, 0.0, height), paint, density)
