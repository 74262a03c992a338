"""Drawn edges found again in the images, all views at once.

An edge lies in the plane of its face. Strips of grey values across it, cut in that plane, line up in every view when the plane is
right, so their steepness may simply be averaged: what lies in the plane stays sharp, what lies before or behind it blurs. The
edge is then the straight line across the strip with the highest mean steepness: two numbers, the offsets at its ends.
A strong line parallel to the edge (a mortar joint beside a wall's corner) is a second maximum of the same map; it is the
distance from where the corners are thought to be, and the other face of the edge, that decide between them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planewright.arrays import Bool, Float, Int, Vec3
from planewright.lifting.views import Views
from planewright.planes.evidence import CornerLines
from planewright.sketch.graph import Sketch
from planewright.tracking.kernels import edge_strip, line_scores

USUAL = 4.5
"""Half the square of the three standard deviations by which the best of many lines of clutter stands out anyway."""


@dataclass(frozen=True, kw_only=True)
class EdgeOptions:
    """How edges are searched."""

    prior: float = 0.2
    """Standard deviation of the present position of an end besides what the corners' covariance says, working pixels in a view that
    sees the edge well."""
    height_weight: float = 1.0
    """What the logarithm of a line's height (its steepness above the strip's median, the steepest line having 1) weighs against the
    log-likelihood of where it is: a line half as steep wins when it is nearer by 0.7 units."""
    near_best: float = 0.5
    """Views that resolve the edge less finely than this share of the best are left out: they only blur the strip."""
    clutter_band: float = 0.25
    """Lines that turn by no more than this share of the search say how steep nothing in particular is: a texture's rows and stains."""
    outstanding: float = 5.0
    """A line counts by half the square of how many standard deviations of that clutter it stands out by, up to this many. Among 350 edges of
    five clips with truth, the negative log-likelihood of the true place fell from .06 to -.38 with it and the options around it."""
    region_weight: float = 4.0
    """What parting the face's texture from what is beside it weighs, from 0 (parts nothing) to 1 (all texture on one side)."""
    region_sigma: float = 4.0
    """How well that locates an edge by itself, the same pixels: it counts for little where the corners are known better, since
    what is beside an edge near its plane (the ground at a wall's foot) is carried by the plane for some pixels too."""
    region: float = 6.0
    """Width compared on both sides, the same pixels."""
    carried: float = 0.6
    """Texture whose mean difference over the views is this share of its mean size is neither the plane's nor another's."""
    texture_floor: float = 3.0
    """Mean size of differences (grey levels) that noise and coding reach on bare surfaces."""
    min_height: float = 0.15
    """Lower maxima are no candidates."""
    reject: float = 9.0
    """No line is taken where the best candidate's score (log-likelihood units) is below minus this."""
    search: float = 4.0
    """An end is searched this many standard deviations to both sides."""
    max_search: float = 40.0
    """Never further than this, the same pixels."""
    step: float = 0.4
    """Finest spacing of the offsets, the same pixels; wide searches have at most `max_steps` to a side."""
    max_steps: int = 70
    """Steps to a side."""
    sample_spacing: float = 2.5
    """Spacing along the edge, the same pixels."""
    max_samples: int = 64
    """Samples along an edge."""
    hue: float = 2.0
    """What a difference of colour (Cr, Cb) counts beside the same difference of brightness: bricks and soil may be equally bright. Among
    1200 ends of edges of nine clips with truth it took the negative log-likelihood of the true place from -.44 to -.49."""
    grain: float = 1.0
    """So much of a difference of colour is noise and coding, and does not count."""
    limit: float = 60.0
    """Grey levels: steeper differences than this count for less and less, never for more than this: one bright stain must not be the edge."""
    sigma: float = 0.3
    """Standard deviation of a clear line in all, the same pixels: an edge's error is a bias common to all views (shading, rounding,
    a line beside it), so more views do not make it smaller."""
    min_contrast: float = 1.15
    """The best line must be this much steeper than the strip's median."""
    missing: float = 0.02
    """The chance that the drawn edge is none of the candidates is that of a line of this height right where it is expected, less where
    the best candidate stands out."""
    clear_weight: float = 2.0
    """What the logarithm of the best line's contrast, beyond a contrast of 2, weighs against that chance: the one line on a bare wall is it."""
    ambiguous: float = 0.5
    """A second candidate over three pixels off (both ends together) that is at least this likely, relative to the best, makes the edge
    ambiguous."""


