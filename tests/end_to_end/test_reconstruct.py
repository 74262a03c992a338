"""Clip in, model out, by the real command line: near the truth, whole, the same every time, and resumable."""

import json
import os
import re
import signal
import subprocess
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from planewright import read_sketch
from planewright.export.formats import read_result_model
from planewright.synthetic.score import score

Start = Callable[..., "subprocess.Popen[str]"]
Run = Callable[..., "subprocess.CompletedProcess[str]"]


def words(small_clip: Path, output: Path, *more: str) -> list[str]:
    return ["reconstruct", str(small_clip / "clip.mp4"), "--sketch", str(small_clip / "sketch.json"), "--output", str(output), *more]


@pytest.fixture(scope="session")
def reconstructed(run: Run, small_clip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished result of the small clip, made with one thread."""
    folder = tmp_path_factory.mktemp("reconstructed") / "result"
    done = run(*words(small_clip, folder, "--threads", "1"))
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="session")
def document(reconstructed: Path) -> dict:
    return json.loads((reconstructed / "reconstruction.json").read_text(encoding="utf-8"))


def test_the_folder_holds_the_result_and_nothing_else(reconstructed: Path) -> None:
    assert sorted(path.name for path in reconstructed.iterdir()) == ["model.glb", "reconstruction.json", "report.html", "run.json"]


def test_the_result_is_near_the_truth(document: dict, small_clip: Path) -> None:
    figures = score(document, json.loads((small_clip / "truth.json").read_text(encoding="utf-8")))
    assert "refused" not in figures
    # The clip is too short to show every corner; of what was drawn nothing is missing.
    assert len(document["faces"]) == len(read_sketch(small_clip / "sketch.json").faces) >= 6
    assert figures["cameras_pct"] == 100
    assert abs(figures["focal_error_pct"]) < 3
    assert figures["rotation_median_deg"] < 0.2
    assert figures["normal_max_deg"] < 2
    assert figures["median_px"] < 1.5


def test_relations_and_planes_hold_exactly(document: dict, small_clip: Path) -> None:
    figures = score(document, json.loads((small_clip / "truth.json").read_text(encoding="utf-8")))
    assert figures["planarity_max"] < 1e-9
    assert figures["relation_residual_max"] < 1e-9


def test_the_document_keeps_its_format(document: dict, small_clip: Path) -> None:
    assert (document["format"], document["version"]) == ("planewright-reconstruction", 1)
    assert {"clip", "camera", "frames", "points", "tracks", "faces", "adjacency", "relations", "report"} <= set(document)
    assert document["clip"]["name"] == "clip.mp4"
    assert (document["clip"]["image_size"], document["clip"]["num_frames"]) == ([320, 180], 24)
    low, high = document["camera"]["focal_interval"]
    assert low < document["camera"]["focal"][0] < high
    for frame in document["frames"]:
        rotation = np.array(frame["cam_from_world"]["rotation"])
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    sketch = read_sketch(small_clip / "sketch.json")
    for point in sketch.points:
        for frame, xy in point.marks.items():
            entry = document["tracks"][point.id][str(frame)]
            assert entry["state"] == "marked"
            assert np.hypot(*np.subtract(entry["xy"], xy)) < 6
    for entries in document["tracks"].values():
        assert list(map(int, entries)) == sorted(map(int, entries))
        assert all(entry["sigma"] > 0 for entry in entries.values() if entry["state"] in ("marked", "tracked", "bridged"))


def test_the_model_stands_on_the_corners(document: dict, reconstructed: Path) -> None:
    model = read_result_model(reconstructed)
    assert {face.id for face in model.faces} == {face["id"] for face in document["faces"]}
    assert model.atlas.std() > 5


class Reader(HTMLParser):
    """What a browser would run or fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.scripts, self.images, self.outside = 0, 0, []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.scripts += tag == "script" or any(name.startswith("on") for name, _ in attrs)
        for name, value in attrs:
            if name in ("href", "src", "xlink:href") and value is not None:
                self.images += value.startswith("data:image/jpeg;base64,")
                self.outside += [] if value.startswith("data:image/jpeg;base64,") else [value]


def test_the_report_is_one_page_that_runs_and_fetches_nothing(reconstructed: Path) -> None:
    reader = Reader()
    page = (reconstructed / "report.html").read_text(encoding="utf-8")
    reader.feed(page)
    assert reader.scripts == 0
    assert reader.outside == []
    assert "url(" not in page
    # The sketch, the trails, at least 8 frames with the model over them, and the model from three sides, textured and shaded.
    assert reader.images >= 2 + 8 + 6


def test_the_run_tells_what_it_took(reconstructed: Path) -> None:
    run = json.loads((reconstructed / "run.json").read_text(encoding="utf-8"))
    assert {"seconds", "peak_memory_bytes", "versions", "options", "seed", "machine"} <= set(run)
    assert all(seconds >= 0 for seconds in run["seconds"].values())


def test_no_path_of_this_machine_is_in_the_result(reconstructed: Path, small_clip: Path) -> None:
    for path in reconstructed.iterdir():
        content = path.read_bytes()
        assert str(small_clip).encode() not in content
        assert str(Path.home()).encode() + b"/" not in content


def test_the_same_input_gives_the_same_bytes_on_any_number_of_threads(run: Run, reconstructed: Path, small_clip: Path, tmp_path: Path) -> None:
    done = run(*words(small_clip, tmp_path / "again", "--threads", "2", "--quiet"))
    assert done.returncode == 0, done.stderr
    assert (done.stdout, done.stderr) == ("", "")
    for name in ("reconstruction.json", "model.glb"):
        assert (tmp_path / "again" / name).read_bytes() == (reconstructed / name).read_bytes(), name


def test_a_finished_result_is_refused_unless_forced(run: Run, reconstructed: Path, small_clip: Path) -> None:
    before = (reconstructed / "reconstruction.json").stat().st_mtime_ns
    done = run(*words(small_clip, reconstructed))
    assert done.returncode == 2
    assert "--force" in done.stderr
    assert (reconstructed / "reconstruction.json").stat().st_mtime_ns == before


def test_a_result_is_exported_by_its_folder(run: Run, reconstructed: Path, tmp_path: Path) -> None:
    assert run("export", reconstructed, "--format", "obj", "--output", tmp_path / "model.obj").returncode == 0
    assert (tmp_path / "model.obj").read_text(encoding="utf-8").count("\nv ") > 10
    assert run("export", reconstructed, "--format", "obj", "--output", tmp_path / "model.obj").returncode == 2
    assert run("export", reconstructed, "--format", "stl9", "--output", tmp_path / "model.x").returncode == 2
    assert run("export", tmp_path, "--format", "obj", "--output", tmp_path / "other.obj").returncode == 3


@pytest.mark.skipif(os.name == "nt", reason="Windows sends Ctrl-C to a console, not to a process")
def test_a_run_stopped_at_any_moment_ends_with_130_and_goes_on_to_the_same_bytes(
    start: Start, run: Run, reconstructed: Path, small_clip: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "stopped"
    moments = ["Reading the clip", "Following features", "Posing keyframes", "Refining", "Drawing the report"]
    for moment in moments:
        with start(*words(small_clip, folder, "--json")) as process:
            assert process.stdout is not None
            for line in process.stdout:
                if re.search(moment, json.loads(line).get("step", "")):
                    break
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=60)
        assert process.returncode == 130, (moment, error)
        assert "Traceback" not in error
        assert not (folder / "reconstruction.json").exists()
    done = run(*words(small_clip, folder))
    assert done.returncode == 0, done.stderr
    assert {"features", "cameras", "structure"} <= set(json.loads((folder / "run.json").read_text(encoding="utf-8"))["resumed"])
    assert sorted(path.name for path in folder.iterdir()) == sorted(path.name for path in reconstructed.iterdir())
    for name in ("reconstruction.json", "model.glb"):
        assert (folder / name).read_bytes() == (reconstructed / name).read_bytes(), name


@pytest.mark.skipif(os.name == "nt", reason="Windows sends Ctrl-C to a console, not to a process")
@pytest.mark.parametrize("module", ["typer", "numpy", "llvmlite.binding", "planewright.pipeline.run"])
def test_a_run_stopped_while_it_loads_ends_with_130(start: Start, small_clip: Path, tmp_path: Path, module: str) -> None:
    with start(*words(small_clip, tmp_path / "stopped"), python=("-X", "importtime")) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if line.split("|")[-1].strip() == module:
                break
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
    assert process.returncode == 130, error
    assert "Traceback" not in error
