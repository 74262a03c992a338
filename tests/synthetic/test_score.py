"""The scorer: perfect for the truth itself in any frame and scale, and each figure moves by what was put in."""

import copy
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planewright.geometry.rigid import rotations_from_vectors
from planewright.synthetic import demo_scene, truth
from planewright.synthetic.score import close, score


@pytest.fixture(scope="module")
def known() -> dict[str, Any]:
    return truth(demo_scene(12, (320, 180)))


def as_found(known: dict[str, Any], scale: float = 2.3, seed: int = 5) -> dict[str, Any]:
    """The truth as a reconstruction, in another frame and scale."""
    rng = np.random.default_rng(seed)
    turn, shift = rotations_from_vectors(rng.normal(size=(1, 3)))[0], rng.normal(size=3)
    frames, faces = [], []
    for f in known["frames"]:
        rotation, translation = (np.array(f["cam_from_world"][k]) for k in ("rotation", "translation"))
        moved = rotation @ turn.T
        frames.append({"index": f["index"], "cam_from_world": {"rotation": moved.tolist(), "translation": (scale * translation - moved @ shift).tolist()}})
    for f in known["faces"]:
        normal = turn @ np.array(f["normal"])
        faces.append({**f, "normal": normal.tolist(), "offset": scale * f["offset"] + float(normal @ shift)})
    return {
        "camera": copy.deepcopy(known["camera"]),
        "frames": frames,
        "faces": faces,
        "points": [{"id": p["id"], "xyz": (scale * turn @ np.array(p["xyz"]) + shift).tolist()} for p in known["points"]],
        "relations": [{"kind": k, "faces": pair, "state": "enforced"} for k, pairs in known["relations"].items() for pair in pairs],
        "tracks": {
            k: {str(i): {"xy": xy, "sigma": 1.0, "state": "tracked"} if seen else {"state": "hidden"} for i, (xy, seen) in enumerate(rows)}
            for k, t in known["tracks"].items()
            for rows in [list(zip(t["xy"], t["visible"], strict=True))]
        },
        "report": {"corrections": 0},
    }


def test_the_truth_scores_perfectly_in_any_frame_and_scale(known: dict[str, Any]) -> None:
    figures = score(as_found(known), known)
    for key in ("rmse_px", "ate_pct", "rotation_max_deg", "focal_error_pct", "corner_max_pct", "normal_max_deg", "offset_median_pct", "relation_residual_max"):
        assert_allclose(figures[key], 0.0, atol=1e-9, err_msg=key)
    for key in ("within_1px_pct", "claimed_pct", "cameras_pct", "points_pct", "faces_pct", "coverage95_pct"):
        assert figures[key] == 100.0, key
    for key in ("visibility_f1", "hidden_f1", "faces_found_f1", *(f"{k}_{x}" for k in ("parallel", "orthogonal", "coplanar") for x in ("precision", "recall"))):
        assert figures[key] == 1.0, key
    assert figures["near_misses_enforced"] == f"0/{len(known['near_misses'])}"


def test_an_error_comes_out_as_large_as_it_was_put_in(known: dict[str, Any]) -> None:
    found = as_found(known)
    found["camera"]["focal"] = [1.01 * f for f in found["camera"]["focal"]]
    for track in found["tracks"].values():
        for entry in track.values():
            if "xy" in entry:
                entry["xy"] = [entry["xy"][0] + 1.8, entry["xy"][1] - 2.4]
    normal = np.array(found["faces"][0]["normal"])
    aside = np.cross(normal, [0.3, 0.5, -0.7])
    found["faces"][0]["normal"] = (np.cos(0.02) * normal + np.sin(0.02) * aside / np.linalg.norm(aside)).tolist()
    figures = score(found, known)
    assert_allclose(figures["focal_error_pct"], 1.0)
    assert_allclose([figures["rmse_px"], figures["median_px"]], 3.0)
    assert (figures["within_2px_pct"], figures["within_5px_pct"], figures["coverage95_pct"]) == (0.0, 100.0, 0.0)
    assert_allclose(figures["normal_max_deg"], np.degrees(0.02))
    assert figures["normal_worst"] == known["faces"][0]["id"]


def test_what_is_not_claimed_counts_as_missed(known: dict[str, Any]) -> None:
    found = as_found(known)
    for k in list(found["tracks"])[::2]:
        del found["tracks"][k]
    figures = score(found, known)
    left = sum(sum(known["tracks"][k]["visible"]) for k in found["tracks"])
    assert_allclose(figures["within_1px_pct"], 100.0 * left / sum(sum(t["visible"]) for t in known["tracks"].values()))


def test_a_near_miss_that_is_enforced_costs_precision_and_is_counted(known: dict[str, Any]) -> None:
    found = as_found(known)
    near = known["near_misses"][0]
    found["relations"].append({"kind": near["kind"].removeprefix("near_"), "faces": [near["a"], near["b"]], "state": "enforced"})
    figures = score(found, known)
    assert not figures["near_misses_enforced"].startswith("0/")
    assert min(figures["parallel_precision"], figures["orthogonal_precision"]) < 1.0
    assert figures["relation_residual_max"] > 0.05


def test_relations_carry_over_to_parallels() -> None:
    implied = close(["a", "b", "c", "d"], [("coplanar", "a", "b"), ("parallel", "b", "c"), ("orthogonal", "c", "d")])
    assert implied["parallel"] == {frozenset(p) for p in ("ab", "bc", "ac")}
    assert implied["coplanar"] == {frozenset("ab")}
    assert implied["orthogonal"] == {frozenset(p) for p in ("ad", "bd", "cd")}


@pytest.mark.parametrize("fault", ["nan", "long normal", "twice"])
def test_a_malformed_file_is_refused_with_a_sentence(known: dict[str, Any], fault: str) -> None:
    found = as_found(known)
    if fault == "nan":
        found["points"][0]["xyz"][1] = float("nan")
    elif fault == "long normal":
        found["faces"][1]["normal"] = [1.0, 1.0, 0.0]
    else:
        found["points"].append(found["points"][0])
    figures = score(found, known)
    assert list(figures) == ["refused"]
    assert str(figures["refused"]).endswith(".")


def test_marked_tracks_and_known_shapes_are_scored(known: dict[str, Any]) -> None:
    found = as_found(known)
    points = {p["id"]: np.array(p["xyz"]) for p in known["points"]}
    tracks = {
        "format": "planewright-truth-tracks",
        "tracks": {k: {str(i): xy for i, xy in enumerate(t["xy"]) if t["visible"][i]} for k, t in known["tracks"].items()},
    }
    assert score(found, tracks)["within_1px_pct"] == 100.0
    shape = {
        "format": "planewright-truth-shape",
        "angles": [{"faces": ["front", "far_side"], "deg": 90.0}, {"faces": ["front", "pane"], "deg": 3.0}],
        "edge_lengths": [{"edge": [a, b], "length": float(np.linalg.norm(points[a] - points[b]))} for a, b in (("a0", "a1"), ("a0", "b0"), ("w0", "w1"))],
    }
    figures = score(found, shape)
    assert_allclose([figures["angle_error_max_deg"], figures["angle_error_median_deg"], figures["length_error_max_pct"]], [3.0, 1.5, 0.0], atol=1e-9)