@dataclass(frozen=True, eq=False)
class Anchor:
    """Corners as clicks and planes alone give them."""

    points: Float[np.ndarray, "points 3"]
    covariance: Float[np.ndarray, "points 3 3"]


@dataclass(frozen=True, eq=False)
class EdgeLine:
    """One edge found in the plane of one of its faces."""

    edge: tuple[int, int]
    """Rows of its points."""
    face: int
    across: Vec3
    """Unit vector in the plane, at right angles to the edge."""
    facing: Vec3
    """Unit vector at right angles to the edge and to the mean line of sight: what the views measure is along it. Were the plane a little
    off, the line found in it would be off along the line of sight, so `across` would say too much on faces seen at a glance."""
    offset: tuple[float, float]
    """Of the line at the two ends, along `across`, from the present corners; world units."""
    sigma: tuple[float, float]
    pixel: float
    """World length of one working pixel across the edge, in a view that sees it well."""
    contrast: float
    """Steepness of the line over the strip's median."""
    ambiguous: bool
    other_offset: tuple[float, float] | None
    """The second candidate of an ambiguous edge: its offsets from the first one."""


def drawn_edges(sketch: Sketch) -> list[tuple[int, int, int]]:
    """(face, first point, second point) of every edge of every loop and hole that the person drew; all of them where no edge is drawn.

    An open face has none between its last corner and its first.
    """
    row = {point.id: i for i, point in enumerate(sketch.points)}
    drawn = {frozenset(edge) for edge in sketch.edges}
    out: list[tuple[int, int, int]] = []
    for f, face in enumerate(sketch.faces):
        for loop in (face.loop, *face.holes):
            pairs = list(zip(loop, (*loop[1:], loop[0]), strict=True))
            closed = not (face.open and loop is face.loop)
            out += [(f, row[a], row[b]) for a, b in (pairs if closed else pairs[:-1]) if not drawn or frozenset((a, b)) in drawn]
    return out


def measure_edges(
    views: Views,
    edges: Sequence[tuple[int, int, int]],
    points: Float[np.ndarray, "points 3"],
    anchor: Anchor,
    normals: Float[np.ndarray, "faces 3"],
    owners: Int[np.ndarray, "views height width"],
    options: EdgeOptions = EdgeOptions(),
) -> list[EdgeLine]:
    """Find each edge in the plane of each of its faces; edges whose strip shows no clear line are left out.

    edges: (face, point, point) of faces and points that are known. points: the present corners, where the strips are cut. anchor: where
    the corners are without any edge; it decides between parallel lines. Were it the present corners, a wrong line would draw them
    to it, and the next round would find it nearer (a mortar joint took a wall's foot 6 px up in three rounds).
    """
    projections = views.projections.copy()
    projections[:, :2] -= 0.5 * projections[:, 2:3]
    found: list[EdgeLine] = []
    for f, a, b in edges:
        line = _measure(views, projections, f, (min(a, b), max(a, b)), points, anchor, normals[f], owners, options)
        if line is not None:
            found.append(line)
    return found


