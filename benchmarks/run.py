"""Run `planewright reconstruct` on every workload and write what came of it: figures against the truth, seconds a stage, peak memory.

python -m benchmarks.run [NAME ...] [--group GROUP] [--quick] [--output DIR]
"""

import argparse
import json
import multiprocessing
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.metrics import METRICS, number
from benchmarks.workloads import Workload, recorded, rendered
from benchmarks.workloads.workload import ClipFiles
from planewright.sketch.read import read_sketch
from planewright.synthetic import clip_difficulty, score
from planewright.video.clip import open_clip

Value = TypeVar("Value")


def measure(workload: Workload, folder: Path) -> dict[str, Any]:
    """All figures of one workload."""
    files = in_fresh_process(workload.prepare, folder / "input")
    figures = reconstructed(files, folder / "result")
    figures["status_as_expected"] = int(figures["status"] == workload.expected_status)
    return figures if figures["status"] else figures | in_fresh_process(scored, files, folder / "result")


def reconstructed(files: ClipFiles, result: Path) -> dict[str, Any]:
    """Run the command on a clip into the folder `result` (an earlier one is removed): its status, seconds in all and a stage, peak memory."""
    shutil.rmtree(result, ignore_errors=True)
    command = [*planewright_command(), "reconstruct", str(files.clip), "--sketch", str(files.sketch), "--output", str(result), "--quiet"]
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", errors="replace")
    figures: dict[str, Any] = {
        "status": done.returncode,
        "seconds": round(time.perf_counter() - start, 2),
    }
    if done.returncode:
        figures["said"] = done.stderr.strip()
        return figures
    record = json.loads((result / "run.json").read_text(encoding="utf-8"))
    figures["stages"] = record["seconds"]
    if record.get("peak_memory_bytes"):
        figures["peak_memory_mb"] = round(record["peak_memory_bytes"] / 1e6, 1)
    return figures


def scored(files: ClipFiles, result: Path) -> dict[str, Any]:
    """The figures against all that is known of a clip, and what plain Lucas-Kanade keeps of its corners."""
    found = json.loads((result / "reconstruction.json").read_text(encoding="utf-8"))
    figures: dict[str, Any] = {}
    for file in files.truths:
        truth = json.loads(file.read_text(encoding="utf-8"))
        figures |= score(found, truth)
        if "tracks" in truth:
            hard = clip_difficulty(open_clip(files.clip), read_sketch(files.sketch), truth)
            figures |= {"lk_within_2px_pct": hard.within_2px_pct, "lk_within_5px_pct": hard.within_5px_pct}
    return figures


def in_fresh_process(work: Callable[..., Value], *args: object) -> Value:
    """Do it in a process of its own: Linux counts the memory of the process that starts another into the other's peak, so this one stays small."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(work, *args).result()


def planewright_command() -> list[str]:
    """The command line, run by this interpreter."""
    return [sys.executable, "-c", "from planewright.cli.main import main; main()"]


def table(results: dict[str, dict[str, Any]]) -> str:
    """The figures as a Markdown table, a column a workload."""
    names = list(results)
    lines = ["| figure | unit | " + " | ".join(names) + " |", "|---" * (len(names) + 2) + "|"]
    rows = [("status", ""), ("lk_within_2px_pct", "%, plain Lucas-Kanade"), *((m.key, m.unit) for m in METRICS if m.key != "status_as_expected")]
    for key, unit in rows:
        values = [results[name].get(key) for name in names]
        if any(v is not None for v in values):
            lines.append(f"| {key} | {unit} | " + " | ".join(_short(v) for v in values) + " |")
    stages = list(dict.fromkeys(stage for r in results.values() for stage in r.get("stages", {})))
    for stage in stages:
        lines.append(f"| {stage} | s | " + " | ".join(_short(results[n].get("stages", {}).get(stage)) for n in names) + " |")
    return "\n".join(lines) + "\n"


def _short(value: object) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) and number(value) is not None else f"{number(value):.4g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="workloads to run; all by default")
    parser.add_argument("--group", help="only the workloads of one group: twin, hard, quick, refused, recorded")
    parser.add_argument("--quick", action="store_true", help="only the workloads that take about a minute")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks"), help="where clips, results and tables go")
    args = parser.parse_args()
    workloads = [
        w for w in (*rendered(), *recorded()) if (w.name in args.names or not args.names) and (w.quick or not args.quick) and args.group in (None, w.group)
    ]
    unknown = set(args.names) - {w.name for w in workloads}
    if unknown or not workloads:
        parser.error(f"There is no workload {', '.join(sorted(unknown)) or 'left'}; there are {', '.join(w.name for w in (*rendered(), *recorded()))}.")
    results: dict[str, dict[str, Any]] = {}
    args.output.mkdir(parents=True, exist_ok=True)
    for workload in workloads:
        results[workload.name] = measure(workload, args.output / workload.name)
        summary = {k: results[workload.name].get(k) for k in ("status", "within_2px_pct", "lk_within_2px_pct", "normal_mean_deg", "seconds")}
        print(workload.name, json.dumps(summary), results[workload.name].get("said", ""), flush=True)
        (args.output / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        (args.output / "table.md").write_text(table(results), encoding="utf-8")
    print(table(results))


if __name__ == "__main__":
    main()
