"""Faces through a clip, each registered in every frame to a frame in which it is known; nothing is chained but the search's start."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import cv2
import numpy as np

from planewright.arrays import Bool, Float, GrayImage, Int, Mat3
from planewright.progress import Progress, silent
from planewright.registration.homography import apply_homography, change_jacobian, changed, point_jacobian
from planewright.registration.kernels import align_face, find_lines
from planewright.registration.registered import CELLS, Registered
from planewright.registration.strands import Strand, find_strands
from planewright.registration.templates import (
    Level,
    Template,
    TemplateLevel,
    TemplateOptions,
    cell_of,
    clear_share,
    face_mask,
    make_template,
    pyramid,
    to_level,
)
from planewright.sketch.graph import Sketch
from planewright.video.frames import Frames

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""Of a face's square."""


@dataclass(frozen=True, kw_only=True)
class RegistrationOptions:
    """How faces are followed."""

    templates: TemplateOptions = field(default_factory=TemplateOptions)
    """How a face's pixels are chosen."""
    flow_points: int = 24
    """Points of a face whose optical flow predicts its next place."""
    flow_window: int = 15
    """Of the flow, pixels."""
    flow_sigma: float = 0.7
    """Of one point's flow along an axis, pixels; neighbours err together, so their number counts for a third."""
    neighbour_sigma: float = 1.0
    """Error a frame of a corner whose motion is taken from the faces around, pixels. Such errors have one sense: over frames they add up, not their squares."""
    neighbourhood: float = 0.15
    """Reach of that motion, as a share of the image's longer side."""
    lost_sigma: float = 25.0
    """A face whose corners are known worse than this, pixels, is not looked for any more."""
    grey_sigma: float = 1.0
    """Least standard deviation of a smoothed grey value: noise and compression."""
    least_grey_sigma: float = 0.3
    """The same on the coarse levels, where noise averages out but compression does not."""
    independent: float = 12.0
    """Neighbouring pixels of a frame that count as one: what its smoothing correlates (4 pi sigma^2)."""
    sure_sigma: float = 1.0
    """Pixels; faces known better than this are registered first, and hold those beside them by the corners they share."""
    click_sigma: float = 1.2
    """Of the marks along an axis, pixels: a click beside a corner is another place on each of its faces, and these part as the view changes."""
    shared_sigma: float = 0.7
    """What is left of the distance between a corner on one face and on another, pixels: faces are not quite plane."""
    iterations: int = 12
    """Of the registration, on each level."""
    min_correlation: float = 0.7
    """With the template, of the pixels that agree; less is asked of a face whose contrast drowns in noise."""
    max_residual: float = 0.35
    """Largest standard deviation of the pixels from the template, in standard deviations of the template, besides three `grey_sigma`."""
    again_correlation: float = 0.85
    """`min_correlation` for a face that was lost."""
    again_residual: float = 0.25
    """`max_residual` for a face that was lost."""
    settled: int = 5
    """Frames in a row in which a face must be found before a template is made of it."""
    min_weight: float = 0.4
    """Mean Tukey weight of the pixels in the image."""
    max_jump: float = 8.0
    """Pixels, besides three sigmas, by which a corner may leave its prediction."""
    max_sigma: float = 3.0
    """Pixels; a face of which the worst corner is known worse than this does not count as registered."""
    min_area: float = 80.0
    """Square pixels; a smaller image of a face is not looked at."""
    max_templates: int = 6
    """Of a strand: the first and those added where it looks different."""
    new_template: float = 0.6
    """A template is added when the face is seen larger, smaller or more foreshortened than in any: |ln s1| + |ln s2| of the scales between them."""
    hop_penalty: float = 0.1
    """How much nearer in the same measure an added template must be to be preferred to the first."""
    search: float = 3.5
    """Edges are looked for this far from where the face shows them, pixels."""
    spacing: float = 3.0
    """Of the samples along an edge, pixels."""
    min_step: float = 3.0
    """Weakest step across an edge that counts, grey levels over one pixel."""
    min_share: float = 0.5
    """Of an edge's samples that must lie on one line."""
    line_sigma: float = 0.5
    """Least standard deviation of a line's end against the line in the first frame, pixels."""


