"""Corners as intersections of followed edges: the propagation of "Recovering 3D Planar Arrangements from Videos", section 3.1, step by step."""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from benchmarks.baselines.flow import flow
from benchmarks.baselines.sweep import Step
from planewright.arrays import Bool, Float, GrayImage, Int
from planewright.sketch.faces import find_faces
from planewright.sketch.graph import Sketch


@dataclass(frozen=True, kw_only=True)
class EdgeSampleOptions:
    """What the paper leaves open, and its window."""

    samples: int = 24
    """Of a segment, uniform between its ends; the ends themselves (4 %) are left out."""
    min_length: float = 8.0
    """Pixels; a shorter segment has no direction to speak of."""
    draws: int = 50
    """Of the weighted RANSAC, two samples each."""
    inlier: float = 1.0
    """Pixels from the line."""
    round_trip: float = 0.5
    """Standard deviation in the confidence of a flow vector, pixels: exp(-e^2 / 2 s^2) of the way there and back."""
    gray: float = 12.0
    """And of the change of grey value along the vector."""
    window: int = 1
    """Side of the perturbation window, pixels. The paper's is 3; 1 leaves corners where their lines meet, and is the better of the two: on a clip of 90 frames
    36 % of the corner-frames stay within 2 px against 6 %, for the most confident of nine neighbours wanders."""
    min_angle: float = 0.05
    """Share of the weaker direction in the lines' information below which the corner's own flow holds it: lines that meet at less than about 25 degrees."""
    dense: bool = False
    """Flow by dense inverse search instead of Lucas-Kanade on each sample."""
    flow_window: int = 15
    """Side of Lucas-Kanade's window, pixels."""
    seed: int = 0
    """Of the draws."""


def edge_samples(sketch: Sketch, options: EdgeSampleOptions = EdgeSampleOptions()) -> Step:
    """Samples along every segment at a corner, their flow, weighted RANSAC lines, the weighted least-squares intersection; of the candidates in a 3 x 3 window
    around the corner, each with its own segments to the neighbouring corners, the one whose lines are most confident.

    The confidence of a vector comes from its round trip and from the change of grey value along it. Dense inverse search (Kroeger et al. 2016) keeps 24 %
    where Lucas-Kanade on each sample keeps 36 %.
    """
    row = {point.id: k for k, point in enumerate(sketch.points)}
    found = find_faces(sketch)
    edges = {tuple(sorted((row[a], row[b]))) for a, b in sketch.edges}
    for face in found.faces:
        for loop in (face.loop, *face.holes):
            closed = loop if face.open and loop is face.loop else (*loop, loop[0])
            edges |= {tuple(sorted((row[a], row[b]))) for a, b in pairwise(closed)}
    ends = np.array(sorted((x, y) for a, b in edges for x, y in ((a, b), (b, a))), dtype=np.intp).reshape(-1, 2)
    dense = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    half = options.window // 2
    shifts = np.array([(x, y) for y in range(-half, half + 1) for x in range(-half, half + 1)], dtype=np.float64)
    # The corner itself comes first, so that it wins where candidates are equally confident.
    shifts = shifts[np.argsort((shifts**2).sum(axis=1), kind="stable")]
    along = np.linspace(0.04, 0.96, options.samples)
    rng = np.random.default_rng(options.seed)

    def step(old: GrayImage, new: GrayImage, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
        known = np.isfinite(points[:, 0])
        carried = np.full_like(points, np.nan)
        carried[known] = flow(old, new, points[known])[0]

        long = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1) >= options.min_length  # False where an end is unknown
        if not long.any():
            return carried
        corner = ends[long, 0]
        start = points[corner][:, None] + shifts
        at = start[:, :, None] + along[:, None] * (points[ends[long, 1]][:, None, None] - start[:, :, None])  # segments, candidates, samples, 2
        if options.dense:
            there, back = dense.calc(old, new, None), dense.calc(new, old, None)
            moved = at + _sample(there, at)
            error = np.linalg.norm(_sample(back, moved) + moved - at, axis=-1)
        else:
            flat, off = flow(old, new, at.reshape(-1, 2), options.flow_window)
            moved, error = flat.reshape(at.shape), np.minimum(off, 1e3).reshape(at.shape[:-1])
        change = _sample(new, moved) - _sample(old, at)
        weight = np.exp(-(error**2) / (2 * options.round_trip**2) - change**2 / (2 * options.gray**2))
        weight *= _inside(at, old.shape) & _inside(moved, old.shape)
        normal, offset, line_weight = _lines(moved, weight, options, rng)

        result = carried.copy()
        for c in np.unique(corner):
            lines = np.flatnonzero(corner == c)
            result[c] = _intersection(normal[lines], offset[lines], line_weight[lines], carried[c], shifts, options)
        return result

    return step


