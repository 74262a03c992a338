"""The truth of a clip as JSON (`planewright-truth`), and the sketch a person would draw on it."""

from dataclasses import replace
from itertools import combinations

import numpy as np

from planewright.arrays import Bool, Float
from planewright.geometry.camera import Intrinsics
from planewright.geometry.rigid import Rigid
from planewright.sfm.cameras import Cameras
from planewright.sketch.graph import Edge, FaceId, PointId, Sketch, SketchFace, SketchPoint
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.polygons import flatten
from planewright.synthetic.scene import Scene, loop_normal

_SLACK = 0.004
"""Share of the scene's diagonal by which a cover must be nearer than a corner to hide it (docs/file-format.md)."""
_NEAR_MISS_DEG = 15.0
_EXACT_DEG = 1e-6
"""The scenes are exact to rounding, and what is meant to be off is off by degrees."""


def turns(scene: Scene) -> bool:
    """Whether the sketched object turns on its own."""
    return any(s.carrier == "object" for s in scene.surfaces)


def object_pose(clip: SyntheticClip, time: float) -> Rigid:
    """cam_from_world at a time in frames; where the object turns, the world is the object's own frame."""
    pose = clip.path.cam_from_world(time)
    return pose @ clip.path.world_from_object(time) if turns(clip.scene) else pose


def object_poses(clip: SyntheticClip) -> list[Rigid]:
    """`object_pose` of every frame: in the middle of its exposure, and of its readout where rows are read one after the other."""
    return [object_pose(clip, float(k)) for k in range(clip.num_frames)]


def true_cameras(clip: SyntheticClip) -> Cameras:
    """The cameras as the walk's own type."""
    poses = object_poses(clip)
    return Cameras(
        intrinsics=clip.intrinsics,
        frame=np.arange(len(poses)),
        rotation=np.array([p.rotation for p in poses]),
        translation=np.array([p.translation for p in poses]),
        posed=np.ones(len(poses), np.bool_),
        focal_sigma=0.0,
        focal_interval=(clip.intrinsics.focal, clip.intrinsics.focal),
    )


def _projected(intrinsics: Intrinsics, in_cam: Float[np.ndarray, "*many 3"]) -> Float[np.ndarray, "*many 2"]:
    """Pixels; of points behind the camera those of its axis."""
    safe = np.where(in_cam[..., 2:] > 1e-9, in_cam, np.array([0.0, 0.0, 1.0]))
    return intrinsics.project(safe.reshape(-1, 3)).reshape(*in_cam.shape[:-1], 2)


def _row_times(clip: SyntheticClip, points: Float[np.ndarray, "points 3"], frame: int) -> Float[np.ndarray, "points"]:
    """When the row that shows a point is read, in frames: the time t at which its row is y(t), t = frame + readout (y / height - 1/2).

    The row is a smooth function of time: a polynomial through nine Chebyshev nodes stands for it (8th degree, within 1e-6 pixels).
    Points far outside the image stay at half a readout beyond its first or last row.
    """
    readout, height = clip.options.readout, clip.intrinsics.image_size[1]
    nodes = np.cos(np.pi * (np.arange(9) + 0.5) / 9)
    rows = np.array([_projected(clip.intrinsics, object_pose(clip, frame + readout * u).apply(points))[:, 1] for u in nodes])
    fit = np.polynomial.chebyshev.chebfit(nodes, rows / height - 0.5, 8)
    share = np.zeros(len(points))
    # Each round shrinks the error by the motion per readout over the image's height: a tenth and less.
    for _ in range(12):
        share = np.clip(np.polynomial.chebyshev.chebval(share, fit, tensor=False), -1.0, 1.0)
    return frame + readout * share


def true_tracks(clip: SyntheticClip) -> tuple[Float[np.ndarray, "points frames 2"], Bool[np.ndarray, "points frames"], Bool[np.ndarray, "points frames"]]:
    """Pixels of every corner in every frame, whether it is visible, and whether it lies in the image; points in the scene's order.

    Where rows are read one after the other, the pixels are those where the corner appears, at the time of its own row.
    Visible: in the image, a sketched face at the corner looks at the camera, and nothing nearer by 0.4 % of the scene's diagonal covers it
    in the middle of the frame's time.
    """
    scene = clip.scene
    points = scene.corner_array(list(scene.points))
    poses = object_poses(clip)
    centers = np.array([-p.rotation.T @ p.translation for p in poses])
    in_cam = np.stack([p.apply(points) for p in poses], axis=1)
    if clip.options.readout:
        for k in range(clip.num_frames):
            for i, time in enumerate(_row_times(clip, points, k).tolist()):
                in_cam[i, k] = object_pose(clip, time).apply(points[i : i + 1])[0]
    xy = _projected(clip.intrinsics, in_cam)
    in_image = (in_cam[..., 2] > 1e-9) & np.all((xy >= 0) & (xy < np.array(clip.intrinsics.image_size)), axis=2)
    facing = np.zeros_like(in_image)
    order = {k: i for i, k in enumerate(scene.points)}
    for face in scene.faces:
        loop = scene.corner_array(face.loop)
        looks = (centers - loop[0]) @ loop_normal(loop) > 0
        for k in (*face.loop, *(k for hole in face.holes for k in hole)):
            facing[order[k]] |= looks
    return xy, in_image & facing & ~_covered(clip, points, centers), in_image