def follow_faces(frames: Frames, sketch: Sketch, options: RegistrationOptions = RegistrationOptions(), *, progress: Progress = silent) -> Registered:
    """Homographies of all drawn faces in all frames, without cameras.

    A face starts in every frame in which three of its corners are marked. In each frame its place is predicted (optical flow of its own points, or the
    motion of the faces around it), then registered to a frame in which it is known (kernels.align_face), then to its drawn edges. The prediction is the
    prior of a Kalman update: what the pixels of a bare face do not say stays as uncertain as the motion makes it. Sweeps: forwards from the first mark,
    backwards over the whole clip, forwards again; each fills what the one before could not find.
    """
    numbers = [int(n) for n in frames.numbers]
    strands = find_strands(sketch, numbers)
    follower = _Follower(frames, numbers, strands, options)
    if strands:
        follower.sweep(progress)
        follower.drop_refuted()
    return follower.registered()


class _Follower:
    """The table that the sweeps fill, and the state of the frame before."""

    def __init__(self, frames: Frames, numbers: Sequence[int], strands: tuple[Strand, ...], options: RegistrationOptions) -> None:
        self.frames, self.numbers, self.strands, self.options = frames, numbers, strands, options
        s, t = len(strands), len(numbers)
        most = max((len(strand.edges) for strand in strands), default=0)
        self.h = np.full((s, t, 3, 3), np.nan)
        self.p = np.full((s, t, 8, 8), np.nan)
        self.found = np.zeros((s, t), bool)
        self.correlation = np.zeros((s, t))
        self.support = np.full((s, t, CELLS * CELLS), np.nan, np.float32)
        self.lines = np.full((s, t, most, 4), np.nan, np.float32)
        self.templates: list[list[Template]] = [[] for _ in strands]
        self.points: list[Float[np.ndarray, "points 2"]] = [np.zeros((0, 2)) for _ in strands]
        self.seed_lines: list[Float[np.ndarray, "edges 4"]] = [np.zeros((0, 4)) for _ in strands]
        self.missed = np.zeros(s, np.int64)
        self.run = np.zeros(s, np.int64)
        self.refuted = np.zeros(s, np.int64)

    def registered(self) -> Registered:
        return Registered(
            strands=self.strands, image_size=self.frames.image_size, frame=np.array(self.numbers, dtype=np.int64), homography=self.h, covariance=self.p,
            found=self.found, correlation=self.correlation, support=self.support, lines=self.lines,
        )  # fmt: skip

    def sweep(self, progress: Progress) -> None:
        at = {n: k for k, n in enumerate(self.numbers)}
        seeds = sorted({at[strand.frame] for strand in self.strands})
        order = [*range(seeds[0], len(self.numbers)), *range(len(self.numbers) - 1, -1, -1), *range(seeds[-1] + 1)]
        passes = [range(seeds[0], len(self.numbers)), range(len(self.numbers) - 1, -1, -1), range(seeds[-1] + 1)]
        done = 0
        with ThreadPoolExecutor(2) as threads:
            for span in passes:
                before: tuple[int, GrayImage] | None = None
                self.missed[:] = 0
                for k, gray in self._read(span):
                    progress("Registering faces", done, len(order))
                    self._advance(k, gray, before, threads)
                    before = (k, gray)
                    done += 1
        progress("Registering faces", len(order), len(order))

    def drop_refuted(self) -> None:
        """Strands that were contradicted more often than found show something else than their face: only the frame of their marks is left."""
        for s in np.nonzero(self.refuted > np.maximum(self.found.sum(axis=1), 4))[0]:
            others = np.array(self.numbers) != self.strands[s].frame
            self.found[s, others] = False
            self.h[s, others] = np.nan
            self._forget(int(s), others)

    def _read(self, span: range, chunk: int = 24) -> Iterator[tuple[int, GrayImage]]:
        """Frames in the order of the span, a chunk in memory at a time when it goes backwards."""
        at = {n: k for k, n in enumerate(self.numbers)}
        if span.step > 0:
            for n, gray in self.frames.gray([self.numbers[k] for k in span]):
                yield at[n], gray
            return
        for first in range(0, len(span), chunk):
            part = span[first : first + chunk]
            held = {at[n]: gray for n, gray in self.frames.gray([self.numbers[k] for k in reversed(part)])}
            for k in part:
                yield k, held[k]

    def _advance(self, k: int, gray: GrayImage, before: tuple[int, GrayImage] | None, threads: ThreadPoolExecutor) -> None:
        born = [s for s, strand in enumerate(self.strands) if strand.frame == self.numbers[k] and not self.templates[s]]
        known = [] if before is None else [s for s in range(len(self.strands)) if np.isfinite(self.h[s, before[0], 2, 2])]
        todo = [s for s in known if not self.found[s, k]]
        if not born and not todo:
            return
        o = self.options
        levels = pyramid(gray, o.templates)
        for s in born:
            self._bear(s, k, gray, levels)
        if before is None or not todo:
            return
        self._predict(known, todo, before[0], k, before[1], gray)
        wanted = [s for s in todo if np.isfinite(self.h[s, k, 2, 2]) and (self.missed[s] < 6 or self.missed[s] % 3 == 0)]
        sure = {s for s in wanted if self.found[s, before[0]] and _worst_corner(self.h[s, before[0]], self.p[s, before[0]], self.strands[s].q) < o.sure_sigma}
        for some in (sorted(sure), [s for s in wanted if s not in sure]):
            for s in some:
                if s not in sure:
                    self._hold(s, k)

            def register(s: int) -> None:
                self._register(s, k, levels)

            list(threads.map(register, some))
            self._measure_lines(k, levels[0], [s for s in some if self.correlation[s, k] != 0])
            self._agree(k, set(some))
        for s in todo:
            self.missed[s] = 0 if self.found[s, k] else self.missed[s] + 1
            self.run[s] = self.run[s] + 1 if self.found[s, k] else 0
            if self.run[s] >= o.settled:
                self._maybe_add_template(s, k, levels)

    def _bear(self, s: int, k: int, gray: GrayImage, levels: Sequence[Level]) -> None:
        """The first template of a strand, the points that its flow is read at, and the lines at its edges."""
        strand, o = self.strands[s], self.options
        loop = apply_homography(strand.h, strand.q[: strand.loop_length])
        others = [apply_homography(strand.h, other) for other in strand.others]
        mask = face_mask(gray.shape, loop, [], others, o.templates.erosion)
        template = make_template(levels, mask, self.numbers[k], strand.h, np.zeros((8, 8)), o.templates)
        if template is None:
            # Too thin for a margin like that.
            template = make_template(levels, face_mask(gray.shape, loop, [], others, 1.0), self.numbers[k], strand.h, np.zeros((8, 8)), o.templates)
        if template is None:
            return
        self.templates[s] = [template]
        corners = cv2.goodFeaturesToTrack(gray, o.flow_points, 0.005, 4, mask=mask.astype(np.uint8), blockSize=5)
        # None where there are none
        found = np.asarray(corners if corners is not None else np.zeros((0, 2)), np.float64).reshape(-1, 2)  # pyright: ignore[reportUnnecessaryComparison]
        self.points[s] = apply_homography(np.linalg.inv(strand.h), found)
        self.h[s, k], self.p[s, k] = strand.h, np.zeros((8, 8))
        self.found[s, k], self.correlation[s, k] = True, 1.0
        self.support[s, k] = np.where(np.bincount(_cells(template), minlength=CELLS * CELLS) > 0, 1.0, np.nan)
        ends = loop_ends(strand, strand.h)
        out = np.zeros((len(ends), 4))
        find_lines(levels[0], ends, o.search, o.spacing, o.min_step, out)
        out[out[:, 3] < o.min_share] = np.nan
        self.seed_lines[s] = out
        self.lines[s, k, : len(out)] = out

    def _predict(self, known: Sequence[int], todo: Sequence[int], j: int, k: int, old: GrayImage, new: GrayImage) -> None:
        """Where flow carries the strands from column j to column k, and how sure that is."""
        o = self.options
        rows, columns = new.shape
        places: list[Float[np.ndarray, "n 2"]] = []
        owner: list[Int[np.ndarray, "n"]] = []
        for s in known:
            if self.found[s, j] and len(self.points[s]):
                xy = apply_homography(self.h[s, j], self.points[s])
                good = np.isfinite(xy).all(axis=1) & (np.nan_to_num(xy) > 3).all(axis=1)
                good &= (np.nan_to_num(xy[:, 0]) < columns - 4) & (np.nan_to_num(xy[:, 1]) < rows - 4)
                places.append(xy[good])
                owner.append(np.full(int(good.sum()), s))
        start = np.concatenate(places) if places else np.zeros((0, 2))
        of = np.concatenate(owner) if owner else np.zeros(0, np.int64)
        moved = np.zeros((0, 2))
        if len(start):
            window, criteria = (o.flow_window, o.flow_window), (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.03)
            first = start.astype(np.float32)[:, None]
            there, ok, _ = cv2.calcOpticalFlowPyrLK(old, new, first, np.empty_like(first), winSize=window, maxLevel=3, criteria=criteria)
            good = ok[:, 0] > 0
            start, of, moved = start[good], of[good], (there[good, 0] - first[good, 0]).astype(np.float64)
        for s in todo:
            h, p = self.h[s, j], self.p[s, j]
            own = np.nonzero(of == s)[0]
            own_flow = bool(self.found[s, j]) and len(own) >= 6
            if own_flow:
                q = apply_homography(np.linalg.inv(h), start[own])
                change, spread = _fit_change(h, q, moved[own], o.flow_sigma)
            elif len(start):
                centre = h[:2, 2] / h[2, 2]
                near = np.exp(-((start - centre) ** 2).sum(axis=1) / (2 * (o.neighbourhood * max(rows, columns)) ** 2)) + 1e-6
                change, spread = _carried(h, start, moved, near, o.neighbour_sigma)
            else:
                change, spread = np.zeros(8), np.linalg.inv(_corner_information(h, 2 * o.neighbour_sigma))
            guess = changed(h, change)
            if not self._worth(guess):
                continue
            covariance = p + spread
            if not own_flow:
                before = max(_worst_corner(h, p), 0.1)
                covariance = p * (1 + 2 * o.neighbour_sigma / before) + spread
            if _worst_corner(guess, covariance) > o.lost_sigma:
                continue
            if np.isfinite(self.h[s, k, 2, 2]) and _worst_corner(self.h[s, k], self.p[s, k]) < _worst_corner(guess, covariance):
                continue  # predicted better by an earlier sweep
            self.h[s, k], self.p[s, k] = guess, covariance

    def _shared(self, s: int, k: int) -> Iterator[tuple[int, Int[np.ndarray, "shared"], Int[np.ndarray, "shared"]]]:
        """Strands drawn in the same frame and found in column k that share corners with strand s: which, and the rows of these corners in both."""
        mine = self.strands[s]
        for other, strand in enumerate(self.strands):
            if other != s and self.found[other, k] and strand.frame == mine.frame:
                _, a, b = np.intersect1d(mine.corners, strand.corners, return_indices=True)
                if len(a):
                    yield other, a, b

    def _parting(self, s: int, other: int, k: int, a: Int[np.ndarray, "shared"], b: Int[np.ndarray, "shared"]) -> Float[np.ndarray, "shared 2 2"]:
        """Covariance of the distance between the shared corners of two strands in column k, their own and that of the marks."""
        o, mine, theirs = self.options, self.strands[s], self.strands[other]
        d = change_jacobian(self.h[other, k], theirs.q[b])
        # Pixels of this frame by pixels of the first, on either face.
        first = point_jacobian(self.h[s, k], mine.q[a]) @ np.linalg.inv(point_jacobian(mine.h, mine.q[a]))
        second = point_jacobian(self.h[other, k], theirs.q[b]) @ np.linalg.inv(point_jacobian(theirs.h, theirs.q[b]))
        apart = first - second
        own = np.einsum("cij,jk,clk->cil", d, self.p[other, k], d)
        return own + o.click_sigma**2 * apart @ apart.transpose(0, 2, 1) + o.shared_sigma**2 * np.eye(2)

    def _hold(self, s: int, k: int) -> None:
        """A prediction improved by the corners that the strand shares with those already found in this frame."""
        h, p = self.h[s, k], self.p[s, k]
        information, pull = np.linalg.inv(p + 1e-10 * np.eye(8)), np.zeros(8)
        for other, a, b in self._shared(s, k):
            q = self.strands[s].q[a]
            away, j = apply_homography(self.h[other, k], self.strands[other].q[b]) - apply_homography(h, q), change_jacobian(h, q)
            spread = self._parting(s, other, k, a, b)
            if not (np.isfinite(away).all() and np.isfinite(spread).all()):
                continue
            # Cauchy weights: a shared corner that is far off says that one of the two is wrong, not which.
            mine = np.einsum("cij,jk,clk->cil", j, p, j) + spread
            doubt = np.einsum("ci,cij,cj->c", away, np.linalg.inv(mine), away)
            weight = np.linalg.inv(spread) / (1.0 + doubt / 9.0)[:, None, None]
            information += np.einsum("cia,cij,cjb->ab", j, weight, j)
            pull += np.einsum("cia,cij,cj->a", j, weight, away)
        if pull.any():
            covariance = np.linalg.inv(information)
            guess = changed(h, covariance @ pull)
            if self._worth(guess):
                self.h[s, k], self.p[s, k] = guess, covariance

    def _agree(self, k: int, fresh: set[int]) -> None:
        """Takes back what contradicts better known faces at the corners they share."""
        worst = {s: _worst_corner(self.h[s, k], self.p[s, k], self.strands[s].q) for s in range(len(self.strands)) if self.found[s, k]}
        for s in sorted(fresh & worst.keys(), key=lambda s: (-worst[s], s)):
            for other, a, b in self._shared(s, k):
                if worst[other] > worst[s]:
                    continue
                away = apply_homography(self.h[s, k], self.strands[s].q[a]) - apply_homography(self.h[other, k], self.strands[other].q[b])
                j = change_jacobian(self.h[s, k], self.strands[s].q[a])
                spread = np.einsum("cij,jk,clk->cil", j, self.p[s, k], j) + self._parting(s, other, k, a, b)
                if (np.einsum("ci,cij,cj->c", away, np.linalg.inv(spread), away) > 13.8).any():
                    self.found[s, k] = False
                    self.refuted[s] += 1
                    self._forget(s, k)
                    self.p[s, k] += np.linalg.inv(_corner_information(self.h[s, k], 3.0))
                    break

    def _forget(self, s: int, k: int | Bool[np.ndarray, "frames"]) -> None:
        self.correlation[s, k], self.support[s, k], self.lines[s, k] = 0.0, np.nan, np.nan

    def _worth(self, h: Mat3) -> bool:
        """Whether the face is seen from its front, large enough, and in the image."""
        corners = apply_homography(h, CORNERS)
        if not np.isfinite(corners).all() or not h[2, 2] > 0:
            return False
        j = point_jacobian(h, CORNERS)
        det = np.linalg.det(j)
        if (4 * det < self.options.min_area).any() or det.max() > 30 * det.min():
            return False
        width, height = self.frames.image_size
        return bool((corners.max(axis=0) > 0).all() and corners[:, 0].min() < width and corners[:, 1].min() < height)

    def _register(self, s: int, k: int, levels: Sequence[Level]) -> None:
        """Coarse to fine; the level that knows the face best has the last word: the finest, unless noise drowns what a face shows there."""
        o = self.options
        guess, spread = self.h[s, k].copy(), self.p[s, k].copy()
        template = self._best_template(s, guess)
        prior = np.linalg.inv(spread + 1e-10 * np.eye(8))
        worst = _worst_corner(guess, spread)
        # A face seen smaller than in its template has fewer pixels in this frame than the template has.
        shrunk = np.linalg.det(point_jacobian(guess, np.zeros((1, 2)))[0]) / np.linalg.det(point_jacobian(template.h, np.zeros((1, 2)))[0])
        crowding = o.independent / float(np.clip(shrunk, 0.02, 1.0))
        h, deviation = guess.copy(), np.zeros(8)
        best: _Aligned | None = None
        for level in range(self._first_level(template, len(levels), worst), -1, -1):
            t = template.levels[level]
            if t is None:
                continue
            scaled = to_level(level) @ h
            scaled /= scaled[2, 2]
            weights, information, figures, offset = np.zeros(len(t.q)), np.zeros((8, 8)), np.zeros(6), deviation.copy()
            floor = max(o.grey_sigma * 0.5**level, o.least_grey_sigma)
            crowd, clear = max(t.share * crowding / (1 if level == 0 else 2), 1.0), clear_share(t, floor)
            good = align_face(
                levels[level], t.q, t.values, t.steepest, scaled, offset, prior, floor, crowd / clear**2, o.iterations,
                0.02 if level == 0 else 0.05, weights, information, figures,
            )  # fmt: skip
            if not good:
                continue
            h, deviation = np.linalg.inv(to_level(level)) @ scaled, offset
            h /= h[2, 2]
            # The template's own noise looks like slope, and says nothing.
            now = clear_share(t, max(float(figures[3]), floor))
            covariance = np.linalg.inv(information * (now / clear) ** 2 + prior)
            error = _worst_corner(h, covariance)
            if best is None or error < best.error:
                best = _Aligned(h, covariance, error, t, weights, figures, floor)
        if best is None:
            return
        t, figures = best.level, best.figures
        contrast = float(t.values.var())
        reliable = max(contrast - best.floor**2, 0.0) / max(contrast, 1e-9)
        lost = self.missed[s] >= 3
        correlation, residual = (o.again_correlation, o.again_residual) if lost else (o.min_correlation, o.max_residual)
        before, after = apply_homography(guess, CORNERS), apply_homography(best.h, CORNERS)
        jump = float(np.abs(after - before).max()) if np.isfinite(after).all() else np.inf
        alike = figures[0] >= correlation * reliable and figures[3] <= 3 * best.floor + residual * figures[4] * np.sqrt(contrast)
        if not (alike and figures[1] >= o.min_weight and jump <= o.max_jump + 3 * worst and self._worth(best.h)):
            return
        self.h[s, k], self.p[s, k] = best.h, best.covariance + template.covariance
        self.correlation[s, k] = max(float(figures[0]), 1e-3)
        inside = best.weights >= 0
        cell = cell_of(t.q, CELLS)[inside]
        total = np.bincount(cell, minlength=CELLS * CELLS)
        with np.errstate(invalid="ignore"):
            self.support[s, k] = np.bincount(cell, weights=best.weights[inside] > 0.3, minlength=CELLS * CELLS) / np.where(total > 0, total, np.nan)

    def _first_level(self, template: Template, count: int, worst: float) -> int:
        """Coarse levels as far as the prediction may be wrong, for level l reaches about 2^l pixels, and as noise hides what the finer ones show."""
        first = min(count, len(template.levels)) - 1
        while first > 0 and 2.0**first > max(1.5 * worst, 2.0):
            t = template.levels[first - 1]
            if t is not None and clear_share(t, max(self.options.grey_sigma * 0.5 ** (first - 1), self.options.least_grey_sigma)) < 0.5:
                break
            first -= 1
        return first

    def _measure_lines(self, k: int, image: Level, rows: Sequence[int]) -> None:
        """Lines at the drawn edges of the registered strands; what they add to the homographies; which strands are found."""
        o = self.options
        # What the pixels leave open, lines further off may settle; the others are then looked for from there.
        loose = [s for s in rows if _worst_corner(self.h[s, k], self.p[s, k], self.strands[s].q) > o.sure_sigma]
        for some, search in ((loose, 2 * o.search), (rows, o.search)):
            if not some:
                continue
            ends = [loop_ends(self.strands[s], self.h[s, k]) for s in some]
            every = np.concatenate(ends)
            out = np.zeros((len(every), 4))
            find_lines(image, np.where(np.isfinite(every), every, -1e4), search, o.spacing, o.min_step, out)
            out[out[:, 3] < o.min_share] = np.nan
            at = 0
            for s, own in zip(some, ends, strict=True):
                self.lines[s, k, : len(own)] = out[at : at + len(own)]
                at += len(own)
                before = self.p[s, k].copy()
                self._use_lines(s, k, own, self.lines[s, k, : len(own)].astype(np.float64))
                if search > o.search:
                    self.p[s, k] = before  # the same lines must not count twice
        for s in rows:
            self.found[s, k] = _worst_corner(self.h[s, k], self.p[s, k], self.strands[s].q) <= o.max_sigma and self._worth(self.h[s, k])

    def _use_lines(self, s: int, k: int, ends: Float[np.ndarray, "edges 4"], lines: Float[np.ndarray, "edges 4"]) -> None:
        """A Kalman update by the offsets of the lines against those in the first frame, as far as they are believable."""
        o, strand = self.options, self.strands[s]
        first = self.seed_lines[s]
        both = np.isfinite(lines[:, 0]) & np.isfinite(first[:, 0]) & np.isfinite(ends).all(axis=1)
        if not both.any():
            return
        h, p = self.h[s, k], self.p[s, k]
        e, f = ends[both].reshape(-1, 2, 2), loop_ends(strand, strand.h)[both].reshape(-1, 2, 2)
        direction = e[:, 1] - e[:, 0]
        length = np.linalg.norm(direction, axis=1)
        normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1) / np.maximum(length, 1e-9)[:, None]
        f_direction = f[:, 1] - f[:, 0]
        f_normal = np.stack([-f_direction[:, 1], f_direction[:, 0]], axis=1) / np.maximum(np.linalg.norm(f_direction, axis=1), 1e-9)[:, None]
        # The line of the first frame, carried into this one: an offset across the edge there is an offset across it here, times the scale between them.
        q = strand.q[strand.edges[both].reshape(-1)]
        n = normal.repeat(2, axis=0)
        across = point_jacobian(h, q) @ np.linalg.inv(point_jacobian(strand.h, q)) @ f_normal.repeat(2, axis=0)[:, :, None]
        expected = first[both, :2].reshape(-1) * np.einsum("ci,cij->c", n, across)
        residual = lines[both, :2].reshape(-1) - expected
        jacobian = np.einsum("ci,cij->cj", n, change_jacobian(h, q))
        samples = np.clip(length / o.spacing, 5, 60)
        sigma = np.sqrt(o.line_sigma**2 + 4 * (lines[both, 2] ** 2 + first[both, 2] ** 2) / samples).repeat(2)
        expected_sigma = np.sqrt(np.einsum("ni,ij,nj->n", jacobian, p, jacobian) + sigma**2)
        # Three sigmas: beyond, it is another line.
        use = (np.abs(residual) < 3 * expected_sigma).reshape(-1, 2).all(axis=1).repeat(2)
        if not use.any():
            return
        j, r, w = jacobian[use], residual[use], 1.0 / sigma[use] ** 2
        inverse = np.linalg.inv(p + 1e-12 * np.eye(8))
        covariance = np.linalg.inv(inverse + (j * w[:, None]).T @ j)
        self.h[s, k], self.p[s, k] = changed(h, covariance @ (j.T @ (w * r))), covariance

    def _best_template(self, s: int, h: Mat3) -> Template:
        return min(self.templates[s], key=lambda t: (_unlike(t.h, h) + (self.options.hop_penalty if t is not self.templates[s][0] else 0.0), t.frame))

    def _maybe_add_template(self, s: int, k: int, levels: Sequence[Level]) -> None:
        """A new template where the face looks different from all there are and is known well."""
        o, h, p = self.options, self.h[s, k], self.p[s, k]
        if len(self.templates[s]) >= o.max_templates or min(_unlike(t.h, h) for t in self.templates[s]) < o.new_template:
            return
        strand = self.strands[s]
        if np.nanmean(self.support[s, k]) < 0.75 or _worst_corner(h, p, strand.q) > 0.5:
            return
        loop = apply_homography(h, strand.q[: strand.loop_length])
        others = [apply_homography(h, other) for other in strand.others]
        if not np.isfinite(loop).all() or not all(np.isfinite(other).all() for other in others):
            return
        mask = face_mask(levels[0].shape, loop, [], others, o.templates.erosion)
        template = make_template(levels, mask, self.numbers[k], h, p, o.templates)
        if template is not None and template.levels[0] is not None and len(template.levels[0].q) >= 200:
            self.templates[s].append(template)


