"""Pictures of the model: the camera stands where it is said to stand, and the whole model is in the picture."""

import numpy as np

from planewright.pipeline.result import Result
from planewright.pipeline.views import SIZE, any_right, look_at, model_views


def test_a_camera_that_looks_at_a_point_has_it_in_its_centre_and_stands_upright() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        center, target, up = rng.normal(size=(3, 3))
        up /= np.linalg.norm(up)
        pose = look_at(center, target, up)
        x, y, z = pose.apply(target[None])[0]
        np.testing.assert_allclose([x, y], 0.0, atol=1e-9)
        assert z > 0
        np.testing.assert_allclose(pose.apply(center[None])[0], 0.0, atol=1e-9)
        np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose.rotation) > 0
        assert (pose.rotation @ up)[1] < 0
        np.testing.assert_allclose(any_right(up) @ up, 0.0, atol=1e-12)


def test_there_are_three_sides_textured_and_shaded(true_result: Result) -> None:
    views = model_views(true_result.model, true_result.cameras)
    assert [view.title.split(",")[0] for view in views] == ["Textured"] * 3 + ["Shaded"] * 3
    assert all((view.width, view.height) == SIZE and view.image for view in views)
