"""Features in front of, on and behind a plane."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.lifting.photometric import Reference, plane_from_world
from planewright.lifting.task import Task
from planewright.lifting.witnesses import Witnesses, plane_of_witnesses, seen_through, witnesses_in

BEHIND = 0.06


@pytest.fixture
def reference(wall) -> Reference:
    return wall.reference()


def on_plane(reference: Reference, plane: np.ndarray, count: int, depth: float = 1.0) -> Witnesses:
    """Features spread over a face, `depth` times as deep as a plane."""
    rng = np.random.default_rng(count)
    xy = reference.center + reference.radius * rng.uniform(-0.7, 0.7, (count, 2))
    basis = np.concatenate([(xy - reference.center) / reference.radius, np.ones((count, 1))], axis=1)
    return Witnesses(xy, (basis @ plane) / depth, np.full(count, 1e-3))


def both(a: Witnesses, b: Witnesses) -> Witnesses:
    return Witnesses(np.concatenate([a.xy, b.xy]), np.concatenate([a.rho, b.rho]), np.concatenate([a.sigma, b.sigma]))


def test_features_on_a_plane_or_before_it_are_not_seen_through_it(wall, reference: Reference) -> None:
    plane = plane_from_world(wall.views, reference, wall.normal, wall.offset)
    for depth in (1.0, 1.0 + 0.5 * BEHIND, 0.7):
        assert seen_through(on_plane(reference, plane, 20, depth), reference, plane, BEHIND) == 0.0


def test_features_behind_a_plane_are_counted_less_a_quarter_of_all(wall, reference: Reference) -> None:
    plane = plane_from_world(wall.views, reference, wall.normal, wall.offset)
    mixed = both(on_plane(reference, plane, 10), on_plane(reference, plane, 30, 1.3))
    assert_allclose(seen_through(mixed, reference, plane, BEHIND), 30 - 10)
    unsure = Witnesses(mixed.xy, mixed.rho, np.full(40, 0.2))  # they may as well lie on it
    assert seen_through(unsure, reference, plane, BEHIND) == 0.0


def test_the_plane_of_the_features_is_the_one_behind_what_stands_before_it(wall, reference: Reference) -> None:
    plane = plane_from_world(wall.views, reference, wall.normal, wall.offset)
    found = plane_of_witnesses(both(on_plane(reference, plane, 40), on_plane(reference, plane, 30, 1.5)), reference, BEHIND, np.random.default_rng(0))
    assert found is not None
    assert_allclose(found[0], plane / 1.5, rtol=1e-6)
    assert found[1] == 2.0
    assert found[2] == 0.0


def test_too_few_features_are_no_plane(wall, reference: Reference) -> None:
    plane = plane_from_world(wall.views, reference, wall.normal, wall.offset)
    assert plane_of_witnesses(on_plane(reference, plane, 4), reference, BEHIND, np.random.default_rng(0)) is None


def test_witnesses_are_the_features_seen_in_a_mask_at_that_time(shed, task: Task) -> None:
    height, width = task.views.images.shape[1:]
    left = np.zeros((height, width), bool)
    left[:, : width // 2] = True
    view = int(np.argmin(task.views.frame))
    one, rest, whole = (witnesses_in(task, view, mask) for mask in (left, ~left, np.ones_like(left)))
    assert len(one.rho) > 20
    assert (one.xy[:, 0] < width // 2).all()
    assert len(one.rho) + len(rest.rho) == len(whole.rho)
    # only those of frames near by: the scene's features were seen in four frames, of which this view is the first
    frame = int(task.views.frame[view])
    assert len(whole.rho) <= (abs(shed.cloud.seen[:, 0] - frame) <= task.tolerances.witness_frames).sum() < len(shed.cloud.xyz)
    z = shed.cloud.xyz @ task.views.rotation[view][2] + task.views.translation[view][2]
    assert np.isin(np.round(1.0 / whole.rho, 9), np.round(z, 9)).all()
