"""`planewright demo` needs nothing and tells how far off it is."""

import json
from collections.abc import Callable
from pathlib import Path


def test_the_demo_is_near_its_truth(run: Callable, tmp_path: Path) -> None:
    done = run("demo", "--output", tmp_path / "demo", "--quiet")
    assert done.returncode == 0, done.stderr
    assert "against the truth" in done.stdout
    assert {path.name for path in (tmp_path / "demo").iterdir()} == {"errors.json", "input", "model.glb", "reconstruction.json", "report.html", "run.json"}
    errors = json.loads((tmp_path / "demo" / "errors.json").read_text(encoding="utf-8"))
    assert errors["faces_pct"] == errors["points_pct"] == errors["cameras_pct"] == 100
    assert abs(errors["focal_error_pct"]) < 1
    assert errors["rotation_median_deg"] < 0.1
    assert errors["normal_max_deg"] < 1
    assert errors["corner_rms_pct"] < 1
    assert errors["within_2px_pct"] > 80
    assert 0 < errors["plain_lk_within_2px_pct"] < errors["within_2px_pct"]
    assert errors["parallel_recall"] == errors["orthogonal_recall"] == 1
    assert errors["near_misses_enforced"].startswith("0/")
    assert run("demo", "--output", tmp_path / "demo").returncode == 2
