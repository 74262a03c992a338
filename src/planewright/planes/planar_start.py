"""Where the structured adjustment starts: whatever is known of corners and planes, completed from the evidence."""

from dataclasses import dataclass, replace

import numpy as np

from planewright.arrays import Bool, Float, Int
from planewright.geometry.plane import fit_plane
from planewright.planes.evidence import Evidence


@dataclass(frozen=True, eq=False)
class PlanarStart:
    """First values, in the world; rows as in the sketch."""

    points: Float[np.ndarray, "points 3"]
    """Anything where `point_known` is False."""
    point_known: Bool[np.ndarray, "points"]
    normals: Float[np.ndarray, "faces 3"]
    """Unit, towards the side from which the face was seen; anything where `face_known` is False."""
    offsets: Float[np.ndarray, "faces"]
    """normal . x = offset."""
    face_known: Bool[np.ndarray, "faces"]


def complete_start(start: PlanarStart, incidences: Int[np.ndarray, "incidences 2"], evidence: Evidence) -> PlanarStart:
    """The start with a finite value for every corner and plane; the known flags stay as they were.

    Planes without a value are fitted to their points of evidence, else to their known corners; where those are too few they pass through them and
    face the cameras, so that no known corner must move for a plane of which nothing is known. Corners
    without one go where their planes, lines and clicks meet in the least-squares sense.
    """
    points = np.where(start.point_known[:, None], start.points, 0.0)
    finite = np.isfinite(points).all(axis=1) & start.point_known
    normals = np.where(start.face_known[:, None], start.normals, 0.0)
    offsets = np.where(start.face_known, start.offsets, 0.0)
    plane_ok = np.isfinite(normals).all(axis=1) & np.isfinite(offsets) & start.face_known & (np.linalg.norm(np.nan_to_num(normals), axis=1) > 0.5)
    seen = [points[finite], evidence.plane_points.point, evidence.priors.mean]
    middle = next((group.mean(axis=0) for group in seen if len(group)), np.zeros(3))
    points = np.where(finite[:, None], points, middle)
    normals, offsets = np.where(plane_ok[:, None], normals, 0.0), np.where(plane_ok, offsets, 0.0)
    for face in np.flatnonzero(~plane_ok):
        mine = evidence.plane_points.face == face
        corners = incidences[incidences[:, 0] == face, 1]
        cloud = evidence.plane_points.point[mine]
        weights = evidence.plane_points.sigma[mine] ** -2.0
        if not _spreads(cloud):
            cloud = points[corners[finite[corners]]]
            weights = np.ones(len(cloud))
        if _spreads(cloud):
            normal, offset = fit_plane(cloud, weights)
            normal, offset = _towards_cameras(normal, offset, corners, evidence)
            normals[face], offsets[face], plane_ok[face] = normal, offset, True
        else:
            normals[face], offsets[face] = _facing(points[corners[finite[corners]]], corners, evidence, middle)
    scale = float(np.linalg.norm(np.ptp(np.concatenate([*seen, middle[None]]), axis=0))) or 1.0
    for corner in np.flatnonzero(~finite):
        mine = incidences[incidences[:, 1] == corner, 0]
        points[corner] = _meet(int(corner), normals[mine[plane_ok[mine]]], offsets[mine[plane_ok[mine]]], evidence, middle, scale)
    return replace(start, points=points, normals=normals / np.linalg.norm(normals, axis=1, keepdims=True), offsets=offsets)


def _spreads(cloud: Float[np.ndarray, "n 3"]) -> bool:
    """Whether the points span a plane: the second direction is at least a fiftieth of the first."""
    if len(cloud) < 3:
        return False
    values = np.linalg.svd(cloud - cloud.mean(axis=0), compute_uv=False)
    return bool(values[1] > 0.02 * values[0])


def _towards_cameras(
    normal: Float[np.ndarray, "3"], offset: float, corners: Int[np.ndarray, "corners"], evidence: Evidence
) -> tuple[Float[np.ndarray, "3"], float]:
    """The plane with its normal on the side of the cameras in which its corners were marked."""
    cameras = evidence.marks.projection[np.isin(evidence.marks.corner, corners)]
    if len(cameras) == 0:
        return normal, offset
    centers = -np.linalg.solve(cameras[:, :, :3], cameras[:, :, 3:])[:, :, 0]
    return (normal, offset) if np.median(centers @ normal - offset) >= 0.0 else (-normal, -offset)


def _facing(
    known: Float[np.ndarray, "n 3"], corners: Int[np.ndarray, "corners"], evidence: Evidence, middle: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], float]:
    """The plane through corners on a line (or one, or the middle of the scene) that faces the cameras in which its corners were marked."""
    through = known.mean(axis=0) if len(known) else middle
    cameras = evidence.marks.projection[np.isin(evidence.marks.corner, corners)]
    centers = -np.linalg.solve(cameras[:, :, :3], cameras[:, :, 3:])[:, :, 0] if len(cameras) else through[None] + np.array([[0.0, 0.0, 1.0]])
    normal = centers.mean(axis=0) - through
    if len(known) >= 2:
        line = np.linalg.svd(known - through)[2][0]
        normal = normal - line * (line @ normal)
    size = float(np.linalg.norm(normal))
    normal = normal / size if size > 1e-12 else np.array([0.0, 0.0, 1.0])
    return normal, float(normal @ through)


def _meet(
    corner: int, normals: Float[np.ndarray, "n 3"], offsets: Float[np.ndarray, "n"], evidence: Evidence, middle: Float[np.ndarray, "3"], scale: float
) -> Float[np.ndarray, "3"]:
    """Least-squares meeting point of planes, lines and rays of a corner, held weakly to the middle of the scene."""
    rows, values = [1e-3 * np.eye(3) / scale, normals / (1e-3 * scale)], [1e-3 * middle / scale, offsets / (1e-3 * scale)]
    marks, lines, priors = evidence.marks, evidence.lines, evidence.priors
    mine = marks.corner == corner
    for projection, xy, sigma in zip(marks.projection[mine], marks.xy[mine], marks.sigma[mine], strict=True):
        # x (p3 . X) = p1 . X and the same for y: the pixel error times the depth, so divided by the depth of the middle.
        ray = (xy[:, None] * projection[2] - projection[:2]) / (sigma * max(abs(float(projection[2, :3] @ middle + projection[2, 3])), 1e-9 * scale))
        rows.append(ray[:, :3])
        values.append(-ray[:, 3])
    mine = lines.corner == corner
    rows.append(lines.direction[mine] / lines.sigma[mine][:, None])
    values.append(lines.offset[mine] / lines.sigma[mine])
    for mean, whitening in zip(priors.mean[priors.corner == corner], priors.whitening[priors.corner == corner], strict=True):
        rows.append(whitening)
        values.append(whitening @ mean)
    return np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
