"""A group of buildings from the air: 18 planes, 41 points, through a lens that bends lines."""

import numpy as np

from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.motion import Path, draw_tremor
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, Surface, TrueFace, as_part, blob, box, face_surfaces, pillar, quad, sketched_box
from planewright.synthetic.textures import Painter, bricks, plaster, print_on, shingles, siding, speckled, window
from planewright.synthetic.visitors import bird, pass_before, pass_time, visited


def library(num_frames: int = 500, size: tuple[int, int] = (960, 540), seed: int = 0) -> SyntheticClip:
    """A library with a roof of two slopes at 84 degrees, a tower, a low block, a kiosk that stands 8 degrees off, a plaza and a lawn.

    18 planes, 41 points. The low block stands 4 degrees off, the tower 2. Trees that nobody sketched stand on the plaza and the lawn; a gull passes.
    The lens has k1 = -0.06, k2 = 0.012.
    """
    rng = np.random.default_rng((seed, 1))
    west, east, south, north, eaves = -3.2, 3.0, 0.4, 3.4, 1.9
    ridge_y = 0.5 * (south + north)
    ridge_z = float(eaves + np.tan(np.radians(42.0)) * (north - ridge_y))  # two slopes of 42 degrees: their normals are 84 degrees apart
    buildings = (
        sketched_box("low", (-1.3, -1.3, 0.0), (2.6, 2.2, 1.0), 4.0, ("s", "e", "w", "top")),
        sketched_box("tower", (4.3, 1.2, 0.0), (1.5, 1.5, 4.3), 2.0, ("s", "e", "w", "top")),
        sketched_box("kiosk", (3.2, -3.0, 0.0), (1.3, 1.0, 0.8), 8.0, ("s", "w", "top")),
    )
    points = {
        "sw": (west, south, 0.0), "se": (east, south, 0.0), "ne": (east, north, 0.0), "nw": (west, north, 0.0),
        "sw_eave": (west, south, eaves), "se_eave": (east, south, eaves), "ne_eave": (east, north, eaves), "nw_eave": (west, north, eaves),
        "ridge_w": (west, ridge_y, ridge_z), "ridge_e": (east, ridge_y, ridge_z),
        **{k: p for b in buildings for k, p in b.points.items()},
        "plaza_sw": (0.5, -5.2, 0.0), "plaza_se": (5.2, -5.2, 0.0), "plaza_ne": (5.2, -0.6, 0.0), "plaza_nw": (0.5, -0.6, 0.0),
        "lawn_sw": (-5.4, -6.2, 0.0), "lawn_se": (-0.6, -6.2, 0.0), "lawn_ne": (-0.6, -3.2, 0.0), "lawn_nw": (-5.4, -3.2, 0.0),
    }  # fmt: skip
    faces = (
        TrueFace("front", ("sw", "se", "se_eave", "sw_eave")),
        TrueFace("end", ("se", "ne", "ne_eave", "ridge_e", "se_eave")),
        # Its far upright is seen at a slant and behind trees: who draws leaves it out.
        TrueFace("far_end", ("nw", "sw", "sw_eave", "ridge_w", "nw_eave"), open=True),
        TrueFace("slope_s", ("sw_eave", "se_eave", "ridge_e", "ridge_w")),
        TrueFace("slope_n", ("ne_eave", "nw_eave", "ridge_w", "ridge_e")),
        *(f for b in buildings for f in b.faces),
        TrueFace("plaza", ("plaza_sw", "plaza_se", "plaza_ne", "plaza_nw")),
        TrueFace("lawn", ("lawn_sw", "lawn_se", "lawn_ne", "lawn_nw")),
    )
    density = 0.115 * size[0]
    stone, rows = bricks((188, 172, 148), (150, 138, 120), 0.5, 0.22), window((206, 200, 190), (58, 76, 98), 8, 2)
    tiles, gravel, pale = shingles((138, 74, 60), 0.2, 0.16), speckled((132, 130, 126), (176, 172, 164), 0.08), plaster((214, 206, 192), 0.06)
    paints: dict[str, Painter] = {
        "front": rows, "end": stone, "far_end": stone, "slope_s": tiles, "slope_n": tiles,
        "low_s": window((196, 188, 176), (64, 84, 104), 6, 1), "low_e": pale, "low_w": pale, "low_top": gravel,
        "tower_s": window((178, 120, 92), (56, 70, 92), 3, 7), "tower_e": bricks((172, 108, 80), (204, 192, 176), 0.4, 0.18),
        "tower_w": bricks((172, 108, 80), (204, 192, 176), 0.4, 0.18), "tower_top": gravel,
        "kiosk_s": print_on((204, 190, 90), 12, 0.3), "kiosk_w": siding((96, 132, 122), 0.16), "kiosk_top": plaster((120, 116, 110), 0.09),
        "plaza": bricks((186, 170, 150), (150, 138, 122), 0.44, 0.44, 0.1), "lawn": speckled((84, 122, 48), (132, 150, 74), 0.14),
    }  # fmt: skip
    room: list[Surface] = [
        # Layers of the ground lie closer together than light starts above a surface (2e-3), so that none darkens the one below it.
        quad((-45.0, -36.0, -0.0012), (90.0, 0, 0), (0, 90.0, 0), speckled((112, 114, 92), (150, 142, 116), 0.35), 0.24 * density),
        quad((-8.6, -7.3, -0.0008), (15.4, 0, 0), (0, 14.0, 0), speckled((118, 118, 98), (152, 144, 120), 0.25), 0.5 * density),
        quad((-30.0, -9.6, -0.0004), (60.0, 0, 0), (0, 2.2, 0), plaster((92, 92, 96), 0.07, 0.6), 0.5 * density),
        quad((6.9, -7.4, -0.0004), (1.8, 0, 0), (0, 40.0, 0), plaster((96, 94, 96), 0.07, 0.6), 0.4 * density),
        *box((-7.4, 4.6, -0.0012), (2.4, 3.0, 2.2), 12.0, bricks((176, 140, 116), (206, 196, 184), 0.5, 0.22), 0.6 * density),
        *box((11.2, 3.0, -0.0012), (3.0, 2.4, 1.8), -8.0, print_on((190, 186, 176), 4, 0.5), 0.5 * density),
        *box((-1.5, 8.6, -0.0012), (5.0, 2.2, 2.4), 4.0, window((190, 176, 160), (70, 84, 104), 6, 2), 0.5 * density),
    ]
    clutter: list[Surface] = []
    leaves = speckled((44, 84, 32), (104, 142, 58), 0.1)
    bark = plaster((96, 74, 54), 0.1)
    trees = [(1.3, -4.4, 1.2), (2.0, -1.5, 1.0), (5.0, -1.3, 1.3), (4.7, -4.9, 1.1), (-4.6, -3.6, 1.2), (-2.4, -5.7, 1.0), (-0.9, -3.6, 0.9), (-4.6, 0.2, 1.5)]
    trees += [(-5.2, 2.8, 1.6), (6.3, 3.8, 1.5), (0.6, 5.2, 1.6), (-6.8, -2.6, 1.3)]
    for x, y, high in trees:
        clutter += pillar((x, y, -0.0012), 0.07, high, 6, bark, 0.6 * density)
        clutter += blob((x, y, high), (0.46 * high, 0.46 * high, 0.5 * high), 0.14, leaves, 0.8 * density, rng)
    hidden = [Surface((np.array(loop),), pale, 0.6 * density) for b in buildings for loop in b.hidden]
    hidden.append(quad((east, north, 0.0), (west - east, 0, 0), (0, 0, eaves), stone, 0.6 * density))
    path = Path(
        num_frames=num_frames,
        target=np.array([0.4, 0.0, 0.9]),
        radius=11.5,
        height=(9.4, 9.8),
        azimuth_deg=(-22.0, -162.0),
        tremor=draw_tremor(0.12, 0.8, rng),
        sweeps=max(1, round(num_frames / 700)),
    )
    around = (*as_part("room", room), *as_part("clutter", clutter))
    scene = Scene(points, faces, (*face_surfaces(points, faces, paints, density), *hidden, *around), (0.45, -0.6, 0.85))
    clip = SyntheticClip("library", scene, path, centered_camera(size, 0.82, (-0.06, 0.012)), RenderOptions(seed=seed))
    flight = pass_before(path, clip.intrinsics, (0.4, 0.6, 1.6), float(round(0.42 * num_frames)), pass_time(num_frames), 0.35, -20.0, back=False)
    return visited(clip, bird(2.6, 2.0 * density, np.random.default_rng((seed, 6))), [flight])