def _covered(clip: SyntheticClip, points: Float[np.ndarray, "points 3"], centers: Float[np.ndarray, "frames 3"]) -> Bool[np.ndarray, "points frames"]:
    """Whether anything hides a corner: its own object, what stands still around it, a visitor. Points and centres are in the object's frame."""
    scene = clip.scene
    slack = _SLACK * scene.diagonal
    turning = turns(scene)
    own = [s for s in scene.surfaces if s.carrier == ("object" if turning else "world")]
    covered = flatten(own).covered(points, centers, slack)
    still = [s for s in scene.surfaces if s.carrier == "world"] if turning else []
    visitors = [s for s in scene.surfaces if s.carrier == "visitor"]
    for others, visiting in ((still, False), (visitors, True)):
        if not others:
            continue
        covers = flatten(others)
        for k in range(clip.num_frames):
            others_from_object = clip.path.world_from_object(float(k)) if turning else Rigid(np.eye(3), np.zeros(3))
            if visiting:
                there = clip.visit.world_from_visitor(float(k)) if clip.visit else None
                if there is None:
                    continue
                others_from_object = there.inverse() @ others_from_object
            covered[:, k] |= covers.covered(others_from_object.apply(points), others_from_object.apply(centers[k : k + 1]), slack)[:, 0]
    return covered


def face_planes(scene: Scene) -> tuple[Float[np.ndarray, "faces 3"], Float[np.ndarray, "faces"]]:
    """Outward unit normals and offsets of the sketched faces."""
    loops = [scene.corner_array(f.loop) for f in scene.faces]
    normals = np.array([loop_normal(loop) for loop in loops])
    return normals, np.array([float((loop @ n).mean()) for loop, n in zip(loops, normals, strict=True)])


def _relations(scene: Scene) -> tuple[dict[str, list[list[str]]], list[dict[str, object]]]:
    """Pairs of faces that are parallel, orthogonal, coplanar; and those that nearly are. Read off exact planes, so closed under transitivity.

    Of what was built a little off, the relations that were meant.
    """
    normals, offsets = face_planes(scene if scene.meant is None else replace(scene, points=scene.meant))
    ids = [f.id for f in scene.faces]
    relations: dict[str, list[list[str]]] = {"parallel": [], "orthogonal": [], "coplanar": []}
    near: list[dict[str, object]] = []
    for i, j in combinations(range(len(ids)), 2):
        cosine = abs(float(normals[i] @ normals[j]))
        angle = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(normals[i], normals[j])), cosine)))
        pair = [ids[i], ids[j]]
        if angle < _EXACT_DEG:
            relations["parallel"].append(pair)
            if abs(offsets[i] - np.sign(normals[i] @ normals[j]) * offsets[j]) < 1e-9 * scene.diagonal:
                relations["coplanar"].append(pair)
        elif angle > 90 - _EXACT_DEG:
            relations["orthogonal"].append(pair)
        elif angle < _NEAR_MISS_DEG:
            near.append({"a": ids[i], "b": ids[j], "kind": "near_parallel", "angle_deg": round(angle, 3)})
        elif angle > 90 - _NEAR_MISS_DEG:
            near.append({"a": ids[i], "b": ids[j], "kind": "near_orthogonal", "angle_deg": round(angle, 3)})
    return relations, near


def truth(clip: SyntheticClip) -> dict[str, object]:
    """The `planewright-truth` of a clip, ready for `json.dump`."""
    scene, camera = clip.scene, clip.intrinsics
    xy, visible, in_image = true_tracks(clip)
    normals, offsets = face_planes(scene)
    relations, near = _relations(scene)
    return {
        "format": "planewright-truth",
        "version": 1,
        "image_size": list(camera.image_size),
        "num_frames": clip.num_frames,
        "camera": {
            "model": "RADIAL" if camera.distortion else "PINHOLE",
            "focal": [camera.focal, camera.focal],
            "principal_point": [float(c) for c in camera.principal_point],
            "distortion": [*camera.distortion, 0.0, 0.0][:2],
            "readout": clip.options.readout,
        },
        "frames": [
            {"index": k, "cam_from_world": {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()}}
            for k, pose in enumerate(object_poses(clip))
        ],
        "points": [{"id": k, "xyz": list(p)} for k, p in scene.points.items()],
        "faces": [
            {"id": f.id, "loop": list(f.loop), "holes": [list(h) for h in f.holes], "normal": normals[i].tolist(), "offset": float(offsets[i]), "open": f.open}
            for i, f in enumerate(scene.faces)
        ],
        "as_built": scene.meant is not None,
        "relations": relations,
        "near_misses": near,
        "tracks": {
            k: {"xy": np.round(xy[i], 3).tolist(), "visible": visible[i].astype(int).tolist(), "in_image": in_image[i].astype(int).tolist()}
            for i, k in enumerate(scene.points)
        },
    }