@dataclass(frozen=True, eq=False)
class _Aligned:
    """What one level found."""

    h: Mat3
    covariance: Float[np.ndarray, "8 8"]
    error: float
    level: TemplateLevel
    weights: Float[np.ndarray, "pixels"]
    figures: Float[np.ndarray, "6"]
    floor: float


def loop_ends(strand: Strand, h: Mat3) -> Float[np.ndarray, "edges 4"]:
    """End points of the strand's edges in the image, pixels with centres at integers."""
    return apply_homography(h, strand.q)[strand.edges].reshape(-1, 4)


def _cells(template: Template) -> Int[np.ndarray, "pixels"]:
    fine = template.levels[0]
    assert fine is not None
    return cell_of(fine.q, CELLS)


def _corner_information(h: Mat3, sigma: float) -> Float[np.ndarray, "8 8"]:
    """As if each corner of the face's square were seen with that sigma."""
    j = change_jacobian(h, CORNERS).reshape(8, 8)
    return j.T @ j / sigma**2


def _worst_corner(h: Mat3, covariance: Float[np.ndarray, "8 8"], q: Float[np.ndarray, "n 2"] = CORNERS) -> float:
    """Largest standard deviation of a corner, pixels."""
    j = change_jacobian(h, q)
    spread = np.einsum("nij,jk,nik->n", j, covariance, j)
    return float(np.sqrt(max(float(np.nan_to_num(spread, nan=1e12).max()), 0.0)))


