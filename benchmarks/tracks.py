"""How well corners are followed: planewright beside plain ways to follow them, on the same frames and the same marks, against the truth.

python -m benchmarks.tracks [NAME ...] [--group twin|hard|recorded] [--output DIR] [--users N] [--from-scratch] [--no-baselines]

Every claim is marked as kept or not; status 1 where one is not. Recorded clips with full truth stand among the twins; `recorded` are those marked by hand.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.baselines import BASELINES, sweep
from benchmarks.corners import corner_errors
from benchmarks.run import in_fresh_process, reconstructed
from benchmarks.simulated_user import SPOT, UserOptions, corrected_by_users
from benchmarks.tables import CURVE, tracks_report
from benchmarks.workloads import Workload, recorded, rendered
from benchmarks.workloads.workload import ClipFiles
from planewright.sketch.read import read_sketch
from planewright.synthetic.score import score_tracks
from planewright.video.clip import open_clip

GROUPS = ("twin", "hard", "recorded")

LEFT_OUT = {"cmu_house": ("gt3", "gt23", "gt24")}
"""Marked by hand, but in no drawn face and on one drawn edge at most: nothing in the drawing says where they are."""

Found = dict[str, Any]
"""point -> frame -> entry, as in `reconstruction.json`."""


@dataclass(frozen=True)
class Known:
    """A clip, and the true tracks of its corners."""

    files: ClipFiles
    truth: Mapping[str, Any]
    group: str


def known_of(workload: Workload, files: ClipFiles) -> Known | None:
    """None where nothing is known of where corners are. Recorded clips whose corners are known exactly stand among the twins."""
    for file in files.truths:
        content = json.loads(file.read_text(encoding="utf-8"))
        if "tracks" in content:
            group = "twin" if workload.group == "recorded" and content["format"] == "planewright-truth" else workload.group
            left_out = LEFT_OUT.get(workload.name, ())
            return Known(files, {k: v for k, v in content["tracks"].items() if k not in left_out}, group)
    return None


def figures_of(found: Found, truth: Mapping[str, Any]) -> dict[str, Any]:
    """The figures of `score_tracks`, and the share of corners whose median error is at most 2 px."""
    errors = corner_errors(found, truth)
    medians = np.array(list(errors.medians().values()))
    return score_tracks(found, truth) | {
        "corners": len(medians),
        "good_corners_pct": 100.0 * float((medians <= SPOT).mean()) if len(medians) else None,
        "bad_corners": {corner: _number(median) for corner, median in errors.medians().items() if median > SPOT},
        "curve": [round(errors.within(pixels), 2) for pixels in CURVE],
    }


def _number(value: float) -> float | None:
    """Rounded; None where it is infinite, which JSON has no word for."""
    return round(value, 2) if np.isfinite(value) else None


def measure(workload: Workload, known: Known, folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Figures of one clip: ours, the baselines', the simulated user's. Tracks are kept in `folder`."""
    run = reconstructed(known.files, folder / "result")
    figures: dict[str, Any] = {"group": known.group, "status": run["status"], "said": run.get("said"), "stages": run.get("stages", {})}
    frames = (
        max(len(next(iter(known.truth.values())).get("xy", ())), 1) if known.group != "recorded" else 1 + max(int(k) for v in known.truth.values() for k in v)
    )
    figures["frames"] = frames
    found = tracks_of(folder)
    if run["status"] == 0:
        figures["ours"] = figures_of(found, known.truth)
        seconds = sum(run["stages"].get(stage, 0.0) for stage in ("features", "cameras", "structure", "tracks"))
        figures["seconds_to_tracks"] = round(seconds, 3)
        figures["ours"]["ms_per_frame"] = 1000.0 * seconds / frames
    if options.baselines:
        figures["baselines"] = {name: figures_of(found, known.truth) for name, found in in_fresh_process(follow, known.files, folder).items()}
    if options.users and run["status"] == 0 and known.group != "recorded":
        user = UserOptions(from_scratch=options.from_scratch)
        done = in_fresh_process(corrected_by_users, known.files, known.truth, options.users, user)
        figures["users"] = done
        for key, policy in (("corrections", "worst first"), ("corrections_listed", "list followed")):
            # Whoever gave up, or was shown nothing wrong though much was, counts as one who lost patience.
            counts = [d[policy]["corrections"] if d[policy]["satisfied"] else user.patience for d in done if policy in d]
            figures["ours"][key] = float(np.median(counts)) if counts else None
    return figures


def tracks_of(folder: Path) -> Found:
    """The tracks of a clip's result; none where there is no result."""
    file = folder / "result" / "reconstruction.json"
    return json.loads(file.read_text(encoding="utf-8"))["tracks"] if file.exists() else {}


