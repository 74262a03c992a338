"""A desk with a monitor, a speaker, a box and a tower: 14 planes, 36 points."""

import numpy as np

from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.motion import Walk, draw_tremor
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, Surface, TrueFace, as_part, blob, box, face_surfaces, pillar, quad, sketched_box
from planewright.synthetic.textures import Painter, books, parcel, planks, plaster, print_on, screen, speckled
from planewright.synthetic.visitors import hand, pass_before, pass_time, visited


def desktop(num_frames: int = 150, size: tuple[int, int] = (960, 540), seed: int = 0) -> SyntheticClip:
    """A desk in units of half a metre: desk top, monitor (dark bezel around a screen), speaker, box, tower: 14 planes, 36 points.

    Books, a second speaker, a keyboard, a mug, a plant and a lamp stand there unsketched. The camera starts close to the tower, and where
    most corners are in sight the tower's are not all in the image. The speaker stands 8 degrees off, the box 4, the tower 2. A hand reaches in.
    """
    rng = np.random.default_rng((seed, 1))
    left, right, low, high, front, back = -0.8, 0.75, 0.2, 1.12, 0.42, 0.58
    rim = 0.07
    blocks = (
        sketched_box("speaker", (-1.2, 0.3, 0.0), (0.42, 0.4, 0.78), 8.0, ("s", "e", "top")),
        sketched_box("box", (-0.35, -0.2, 0.0), (0.62, 0.42, 0.26), -4.0, ("s", "e", "top")),
        sketched_box("tower", (2.05, 0.12, 0.0), (0.42, 0.8, 1.44), 2.0, ("s", "w", "top")),
    )
    points = {
        "desk_sw": (-1.8, -0.85, 0.0), "desk_se": (2.5, -0.85, 0.0), "desk_ne": (2.5, 0.8, 0.0), "desk_nw": (-1.8, 0.8, 0.0),
        "rim_1": (left, front, low), "rim_2": (right, front, low), "rim_3": (right, front, high), "rim_4": (left, front, high),
        "lit_1": (left + rim, front, low + 1.6 * rim), "lit_2": (right - rim, front, low + 1.6 * rim),
        "lit_3": (right - rim, front, high - rim), "lit_4": (left + rim, front, high - rim),
        "back_2": (right, back, low), "back_3": (right, back, high), "back_4": (left, back, high),
        **{k: p for block in blocks for k, p in block.points.items()},
    }  # fmt: skip
    faces = (
        # What stands on the desk hides most of its far side: who draws leaves it out.
        TrueFace("desk", ("desk_nw", "desk_sw", "desk_se", "desk_ne"), open=True),
        TrueFace("bezel", ("rim_1", "rim_2", "rim_3", "rim_4"), (("lit_1", "lit_2", "lit_3", "lit_4"),)),
        TrueFace("screen", ("lit_1", "lit_2", "lit_3", "lit_4")),
        TrueFace("monitor_side", ("rim_2", "back_2", "back_3", "rim_3")),
        TrueFace("monitor_top", ("rim_4", "rim_3", "back_3", "back_4")),
        *(f for block in blocks for f in block.faces),
    )
    density = 0.34 * size[0]
    black, cloth = plaster((34, 34, 38), 0.06, 0.2), speckled((40, 40, 44), (74, 72, 76), 0.03)
    steel = plaster((120, 124, 130), 0.03, 0.3)
    paints: dict[str, Painter] = {
        "desk": planks((164, 122, 78), 0.6, 0.08), "bezel": black, "screen": screen(), "monitor_side": black, "monitor_top": black,
        "speaker_s": cloth, "speaker_e": plaster((82, 56, 40), 0.08, 0.2), "speaker_top": plaster((82, 56, 40), 0.08, 0.2),
        "box_s": parcel((172, 140, 96)), "box_e": parcel((172, 140, 96)), "box_top": print_on((204, 198, 184), 60, 0.2),
        "tower_s": print_on((58, 60, 66), 24, 0.16), "tower_w": steel, "tower_top": steel,
    }  # fmt: skip
    wood = plaster((112, 82, 54), 0.06)
    board = [
        quad((-1.8, -0.85, -0.09), (4.3, 0, 0), (0, 0, 0.09), wood, density),
        quad((2.5, -0.85, -0.09), (0, 1.65, 0), (0, 0, 0.09), wood, 0.6 * density),
        quad((-1.8, 0.8, -0.09), (0, -1.65, 0), (0, 0, 0.09), wood, 0.6 * density),
    ]
    room = [
        quad((-5.0, -4.5, -1.45), (10.0, 0, 0), (0, 6.0, 0), speckled((96, 86, 76), (132, 120, 104), 0.1), 0.4 * density),
        quad((-5.0, 1.15, -1.45), (10.0, 0, 0), (0, 0, 5.0), plaster((178, 182, 176), 0.03, 0.5), 0.4 * density),
        quad((-4.0, -4.5, -1.45), (0, 5.65, 0), (0, 0, 5.0), books(0.8), 0.35 * density),
        quad((4.0, 1.15, -1.45), (0, -5.65, 0), (0, 0, 5.0), print_on((186, 180, 170), 8, 0.4), 0.35 * density),
        quad((-1.9, 1.13, 0.75), (0.9, 0, 0), (0, 0, 1.1), print_on((206, 200, 188), 40, 0.2), 0.6 * density),
        quad((0.5, 1.13, 1.55), (1.3, 0, 0), (0, 0, 0.8), print_on((70, 100, 120), 40, 0.2), 0.6 * density),
    ]
    # The rest of the monitor, and its foot.
    monitor = [
        quad((left, back, low), (0, front - back, 0), (0, 0, high - low), black, 0.5 * density),
        quad((right, back, low), (left - right, 0, 0), (0, 0, high - low), black, 0.5 * density),
        quad((left, back, low), (right - left, 0, 0), (0, front - back, 0), black, 0.5 * density),
        *box((-0.02, 0.5, 0.0), (0.22, 0.08, low), 0.0, black, 0.7 * density),
        *box((-0.02, 0.48, 0.0), (0.6, 0.36, 0.03), 0.0, black, 0.7 * density),
    ]
    # What nobody sketched.
    clutter: list[Surface] = [
        *box((1.45, 0.0, 0.0), (0.26, 0.34, 0.6), -9.0, cloth, 0.7 * density),
        *box((0.4, -0.5, 0.0), (0.8, 0.3, 0.05), 3.0, print_on((60, 62, 66), 160, 0.05), density),
        *box((-1.15, -0.4, 0.0), (0.5, 0.36, 0.09), 22.0, print_on((150, 50, 46), 60, 0.16), 0.8 * density),
        *box((-1.13, -0.42, 0.09), (0.46, 0.33, 0.07), 34.0, print_on((60, 90, 140), 60, 0.16), 0.8 * density),
        *pillar((0.33, 0.1, 0.0), 0.1, 0.24, 14, print_on((190, 60, 50), 160, 0.1), 0.8 * density),
        *pillar((-1.58, -0.15, 0.0), 0.11, 0.2, 12, plaster((160, 100, 70), 0.08), 0.7 * density),
        *blob((-1.58, -0.15, 0.38), (0.2, 0.2, 0.22), 0.18, speckled((48, 92, 36), (108, 148, 62), 0.03), 0.7 * density, rng),
        *pillar((1.25, -0.62, 0.0), 0.09, 0.3, 12, print_on((206, 190, 90), 160, 0.1), 0.8 * density),
    ]
    hidden = [Surface((np.array(loop),), wood, 0.5 * density) for block in blocks for loop in block.hidden]
    places = [(2.4, -2.9, 2.2), (1.3, -2.7, 1.95), (0.3, -2.8, 1.6), (-0.5, -2.85, 1.55), (-1.0, -3.0, 1.6), (-0.4, -3.1, 1.6), (0.5, -2.9, 1.65)]
    targets = [(1.8, 0.1, 0.35), (1.35, 0.1, 0.4), (0.0, 0.1, 0.3), (-0.4, 0.1, 0.3), (-0.7, 0.05, 0.22), (-0.2, 0.1, 0.3), (0.1, 0.1, 0.3)]
    walk = Walk(num_frames, np.array(places), np.array(targets), draw_tremor(0.03, 0.8, rng))
    around = (*board, *as_part("room", room), *monitor, *as_part("clutter", clutter))
    scene = Scene(points, faces, (*face_surfaces(points, faces, paints, density), *hidden, *around), (0.25, -0.7, 0.8), ambient=0.6)
    clip = SyntheticClip("desktop", scene, walk, centered_camera(size, 0.8), RenderOptions(seed=seed))
    reach = pass_before(walk, clip.intrinsics, (0.1, 0.2, 0.45), float(round(0.62 * num_frames)), pass_time(num_frames), 0.55, 70.0)
    return visited(clip, hand(0.62, density, np.random.default_rng((seed, 6))), [reach])
