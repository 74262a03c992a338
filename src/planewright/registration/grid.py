"""Points on followed faces as scene features, so that cameras can be solved from faces that have no corners of their own."""

from dataclasses import dataclass

import cv2
import numpy as np

from planewright.arrays import Float, Int
from planewright.features.features import Features
from planewright.registration.homography import apply_homography, change_jacobian
from planewright.registration.registered import CELLS, Registered
from planewright.registration.strands import Strand
from planewright.registration.templates import cell_of


@dataclass(frozen=True, kw_only=True)
class GridOptions:
    """Which points of a face are used."""

    points: int = 40
    """Aimed at on each face."""
    max_sigma: float = 0.7
    """Pixels; a point known worse than this is left out of that frame."""
    min_support: float = 0.5
    """Share of the pixels around it that must agree with the face's template."""
    margin: float = 2.0
    """Pixels kept free along the image's border."""


def face_features(registered: Registered, options: GridOptions = GridOptions()) -> Features:
    """Grid points inside the followed faces, seen wherever their face was found and they are well known."""
    width, height = registered.image_size
    frames: list[Int[np.ndarray, "rows"]] = []
    tracks: list[Int[np.ndarray, "rows"]] = []
    places: list[Float[np.ndarray, "rows 2"]] = []
    num_tracks = 0
    for s, strand in enumerate(registered.strands):
        q = grid_points(strand, options.points)
        columns = np.nonzero(registered.found[s])[0]
        if not len(q) or len(columns) < 3:
            continue
        h, p = registered.homography[s, columns], registered.covariance[s, columns]
        every = np.broadcast_to(q, (len(columns), *q.shape))
        xy = apply_homography(h, every) + 0.5
        d = change_jacobian(h, every)
        sigma = np.sqrt(np.einsum("kpij,kjl,kpil->kpi", d, p, d).max(axis=2))
        support = np.nan_to_num(registered.support[s][columns][:, cell_of(q, CELLS)])
        good = np.isfinite(xy).all(axis=2) & (sigma <= options.max_sigma) & (support >= options.min_support)
        inside = (np.nan_to_num(xy, nan=-1.0) > options.margin).all(axis=2)
        inside &= (np.nan_to_num(xy[..., 0]) < width - options.margin) & (np.nan_to_num(xy[..., 1]) < height - options.margin)
        good &= inside
        good &= good.sum(axis=0) >= 3
        k, point = np.nonzero(good)
        frames.append(registered.frame[columns[k]])
        tracks.append(num_tracks + point)
        places.append(xy[k, point])
        num_tracks += len(q)
    if not frames:
        return Features(track_index=np.zeros(0, np.int32), frame=np.zeros(0, np.int32), xy=np.zeros((0, 2), np.float32), num_tracks=0)
    frame, track, xy = np.concatenate(frames), np.concatenate(tracks), np.concatenate(places)
    used, track = np.unique(track, return_inverse=True)
    order = np.lexsort((track, frame))
    return Features(
        track_index=track[order].astype(np.int32), frame=frame[order].astype(np.int32), xy=xy[order].astype(np.float32), num_tracks=len(used)
    )  # fmt: skip


def grid_points(strand: Strand, count: int) -> Float[np.ndarray, "points 2"]:
    """About that many points of a square grid inside the strand's loop and outside what covers it, face coordinates."""
    loop = strand.q[: strand.loop_length].astype(np.float32)[:, None]
    kept = np.zeros((0, 2))
    for cells in range(4, 41):
        at = (np.arange(cells) + 0.5) / cells * 2 - 1
        grid = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
        inside = [cv2.pointPolygonTest(loop, (float(x), float(y)), measureDist=True) > 0.03 for x, y in grid]
        free = [all(cv2.pointPolygonTest(o.astype(np.float32)[:, None], (float(x), float(y)), measureDist=False) < 0 for o in strand.others) for x, y in grid]
        kept = grid[np.array(inside) & np.array(free)]
        if len(kept) >= count:
            return kept
    return kept
