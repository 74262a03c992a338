"""What the renderer draws lies where projection says, and a frame is the same bytes whenever it is drawn."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planewright.arrays import Float
from planewright.synthetic import demo_scene
from planewright.synthetic.clip import SyntheticClip, centered_camera
from planewright.synthetic.motion import Path, draw_tremor
from planewright.synthetic.render import RenderOptions
from planewright.synthetic.scene import Scene, Surface, TrueFace, face_surfaces
from planewright.synthetic.textures import Painter

_FLAT = RenderOptions(samples=4, shutter=0.0, noise=0.0, exposure_drift=0.0)
_CORNERS = {"a": (-0.31, 0.0, -0.27), "b": (0.36, 0.0, -0.22), "c": (0.29, 0.0, 0.33), "d": (-0.34, 0.0, 0.28)}


def plain(value: int) -> Painter:
    def paint(width: float, height: float, density: float, rng: np.random.Generator) -> Float[np.ndarray, "rows columns 3"]:
        return np.full((max(4, round(height * density)), max(4, round(width * density)), 3), float(value), np.float32)

    return paint


def card(surfaces: tuple[Surface, ...] = (), samples: int = 4, azimuth: float = -80.0) -> SyntheticClip:
    """A white card in black space, under a sky without shadows."""
    faces = (TrueFace("card", ("a", "b", "c", "d")),)
    drawn = face_surfaces(_CORNERS, faces, {"card": plain(150)}, 40.0)
    scene = Scene(_CORNERS, faces, (*drawn, *surfaces), (0.0, -1.0, 0.0), ambient=1.0, background=(0.0, 0.0, 0.0))
    path = Path(4, np.zeros(3), 2.0, (0.3, 0.3), (azimuth, azimuth), draw_tremor(0.0, 0.0, np.random.default_rng(0)))
    return SyntheticClip("card", scene, path, centered_camera((200, 150), 1.1), replace(_FLAT, samples=samples))


def moments(image: np.ndarray) -> tuple[float, np.ndarray]:
    """Area and centroid of the bright part, in pixels whose first centre is (0.5, 0.5)."""
    weight = image[..., 1].astype(float) / image.max()
    rows, columns = np.indices(weight.shape) + 0.5
    return float(weight.sum()), np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()


@pytest.mark.parametrize("samples", [1, 4, 5])
def test_a_polygon_covers_the_pixels_that_projection_gives_it(samples: int) -> None:
    clip = card(samples=samples)
    area, centroid = moments(clip.renderer.frame(0))
    xy = clip.intrinsics.project(clip.path.cam_from_world(0.0).apply(np.array(list(_CORNERS.values()))))
    x, y = xy.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    true_area = 0.5 * cross.sum()
    true_centroid = np.array([((x + np.roll(x, -1)) * cross).sum(), ((y + np.roll(y, -1)) * cross).sum()]) / (6 * true_area)
    assert_allclose(area, abs(true_area), rtol=0.004)
    assert_allclose(centroid, true_centroid, atol=0.05)


@pytest.mark.parametrize("distortion", [(-0.15,), (0.1, 0.05)])
def test_a_bent_picture_shows_points_where_the_lens_puts_them(distortion: tuple[float, ...]) -> None:
    """A small card in every corner of the image and in the middle."""
    clip = card()
    for x, y in ((-0.75, -0.55), (0.75, 0.5), (0.0, 0.0), (0.7, -0.5)):
        offset = np.array([x, 0.0, y])
        small = {k: tuple(0.12 * np.array(p) + offset) for k, p in _CORNERS.items()}
        scene = replace(clip.scene, points=small, surfaces=face_surfaces(small, clip.scene.faces, {"card": plain(150)}, 200.0))
        bent = replace(clip, scene=scene, intrinsics=replace(clip.intrinsics, distortion=distortion))
        _, centroid = moments(bent.renderer.frame(0))
        middle = np.mean(list(small.values()), axis=0)
        expected = bent.intrinsics.project(bent.path.cam_from_world(0.0).apply(np.array([middle])))[0]
        straight = clip.intrinsics.project(bent.path.cam_from_world(0.0).apply(np.array([middle])))[0]
        assert_allclose(centroid, expected, atol=0.2)
        assert (x, y) == (0.0, 0.0) or np.linalg.norm(straight - expected) > 1.0


def test_holes_and_nearer_polygons_hide_nothing_and_everything() -> None:
    open_loop = np.array([(-0.4, -0.5, -0.4), (0.4, -0.5, -0.4), (0.4, -0.5, 0.4), (-0.4, -0.5, 0.4)])
    small = 0.25 * open_loop + np.array([0.0, -0.375, 0.0])
    before = card()
    holed = card((Surface((open_loop, small), plain(0), 40.0),))
    image, bare = holed.renderer.frame(0), before.renderer.frame(0)
    through = holed.intrinsics.project(holed.path.cam_from_world(0.0).apply(np.array([[0.0, -0.5, 0.0], [0.2, -0.5, 0.2]])))
    (cx, cy), (ox, oy) = through.astype(int)
    assert image[cy, cx, 0] == bare[cy, cx, 0] > 100
    assert image[oy, ox, 0] == 0 < bare[oy, ox, 0]


def test_neighbours_share_an_edge_without_a_crack() -> None:
    clip = demo_scene(8, (160, 90))
    renderer = replace(clip, scene=replace(clip.scene, background=(255.0, 0.0, 255.0)), options=_FLAT).renderer
    without = replace(clip, scene=replace(clip.scene, background=(0.0, 255.0, 0.0)), options=_FLAT).renderer
    height = 45  # the lower half shows floor and house everywhere: whatever the background, it must not shine through
    assert_array_equal(renderer.frame(3)[height:], without.frame(3)[height:])


def test_a_frame_is_the_same_whenever_it_is_drawn() -> None:
    clip, again = demo_scene(8, (160, 90), seed=3), demo_scene(8, (160, 90), seed=3)
    late = clip.renderer.frame(5)
    assert_array_equal(late, dict(again.frames.color(range(8)))[5])
    assert np.abs(late.astype(int) - demo_scene(8, (160, 90), seed=4).renderer.frame(5)).mean() > 2


def test_noise_has_the_asked_deviation_and_exposure_drifts_within_its_bound() -> None:
    clip = demo_scene(8, (160, 90))
    quiet = replace(clip, options=replace(clip.options, noise=0.0, exposure_drift=0.0)).renderer
    noisy = replace(clip, options=replace(clip.options, noise=2.0, exposure_drift=0.0)).renderer
    difference = noisy.frame(2).astype(float) - quiet.frame(2)
    assert_allclose(difference.std(), np.sqrt(4.0 + 1.0 / 6.0), rtol=0.05)  # rounding twice adds a sixth
    drifting = replace(clip, options=replace(clip.options, noise=0.0)).renderer
    ratio = np.array([drifting.frame(k).mean() / quiet.frame(k).mean() for k in (0, 30, 60, 90)])
    assert np.ptp(ratio) > 0.1
    assert np.all(np.abs(ratio - 1) < 0.13)


def test_a_longer_exposure_blurs() -> None:
    clip = demo_scene(8, (160, 90))

    def sharpness(shutter: float) -> float:
        options = replace(clip.options, noise=0.0, shutter=shutter)
        return float(np.abs(np.diff(replace(clip, options=options).renderer.frame(4).astype(float), axis=1)).mean())

    assert sharpness(4.0) < 0.9 * sharpness(1.0) < 0.9 * sharpness(0.0)
