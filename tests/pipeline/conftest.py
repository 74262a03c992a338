"""A result that is the truth itself: what leaves the pipeline can be held against it without solving anything."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from planewright.model.build import build_model
from planewright.pipeline.result import Result
from planewright.planes.planar_scene import PlanarScene
from planewright.refine.rounds import Structure
from planewright.relations.adjacency import Adjacency
from planewright.relations.relation import Relation
from planewright.sketch.graph import FaceId, PointId, Sketch
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.houses import demo_scene
from planewright.synthetic.observe import draw, face_planes, true_cameras, true_tracks
from planewright.texture.bake import bake_texture
from planewright.tracking.tracks import State, Tracks
from planewright.video.clip import ClipInfo

NOISE = 0.4
"""Pixels on each axis of every measured corner."""

Rename = Callable[[str], str]


@pytest.fixture(scope="session")
def scene_clip() -> SyntheticClip:
    return demo_scene(24, (320, 180))


@pytest.fixture(scope="session")
def true_result(scene_clip: SyntheticClip) -> Result:
    """The shed as it is: exact planes and cameras, tracks with known noise, two relations."""
    cameras = true_cameras(scene_clip)
    xy, visible, inside = true_tracks(scene_clip)
    sketch = draw(scene_clip, np.random.default_rng(0))
    ids, face_ids = list(scene_clip.scene.points), [face.id for face in scene_clip.scene.faces]
    normals, offsets = face_planes(scene_clip.scene)
    faces = [face_ids.index(face.id) for face in sketch.faces]
    count = len(faces)
    scene = PlanarScene(
        sketch=sketch,
        points=scene_clip.scene.corner_array([point.id for point in sketch.points]),
        point_known=np.ones(len(sketch.points), bool),
        point_covariance=np.tile(np.diag([1e-6, 4e-6, 9e-6]), (len(sketch.points), 1, 1)),
        normals=normals[faces],
        offsets=offsets[faces],
        face_known=np.ones(count, bool),
        plane_covariance=np.eye(3 * count) * 1e-6,
    )
    rng = np.random.default_rng(1)
    rows = [
        (i, frame, *(xy[ids.index(point.id), frame] + rng.normal(0.0, NOISE, 2)), state_of(frame in point.marks, bool(visible[ids.index(point.id), frame])))
        for i, point in enumerate(sketch.points)
        for frame in np.flatnonzero(inside[ids.index(point.id)])
    ]
    table = np.array(rows)
    tracks = Tracks(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:4], np.tile(np.eye(2) * NOISE**2, (len(rows), 1, 1)), table[:, 4].astype(int))
    names = [face.id for face in sketch.faces]
    relations = (
        Relation("parallel", (names[0], names[1]), "enforced", "detected", 0.4, 0.3, None, 12.0, 1, "0.4 degrees before."),
        Relation("orthogonal", (names[0], names[2]), "released", "detected", 3.4, 0.3, None, -12.0, None, "3.4 degrees off."),
    )
    adjacency = (Adjacency((names[0], names[2]), (sketch.edges[0][0], sketch.edges[0][1]), 90.0, 0.1),)
    info = ClipInfo("clip.mp4", "0" * 64, scene_clip.intrinsics.image_size, 24, 30.0, tuple(np.arange(24) / 30.0))
    atlas = bake_texture(scene_clip.frames, scene, cameras)
    return Result(info, cameras, Structure(scene, relations, adjacency, ()), tracks, build_model(scene, atlas, cameras=cameras), ("A warning.",))


def state_of(marked: bool, visible: bool) -> State:
    return State.MARKED if marked else State.TRACKED if visible else State.HIDDEN


@pytest.fixture(scope="session")
def renamed(true_result: Result) -> Callable[[str], Result]:
    """The same result with one text put in for every name that comes from a file."""

    def rename(text: str) -> Result:
        scene = true_result.scene
        point = {p.id: PointId(f"{text}{i}") for i, p in enumerate(scene.sketch.points)}
        face = {f.id: FaceId(f"{text}{i}") for i, f in enumerate(scene.sketch.faces)}
        sketch = Sketch(
            points=tuple(replace(p, id=point[p.id]) for p in scene.sketch.points),
            image_size=scene.sketch.image_size,
            edges=tuple((point[a], point[b]) for a, b in scene.sketch.edges),
            faces=tuple(
                replace(f, id=face[f.id], loop=tuple(point[c] for c in f.loop), holes=tuple(tuple(point[c] for c in hole) for hole in f.holes))
                for f in scene.sketch.faces
            ),
        )
        structure = true_result.structure
        relations = tuple(replace(r, faces=tuple(face[f] for f in r.faces), reason=text) for r in structure.relations)
        adjacency = tuple(replace(a, faces=(face[a.faces[0]], face[a.faces[1]]), edge=(point[a.edge[0]], point[a.edge[1]])) for a in structure.adjacency)
        return replace(
            true_result,
            clip=replace(true_result.clip, name=text),
            structure=Structure(replace(scene, sketch=sketch), relations, adjacency, ()),
            warnings=(text,),
        )

    return rename
