"""The benchmarks' own rules: a worse figure is noticed, noise is not, and what is listed is what the scorer measures."""

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", *words], cwd=ROOT, capture_output=True, text=True, encoding="utf-8")


def compared(folder: Path, before: dict[str, object], now: dict[str, object]) -> subprocess.CompletedProcess[str]:
    (folder / "before.json").write_text(json.dumps({"clip": before}), encoding="utf-8")
    (folder / "now.json").write_text(json.dumps({"clip": now}), encoding="utf-8")
    return run("benchmarks.compare", str(folder / "now.json"), "--baseline", str(folder / "before.json"))


def test_a_worse_figure_fails_and_a_better_one_does_not(tmp_path: Path) -> None:
    before: dict[str, object] = {"normal_mean_deg": 0.5, "within_2px_pct": 90.0, "focal_error_pct": -0.1, "near_misses_enforced": 0.0}
    assert compared(tmp_path, before, before).returncode == 0
    assert compared(tmp_path, before, {**before, "normal_mean_deg": 0.2, "focal_error_pct": 0.01}).returncode == 0
    assert compared(tmp_path, before, {**before, "normal_mean_deg": 0.54}).returncode == 0  # within the tolerance
    for key, value in (
        ("normal_mean_deg", 0.8),
        ("within_2px_pct", 88.0),
        ("focal_error_pct", 0.4),
        ("near_misses_enforced", "1/15"),
        ("within_2px_pct", None),
    ):
        done = compared(tmp_path, before, {**before, key: value})
        assert done.returncode == 1, (key, value)
        assert key in done.stdout


def test_a_baseline_keeps_the_figures_of_a_run_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "now.json").write_text(
        json.dumps({"clip": {"rmse_px": 0.51234567, "corner_worst": "a", "near_misses_enforced": "2/9", "parallel_recall": 1 / 3}}), encoding="utf-8"
    )
    kept = tmp_path / "kept.json"  # and a run is no worse than its own baseline, though that keeps five digits
    assert run("benchmarks.compare", str(tmp_path / "now.json"), "--baseline", str(kept), "--update").returncode == 0
    assert json.loads(kept.read_text(encoding="utf-8")) == {"clip": {"near_misses_enforced": 2.0, "parallel_recall": 0.33333, "rmse_px": 0.51235}}
    assert run("benchmarks.compare", str(tmp_path / "now.json"), "--baseline", str(kept)).stdout.split("\n")[0] == "worse: 0"