def main_frame(visible: Bool[np.ndarray, "points frames"]) -> int:
    """The frame with most corners visible, the one nearest to mid-clip among equals: where a person would draw."""
    count = visible.sum(axis=0)
    best = np.flatnonzero(count == count.max())
    return int(best[np.argmin(np.abs(best - visible.shape[1] // 2))])


SLIVER = 6.0
"""A face that a frame shows no thicker than this, pixels, is a line to whoever draws: its corners are clicked where it opens."""


def thickness(scene: Scene, xy: Float[np.ndarray, "points frames 2"]) -> Float[np.ndarray, "faces frames"]:
    """How thick each face's loop is in each frame, pixels: two standard deviations of its corners about the line that fits them best, which
    for a rectangle is its width."""
    row = {k: i for i, k in enumerate(scene.points)}
    out = np.empty((len(scene.faces), xy.shape[1]))
    for f, face in enumerate(scene.faces):
        corners = xy[[row[k] for k in face.loop]].transpose(1, 0, 2)
        spread = np.linalg.svd(corners - corners.mean(axis=1, keepdims=True), compute_uv=False)[:, 1]
        out[f] = 2.0 * spread / np.sqrt(len(face.loop))
    return out


def opened(scene: Scene, xy: Float[np.ndarray, "points frames 2"]) -> Bool[np.ndarray, "points frames"]:
    """Whether a frame shows one of the faces of a corner as more than a line; true for corners without a face."""
    thick = thickness(scene, xy) > SLIVER
    out = np.zeros(xy.shape[:2], bool)
    for i, k in enumerate(scene.points):
        of_corner = [f for f, face in enumerate(scene.faces) if k in face.loop or any(k in hole for hole in face.holes)]
        out[i] = thick[of_corner].any(axis=0) if of_corner else True
    return out


def draw(clip: SyntheticClip, rng: np.random.Generator, click_noise: float = 1.0, with_faces: bool = True) -> Sketch:
    """The sketch of a clip: corners clicked in its main frame, those hidden there or on faces that show as lines there in the nearest frame
    that shows them well.

    click_noise: standard deviation of a click on each axis, pixels. A corner that no frame shows is left out, and so are its edges and faces.
    """
    xy, visible, _ = true_tracks(clip)
    scene, size = clip.scene, np.array(clip.intrinsics.image_size)
    main = main_frame(visible)
    # A click two pixels or more inside the image: what lies on the very border cannot be seen well enough to click.
    inside = visible & np.all((xy > 2) & (xy < size - 2), axis=2)
    open_there = inside & opened(scene, xy)
    clear = np.where(open_there.any(axis=1, keepdims=True), open_there, inside)
    clicks = rng.normal(0.0, click_noise, (len(xy), 2)) if click_noise > 0 else np.zeros((len(xy), 2))
    marked: list[SketchPoint] = []
    for i, k in enumerate(scene.points):
        shown = np.flatnonzero(clear[i])
        if len(shown) == 0:
            continue
        # Such a corner is marked some frames after it comes into sight, as who scrubs through a clip would.
        frame = main
        if not clear[i, main]:
            nearest = int(np.argmin(np.abs(shown - main)))
            deeper = nearest - 8 if shown[nearest] < main else nearest + 8
            frame = int(shown[np.clip(deeper, 0, len(shown) - 1)])
        x, y = np.round(xy[i, frame] + clicks[i], 2)
        marked.append(SketchPoint(PointId(k), {frame: (float(x), float(y))}))
    known = {p.id for p in marked}
    faces = tuple(
        SketchFace(FaceId(f.id), tuple(PointId(k) for k in f.loop), tuple(tuple(PointId(k) for k in h) for h in f.holes), f.open)
        for f in scene.faces
        if known.issuperset((*f.loop, *(k for h in f.holes for k in h)))
    )
    edges: set[Edge] = set()
    for face in faces:
        for ring in (face.loop, *face.holes):
            ends = ring[1:] if face.open and ring is face.loop else (*ring[1:], ring[0])
            edges.update((min(a, b), max(a, b)) for a, b in zip(ring, ends, strict=False))
    return Sketch(tuple(marked), clip.intrinsics.image_size, tuple(sorted(edges)), faces if with_faces else ())