def _measure(
    views: Views,
    projections: Float[np.ndarray, "views 3 4"],
    face: int,
    edge: tuple[int, int],
    points: Float[np.ndarray, "points 3"],
    anchor: Anchor,
    normal: Vec3,
    owners: Int[np.ndarray, "views height width"],
    options: EdgeOptions,
) -> EdgeLine | None:
    a, b = points[edge[0]], points[edge[1]]
    along = b - a
    length = float(np.linalg.norm(along))
    if length < 1e-12:
        return None
    across = np.cross(normal, along / length)
    across /= np.linalg.norm(across)
    per_unit, pixels_long = _pixels_across(views, a, b, across)
    facing = (views.centers - a) @ normal > 0
    usable = facing & (per_unit > 0)
    if usable.sum() < 2:
        return None
    best = float(np.percentile(per_unit[usable], 95))
    chosen = np.nonzero(usable & (per_unit > options.near_best * best) & (per_unit < 3 * best))[0]
    if len(chosen) < 2:
        return None
    pixel = 1.0 / best
    samples = int(np.clip(np.median(pixels_long[chosen]) / options.sample_spacing, 4, options.max_samples))
    if np.median(pixels_long[chosen]) < 8.0:
        return None
    priors, middles = [], []
    for c in edge:
        if not (np.isfinite(anchor.covariance[c]).all() and np.isfinite(anchor.points[c]).all()):
            priors.append(options.max_search)
            middles.append(0.0)
            continue
        variance, away = float(across @ anchor.covariance[c] @ across), float(across @ (anchor.points[c] - points[c]))
        priors.append(float(min(np.hypot(options.prior, np.sqrt(max(variance, 0.0)) / pixel), options.max_search)))
        middles.append(away / pixel)
    search = min(max(options.search * sigma + abs(middle) for sigma, middle in zip(priors, middles, strict=True)), options.max_search)
    reach = int(np.clip(np.ceil(search / options.step), 4, options.max_steps))
    step = search / reach
    half = 2 * reach
    scale = owners.shape[1] / views.images.shape[1]
    best_strip: tuple[float, float, Float[np.ndarray, "s w"], Float[np.ndarray, "s"], Float[np.ndarray, "4 s w"], Float[np.ndarray, "v"]] | None = None
    for sign in (1.0, -1.0):
        # which side of the edge the face is on is found by looking: `owners` knows its polygon
        strip, count, texture = np.zeros((samples, 2 * half + 1)), np.zeros(samples), np.zeros((4, samples, 2 * half + 1))
        seen = np.zeros(len(chosen))
        edge_strip(
            views.images, views.chroma, options.hue, options.grain, chosen, projections, a, along, across, half, step * pixel, sign * 3.0 * pixel, owners, scale, face, options.limit,
            strip, count, texture, seen,
        )  # fmt: skip
        if best_strip is None or count.sum() > best_strip[0]:
            best_strip = (float(count.sum()), sign, strip, count, texture, seen)
    assert best_strip is not None
    _, sign, strip, count, texture, seen = best_strip
    enough = count >= max(2.0, 0.1 * count.max())
    if enough.sum() < 3:
        return None
    mean = np.where(enough[:, None], strip / np.maximum(count, 1.0)[:, None], 0.0)
    region = _region(texture / np.maximum(count, 1.0)[None, :, None], enough, sign, step, options)
    facing = _facing(views.centers[chosen], seen, 0.5 * (a + b), along, across)
    return _best_line(mean, region, enough, edge, face, (across, facing), pixel, reach, step, middles, priors, options)


def _pixels_across(views: Views, a: Vec3, b: Vec3, across: Vec3) -> tuple[Float[np.ndarray, "views"], Float[np.ndarray, "views"]]:
    """Working pixels, at right angles to the projected edge, per world unit along `across`, and the edge's length; 0 where it is out of the image."""
    p = views.projections
    ends = np.stack([a, b, 0.5 * (a + b)])
    q = np.einsum("vij,nj->vni", p[:, :, :3], ends) + p[:, None, :, 3]
    z = q[:, :, 2]
    ok = (z > 1e-9).all(axis=1)
    xy = q[:, :, :2] / np.where(np.abs(z) < 1e-9, 1e-9, z)[:, :, None]
    direction = xy[:, 1] - xy[:, 0]
    size = np.linalg.norm(direction, axis=1)
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1) / np.maximum(size, 1e-9)[:, None]
    move = p[:, :, :3] @ across
    jac = (move[:, :2] - xy[:, 2] * move[:, 2:]) / np.where(np.abs(z[:, 2:]) < 1e-9, 1e-9, z[:, 2:])
    height, width = views.images.shape[1:]
    lo, hi = xy[:, :2].min(axis=1), xy[:, :2].max(axis=1)
    ok &= (hi[:, 0] > 0) & (hi[:, 1] > 0) & (lo[:, 0] < width) & (lo[:, 1] < height)
    return np.where(ok, np.abs((jac * normal).sum(axis=1)), 0.0), np.where(ok, size, 0.0)