def _fit_change(
    h: Mat3, q: Float[np.ndarray, "n 2"], motion: Float[np.ndarray, "n 2"], sigma: float
) -> tuple[Float[np.ndarray, "8"], Float[np.ndarray, "8 8"]]:
    """The change of a homography that moves points as their flow says (Cauchy weights), and its covariance.

    What the points do not determine stays near a shift of the whole face: corners move against each other by a few pixels a frame at most.
    """
    j = change_jacobian(h, q)
    middle = np.median(motion, axis=0)
    shift = np.zeros(8)
    turn = h[:2, :2] - np.outer(h[:2, 2], h[2, :2])
    shift[[2, 5]] = np.linalg.solve(turn, middle)
    prior = _corner_information(h, 4.0)
    change = shift
    weight = 1.0 / (1.0 + ((motion - middle) ** 2).sum(axis=1) / 4.0**2)
    normal = prior
    for _ in range(6):
        w = weight / (3.0 * sigma**2)
        normal = prior + np.einsum("nci,n,ncj->ij", j, w, j)
        change = np.linalg.solve(normal, prior @ shift + np.einsum("nci,n,nc->i", j, w, motion))
        left = ((motion - j @ change) ** 2).sum(axis=1)
        spread = max(2.0 * float(np.median(left)), sigma**2)
        weight = 1.0 / (1.0 + left / spread)
    return change, np.linalg.inv(normal)


