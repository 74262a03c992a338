"""`reconstruction.json` says what was found, to the last digit, and the same things always in the same bytes."""

import json
from dataclasses import replace

import numpy as np
import pytest

from planewright.pipeline.result import Result, document, normal_sigmas_deg, reprojection_errors, to_json
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.observe import truth
from planewright.synthetic.score import score
from planewright.tracking.tracks import Tracks

NOISE = 0.4


def test_the_truth_scores_as_the_truth(true_result: Result, scene_clip: SyntheticClip) -> None:
    figures = score(json.loads(to_json(document(true_result))), json.loads(json.dumps(truth(scene_clip))))
    assert "refused" not in figures
    assert figures["focal_error_pct"] == 0
    assert figures["rotation_max_deg"] < 1e-6
    assert figures["normal_max_deg"] < 1e-6
    assert figures["corner_rms_pct"] < 1e-6
    assert figures["planarity_max"] < 1e-12
    assert 90 < figures["coverage95_pct"] < 99
    assert figures["sigma_median_px"] == pytest.approx(NOISE)
    assert figures["visibility_f1"] == 1


def test_numbers_come_back_to_the_last_bit(true_result: Result) -> None:
    back = json.loads(to_json(document(true_result)))
    np.testing.assert_array_equal([point["xyz"] for point in back["points"]], true_result.scene.points)
    np.testing.assert_array_equal([face["normal"] for face in back["faces"]], true_result.scene.normals)
    np.testing.assert_array_equal([frame["cam_from_world"]["rotation"] for frame in back["frames"]], true_result.cameras.rotation)


def test_the_error_of_reprojection_is_the_noise(true_result: Result) -> None:
    _, errors = reprojection_errors(true_result)
    assert np.sqrt((errors**2).mean()) == pytest.approx(NOISE * np.sqrt(2), rel=0.1)


def test_sigmas_of_normals_are_those_of_their_worst_tilt(true_result: Result) -> None:
    scene = true_result.scene
    covariance = scene.plane_covariance.copy()
    covariance[3:5, 3:5] = np.diag(np.radians([0.5, 2.0]) ** 2)
    sigmas = normal_sigmas_deg(replace(scene, plane_covariance=covariance))
    np.testing.assert_allclose(sigmas[0], np.degrees(1e-3))
    np.testing.assert_allclose(sigmas[1], 2.0)


def test_what_is_not_known_is_left_out_or_null_and_never_a_number(true_result: Result) -> None:
    scene, cameras = true_result.scene, true_result.cameras
    known, faces, posed = scene.point_known.copy(), scene.face_known.copy(), cameras.posed.copy()
    known[2] = faces[1] = posed[3] = False
    points, normals, offsets = scene.points.copy(), scene.normals.copy(), scene.offsets.copy()
    points[2], normals[1], offsets[1] = np.nan, np.nan, np.nan
    covariance = scene.point_covariance.copy()
    covariance[0] = np.nan
    plane_covariance = scene.plane_covariance.copy()
    plane_covariance[:3] = plane_covariance[:, :3] = np.nan
    track_covariance = true_result.tracks.covariance.copy()
    track_covariance[0] = np.nan
    tracks = true_result.tracks
    poorer = replace(
        true_result,
        cameras=replace(cameras, posed=posed, focal_sigma=float("inf"), focal_interval=(100.0, None)),
        tracks=Tracks(tracks.point_index, tracks.frame, tracks.xy, track_covariance, tracks.state),
        structure=replace(
            true_result.structure,
            scene=replace(
                scene,
                points=points,
                point_known=known,
                normals=normals,
                offsets=offsets,
                face_known=faces,
                point_covariance=covariance,
                plane_covariance=plane_covariance,
            ),
        ),
    )
    back = json.loads(to_json(document(poorer)))
    assert len(back["points"]) == len(points) - 1
    assert len(back["faces"]) == len(normals) - 1
    assert [frame["index"] for frame in back["frames"]] == [k for k in range(24) if k != 3]
    assert back["camera"]["focal_sigma"] is None
    assert back["camera"]["focal_interval"] == [100.0, None]
    assert back["points"][0]["sigma"] is None
    assert back["report"]["planes"] == len(normals) - 1


@pytest.mark.parametrize("text", ["<script>", '"\\', "a\nb", "\ud800", "\u2028", "é" * 5000])
def test_any_name_comes_back(renamed, text: str) -> None:
    back = json.loads(to_json(document(renamed(text))))
    assert back["clip"]["name"] == text
    assert back["points"][0]["id"] == f"{text}0"
    assert f"{text}0" in back["tracks"]


def test_numbers_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="JSON"):
        to_json({"a": float("nan")})