def _facing(centers: Float[np.ndarray, "views 3"], weight: Float[np.ndarray, "views"], middle: Vec3, along: Vec3, across: Vec3) -> Vec3:
    """Mean normal of the planes through the edge and the cameras, by how much each shows of it, on the side of `across`."""
    normal = np.cross(middle - centers, along)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    mean = weight @ (normal * np.sign(normal @ across)[:, None])
    return mean / np.linalg.norm(mean)


def _region(
    texture: Float[np.ndarray, "4 samples width"], enough: Bool[np.ndarray, "samples"], sign: float, step: float, options: EdgeOptions
) -> Float[np.ndarray, "samples width"]:
    """How well each place across the strip parts what the plane carries from what it does not, between -1 and 1.

    Inside the face the plane carries the texture: differences of grey values are alike in all views, so their mean is as large as
    their mean size. Outside it they cancel, unless what is there lies in the same plane. Bare places say nothing.
    """
    signed, size = np.abs(texture[0]) + np.abs(texture[2]), texture[1] + texture[3]
    strength = np.maximum(size - options.texture_floor, 0.0)
    carried = np.where(size > 0, signed / np.maximum(size, 1e-9) - options.carried, 0.0) * strength
    width = max(1, round(options.region / step))
    total = np.cumsum(np.pad(carried, ((0, 0), (width + 1, width)), mode="constant"), axis=1)
    size_here = carried.shape[1]
    after = total[:, 2 * width + 1 : 2 * width + 1 + size_here] - total[:, width + 1 : width + 1 + size_here]
    before = total[:, width : width + size_here] - total[:, :size_here]
    typical = float(np.abs(carried[enough]).mean()) if enough.any() else 0.0
    weight = min(1.0, float(strength[enough].mean()) / (2.0 * options.texture_floor)) if enough.any() else 0.0
    return sign * (after - before) / max(2 * width * typical, 1e-9) * weight


