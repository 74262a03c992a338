"""How long things take: each stage a frame by length and size of the clip, one correction by the frames it touches, and where the time goes.

python -m benchmarks.speed [--frames N] [--long N] [--sizes WxH ...] [--repeat N] [--skip PART ...] [--output DIR]

The clip is the toy house (18 faces, 35 points). The long one is the short one filmed there and back again, so that only the length differs.
A small clip runs first, so that no figure holds the compilation of a kernel.
"""

import argparse
import cProfile
import json
import pstats
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import av
import numpy as np

import planewright
from benchmarks.run import in_fresh_process, reconstructed
from benchmarks.speed_page import speed_report, time_against_span
from benchmarks.workloads.workload import ClipFiles
from planewright.arrays import Float
from planewright.corrections import Mark, Session, correct
from planewright.mending import Gap, mend
from planewright.pipeline.corrected import open_session
from planewright.pipeline.machine import machine
from planewright.pipeline.run import reconstruct
from planewright.synthetic import demo_scene, toy_house, write_clip
from planewright.tracking.tracks import State, Tracks
from planewright.video.clip import open_clip
from planewright.video.kept_frames import KeptFrames

PARTS = ("stages", "corrections", "paths", "profile")
TO_TRACKS = ("features", "cameras", "structure", "tracks")
"""From the clip to tracks."""
SPANS = (10, 30, 100, 300)
"""Frames that a correction touches."""
PATH_SPANS = (10, 30, 100, 300, 600, 1000)
"""Frames between two anchors."""
DRIFT = 4.0
"""Pixels by which a trace is off where it arrives."""
DRAG = (3.0, -2.0)
"""Pixels by which a corner is dragged."""


def drawn(size: tuple[int, int], frames: int, folder: Path) -> ClipFiles:
    """The toy house in that size, drawn once."""
    files = ClipFiles(folder / "clip.mp4", folder / "sketch.json", (folder / "truth.json",))
    if not all(file.exists() for file in (files.clip, files.sketch, *files.truths)):
        write_clip(toy_house(frames, size), folder)
    return files


def there_and_back(files: ClipFiles, frames: int, folder: Path) -> ClipFiles:
    """The clip's frames forwards, backwards, forwards, ... until there are that many; encoded once."""
    folder.mkdir(parents=True, exist_ok=True)
    clip, sketch = folder / "clip.mp4", folder / "sketch.json"
    shutil.copyfile(files.sketch, sketch)
    if clip.exists():
        return ClipFiles(clip, sketch, ())
    with av.open(str(files.clip)) as source:
        images = [frame.to_ndarray(format="rgb24") for frame in source.decode(video=0)]
    partial_file = folder / "unfinished.mp4"
    with av.open(str(partial_file), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "23", "preset": "veryfast"})
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        round_trip = 2 * (len(images) - 1)
        for k in range(frames):
            at = k % round_trip
            frame = av.VideoFrame.from_ndarray(images[min(at, round_trip - at)], format="rgb24")
            frame.pts = k
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    partial_file.replace(clip)
    return ClipFiles(clip, sketch, ())


def stages(files: ClipFiles, frames: int, folder: Path, repeat: int) -> dict[str, Any]:
    """Seconds a stage of the fastest of several runs: others on the machine only ever make a run slower."""
    runs = [reconstructed(files, folder / "result") for _ in range(repeat)]
    if any(run["status"] for run in runs):
        return {"frames": frames, "said": runs[0].get("said")}
    fastest = min(runs, key=lambda run: sum(run["stages"].values()))
    to_tracks = sum(fastest["stages"][stage] for stage in TO_TRACKS)
    return {
        "frames": frames,
        "stages": fastest["stages"],
        "ms_per_frame": 1000.0 * to_tracks / frames,
        "peak_memory_mb": fastest.get("peak_memory_mb"),
        "runs": [round(sum(run["stages"][stage] for stage in TO_TRACKS), 2) for run in runs],
    }


