"""What cannot be used is said in sentences, with the status of its kind, and leaves no half of a result behind."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from planewright.synthetic.refusals import rotating_camera, still_camera
from planewright.synthetic.write import write_clip

HOSTILE = ["<script>alert(1)</script>", '"; rm -rf /', "a\nb\r\x1b[31m", "[bold]x[/bold]", "../../etc/passwd", "\u202egnirts", "x" * 10_000]

Edit = Callable[[dict[str, Any]], None]


def refused(outcome, status: int, *needed: str) -> None:
    assert outcome.status == status, outcome.err
    assert "Traceback" not in outcome.err
    assert all(character.isprintable() or character == "\n" for character in outcome.err)
    assert len(outcome.err) < 20_000
    for word in needed:
        assert word in outcome.err, outcome.err


def audio(path: Path) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def video(path: Path, num_frames: int) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 320, 180, "yuv420p"
        for number in range(num_frames):
            frame = av.VideoFrame.from_ndarray(np.random.default_rng(number).integers(0, 255, (180, 320, 3), np.uint8), format="rgb24")
            container.mux(stream.encode(frame))
        if num_frames:
            container.mux(stream.encode(None))


CLIPS: dict[str, Callable[[Path, bytes], Any]] = {
    "no video at all": lambda path, clip: path.write_text("this is not a video"),
    "an empty file": lambda path, clip: path.write_bytes(b""),
    "a truncated video": lambda path, clip: path.write_bytes(clip[: len(clip) // 3]),
    "sound only": lambda path, clip: audio(path),
    "no frame": lambda path, clip: video(path, 0),
    "a folder without images": lambda path, clip: path.mkdir(),
    "a playlist that names another file": lambda path, clip: path.write_text("#EXTM3U\n#EXTINF:1,\n/etc/passwd\n"),
    "nothing": lambda path, clip: None,
}


@pytest.mark.parametrize("kind", CLIPS)
def test_a_clip_that_cannot_be_used_is_refused(planewright, small_clip: Path, tmp_path: Path, kind: str) -> None:
    CLIPS[kind](tmp_path / "clip.mp4", (small_clip / "clip.mp4").read_bytes())
    outcome = planewright("reconstruct", tmp_path / "clip.mp4", "--sketch", small_clip / "sketch.json", "--output", tmp_path / "out")
    refused(outcome, 3, "clip.mp4")
    assert not list((tmp_path / "out").glob("[!.]*"))


def test_one_frame_is_no_clip(planewright, small_clip: Path, tmp_path: Path) -> None:
    video(tmp_path / "clip.mp4", 1)
    (tmp_path / "sketch.json").write_text(
        '{"format": "planewright-sketch", "version": 1, "points": ['
        + ", ".join(f'{{"id": "p{i}", "marks": {{"0": [{100 + 50 * (i % 2)}, {50 + 50 * (i // 2)}]}}}}' for i in range(4))
        + '], "faces": [{"id": "f", "loop": ["p0", "p1", "p3", "p2"]}]}'
    )
    refused(planewright("reconstruct", tmp_path / "clip.mp4", "--sketch", tmp_path / "sketch.json", "--output", tmp_path / "out"), 4)


def other_size(sketch: dict[str, Any]) -> None:
    sketch["image_size"] = [1920, 1080]


def unknown_point(sketch: dict[str, Any]) -> None:
    sketch["edges"].append(["a0", "nobody"])


def two_corners(sketch: dict[str, Any]) -> None:
    sketch["faces"][0]["loop"] = sketch["faces"][0]["loop"][:2]


def on_a_line(sketch: dict[str, Any]) -> None:
    sketch["points"] += [{"id": f"line{i}", "marks": {"12": [50 + 20 * i, 60 + 10 * i]}} for i in range(3)]
    sketch["faces"].append({"id": "flat", "loop": ["line0", "line1", "line2"]})


def outside_the_clip(sketch: dict[str, Any]) -> None:
    sketch["points"][0]["marks"]["5000"] = [10.0, 10.0]


def newer(sketch: dict[str, Any]) -> None:
    sketch["version"] = 2


def another_format(sketch: dict[str, Any]) -> None:
    sketch["format"] = "planewright-reconstruction"


def no_points(sketch: dict[str, Any]) -> None:
    sketch.update(points=[], edges=[], faces=[])


def not_finite(sketch: dict[str, Any]) -> None:
    sketch["points"][0]["marks"] = {"12": [float("nan"), 1.0]}


SKETCHES: dict[str, tuple[Edit, str]] = {
    "another image size": (other_size, "1920x1080"),
    "an unknown point": (unknown_point, "nobody"),
    "a face of two points": (two_corners, "face"),
    "a face on a line": (on_a_line, "flat"),
    "a mark outside the clip": (outside_the_clip, "5000"),
    "a newer version": (newer, "version"),
    "another format": (another_format, "format"),
    "no points": (no_points, "points"),
    "a number that is none": (not_finite, "NaN"),
}


@pytest.mark.parametrize("kind", SKETCHES)
def test_a_sketch_that_cannot_be_used_is_refused(planewright, small_clip: Path, tmp_path: Path, kind: str) -> None:
    edit, word = SKETCHES[kind]
    sketch = json.loads((small_clip / "sketch.json").read_text(encoding="utf-8"))
    edit(sketch)
    (tmp_path / "sketch.json").write_text(json.dumps(sketch), encoding="utf-8")
    refused(planewright("reconstruct", small_clip / "clip.mp4", "--sketch", tmp_path / "sketch.json", "--output", tmp_path / "out"), 3, word)
    refused(planewright("sketch", "check", tmp_path / "sketch.json", "--clip", small_clip / "clip.mp4"), 3, word if kind in STRUCTURAL else "")
    assert not list((tmp_path / "out").glob("[!.]*"))


STRUCTURAL = {"an unknown point", "a face of two points", "a newer version", "another format", "a number that is none"}
"""Found while the file is read; the others are listed one by one by `sketch check`, which ends with their number."""


def test_a_sketch_of_a_million_points_is_refused_early(planewright, small_clip: Path, tmp_path: Path) -> None:
    points = ",".join(f'{{"id":"{i}","marks":{{"0":[1,1]}}}}' for i in range(10**6))
    (tmp_path / "sketch.json").write_text('{"format":"planewright-sketch","version":1,"points":[' + points + "]}")
    refused(planewright("reconstruct", small_clip / "clip.mp4", "--sketch", tmp_path / "sketch.json", "--output", tmp_path / "out"), 3, "sketch.json")


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "null", "\x00\xff", "[" * 100_000, '{"a": ' * 50_000])
def test_a_file_that_is_no_sketch_is_refused(planewright, small_clip: Path, tmp_path: Path, text: str) -> None:
    (tmp_path / "sketch.json").write_bytes(text.encode("latin-1"))
    refused(planewright("sketch", "check", tmp_path / "sketch.json"), 3, "sketch.json")


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_stay_text(planewright, small_clip: Path, tmp_path: Path, name: str) -> None:
    sketch = json.loads((small_clip / "sketch.json").read_text(encoding="utf-8"))
    sketch["faces"][0]["id"] = name
    sketch["points"].append({"id": name, "marks": {"12": [20.0, 20.0]}})
    (tmp_path / "sketch.json").write_text(json.dumps(sketch), encoding="utf-8")
    checked = planewright("sketch", "check", tmp_path / "sketch.json")
    assert checked.status == 0, checked.err
    assert all(character.isprintable() or character == "\n" for character in checked.out + checked.err)
    assert max(map(len, checked.out.splitlines())) < 500
    sketch["edges"].append([name, name + "?"])
    (tmp_path / "sketch.json").write_text(json.dumps(sketch), encoding="utf-8")
    refused(planewright("sketch", "check", tmp_path / "sketch.json"), 3)


def test_a_missing_sketch_is_refused(planewright, small_clip: Path, tmp_path: Path) -> None:
    refused(planewright("reconstruct", small_clip / "clip.mp4", "--sketch", tmp_path / "none.json", "--output", tmp_path / "out"), 3, "none.json")


@pytest.mark.parametrize("frames", ["", "5", "9:2", "a:b", "100:", "0:10:0"])
def test_frames_that_name_none_are_a_fault_of_the_words(planewright, small_clip: Path, tmp_path: Path, frames: str) -> None:
    clip, sketch = small_clip / "clip.mp4", small_clip / "sketch.json"
    refused(planewright("reconstruct", clip, "--sketch", sketch, "--output", tmp_path / "out", "--frames", frames), 2)


def test_a_folder_that_cannot_be_written_is_refused(planewright, small_clip: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for output in (tmp_path / "file", tmp_path / "file" / "out"):
        refused(planewright("reconstruct", small_clip / "clip.mp4", "--sketch", small_clip / "sketch.json", "--output", output), 3, "file")


@pytest.mark.parametrize("make", [rotating_camera, still_camera])
def test_views_that_show_no_depth_are_refused_with_the_reason(planewright, tmp_path: Path, make: Callable[[], Any]) -> None:
    clip, sketch, _ = write_clip(make(), tmp_path / "input")
    outcome = planewright("reconstruct", clip, "--sketch", sketch, "--output", tmp_path / "out", "--quiet")
    refused(outcome, 4, "camera", "tracks.json")
    assert outcome.out == ""
    # No half of a result, but what could be followed without a camera.
    assert [file.name for file in (tmp_path / "out").glob("[!.]*")] == ["tracks.json"]