def _best_line(
    mean: Float[np.ndarray, "samples width"],
    region: Float[np.ndarray, "samples width"],
    enough: Bool[np.ndarray, "samples"],
    edge: tuple[int, int],
    face: int,
    directions: tuple[Vec3, Vec3],
    pixel: float,
    reach: int,
    step: float,
    middles: Sequence[float],
    priors: Sequence[float],
    options: EdgeOptions,
) -> EdgeLine | None:
    samples = len(enough)
    size = 2 * reach + 1
    scores = np.empty((size, size))
    line_scores(mean, enough, 2 * reach, scores)
    floor = float(np.median(mean[enough]))
    ends = np.arange(-reach, reach + 1) * step
    # Student's t with 10 degrees of freedom: now and then a click is off by more than its sigma says
    off = [5.5 * np.log1p(((ends - middle) / sigma) ** 2 / 10.0) for middle, sigma in zip(middles, priors, strict=True)]
    away = off[0][:, None] + off[1][None]
    height = (scores - floor) / max(float(scores.max()) - floor, 1e-9)
    # candidates are the maxima that stand out; which of them is the drawn edge is first a question of where it was drawn
    padded = np.pad(scores, 1, constant_values=np.inf)
    around = np.max([padded[1 + a : 1 + a + size, 1 + b : 1 + b + size] for a in (-1, 0, 1) for b in (-1, 0, 1) if (a, b) != (0, 0)], axis=0)
    peak = (scores >= around) & (scores > options.min_contrast * max(floor, 0.35)) & (height > options.min_height)
    if not peak.any():
        return None
    weight = options.region_weight * (1.0 - float(np.exp(-((max(priors) / options.region_sigma) ** 2))))
    parts = np.empty((size, size))
    line_scores(region, enough, 2 * reach, parts)
    near = np.abs(np.arange(size)[:, None] - np.arange(size)) <= options.clutter_band * reach
    low, usual, high = np.percentile(scores[near], [25.0, 50.0, 75.0])
    clutter = max(float(high - low) / 1.35, 0.02 * float(scores.max()), 0.1)
    stands_out = 0.5 * np.clip((scores - usual) / clutter, 0.0, options.outstanding) ** 2
    most = float(stands_out[peak].max())
    stands_out -= most
    posterior = np.where(
        peak,
        options.height_weight * np.log(np.maximum(height, 1e-9)) + stands_out + weight * (parts - parts[peak].max()) - away,
        -np.inf,
    )
    i, j = (int(v) for v in np.unravel_index(int(np.argmax(posterior)), posterior.shape))
    if posterior[i, j] < -options.reject:
        return None
    contrast = float(scores[i, j]) / max(floor, 0.35)
    # the candidates' mixture, with the chance that none of them is the edge: where several are as good, their spread is the error
    chance = np.where(peak, np.exp(posterior - posterior[i, j]), 0.0)
    clear = options.clear_weight * max(float(np.log(contrast / 2.0)), 0.0)
    missing = float(np.exp(options.height_weight * np.log(options.missing) - 0.5 * max(most - USUAL, 0.0) - clear - posterior[i, j]))
    chance[np.hypot(ends[:, None] - ends[i], ends[None] - ends[j]) < 1.5] = 0.0
    chance[i, j] = 1.0
    total = float(chance.sum()) + missing
    best = (float(ends[i]) + step * _peak(scores[i - 1 : i + 2, j]), float(ends[j]) + step * _peak(scores[i, j - 1 : j + 2]))
    t = (np.nonzero(enough)[0] + 0.5) / samples
    middle, spread = float(t.mean()), max(float(t.var()), 1e-4)
    offset, sigma = [0.0, 0.0], [0.0, 0.0]
    for end in (0, 1):
        share = chance.sum(axis=1 - end)
        places = ends.copy()
        places[(i, j)[end]] = best[end]
        mean_offset = float((share @ places + missing * middles[end]) / total)
        around_it = float((share @ (places - mean_offset) ** 2 + missing * ((middles[end] - mean_offset) ** 2 + priors[end] ** 2)) / total)
        # a line's standard deviation at its ends, relative to one seen over its whole length
        alone = options.sigma * np.sqrt((1.0 + (end - middle) ** 2 / spread) / 4.0)
        offset[end], sigma[end] = mean_offset * pixel, float(np.hypot(alone, np.sqrt(around_it))) * pixel
    rival = np.where(np.abs(ends[:, None] - ends[i]) + np.abs(ends[None] - ends[j]) > 3.0, chance, 0.0)
    k, m = (int(v) for v in np.unravel_index(int(np.argmax(rival)), rival.shape))
    ambiguous = bool(rival[k, m] > options.ambiguous)
    return EdgeLine(
        edge, face, *directions, (offset[0], offset[1]), (sigma[0], sigma[1]), pixel, contrast, ambiguous,
        (float(ends[k] - ends[i]) * pixel, float(ends[m] - ends[j]) * pixel) if ambiguous else None,
    )  # fmt: skip


def _peak(values: Float[np.ndarray, "3"]) -> float:
    """Where the parabola through three equally spaced values has its top, in steps from the middle one."""
    curvature = values[0] - 2 * values[1] + values[2]
    return float(np.clip(0.5 * (values[0] - values[2]) / curvature, -0.5, 0.5)) if curvature < 0 else 0.0


def corner_lines(lines: Sequence[EdgeLine], points: Float[np.ndarray, "points 3"]) -> CornerLines:
    """The lines as evidence about corners. An edge found in two faces counts once in all: its sigma grows by the square root of two."""
    times: dict[tuple[int, int], int] = {}
    for line in lines:
        times[line.edge] = times.get(line.edge, 0) + 1
    corner, direction, offset, sigma = [], [], [], []
    for line in lines:
        for end in (0, 1):
            corner.append(line.edge[end])
            slant = float(line.facing @ line.across)
            direction.append(line.facing)
            offset.append(float(line.facing @ points[line.edge[end]]) + slant * line.offset[end])
            sigma.append(slant * line.sigma[end] * np.sqrt(times[line.edge]))
    return CornerLines(np.array(corner, int), np.array(direction, float).reshape(-1, 3), np.array(offset, float), np.array(sigma, float))
