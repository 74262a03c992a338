"""Three cartons: 11 planes, 23 points."""

import numpy as np

from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.motion import Path, draw_tremor
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, Surface, as_part, blob, box, face_surfaces, opened, pillar, quad, sketched_box
from planewright.synthetic.textures import Painter, books, bricks, parcel, planks, plaster, print_on, speckled
from planewright.synthetic.visitors import hand, pass_before, pass_time, visited


def boxes(num_frames: int = 300, size: tuple[int, int] = (960, 540), seed: int = 0) -> SyntheticClip:
    """A carton, one beside it that is turned by 2 degrees, and one on top that is turned by 8 and whose lid rises by 4: 11 planes, 23 points.

    They partly hide each other, and a tin and a ball that nobody sketched stand before them: no frame shows all corners. A hand reaches in.
    """
    rng = np.random.default_rng((seed, 1))
    cartons = (
        sketched_box("large", (-0.35, 0.1, 0.0), (1.5, 1.0, 0.9), 0.0, ("s", "e", "w", "top")),
        sketched_box("small", (1.04, -0.42, 0.0), (0.75, 0.7, 0.62), 2.0, ("s", "e", "top")),
        sketched_box("upper", (-0.42, 0.14, 0.9), (0.95, 0.66, 0.5), 8.0, ("s", "e", "w", "top"), 4.0),
    )
    points = {k: p for carton in cartons for k, p in carton.points.items()}
    # The far side of the large carton's top is seen only past the upper carton: who draws leaves it out.
    faces = tuple(opened(f, "large_7") if f.id == "large_top" else f for carton in cartons for f in carton.faces)
    density = 0.4 * size[0]
    brown, pale, white = (168, 126, 82), (190, 152, 106), (206, 204, 198)
    paints: dict[str, Painter] = {
        "large_s": parcel(brown), "large_e": parcel(brown, mirrored=True), "large_w": parcel(brown), "large_top": parcel(brown, (150, 112, 70)),
        "small_s": print_on(white, 40, 0.2), "small_e": print_on((52, 88, 128), 40, 0.2), "small_top": parcel(white, (120, 60, 50)),
        "upper_s": parcel(pale, (96, 66, 46)), "upper_e": plaster(pale, 0.05, 0.2), "upper_w": parcel(pale, (96, 66, 46)), "upper_top": parcel(pale),
    }  # fmt: skip
    room = [
        quad((-5.0, -4.5, 0.0), (10.0, 0, 0), (0, 9.0, 0), planks((150, 112, 76), 0.3, 0.14), 0.5 * density),
        quad((-5.0, 3.2, 0.0), (10.0, 0, 0), (0, 0, 4.5), bricks((170, 150, 134), (206, 198, 188), 0.4, 0.16), 0.3 * density),
        quad((-4.6, -4.5, 0.0), (0, 9.0, 0), (0, 0, 4.5), books(0.8), 0.3 * density),
        quad((4.6, 4.5, 0.0), (0, -9.0, 0), (0, 0, 4.5), print_on((180, 190, 196), 6, 0.5), 0.3 * density),
    ]
    clutter: list[Surface] = [
        *pillar((0.12, -1.15, 0.0), 0.15, 0.46, 14, print_on((206, 186, 84), 90, 0.14), 0.8 * density),
        *blob((-1.35, -0.75, 0.24), (0.24, 0.24, 0.24), 0.0, plaster((190, 52, 40), 0.07, 0.15), 0.8 * density, rng),
        *blob((1.95, 0.45, 0.3), (0.34, 0.34, 0.34), 0.16, speckled((52, 98, 34), (118, 158, 62), 0.04), 0.7 * density, rng),
        *box((-2.6, 1.5, 0.0), (0.9, 0.8, 1.1), 28.0, print_on((70, 120, 128), 14, 0.3), 0.6 * density),
        *box((2.4, 1.9, 0.0), (1.1, 0.7, 0.8), -14.0, print_on((176, 122, 70), 14, 0.3), 0.6 * density),
        *box((0.5, 2.4, 0.0), (1.2, 0.6, 1.5), 6.0, print_on((120, 84, 116), 14, 0.3), 0.6 * density),
    ]
    hidden = tuple(Surface((np.array(loop),), paints["large_top"], 0.5 * density) for carton in cartons for loop in carton.hidden)
    path = Path(
        num_frames=num_frames,
        target=np.array([0.1, -0.05, 0.62]),
        radius=3.3,
        height=(1.9, 2.6),
        azimuth_deg=(-28.0, -148.0),
        tremor=draw_tremor(0.035, 0.8, rng),
        sweeps=max(1, round(num_frames / 450)),
    )
    around = (*as_part("room", room), *as_part("clutter", clutter))
    scene = Scene(points, faces, (*face_surfaces(points, faces, paints, density), *hidden, *around), (0.3, -0.65, 0.8))
    clip = SyntheticClip("boxes", scene, path, centered_camera(size, 0.8), RenderOptions(seed=seed))
    reach = pass_before(path, clip.intrinsics, (-0.1, -0.3, 0.95), float(round(0.68 * num_frames)), pass_time(num_frames), 0.6, 115.0)
    return visited(clip, hand(0.8, density, np.random.default_rng((seed, 6))), [reach])
