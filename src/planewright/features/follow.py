"""Scene features through a clip: every observation is registered to the patch in which the feature was born, so nothing drifts."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from planewright.arrays import Bool, Float, GrayImage, Int, UInt8
from planewright.features.detect import DetectOptions, detect_corners
from planewright.features.features import Features
from planewright.features.kernels import align_patches
from planewright.progress import Progress, silent
from planewright.video.frames import Frames

Regions = Mapping[int, Sequence[Float[np.ndarray, "_corners 2"]]]
"""Frame number -> polygons in pixels."""


@dataclass(frozen=True, kw_only=True)
class FollowOptions:
    """How features are followed."""

    detect: DetectOptions = field(default_factory=DetectOptions)
    max_pixels: float = 1.6e6
    """Images with more pixels are halved (or more) for following; positions are scaled back."""
    half_window: int = 7
    """Half the patch's side, pixels: 15 x 15 in all."""
    window_sigma: float = 4.0
    """Of the patch's Gaussian weight, pixels."""
    smoothing: float = 0.7
    """Of the image before registration, pixels; it takes out the pull of bilinear interpolation towards whole pixels."""
    pyramid_levels: int = 3
    """Of the prediction from the frame before; three reach about 50 pixels of motion a frame."""
    max_round_trip: float = 0.7
    """Pixels between a point and its prediction there and back again."""
    max_jump: float = 2.5
    """Pixels between prediction and registered position."""
    min_zncc: float = 0.80
    """Correlation with the birth patch below which a feature ends."""
    max_scale: float = 3.0
    """Change of the patch's area, either way, at which a feature ends."""
    max_change: float = 0.6
    """Change of the patch's affine shape in one frame (sum over its four entries) that no camera makes."""
    shape_stiffness: float = 1e5
    """Weight of a change of the patch's affine shape in one frame, (grey levels a unit of change)^2: noise of 4 grey levels against changes of 0.013.
    A weak or blurred patch does not tell its shape; left free, it threw off a tenth of such features in every frame. At 960x540 a desk compressed until
    blocks show then has cameras good to 0.56 pixels at its corners (12.6 without, 0.64 at 2e4, 0.56 at 5e5), an ordinary one 0.13 (0.19)."""
    iterations: int = 10
    """Of the registration."""
    min_length: int = 3
    """Frames; shorter tracks are dropped."""
    max_observations: float = 6e5
    """In a clip of more than about 850 frames fewer corners are followed at a time, so that the table stays near this size (10 MB)."""
    min_corners: int = 250
    """But never fewer than this."""
    detect_every: int = 3
    """Frames between looks for new corners."""


def follow_features(frames: Frames, options: FollowOptions = FollowOptions(), *, regions: Regions | None = None, progress: Progress = silent) -> Features:
    """Features of the whole image, or with `regions` of the parts of it that the polygons cover.

    One pass over the clip, two frames in memory at a time. Pyramidal Lucas-Kanade (Bouguet 2001) from the frame before is only a prediction; the position
    is that of an affine, gain and bias registration to the patch of the frame in which the feature was first seen (kernels.align_patches). Without that
    step cameras are 3 to 9 times worse.

    With `regions`, corners are found only inside the polygons, in the frames they are given for, and followed forwards and backwards from there: the
    way to follow an object that moves before a still background.
    """
    numbers = [int(n) for n in frames.numbers]
    affordable = max(int(options.max_observations / max(len(numbers), 1)), options.min_corners)
    options = replace(options, detect=replace(options.detect, max_corners=min(options.detect.max_corners, affordable)))
    scale = _working_scale(frames.image_size, options.max_pixels)
    log = _Log(options.min_length)
    if not regions:
        follower = _Follower(options, log)
        for done, (number, image) in enumerate(frames.gray(numbers)):
            progress("Following features", done, len(numbers))
            follower.advance(number, _shrink(image, scale))
            if done % options.detect_every == 0:
                follower.top_up()
        follower.finish()
        progress("Following features", len(numbers), len(numbers))
        return log.features(scale)

    births = sorted(n for n in regions if n in set(numbers))
    seeds: dict[int, tuple[Int[np.ndarray, "born"], Float[np.ndarray, "born 2"]]] = {}
    for number, image in frames.gray(births):
        small = _shrink(image, scale)
        corners = detect_corners(small, np.zeros((0, 2)), options.detect, allowed=_inside(regions[number], small.shape, scale))
        seeds[number] = (log.new_tracks(len(corners)), corners)
    passes = ([n for n in numbers if births and n >= births[0]], [n for n in reversed(numbers) if births and n <= births[-1]])
    total, done = sum(map(len, passes)), 0
    for back, order in enumerate(passes):
        follower = _Follower(options, log)
        for number, image in _backwards(frames, order) if back else frames.gray(order):
            progress("Following features", done, total)
            follower.advance(number, _shrink(image, scale))
            if number in seeds:
                follower.add(*seeds[number], record=not back)
            done += 1
        follower.finish()
    progress("Following features", total, total)
    return log.features(scale)


