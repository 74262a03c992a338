"""What a run found, and `reconstruction.json` (docs/file-format.md): a function of the input, the options and the seed, byte for byte."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from planewright.arrays import Float
from planewright.corrections.session import Model
from planewright.corrections.suggest import Suggestion, rank_corrections
from planewright.model.planar_model import PlanarModel
from planewright.planes.planar_scene import PlanarScene
from planewright.refine.rounds import Structure
from planewright.relations.relation import Relation
from planewright.sfm.cameras import Cameras
from planewright.sketch.graph import Sketch
from planewright.tracking.tracks import State, Tracks
from planewright.video.clip import ClipInfo

MODELS = {0: "SIMPLE_PINHOLE", 1: "SIMPLE_RADIAL", 2: "RADIAL"}
"""COLMAP's names by the number of distortion terms."""

NEXT_CORRECTIONS = 8
"""Corrections named in a result, at most; those that gain less than one frame are not worth a person's time."""


@dataclass(frozen=True, eq=False)
class Result:
    """Everything that was found in one clip."""

    clip: ClipInfo
    cameras: Cameras
    structure: Structure
    """Corners, planes, relations, adjacency."""
    tracks: Tracks
    model: PlanarModel
    warnings: tuple[str, ...]
    """What a person should know before they rely on the result."""

    @property
    def scene(self) -> PlanarScene:
        """Corners and planes."""
        return self.structure.scene


def next_corrections(result: Result) -> tuple[Suggestion, ...]:
    """The marks that would gain most: in how many frames they bring a corner from more than 5 px off to within."""
    ranked = rank_corrections(result.scene.sketch, result.tracks, Model(result.cameras, result.structure), NEXT_CORRECTIONS)
    return tuple(mark for mark in ranked if mark.gain >= 1.0)


def reprojection_errors(result: Result) -> tuple[Float[np.ndarray, "rows"], Float[np.ndarray, "rows"]]:
    """Of every measured position (marked or tracked): its frame, and its distance in pixels from the projection of its corner."""
    tracks, cameras, scene = result.tracks, result.cameras, result.scene
    frames, errors = [np.zeros(0)], [np.zeros(0)]
    measured = np.isin(tracks.state, (State.MARKED, State.TRACKED)) & scene.point_known[tracks.point_index]
    for frame in np.unique(tracks.frame[measured]):
        row = cameras.row(int(frame))
        if row is None:
            continue
        here = np.flatnonzero(measured & (tracks.frame == frame))
        in_cam = cameras.cam_from_world(row).apply(scene.points[tracks.point_index[here]])
        front = in_cam[:, 2] > 0
        straight = cameras.intrinsics.pinhole().project(in_cam[front])
        error = cameras.lens.to_displayed(int(frame), straight, in_cam[front, 2]) - tracks.xy[here[front]]
        frames.append(np.full(len(error), float(frame)))
        errors.append(np.linalg.norm(error, axis=1))
    return np.concatenate(frames), np.concatenate(errors)


def rmse(errors: Float[np.ndarray, "rows"]) -> float | None:
    """Root of the mean square, or None of nothing."""
    return float(np.sqrt((errors**2).mean())) if len(errors) else None


def normal_sigmas_deg(scene: PlanarScene) -> Float[np.ndarray, "faces"]:
    """Standard deviation of each face's normal along its worst direction, in degrees."""
    tilt = np.stack([scene.plane_covariance[3 * f : 3 * f + 2, 3 * f : 3 * f + 2] for f in range(len(scene.normals))] or [np.zeros((2, 2))])
    worst = np.linalg.eigvalsh(np.where(np.isfinite(tilt), tilt, 0.0))[:, -1]
    return np.degrees(np.sqrt(np.maximum(worst, 0.0)))[: len(scene.normals)]


def document(result: Result) -> dict[str, Any]:
    """The content of `reconstruction.json`."""
    scene = result.scene
    errors = reprojection_errors(result)[1]
    return {
        "format": "planewright-reconstruction",
        "version": 1,
        "clip": clip_entry(result.clip),
        **({"unit": result.model.unit} if result.model.unit is not None else {}),
        "camera": _camera(result.cameras),
        "frames": list(_frames(result.cameras)),
        "points": list(_points(scene)),
        "tracks": track_entries(result.tracks, scene.sketch),
        "faces": list(_faces(scene)),
        "adjacency": [
            {"faces": list(pair.faces), "edge": list(pair.edge), "dihedral_deg": pair.dihedral_deg, "sigma_deg": pair.sigma_deg}
            for pair in result.structure.adjacency
        ],
        "relations": [_relation(relation) for relation in result.structure.relations],
        "report": {
            "planes": int(scene.face_known.sum()),
            "points": int(scene.point_known.sum()),
            "corrections": sum(max(len(point.marks) - 1, 0) for point in scene.sketch.points),
            "reprojection_rmse_px": rmse(errors),
            "warnings": list(result.warnings),
            "next_corrections": [{"point": mark.point, "frame": mark.frame, "gain": mark.gain, "reason": mark.reason} for mark in next_corrections(result)],
        },
    }


