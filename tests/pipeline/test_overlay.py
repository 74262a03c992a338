"""Edges of the model over a frame: where the truth is, solid where the truth is visible."""

import numpy as np

from planewright.pipeline.overlay import edge_strokes, model_edges
from planewright.pipeline.result import Result
from planewright.planes.polygons import scene_polygons
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.observe import true_tracks


def test_each_edge_is_drawn_once(true_result: Result) -> None:
    edges = model_edges(true_result.scene)
    assert len(set(edges)) == len(edges) >= 12
    assert all(a < b for a, b in edges)


def test_strokes_begin_and_end_at_true_corners_or_the_border_or_where_something_hides(true_result: Result, scene_clip: SyntheticClip) -> None:
    xy, visible, inside = true_tracks(scene_clip)
    ids = list(scene_clip.scene.points)
    rows = [ids.index(point.id) for point in true_result.scene.sketch.points]
    polygons = scene_polygons(true_result.scene)
    for frame in (0, 11, 23):
        strokes = edge_strokes(true_result.scene, polygons, true_result.cameras, frame)
        ends = np.array([end for stroke in strokes for end in (stroke.xy[0], stroke.xy[-1])])
        solid = np.array([end for stroke in strokes if stroke.visible for end in (stroke.xy[0], stroke.xy[-1])])
        width, height = scene_clip.intrinsics.image_size
        assert ((ends > -20) & (ends < np.array([width, height]) + 20)).all()
        for row in rows:
            if inside[row, frame] and np.all((xy[row, frame] > 3) & (xy[row, frame] < [width - 3, height - 3])):
                assert np.linalg.norm(ends - xy[row, frame], axis=1).min() < 1e-6
                if visible[row, frame]:
                    assert np.linalg.norm(solid - xy[row, frame], axis=1).min() < 3