class _Log:
    """The growing table: small arrays a frame, 12 bytes an observation; short tracks leave it when it is read."""

    def __init__(self, min_length: int) -> None:
        self._min_length = min_length
        self._rows: list[tuple[int, Int[np.ndarray, "rows"], Float[np.ndarray, "rows 2"]]] = []
        self._length: Int[np.ndarray, "tracks"] = np.zeros(0, np.int32)

    def new_tracks(self, count: int) -> Int[np.ndarray, "new"]:
        first = len(self._length)
        self._length = np.concatenate([self._length, np.zeros(count, np.int32)])
        return np.arange(first, first + count, dtype=np.int32)

    def append(self, frame: int, track: Int[np.ndarray, "rows"], xy: Float[np.ndarray, "rows 2"]) -> None:
        self._length[track] += 1
        self._rows.append((frame, track.astype(np.int32), xy.astype(np.float32)))

    def features(self, scale: float) -> Features:
        """The table, its tracks renumbered without the short ones; empties the log."""
        long = self._length >= self._min_length
        new_index = np.cumsum(long, dtype=np.int32) - 1
        order = sorted(range(len(self._rows)), key=lambda k: self._rows[k][0])
        count = int(self._length[long].sum())
        track, frame, xy = np.empty(count, np.int32), np.empty(count, np.int32), np.empty((count, 2), np.float32)
        at, k = 0, 0
        while k < len(order):
            number = self._rows[order[k]][0]
            same = [order[k]]
            while k + len(same) < len(order) and self._rows[order[k + len(same)]][0] == number:
                same.append(order[k + len(same)])
            tracks = np.concatenate([self._rows[j][1] for j in same])
            points = np.concatenate([self._rows[j][2] for j in same])
            keep = np.nonzero(long[tracks])[0]
            keep = keep[np.argsort(tracks[keep], kind="stable")]
            n = len(keep)
            track[at : at + n], frame[at : at + n] = new_index[tracks[keep]], number
            # OpenCV puts pixel centres at whole numbers.
            xy[at : at + n] = (points[keep] + 0.5) * scale
            at, k = at + n, k + len(same)
            for j in same:
                self._rows[j] = (number, tracks[:0], points[:0])
        return Features(track_index=track, frame=frame, xy=xy, num_tracks=int(long.sum()))