def to_json(content: Mapping[str, Any]) -> bytes:
    """Stable bytes: the shortest digits that give the same number back, one line for each item of a top-level list or object."""

    def one(value: Any) -> str:
        return json.dumps(value, allow_nan=False, separators=(", ", ": "))

    def block(value: Any) -> str:
        if isinstance(value, dict) and any(isinstance(item, dict) for item in value.values()):  # pyright: ignore[reportUnknownVariableType]
            return "{\n" + ",\n".join(f"  {one(key)}: {one(item)}" for key, item in value.items()) + "\n }"
        if isinstance(value, list) and value and isinstance(value[0], dict):
            return "[\n" + ",\n".join(f"  {one(item)}" for item in value) + "\n ]"  # pyright: ignore[reportUnknownVariableType]
        return one(value)

    return ("{\n" + ",\n".join(f" {one(key)}: {block(value)}" for key, value in content.items()) + "\n}\n").encode()


def _camera(cameras: Cameras) -> dict[str, Any]:
    lens = cameras.intrinsics
    return {
        "model": MODELS[len(lens.distortion)],
        "focal": [lens.focal, lens.focal],
        "principal_point": lens.principal_point.tolist(),
        "distortion": list(lens.distortion),
        "focal_sigma": cameras.focal_sigma if np.isfinite(cameras.focal_sigma) else None,
        "focal_interval": list(cameras.focal_interval),
        **({} if cameras.shutter is None else {"readout": cameras.shutter.readout}),
    }


def _frames(cameras: Cameras) -> Iterator[dict[str, Any]]:
    for row in np.flatnonzero(cameras.posed):
        pose = {"rotation": cameras.rotation[row].tolist(), "translation": cameras.translation[row].tolist()}
        yield {"index": int(cameras.frame[row]), "cam_from_world": pose}


def _points(scene: PlanarScene) -> Iterator[dict[str, Any]]:
    for i in np.flatnonzero(scene.point_known):
        variance = np.diag(scene.point_covariance[i])
        sigma = np.sqrt(np.maximum(variance, 0.0)).tolist() if np.isfinite(variance).all() else None
        yield {"id": scene.sketch.points[i].id, "xyz": scene.points[i].tolist(), "sigma": sigma}


def clip_entry(clip: ClipInfo) -> dict[str, Any]:
    """Which clip a file is about."""
    return {"name": clip.name, "sha256": clip.sha256, "image_size": list(clip.image_size), "num_frames": clip.num_frames, "fps": clip.fps}


def track_entries(tracks: Tracks, sketch: Sketch) -> dict[str, dict[str, Any]]:
    """Point -> frame -> what is claimed there; points without a claim are left out."""
    document: dict[str, dict[str, Any]] = {point.id: {} for point in sketch.points}
    eigenvalues = np.linalg.eigvalsh(np.where(np.isfinite(tracks.covariance), tracks.covariance, 0.0)) if len(tracks.frame) else np.zeros((0, 2))
    sigma = np.sqrt(np.maximum(eigenvalues[:, -1], 0.0))
    known = np.isfinite(tracks.covariance).all(axis=(1, 2)) & (sigma > 0)
    for k in range(len(tracks.frame)):
        entry: dict[str, Any] = {"xy": tracks.xy[k].tolist(), "state": State(int(tracks.state[k])).name.lower()}
        if known[k]:
            (xx, xy), (_, yy) = tracks.covariance[k].tolist()
            entry |= {"sigma": float(sigma[k]), "cov": [xx, xy, yy]}
        document[sketch.points[int(tracks.point_index[k])].id][str(int(tracks.frame[k]))] = entry
    return {point: entries for point, entries in document.items() if entries}


def _faces(scene: PlanarScene) -> Iterator[dict[str, Any]]:
    sigmas = normal_sigmas_deg(scene)
    for f in np.flatnonzero(scene.face_known):
        face = scene.sketch.faces[f]
        yield {
            "id": face.id,
            "loop": list(face.loop),
            "holes": [list(hole) for hole in face.holes],
            "normal": scene.normals[f].tolist(),
            "offset": float(scene.offsets[f]),
            "normal_sigma_deg": float(sigmas[f]),
            "inferred_edges": [[face.loop[-1], face.loop[0]]] if face.open else [],
        }


def _relation(relation: Relation) -> dict[str, Any]:
    return {
        "kind": relation.kind,
        "faces": list(relation.faces),
        "state": relation.state,
        "source": relation.source,
        "deviation_deg": relation.deviation_deg,
        "sigma_deg": relation.sigma_deg,
        "order": relation.order,
        "reason": relation.reason,
    }
