"""`planewright sketch check` says what a drawing holds."""

import json
from pathlib import Path


def test_it_counts_and_names_what_was_drawn(planewright, small_clip: Path) -> None:
    sketch = json.loads((small_clip / "sketch.json").read_text(encoding="utf-8"))
    outcome = planewright("sketch", "check", small_clip / "sketch.json", "--clip", small_clip / "clip.mp4")
    assert outcome.status == 0
    assert f"{len(sketch['points'])} points" in outcome.out
    assert f"{len(sketch['faces'])} faces" in outcome.out
    for face in sketch["faces"]:
        assert f"face {face['id']} (given)" in outcome.out


def test_faces_are_found_where_none_are_given(planewright, small_clip: Path, tmp_path: Path) -> None:
    sketch = json.loads((small_clip / "sketch.json").read_text(encoding="utf-8"))
    del sketch["faces"]
    (tmp_path / "sketch.json").write_text(json.dumps(sketch), encoding="utf-8")
    outcome = planewright("sketch", "check", tmp_path / "sketch.json")
    assert outcome.status == 0
    assert "(found)" in outcome.out