class _Follower:
    """The features alive between two frames."""

    def __init__(self, options: FollowOptions, log: _Log) -> None:
        h = options.half_window
        grid = np.mgrid[-h : h + 1, -h : h + 1].reshape(2, -1).T[:, ::-1].astype(np.float64)
        self._options, self._log = options, log
        self._offsets = np.ascontiguousarray(grid)
        self._weights = np.exp(-(grid**2).sum(axis=1) / (2 * options.window_sigma**2))
        pixels = len(grid)
        self._gray: GrayImage | None = None
        self._smooth = np.zeros((0, 0), np.float32)
        self._number = -1
        self._track = np.zeros(0, np.int32)
        self._centre = np.zeros((0, 2))
        self._affine = np.zeros((0, 2, 2))
        self._templates = np.zeros((0, pixels), np.float32)
        self._steepest = np.zeros((0, 2, pixels), np.float32)
        self._hessians = np.zeros((0, 8, 8))
        # Each patch is registered on its own, so the number of threads cannot change a result.
        self._threads = ThreadPoolExecutor(2)

    def finish(self) -> None:
        self._threads.shutdown()

    def advance(self, number: int, gray: GrayImage) -> None:
        """Follow everything alive into the next frame."""
        o = self._options
        smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), o.smoothing)
        if self._gray is not None and len(self._track):
            keep, predicted = self._predict(self._gray, gray)
            self._select(keep)
            self._centre = predicted.copy()
            before = self._affine.copy()
            zncc = np.full(len(self._track), -1.0)
            self._register(smooth, zncc)
            det = np.linalg.det(self._affine)
            jump = np.linalg.norm(self._centre - predicted, axis=1)
            change = np.abs(self._affine - before).sum(axis=(1, 2))
            good = (zncc >= o.min_zncc) & (jump <= o.max_jump) & (det < o.max_scale) & (det > 1 / o.max_scale) & (change < o.max_change)
            self._select(good)
            self._log.append(number, self._track, self._centre)
        self._gray, self._smooth, self._number = gray, smooth, number

    def top_up(self) -> None:
        """New corners where the image has room for them."""
        assert self._gray is not None
        corners = detect_corners(self._gray, self._centre, self._options.detect)
        self.add(self._log.new_tracks(len(corners)), corners, record=True)

    def add(self, track: Int[np.ndarray, "born"], corners: Float[np.ndarray, "born 2"], *, record: bool) -> None:
        """Give birth to features at whole pixels of the current frame."""
        if not len(corners):
            return
        h = self._options.half_window
        span = np.arange(-h - 1, h + 2)
        x, y = corners[:, 0].astype(np.intp), corners[:, 1].astype(np.intp)
        wide = self._smooth[y[:, None, None] + span[:, None], x[:, None, None] + span]
        templates = wide[:, 1:-1, 1:-1].reshape(len(corners), -1)
        gx = ((wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2]) / 2).reshape(len(corners), -1)
        gy = ((wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]) / 2).reshape(len(corners), -1)
        u, v = self._offsets.T
        jacobian = np.stack([gx * u, gx * v, gy * u, gy * v, gx, gy, templates, np.ones_like(gx)], axis=2).astype(np.float64)
        hessian = np.einsum("npi,p,npj->nij", jacobian, self._weights, jacobian)
        # A ridge of 1e-6 of each diagonal entry keeps patches of straight edges from dividing by nothing; they fail the round trip soon enough.
        hessian += 1e-6 * np.einsum("nii->ni", hessian)[:, :, None] * np.eye(8) + 1e-9 * np.eye(8)
        hessian[:, range(4), range(4)] += self._options.shape_stiffness
        self._track = np.concatenate([self._track, track])
        self._centre = np.concatenate([self._centre, corners])
        self._affine = np.concatenate([self._affine, np.tile(np.eye(2), (len(corners), 1, 1))])
        self._templates = np.concatenate([self._templates, templates])
        self._steepest = np.concatenate([self._steepest, np.stack([gx, gy], axis=1)])
        self._hessians = np.concatenate([self._hessians, np.linalg.inv(hessian)])
        if record:
            self._log.append(self._number, track, corners)

    def _predict(self, old: GrayImage, new: GrayImage) -> tuple[Bool[np.ndarray, "alive"], Float[np.ndarray, "kept 2"]]:
        """Which features pyramidal Lucas-Kanade carries over and back, and where to."""
        o = self._options
        window = (2 * o.half_window + 1,) * 2
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.03)

        def carry(a: GrayImage, b: GrayImage, start: Float[np.ndarray, "n 1 2"]) -> tuple[Float[np.ndarray, "n 1 2"], Bool[np.ndarray, "n"]]:
            end, ok, _ = cv2.calcOpticalFlowPyrLK(a, b, start, np.empty_like(start), winSize=window, maxLevel=o.pyramid_levels, criteria=criteria)
            return np.asarray(end), np.asarray(ok)[:, 0] > 0

        def part(start: Float[np.ndarray, "n 1 2"]) -> tuple[Bool[np.ndarray, "n"], Float[np.ndarray, "n 2"]]:
            if not len(start):
                return np.zeros(0, bool), np.zeros((0, 2))
            there, ok = carry(old, new, start)
            back, ok_back = carry(new, old, there)
            error = np.linalg.norm(back - start, axis=2)[:, 0]
            return ok & ok_back & (error < o.max_round_trip), there[:, 0].astype(np.float64)

        keep, there = (np.concatenate(both) for both in zip(*self._threads.map(part, np.array_split(self._centre.astype(np.float32)[:, None], 2)), strict=True))
        return keep, there[keep]

    def _register(self, smooth: Float[np.ndarray, "height width"], zncc: Float[np.ndarray, "alive"]) -> None:
        half = len(zncc) // 2

        def part(span: tuple[int, int]) -> None:
            patches = (self._templates, self._steepest, self._hessians, self._offsets, self._weights)
            args = (*patches, self._options.shape_stiffness, self._affine, self._centre, zncc)
            align_patches(smooth, *args, *span, self._options.iterations)

        list(self._threads.map(part, ((0, half), (half, len(zncc)))))

    def _select(self, keep: Bool[np.ndarray, "alive"]) -> None:
        self._track, self._centre, self._affine = self._track[keep], self._centre[keep], self._affine[keep]
        self._templates, self._steepest, self._hessians = self._templates[keep], self._steepest[keep], self._hessians[keep]


def _working_scale(image_size: tuple[int, int], max_pixels: float) -> float:
    """How many image pixels one working pixel spans: 1, 2, 3, ..."""
    return float(np.ceil(np.sqrt(image_size[0] * image_size[1] / max_pixels) - 1e-9)) if image_size[0] * image_size[1] > max_pixels else 1.0


def _shrink(image: GrayImage, scale: float) -> UInt8[np.ndarray, "rows columns"]:
    if scale == 1.0:
        return image
    # Whole multiples keep "working pixel + 0.5 = image pixel / scale" exact; the rest of the division is cut off at the right and bottom.
    step = int(scale)
    height, width = image.shape[0] // step, image.shape[1] // step
    return np.asarray(cv2.resize(image[: height * step, : width * step], (width, height), interpolation=cv2.INTER_AREA))


def _inside(polygons: Sequence[Float[np.ndarray, "_corners 2"]], shape: tuple[int, int], scale: float) -> Bool[np.ndarray, "height width"]:
    mask = np.zeros(shape, np.uint8)
    for polygon in polygons:
        cv2.fillPoly(mask, [np.round(polygon / scale - 0.5).astype(np.int32)[:, None]], 1)
    return mask.astype(bool)


def _backwards(frames: Frames, order: Sequence[int], chunk: int = 24) -> Iterator[tuple[int, GrayImage]]:
    """Frames last first, a chunk in memory at a time."""
    for at in range(0, len(order), chunk):
        held: Iterable[tuple[int, GrayImage]] = list(frames.gray(sorted(order[at : at + chunk])))
        yield from reversed(list(held))