@dataclass(eq=False)
class _First:
    """Notes when the first partial answer comes."""

    began: float
    seconds: float | None = None

    def __call__(self, tracks: Tracks) -> None:
        del tracks
        if self.seconds is None:
            self.seconds = time.perf_counter() - self.began


def corrections(files: ClipFiles, frames: int, points: int = 6) -> list[dict[str, Any]]:
    """Each of several corners dragged in the middle of spans of several lengths: seconds to the first partial answer and to the last."""
    session = open_session(files.clip, reconstruct(files.clip, files.sketch))
    list(session.frames.gray(session.frames.numbers))  # decoded and kept, as after a look through the clip
    followed = _followed(session)
    corners = followed[:: max(len(followed) // points, 1)][:points]
    rows: list[dict[str, Any]] = []
    for span in (s for s in SPANS if s <= frames):
        for corner in corners:
            rows.append({"span": span} | one_correction(session, corner, span))
    return rows


def _followed(session: Session) -> list[int]:
    """Points that were measured somewhere, those seen longest first."""
    measured = session.tracks.point_index[session.tracks.state == State.TRACKED]
    count = np.bincount(measured, minlength=len(session.sketch.points))
    return [int(p) for p in np.argsort(-count, kind="stable") if count[p]]


def one_correction(session: Session, corner: int, span: int) -> dict[str, Any]:
    """Drag a corner by `DRAG` in the middle of its frames, in a session that knows `span` frames around."""
    tracks = session.tracks
    mine = np.flatnonzero((tracks.point_index == corner) & (tracks.state == State.TRACKED))
    row = mine[len(mine) // 2]
    frame = int(tracks.frame[row])
    if session.model is not None:
        cameras = session.model.cameras
        first = min(max(frame - span // 2, int(cameras.frame[0])), max(int(cameras.frame[-1]) - span + 1, 0))
        near = (cameras.frame >= first) & (cameras.frame < first + span)
        session = replace(session, model=replace(session.model, cameras=replace(cameras, posed=cameras.posed & near)))
    x, y = tracks.xy[row] + np.array(DRAG)
    worked = time.process_time()
    first_answer = _First(time.perf_counter())
    done = correct(session, Mark(session.sketch.points[corner].id, frame, (float(x), float(y))), preview=first_answer)
    total = time.perf_counter() - first_answer.began
    return {
        "point": session.sketch.points[corner].id,
        "kind": done.kind,
        "frames": len(done.frames),
        "first": first_answer.seconds,
        "seconds": total,
        "processor": time.process_time() - worked,
    }


def paths(files: ClipFiles, truth: Path, frames: int) -> list[dict[str, Any]]:
    """The shortest path between two anchors, by the frames between them.

    The traces from both anchors are the truth with a drift of `DRIFT` pixels over the gap, each the other way: as one finds them after a drag,
    near enough for one window in every frame however long the gap is. (Traces that lose their point double the windows, whatever the gap.)

    files: a clip that shows the frames of `truth` forwards, backwards, ...
    """
    kept = KeptFrames(open_clip(files.clip), max_bytes=600_000_000)
    places = _longest_seen(json.loads(truth.read_text(encoding="utf-8")))
    at = np.arange(frames) % (2 * (len(places) - 1))
    places = places[np.minimum(at, 2 * (len(places) - 1) - at)]
    rows: list[dict[str, Any]] = []
    mend(kept, _gap(places[:5]))  # compiles the kernel
    for span in (s for s in PATH_SPANS if s <= frames):
        gap = _gap(places[:span])
        list(kept.gray(range(span)))  # decoded and kept, as after a look through the clip
        began, worked = time.perf_counter(), time.process_time()
        mend(kept, gap)
        rows.append({"span": span, "seconds": time.perf_counter() - began, "first": None, "processor": time.process_time() - worked})
    return rows


def _longest_seen(truth: Mapping[str, Any]) -> Float[np.ndarray, "frames 2"]:
    """The corner that is visible in most frames."""
    tracks = list(truth["tracks"].values())
    return np.array(max(tracks, key=lambda track: (sum(track["visible"]), sum(track["in_image"])))["xy"], dtype=np.float64)


def _gap(places: Float[np.ndarray, "frames 2"]) -> Gap:
    drift = np.linspace(0.0, 1.0, len(places))[:, None] * np.array([DRIFT, 0.0])
    return Gap(np.arange(len(places)), places + drift, places + drift[::-1])


def profile(files: ClipFiles, rows: int = 24) -> list[dict[str, Any]]:
    """Functions by the time spent in themselves; a compiled kernel is one of them. The profiler makes Python's own part look larger by about a third."""
    watch = cProfile.Profile()
    watch.enable()
    reconstruct(files.clip, files.sketch)
    watch.disable()
    root = str(Path(planewright.__file__).parent)
    entries: dict[Any, Any] = pstats.Stats(watch).stats  # type: ignore[attr-defined]  # a name's calls, own seconds, seconds with all below
    total = sum(own for _, _, own, _, _ in entries.values())
    found: list[dict[str, Any]] = []
    for (file, _, name), (_, calls, own, whole, _) in sorted(entries.items(), key=lambda item: -item[1][2])[:rows]:
        place = Path(file).relative_to(root).as_posix() if file.startswith(root) else Path(file).name
        found.append({"function": f"{place}: {name}" if file != "~" else name, "calls": calls, "own": own, "whole": whole, "share_pct": 100.0 * own / total})
    return found


def sized(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(width), int(height)


def measure(output: Path, frames: int, long: int, sizes: Sequence[tuple[int, int]], repeat: int, parts: Sequence[str]) -> dict[str, Any]:
    """All parts asked for, as the content of `speed.json`."""
    content: dict[str, Any] = {"machine": machine(), "clips": {}}
    small = output / "small"
    if not (small / "clip.mp4").exists():
        write_clip(demo_scene(40), small)
    reconstructed(ClipFiles(small / "clip.mp4", small / "sketch.json", ()), small / "result")
    files = {size: in_fresh_process(drawn, size, frames, output / f"{size[0]}x{size[1]}") for size in sizes}
    base = files[sizes[0]]
    longer = in_fresh_process(there_and_back, base, long, output / "long") if long > frames else base
    if "stages" in parts:
        for size, clip in files.items():
            content["clips"][f"{size[0]}x{size[1]}, {frames} frames"] = stages(clip, frames, output / f"{size[0]}x{size[1]}", repeat)
        if longer is not base:
            content["clips"][f"{sizes[0][0]}x{sizes[0][1]}, {long} frames"] = stages(longer, long, output / "long", 1)
    if "corrections" in parts:
        content["corrections"] = in_fresh_process(corrections, base, frames)
    if "paths" in parts:
        content["paths"] = in_fresh_process(paths, longer, base.truths[0], max(long, frames))
    if "profile" in parts:
        content["profile"] = in_fresh_process(profile, base)
    return content


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--long", type=int, default=3000, help="frames of the long clip; 0 leaves it out")
    parser.add_argument("--sizes", type=sized, nargs="+", default=[(960, 540), (1280, 720), (1920, 1080)], metavar="WxH")
    parser.add_argument("--repeat", type=int, default=3, help="runs of which the fastest counts")
    parser.add_argument("--skip", choices=PARTS, nargs="*", default=[])
    parser.add_argument("--output", type=Path, default=Path("out/speed"))
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    content = measure(args.output, args.frames, args.long, args.sizes, args.repeat, [part for part in PARTS if part not in args.skip])
    content["command"] = " ".join(["python -m benchmarks.speed", *sys.argv[1:]])
    (args.output / "speed.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    for part, what in (("corrections", "a correction"), ("paths", "the shortest path")):
        if content.get(part):
            (args.output / f"{part}.svg").write_text(time_against_span(content[part], what, part == "corrections"), encoding="utf-8")
    page = speed_report(content)
    (args.output / "speed.md").write_text(page, encoding="utf-8")
    print(page)


if __name__ == "__main__":
    main()
