"""A clip on disk: every frame is there, twice the same bytes, and the files say what was drawn."""

import json
from pathlib import Path

import av
import numpy as np
import pytest

from planewright.errors import Cancelled, OutputError
from planewright.sketch.read import read_sketch
from planewright.synthetic import demo_scene, draw, write_clip


def test_the_files_hold_the_clip_and_the_same_bytes_every_time(tmp_path: Path) -> None:
    clip = demo_scene(6, (160, 90))
    first, again = write_clip(clip, tmp_path / "a"), write_clip(demo_scene(6, (160, 90)), tmp_path / "b" / "c")
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in again]
    with av.open(str(first[0])) as container:
        images = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(images) == clip.num_frames
    drawn = [clip.renderer.frame(k).astype(float) for k in range(clip.num_frames)]
    away = np.array([[np.abs(image - other).mean() for other in drawn] for image in images])
    assert away.argmin(axis=1).tolist() == list(range(clip.num_frames))
    assert away.diagonal().max() < 12.0
    assert read_sketch(first[1]).faces == draw(clip, np.random.default_rng((0, 2))).faces
    assert json.loads(first[2].read_text(encoding="utf-8"))["format"] == "planewright-truth"


def test_who_stops_the_drawing_is_obeyed(tmp_path: Path) -> None:
    def stop(title: str, done: int, total: int | None) -> None:
        if done == 2:
            raise Cancelled("Stopped.")

    with pytest.raises(Cancelled):
        write_clip(demo_scene(6, (160, 90)), tmp_path, progress=stop)
    assert not list(tmp_path.glob("*.mp4")) and not list(tmp_path.glob(".*"))


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file", encoding="utf-8")
    with pytest.raises(OutputError, match="taken"):
        write_clip(demo_scene(6, (160, 90)), tmp_path / "taken")
