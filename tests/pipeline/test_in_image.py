"""A clip that sets no cameras still gives tracks, and they can be corrected."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planewright.corrections import Mark, correct
from planewright.errors import GeometryError
from planewright.pipeline.in_image import TRACKS_FILE, ImageTracks, follow_in_image, open_image_session, told, tracks_document
from planewright.pipeline.result import to_json
from planewright.pipeline.run import reconstruct
from planewright.sketch.graph import PointId, Sketch, SketchPoint
from planewright.sketch.read import read_sketch
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.observe import true_tracks
from planewright.synthetic.refusals import rotating_camera
from planewright.synthetic.write import write_clip
from planewright.tracking.tracks import State

LONE = SketchPoint(PointId("lone"), {3: (20.0, 20.0)})
"""In no face: nothing follows it."""


@pytest.fixture(scope="module")
def clip() -> SyntheticClip:
    return rotating_camera()


@pytest.fixture(scope="module")
def files(clip: SyntheticClip, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Sketch]:
    file, drawing, _ = write_clip(clip, tmp_path_factory.mktemp("turning"))
    sketch = read_sketch(drawing)
    return file, replace(sketch, points=(*sketch.points, LONE))


@pytest.fixture(scope="module")
def found(files: tuple[Path, Sketch]) -> ImageTracks:
    return follow_in_image(*files)


def test_corners_before_a_turning_camera_move_as_they_do(clip: SyntheticClip, found: ImageTracks) -> None:
    """Where a corner is in the frame in which it was marked, is the mark's and the lines' business; its way from there is the faces'."""
    xy, visible, _ = true_tracks(clip)
    row = {point: i for i, point in enumerate(clip.scene.points)}
    tracks, away, seen = found.tracks, [], 0
    for i, point in enumerate(found.sketch.points[:-1]):
        mine = np.flatnonzero((tracks.point_index == i) & np.isin(tracks.state, (State.TRACKED, State.MARKED)))
        mine = mine[visible[row[point.id], tracks.frame[mine]]]
        off = tracks.xy[mine] - xy[row[point.id], tracks.frame[mine]]
        away.append(np.linalg.norm(off - np.median(off, axis=0), axis=1))
        seen += len(mine)
    assert seen > 0.9 * visible.sum()
    assert np.median(np.concatenate(away)) < 0.2
    assert np.concatenate(away).max() < 1.5


def test_what_was_followed_is_written_and_a_point_of_no_face_keeps_its_marks(found: ImageTracks) -> None:
    document = json.loads(to_json(tracks_document(found, "The camera only turns.")))
    assert document["report"]["warnings"] == ["The camera only turns."]
    assert document["tracks"]["lone"] == {"3": {"xy": [20.0, 20.0], "state": "marked", "sigma": 1.0, "cov": [1.0, 0.0, 1.0]}}
    assert sum(len(entries) for entries in document["tracks"].values()) == len(found.tracks.frame)


def test_a_refusal_says_where_the_tracks_are_and_writes_no_result(files: tuple[Path, Sketch], tmp_path: Path, found: ImageTracks) -> None:
    with pytest.raises(GeometryError, match=rf"turns.* corners were followed in the image .* {TRACKS_FILE}"):
        reconstruct(*files, output=tmp_path)
    assert [file.name for file in tmp_path.glob("[!.]*")] == [TRACKS_FILE]
    written = json.loads((tmp_path / TRACKS_FILE).read_text(encoding="utf-8"))
    # A run follows its faces in the frames as its own stages kept them, and finds the same.
    assert written["tracks"] == json.loads(to_json(tracks_document(found, "")))["tracks"]


def test_nothing_is_said_where_nothing_was_followed(found: ImageTracks) -> None:
    tracks = found.tracks
    lone = tracks.point_index == len(found.sketch.points) - 1
    only = replace(
        tracks, point_index=tracks.point_index[lone], frame=tracks.frame[lone], xy=tracks.xy[lone], covariance=tracks.covariance[lone], state=tracks.state[lone]
    )
    assert told(replace(found, tracks=only)) is None


def test_a_mark_moves_such_a_track(files: tuple[Path, Sketch], found: ImageTracks) -> None:
    session = open_image_session(files[0], found)
    tracks = session.tracks
    corner = int(tracks.point_index[np.flatnonzero(tracks.state == State.TRACKED)[0]])
    at = np.flatnonzero((tracks.point_index == corner) & (tracks.state == State.TRACKED))[-1]
    frame, (x, y) = int(tracks.frame[at]), tracks.xy[at]
    done = correct(session, Mark(session.sketch.points[corner].id, frame, (float(x) + 2.0, float(y)))).session.tracks
    here = (done.point_index == corner) & (done.frame == frame)
    np.testing.assert_allclose(done.xy[here], [[x + 2.0, y]])
    others = done.point_index != corner
    np.testing.assert_array_equal(done.xy[others], tracks.xy[tracks.point_index != corner])
