"""Solid things are closed, and look outwards."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.synthetic.scene import Surface, blob, box, loop_normal, pillar, quad, sketched_box
from planewright.synthetic.textures import plaster

PAINT = plaster((100, 100, 100))
SOLIDS = {
    "box": box((1.0, 2.0, 0.5), (0.8, 0.6, 0.4), 33.0, PAINT, 50.0),
    "pillar": pillar((1.0, 2.0, 0.5), 0.3, 0.9, 9, PAINT, 50.0),
    "blob": blob((1.0, 2.0, 0.5), (0.5, 0.4, 0.6), 0.1, PAINT, 50.0, np.random.default_rng(1)),
}


def volume(surfaces: tuple[Surface, ...], center: np.ndarray) -> float:
    """By the divergence theorem: a sixth of the sum over the triangles of a fan."""
    total = 0.0
    for s in surfaces:
        loop = s.loops[0] - center
        total += sum(np.linalg.det(np.stack([loop[0], loop[i], loop[i + 1]])) for i in range(1, len(loop) - 1)) / 6
    return total


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_look_outwards_and_enclose_their_volume(name: str) -> None:
    surfaces = SOLIDS[name]
    corners = np.concatenate([s.loops[0] for s in surfaces])
    for s in surfaces:
        assert_allclose((s.loops[0] - s.loops[0][0]) @ s.normal, 0.0, atol=1e-12)
        assert (s.loops[0].mean(axis=0) - corners.mean(axis=0)) @ s.normal > 0
    # Seen from the middle of the missing floor, the cone over it has no volume.
    expected = {"box": 0.8 * 0.6 * 0.4, "pillar": 0.5 * 9 * 0.3**2 * np.sin(2 * np.pi / 9) * 0.9}
    if name in expected:
        assert_allclose(volume(surfaces, np.array([1.0, 2.0, 0.5])), expected[name], rtol=1e-9)
    else:
        assert_allclose(volume(surfaces, np.zeros(3)), volume(surfaces, corners.mean(axis=0)), rtol=1e-9)  # closed: no floor is missing


def test_a_loop_looks_to_where_it_runs_counter_clockwise() -> None:
    side = quad((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, 1.0), PAINT, 50.0)
    assert_allclose(side.normal, [0.0, -1.0, 0.0])
    assert_allclose(loop_normal(side.loops[0][::-1]), [0.0, 1.0, 0.0])


def test_a_sketched_box_has_the_sides_that_were_asked_for_and_hides_with_the_others() -> None:
    whole = box((1.0, 2.0, 0.5), (0.8, 0.6, 0.4), 33.0, PAINT, 50.0)
    half = sketched_box("b", (1.0, 2.0, 0.5), (0.8, 0.6, 0.4), 33.0, ("s", "e", "top"))
    assert [f.id for f in half.faces] == ["b_s", "b_e", "b_top"]
    assert set(half.points) == {f"b_{k}" for k in (0, 1, 2, 4, 5, 6, 7)}  # the foot behind belongs to no side that was asked for
    loops = [np.array([half.points[k] for k in f.loop]) for f in half.faces] + [np.array(loop) for loop in half.hidden]
    for k, side in enumerate((0, 1, 4, 2, 3)):
        assert_allclose(loops[k], whole[side].loops[0], atol=1e-12)