def _sample(image: Float[np.ndarray, "..."] | GrayImage, xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "..."]:
    """Bilinear values of a picture or a flow field; those of the border beyond it."""
    flat = xy.reshape(-1, 1, 2).astype(np.float32) - np.float32(0.5)
    picture = image if image.dtype == np.float32 else image.astype(np.float32)
    rows = [cv2.remap(picture, part, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for part in np.array_split(flat, len(flat) // 30000 + 1)]
    values = np.concatenate(rows).astype(np.float64)
    return values.reshape(xy.shape if image.ndim == 3 else xy.shape[:-1])


def _inside(xy: Float[np.ndarray, "*n 2"], shape: tuple[int, ...]) -> Bool[np.ndarray, "*n"]:
    return (xy[..., 0] > 0) & (xy[..., 1] > 0) & (xy[..., 0] < shape[1]) & (xy[..., 1] < shape[0])


def _lines(
    xy: Float[np.ndarray, "segments candidates samples 2"],
    weight: Float[np.ndarray, "segments candidates samples"],
    options: EdgeSampleOptions,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "segments candidates 2"], Float[np.ndarray, "segments candidates"], Float[np.ndarray, "segments candidates"]]:
    """Normal and offset of the weighted RANSAC line through each segment's samples, and the summed weight of its inliers; no weight where there is no line."""
    total = weight.sum(axis=-1, keepdims=True)
    share = np.cumsum(weight, axis=-1) / np.maximum(total, 1e-12)
    draw = rng.random((options.draws, 2))
    pick: Int[np.ndarray, "..."] = (share[..., None, None, :] < draw[:, :, None]).sum(axis=-1).clip(max=xy.shape[2] - 1)
    pair = np.take_along_axis(xy[:, :, None], pick.reshape(*pick.shape[:2], -1)[:, :, None, :, None], axis=3)[:, :, 0].reshape(*pick.shape, 2)
    way = pair[..., 1, :] - pair[..., 0, :]
    length = np.linalg.norm(way, axis=-1)
    normal = np.stack([-way[..., 1], way[..., 0]], axis=-1) / np.maximum(length, 1e-9)[..., None]
    offset = (normal * pair[..., 0, :]).sum(axis=-1)
    distance = np.abs(np.einsum("scdx,scnx->scdn", normal, xy) - offset[..., None])
    support = ((distance < options.inlier) * weight[:, :, None]).sum(axis=-1) * (length > 2.0)
    best = support.argmax(axis=-1)
    near = np.take_along_axis(distance, best[:, :, None, None], axis=2)[:, :, 0] < options.inlier
    inlier_weight = weight * near
    summed = inlier_weight.sum(axis=-1)
    middle = np.einsum("scn,scnx->scx", inlier_weight, xy) / np.maximum(summed, 1e-12)[..., None]
    away = xy - middle[:, :, None]
    _, vectors = np.linalg.eigh(np.einsum("scn,scnx,scny->scxy", inlier_weight, away, away))
    normal = vectors[..., :, 0]
    enough = np.take_along_axis(support, best[..., None], axis=-1)[..., 0] > 0
    return normal, (normal * middle).sum(axis=-1), np.where(enough, summed, 0.0)


def _intersection(
    normal: Float[np.ndarray, "lines candidates 2"],
    offset: Float[np.ndarray, "lines candidates"],
    weight: Float[np.ndarray, "lines candidates"],
    carried: Float[np.ndarray, "2"],
    shifts: Float[np.ndarray, "candidates 2"],
    options: EdgeSampleOptions,
) -> Float[np.ndarray, "2"]:
    """Where the most confident candidate's lines meet. carried: where the corner's own flow puts it, for what the lines do not tell."""
    best = int(weight.sum(axis=0).argmax())
    n, c, w = normal[:, best], offset[:, best], weight[:, best]
    if w.sum() <= 0:
        return carried
    information = np.einsum("l,lx,ly->xy", w, n, n) / w.sum()
    values, vectors = np.linalg.eigh(information)
    # Along a direction that the lines do not tell, the candidate follows the corner's own flow.
    held = vectors[:, :1] @ vectors[:, :1].T * max(options.min_angle - values[0], 0.0)
    return np.linalg.solve(information + held, np.einsum("l,l,lx->x", w, c, n) / w.sum() + held @ (carried + shifts[best]))