def _carried(
    h: Mat3, start: Float[np.ndarray, "n 2"], motion: Float[np.ndarray, "n 2"], near: Float[np.ndarray, "n"], sigma: float
) -> tuple[Float[np.ndarray, "8"], Float[np.ndarray, "8 8"]]:
    """The change by the affine motion of the points around, and its covariance."""
    centre = np.average(start, axis=0, weights=near)
    scale = max(float(np.sqrt(np.average(((start - centre) ** 2).sum(axis=1), weights=near))), 20.0)
    a = np.column_stack([(start - centre) / scale, np.ones(len(start))])
    weight = near.copy()
    fit = np.zeros((3, 2))
    for _ in range(6):
        # The ridge: a few points in a row must not turn the rest of the image.
        fit = np.linalg.solve((a * weight[:, None]).T @ a + np.diag([1.0, 1.0, 1e-6]) * 0.05 * weight.sum(), (a * weight[:, None]).T @ motion)
        left = ((motion - a @ fit) ** 2).sum(axis=1)
        weight = near / (1.0 + left / 1.5**2)
    corners = apply_homography(h, CORNERS)
    wanted = np.column_stack([(corners - centre) / scale, np.ones(4)]) @ fit
    information = _corner_information(h, sigma)
    j = change_jacobian(h, CORNERS).reshape(8, 8)
    return np.linalg.solve(j.T @ j + 1e-9 * np.eye(8), j.T @ wanted.reshape(-1)), np.linalg.inv(information)


def _unlike(a: Mat3, b: Mat3) -> float:
    """How differently large and foreshortened a face is under two homographies."""
    zero = np.zeros((1, 2))
    s = np.linalg.svd(point_jacobian(b, zero)[0] @ np.linalg.inv(point_jacobian(a, zero)[0]), compute_uv=False)
    return float(np.abs(np.log(np.maximum(s, 1e-9))).sum())
