"""The texture against the true colours of a small world."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planewright.model.atlas import Atlas, FaceChart
from planewright.planes.polygons import face_loops
from planewright.texture.atlas import chart_mask
from planewright.texture.bake import bake_texture


def clean_texels(atlas: Atlas, world, chart: FaceChart) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World positions and colours of the seen texels of a face, more than two texels inside its border, and the share of the face that was inferred."""
    mask = chart_mask(chart, face_loops(world.scene)[chart.face])
    place = (slice(chart.row, chart.row + chart.height), slice(chart.column, chart.column + chart.width))
    inferred = atlas.inferred[place]
    usable = mask & ~inferred
    core = usable.copy()
    for dy in range(-3, 4):
        for dx in range(-3, 4):
            core &= np.roll(usable, (dy, dx), axis=(0, 1))
    core[:3], core[-3:], core[:, :3], core[:, -3:] = False, False, False, False
    y, x = np.nonzero(core)
    return chart.to_world(np.stack([x, y], axis=1) + 0.5), atlas.image[place][core].astype(float), inferred[mask].mean()


def psnr(difference: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / np.mean(difference**2)))


@pytest.fixture(scope="module")
def plain(world) -> Atlas:
    return bake_texture(world.clip(), world.scene, world.cameras)


def test_texels_show_the_true_colors_of_their_places(world, plain: Atlas) -> None:
    seen = {world.scene.sketch.faces[chart.face].id: chart for chart in plain.charts}
    for name in ("wall", "window", "side", "panel"):
        points, colors, _ = clean_texels(plain, world, seen[name])
        assert len(points) > 400
        assert psnr(colors - world.true_color(seen[name].face, points)) > 36, name


def test_what_passes_by_and_is_not_in_the_model_is_outvoted(world) -> None:
    def spoil(number: int, image: np.ndarray) -> np.ndarray:
        image = image.copy()
        left = 12 * number
        image[40:120, left : left + 40] = [250, 20, 20]
        return image

    atlas = bake_texture(world.clip(spoil=spoil), world.scene, world.cameras)
    for chart in atlas.charts[:2]:
        points, colors, _ = clean_texels(atlas, world, chart)
        assert psnr(colors - world.true_color(chart.face, points)) > 34


def test_exposure_that_drifts_leaves_no_patches(world, plain: Atlas) -> None:
    gains = 1.0 + 0.12 * np.sin(np.arange(20) * 0.7)
    atlas = bake_texture(world.clip(gains=gains), world.scene, world.cameras)
    for chart in atlas.charts[:3]:
        points, colors, _ = clean_texels(atlas, world, chart)
        truth = world.true_color(chart.face, points)
        # One brightness for the whole is not determined; how evenly it is spread is.
        assert psnr(colors * (colors.ravel() @ truth.ravel() / (colors.ravel() @ colors.ravel())) - truth) > 33


def test_what_no_frame_saw_is_flagged_and_what_was_seen_is_not(world, plain: Atlas) -> None:
    share = {world.scene.sketch.faces[chart.face].id: clean_texels(plain, world, chart)[2] for chart in plain.charts}
    assert share["unseen"] == 1.0
    assert share["window"] == share["panel"] == 0.0
    assert share["side"] < 0.01
    # The panel stands 0.4 before the wall; from all sides together nearly all of the wall behind it is seen.
    assert share["wall"] < 0.1


def test_the_same_input_gives_the_same_bytes(world, plain: Atlas) -> None:
    again = bake_texture(world.clip(), world.scene, world.cameras)
    assert_array_equal(again.image, plain.image)
    assert_array_equal(again.inferred, plain.inferred)


def test_odd_scenes_and_clips_still_give_an_atlas(world) -> None:
    scene, cameras = world.scene, world.cameras
    far = scene.points.copy()
    far[[1, 2, 8, 9]] *= [400.0, 1.0, 1.0]  # the wall and the side become very long, and pass behind some cameras
    a, b, c = far[[1, 8, 9]]
    normal = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
    normals, offsets = scene.normals.copy(), scene.offsets.copy()
    normals[2], offsets[2] = normal, normal @ a
    long = bake_texture(world.clip(), replace(scene, points=far, normals=normals, offsets=offsets), cameras)
    assert max(long.image.shape) <= 4096
    window = next(chart for chart in long.charts if scene.sketch.faces[chart.face].id == "window")
    points, colors, _ = clean_texels(long, world, window)
    assert psnr(colors - world.true_color(window.face, points)) > 33
    lost = bake_texture(world.clip(), scene, replace(cameras, posed=np.zeros(20, dtype=bool)))
    assert lost.inferred.any()
    assert (lost.image == 128).all()
    nothing = bake_texture(world.clip(), replace(scene, face_known=np.zeros(5, dtype=bool)), cameras)
    assert nothing.charts == ()
    line = scene.points.copy()
    line[[10, 11, 12, 13]] = np.linspace([0.2, 0.1, -0.4], [0.7, 0.1, -0.4], 4)
    flat = bake_texture(world.clip(), replace(scene, points=line), cameras)
    assert [scene.sketch.faces[chart.face].id for chart in flat.charts] == ["wall", "window", "side", "unseen"]


def test_charts_keep_their_distance_in_the_atlas(plain: Atlas) -> None:
    taken = np.zeros(plain.inferred.shape, dtype=int)
    for chart in plain.charts:
        taken[chart.row - 4 : chart.row + chart.height + 4, chart.column - 4 : chart.column + chart.width + 4] += 1
    assert taken.max() == 1
    assert sum((chart.width + 8) * (chart.height + 8) for chart in plain.charts) == taken.sum()
