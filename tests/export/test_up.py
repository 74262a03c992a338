"""Turning the world so that y is up."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.export.up import metres_per_unit, y_up_from_world


def test_up_becomes_y_by_a_rotation_for_every_direction(make_model) -> None:
    rng = np.random.default_rng(0)
    for up in [*np.eye(3), *-np.eye(3), *rng.normal(size=(50, 3))]:
        rotation = y_up_from_world(make_model(["a"], world_up=up))
        assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        assert_allclose(rotation @ up / np.linalg.norm(up), [0, 1, 0], atol=1e-12)


def test_the_usual_turn_for_z_up(make_model) -> None:
    assert_allclose(y_up_from_world(make_model(["a"])) @ [1, 2, 3], [1, 3, -2], atol=1e-15)


def test_without_a_known_up_the_cameras_decide(make_model) -> None:
    held = make_model(["a"], world_up=None, view_up=np.array([0.0, 0.0, 2.0]))
    assert_allclose(y_up_from_world(held) @ [0, 0, 1], [0, 1, 0], atol=1e-12)
    assert_allclose(y_up_from_world(make_model(["a"], world_up=None)) @ [0, -1, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(("unit", "metres"), [(None, 1.0), ("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("ft", 0.3048), ("in", 0.0254)])
def test_units_in_metres(make_model, unit: str | None, metres: float) -> None:
    assert metres_per_unit(make_model(["a"], unit=unit)) == metres