def follow(files: ClipFiles, folder: Path) -> dict[str, Found]:
    """What each baseline finds; kept beside the result, so that clips can be pooled."""
    clip, sketch = open_clip(files.clip), read_sketch(files.sketch)
    images = [image for _, image in clip.gray(clip.numbers)]
    paths = {name: sweep(images, sketch, make(sketch), together=name != "LK corners") for name, make in BASELINES.items()}
    np.savez_compressed(folder / "baselines.npz", ids=[point.id for point in sketch.points], **paths)
    return baselines_of(folder)


def baselines_of(folder: Path) -> dict[str, Found]:
    """What `follow` kept, as claims without a sigma."""
    with np.load(folder / "baselines.npz") as kept:
        return {
            name: {
                str(point): {str(k): {"xy": xy.tolist(), "state": "tracked"} for k, xy in enumerate(path) if np.isfinite(xy).all()}
                for point, path in zip(kept["ids"], kept[name], strict=True)
            }
            for name in BASELINES
        }


def pooled(results: Mapping[str, Any], known: Mapping[str, Known], output: Path, group: str) -> dict[str, Any]:
    """The same figures over all corner-frames of a group's clips; a clip without a result counts as missed throughout."""
    names = [name for name, figures in results.items() if figures["group"] == group]
    truth = {f"{name}/{point}": track for name in names for point, track in known[name].truth.items()}
    ours = {f"{name}/{point}": track for name in names for point, track in tracks_of(output / name).items()}
    total: dict[str, Any] = {"ours": figures_of(ours, truth)}
    ran = [results[name] for name in names if results[name]["status"] == 0]
    if ran:
        total["ours"]["ms_per_frame"] = 1000.0 * sum(r["seconds_to_tracks"] for r in ran) / sum(r["frames"] for r in ran)
    if all("baselines" in results[name] for name in names):
        total["baselines"] = {}
        for baseline in BASELINES:
            tracks = {f"{name}/{point}": track for name in names for point, track in baselines_of(output / name)[baseline].items()}
            total["baselines"][baseline] = figures_of(tracks, truth)
    return total


def chosen(names: Sequence[str], group: str | None) -> list[Workload]:
    """The workloads that the command line asks for; all groups with true tracks by default."""
    there = [*rendered(), *recorded()]
    if names:
        return [w for w in there if w.name in names]
    return [w for w in there if w.group in GROUPS]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="clips to run; all of the groups by default")
    parser.add_argument("--group", choices=GROUPS, help="only the clips of one group")
    parser.add_argument("--output", type=Path, default=Path("out/tracks"), help="where clips, results and the table go")
    parser.add_argument("--no-baselines", dest="baselines", action="store_false", help="planewright alone")
    parser.add_argument("--users", type=int, default=0, metavar="N", help="let N simulated users correct each clip")
    parser.add_argument("--from-scratch", action="store_true", help="each correction is a new mark in the sketch and a run from the beginning")
    args = parser.parse_args()
    workloads = chosen(args.names, args.group)
    missing = set(args.names) - {w.name for w in workloads}
    if missing or not workloads:
        parser.error(f"There is no clip {', '.join(sorted(missing)) or 'left'}; there are {', '.join(w.name for w in chosen((), None))}.")
    args.output.mkdir(parents=True, exist_ok=True)
    results: dict[str, Any] = {}
    known: dict[str, Known] = {}
    for workload in workloads:
        folder = args.output / workload.name
        folder.mkdir(exist_ok=True)
        what = known_of(workload, in_fresh_process(workload.prepare, folder / "input"))
        if what is None or (args.group and what.group != args.group):
            continue
        known[workload.name] = what
        results[workload.name] = measure(workload, what, folder, args)
        summary = {k: results[workload.name].get("ours", {}).get(k) for k in ("rmse_px", "median_px", "within_2px_pct", "good_corners_pct", "corrections")}
        print(workload.name, results[workload.name]["status"], json.dumps(summary), results[workload.name]["said"] or "", flush=True)
        (args.output / "tracks.json").write_text(json.dumps({"clips": results}, indent=1) + "\n", encoding="utf-8")
    totals = {group: pooled(results, known, args.output, group) for group in dict.fromkeys(r["group"] for r in results.values())}
    content = {"clips": results, "totals": totals, "command": " ".join(["python -m benchmarks.tracks", *sys.argv[1:]])}
    (args.output / "tracks.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    page, kept = tracks_report(content)
    (args.output / "tracks.md").write_text(page, encoding="utf-8")
    print(page)
    sys.exit(0 if kept else 1)


if __name__ == "__main__":
    main()
