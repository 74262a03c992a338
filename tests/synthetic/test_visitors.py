"""Who passes through comes from outside the image, covers something in a few frames, and is gone."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from planewright.arrays import Float
from planewright.synthetic import boxes, desktop, hall, hard, library, toy_house, true_tracks
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.visitors import alone

TWINS = [boxes, hall, toy_house, desktop, library]


def visitor_pixels(clip: SyntheticClip, time: float) -> Float[np.ndarray, "vertices 2"]:
    """Where the visitor's vertices that are before the camera appear; none when it is away."""
    assert clip.visit is not None
    there = clip.visit.world_from_visitor(time)
    if there is None:
        return np.zeros((0, 2))
    vertices = np.concatenate([s.loops[0] for s in clip.scene.surfaces if s.carrier == "visitor"])
    in_cam = (clip.path.cam_from_world(time) @ there).apply(vertices)
    return clip.intrinsics.project(in_cam[in_cam[:, 2] > 0.05])


@pytest.mark.parametrize("make", [*TWINS, hard.occluder])
def test_a_visitor_neither_appears_nor_vanishes_in_the_image(make: Callable[..., SyntheticClip]) -> None:
    clip = make()
    assert clip.visit is not None
    width, height = clip.intrinsics.image_size
    for p in clip.visit.passes:
        for end in (p.time - 0.999 * p.half, p.time + 0.999 * p.half):
            x, y = visitor_pixels(clip, end).T
            # All on one side of the image: no polygon between them can reach into it.
            assert x.max(initial=-1.0) < 0 or x.min(initial=width) >= width or y.max(initial=-1.0) < 0 or y.min(initial=height) >= height
        x, y = visitor_pixels(clip, p.time).T
        assert np.any((x > 0) & (x < width) & (y > 0) & (y < height))


def spots(clip: SyntheticClip) -> dict[str, tuple[float, float, float]]:
    """Places all over the sketched faces: corners and mixtures of them."""
    rng = np.random.default_rng(0)
    out = dict(clip.scene.points)
    for f in clip.scene.faces:
        loop = clip.scene.corner_array(f.loop)
        for k, weights in enumerate(rng.dirichlet(np.ones(len(loop)), 6)):
            x, y, z = (weights @ loop).tolist()
            out[f"{f.id}.{k}"] = (x, y, z)
    return out


@pytest.mark.parametrize("make", TWINS)
def test_in_a_twin_it_covers_part_of_the_object_in_about_five_percent_of_the_frames(make: Callable[..., SyntheticClip]) -> None:
    clip = make(168)
    dotted = spots(clip)
    faces = tuple(replace(f, loop=(*f.loop, *(k for k in dotted if k.startswith(f"{f.id}.")))) for f in clip.scene.faces)
    dense = replace(clip, scene=replace(clip.scene, points=dotted, faces=faces))
    _, visible, _ = true_tracks(dense)
    _, without, _ = true_tracks(replace(dense, visit=None))
    assert 0.025 < np.mean((without & ~visible).any(axis=0)) < 0.075


def test_a_clip_alone_is_the_clip_without_its_visitor() -> None:
    clip = boxes(30, (160, 90))
    assert clip.visit is not None
    quiet = alone(clip)
    assert quiet.visit is None
    assert not any(s.carrier == "visitor" for s in quiet.scene.surfaces)
    middle = round(clip.visit.passes[0].time)
    shown = clip.renderer.surface_index(middle)
    assert (shown >= len(quiet.scene.surfaces)).mean() > 0.02
    assert (clip.renderer.surface_index(0) >= len(quiet.scene.surfaces)).sum() == 0
