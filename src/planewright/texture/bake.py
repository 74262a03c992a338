"""From frames, cameras and planes to one texture atlas."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from planewright.arrays import Bool, ColorImage, Float, Int, Mat3, UInt8
from planewright.geometry.camera import Intrinsics
from planewright.geometry.raster import FaceBuffer, face_buffer
from planewright.geometry.rigid import Rigid
from planewright.model.atlas import Atlas, FaceChart
from planewright.model.build import average_up
from planewright.planes.planar_scene import PlanarScene
from planewright.planes.polygons import face_loops, scene_polygons
from planewright.progress import Progress, silent, steps
from planewright.sfm.cameras import Cameras
from planewright.texture.atlas import FaceRectangle, chart_mask, face_rectangle, lay_charts
from planewright.texture.exposure import FaceSamples, even_out
from planewright.texture.fill import fill_unseen
from planewright.texture.kernels import fuse_views
from planewright.texture.views import FaceViews, ViewOptions, choose_views
from planewright.video.frames import Frames


@dataclass(frozen=True, kw_only=True)
class BakeOptions:
    """How the texture is made."""

    views: ViewOptions = field(default_factory=ViewOptions)
    max_side: int = 4096
    """Largest side of the atlas, texels; where the faces need more, all texels grow. What graphics cards and phones are sure to take."""
    max_samples: int = 60_000_000
    """Most colours (views times texels) held at a time, 4 bytes each; large faces take fewer views where they would need more."""
    gutter: int = 4
    """Texels around each chart that continue it, so that smaller copies of the atlas do not mix faces."""
    erosion: int = 2
    """Pixels next to an occluder or the face's outline that are not used: they mix both sides."""
    agreement: float = 60.0
    """Distance in RGB, grey levels, within which views support each other's colour. At 30 the edges of print on a filmed carton were ragged, where views
    are off by a fraction of a texel and vote for one side or the other. A bush that hides a wall in most views stays on 3 to 5 % of the wall at any
    value from 30 to 100, and on 5 % with a median a channel."""


def bake_texture(frames: Frames, scene: PlanarScene, cameras: Cameras, options: BakeOptions = BakeOptions(), *, progress: Progress = silent) -> Atlas:
    """A texture for every known face: at each texel the colour that most of the frames which see it best agree on, after evening out the exposure.

    Faces hide one another by the model's own depth; what the model does not know (a passer-by, a shine) is outvoted by the other frames. Texels that
    no frame saw are filled in from their neighbours and flagged as inferred.

    Args:
        frames: without lens distortion: they obey `cameras.intrinsics.pinhole()`.
    """
    loops = face_loops(scene)
    up = average_up(cameras)
    found = {f: face_rectangle(scene.normals[f], borders[0], up) for f, borders in enumerate(loops) if borders}
    rectangles = {f: rectangle for f, rectangle in found.items() if rectangle is not None}
    views = choose_views(scene, cameras, rectangles, frames.numbers, options.views, progress=progress)
    charts, (width, height) = lay_charts(rectangles, _texel_sizes(rectangles, views, cameras.intrinsics.image_size), options.max_side, options.gutter)
    masks = {chart.face: chart_mask(chart, loops[chart.face]) for chart in charts}
    looks = _collect(frames, scene, cameras, charts, masks, _within_budget(charts, views, options.max_samples), options, progress)
    tone = _tones(looks)
    image = np.full((height, width, 3), 128, dtype=np.uint8)
    covered, inferred = np.zeros((height, width), dtype=bool), np.zeros((height, width), dtype=bool)
    for chart in charts:
        place, inside = _place(chart, options.gutter), np.pad(masks[chart.face], options.gutter)
        if chart.face in looks:
            color, count, agreed = looks[chart.face].fused(tone, options.agreement)
            clean = np.pad(_clean(count, agreed, masks[chart.face], options.erosion), options.gutter)
            image[place] = fill_unseen(np.pad(color, [(options.gutter, options.gutter)] * 2 + [(0, 0)]), clean)
            inferred[place] = inside & ~_grown(np.pad(count > 0, options.gutter), options.erosion + 1)
            covered[place] = bool(count.any())
        else:
            inferred[place] = inside
    # What lies between the charts, and faces of which nothing was seen, get the average colour: it should neither stand out nor look as if it were known.
    if covered.any():
        image[~covered] = image[covered].mean(axis=0).round().astype(np.uint8)
    return Atlas(image, inferred, charts)


MAX_IMAGES = 6.0
"""Most texels of one face, in images full of pixels: a floor that runs off into the distance must not leave the others without texture."""


def _texel_sizes(rectangles: dict[int, FaceRectangle], views: dict[int, FaceViews], image_size: tuple[int, int]) -> dict[int, float]:
    """One texel for a pixel of the best view; a face that no frame sees gets 8 texels along its longer side: there is nothing to show."""
    least = {f: float(np.sqrt(r.size[0] * r.size[1] / (MAX_IMAGES * image_size[0] * image_size[1]))) for f, r in rectangles.items()}
    return {f: max(views[f].footprint, least[f]) if f in views else max(rectangle.size) / 8 for f, rectangle in rectangles.items()}


def _within_budget(charts: Sequence[FaceChart], views: dict[int, FaceViews], max_samples: int) -> dict[int, FaceViews]:
    """The views, the least worthy dropped where all together would be more than can be held."""
    size = {chart.face: chart.width * chart.height for chart in charts}
    total = sum(size[f] * len(v.row) for f, v in views.items())
    if total <= max_samples:
        return views
    kept: dict[int, FaceViews] = {}
    for f, v in views.items():
        most = max(1, int(len(v.row) * max_samples / total))
        best = np.sort(np.argsort(-v.weight, kind="stable")[:most])
        kept[f] = FaceViews(v.row[best], v.weight[best], v.footprint)
    return kept


class _Looks:
    """The colours of one face in its views, filled in as the frames come by."""

    def __init__(self, chart: FaceChart, views: FaceViews, frame: Sequence[int]) -> None:
        self.shape = (chart.height, chart.width)
        self.frame = np.array(frame, dtype=np.int64)
        """Index among the frames that are read."""
        self.weight = views.weight.copy()
        self.color = np.zeros((len(frame), chart.height * chart.width, 3), dtype=np.uint8)
        self.valid = np.zeros((len(frame), chart.height * chart.width), dtype=bool)
        self.detail = np.zeros(len(frame))

    def add(self, view: int, color: ColorImage, valid: Bool[np.ndarray, "height width"]) -> None:
        self.color[view] = color.reshape(-1, 3)
        self.valid[view] = valid.reshape(-1)
        self.detail[view] = _detail(color, valid)

    def fused(
        self, tone: Float[np.ndarray, "frames 3 256"], agreement: float
    ) -> tuple[ColorImage, Int[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
        """The colours, how many views see each texel, and their share that agrees on the colour."""
        # A blurred look loses detail; squared, half the detail counts a quarter. Compared with the upper quartile, since the maximum may be an occluder's.
        reference = float(np.quantile(self.detail, 0.75))
        sharp = np.clip(self.detail / reference, 0.1, 1.0) ** 2 if reference > 0 else np.ones(len(self.detail))
        color = np.zeros((self.valid.shape[1], 3), dtype=np.uint8)
        count = np.zeros(self.valid.shape[1], dtype=np.int64)
        agreed = np.zeros(self.valid.shape[1])
        fuse_views(self.color, self.valid, self.weight * sharp, tone[self.frame], agreement, color, count, agreed)
        return color.reshape(*self.shape, 3), count.reshape(self.shape), agreed.reshape(self.shape)


RIM = 6
"""Texels along the border of a face in which disputed colours are not used: the corners of real things are round, and behind them the background shows."""


def _clean(
    count: Int[np.ndarray, "height width"], agreed: Float[np.ndarray, "height width"], inside: Bool[np.ndarray, "height width"], erosion: int
) -> Bool[np.ndarray, "height width"]:
    """True at the texels whose colour is used; the others are filled in from them.

    Not used are strips that only one or two views saw next to what more saw: most views were cut off there by the erosion, and what is left has nobody to
    outvote it. Nor, along the border, colours that less than half of the views share: what lies behind a border looks different from each side.
    """
    lonely = (count < 3) & _grown(count >= 3, erosion + 1)
    disputed = (agreed < 0.5) & _grown(np.pad(~inside, 1, constant_values=True), RIM)[1:-1, 1:-1]
    clean = (count > 0) & ~lonely & ~disputed
    return clean if clean.any() else count > 0


def _detail(color: ColorImage, valid: Bool[np.ndarray, "height width"]) -> float:
    """Median absolute Laplacian of what is seen: comparable between views, since all show the same texels."""
    inner = cv2.erode(valid.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    if np.count_nonzero(inner) < 16:
        return 0.0
    gray = cv2.GaussianBlur(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), (3, 3), 0.7)
    return float(np.mean(np.minimum(np.abs(cv2.Laplacian(gray, cv2.CV_32F)[inner]), 40.0)))


def _collect(
    frames: Frames, scene: PlanarScene, cameras: Cameras, charts: Sequence[FaceChart], masks: dict[int, Bool[np.ndarray, "_h _w"]],
    views: dict[int, FaceViews], options: BakeOptions, progress: Progress,
) -> dict[int, _Looks]:  # fmt: skip
    """Every frame that some face wants, read once and in order."""
    by_face = {chart.face: chart for chart in charts}
    rows = sorted({int(row) for v in views.values() for row in v.row})
    looks = {f: _Looks(by_face[f], v, [rows.index(int(row)) for row in v.row]) for f, v in sorted(views.items())}
    # The texels on the border line mix in what lies beyond it, and all views agree on that; they are filled in from within instead.
    cores = {f: cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0 for f, mask in masks.items()}
    polygons = scene_polygons(scene)
    intrinsics = cameras.intrinsics.pinhole()
    numbers = [int(cameras.frame[row]) for row in rows]
    for index, (_, image) in enumerate(steps(frames.color(numbers), "Reading the texture", progress, len(numbers))):
        pose = cameras.cam_from_world(rows[index])
        buffer = face_buffer(polygons, intrinsics, pose)
        for f, look in looks.items():
            for view in np.flatnonzero(look.frame == index):
                color, valid = _look(image, buffer, intrinsics, pose, by_face[f], options)
                look.add(int(view), color, valid & cores[f])
    return looks


def _look(
    image: ColorImage, buffer: FaceBuffer, intrinsics: Intrinsics, pose: Rigid, chart: FaceChart, options: BakeOptions
) -> tuple[UInt8[np.ndarray, "rows columns 3"], Bool[np.ndarray, "rows columns"]]:
    """A face as one frame shows it, on its chart, and where it is seen."""
    pixels_from_texels = intrinsics.matrix @ _cam_from_texels(chart, pose)
    ahead = _ahead(chart, pose)
    window = _window(pixels_from_texels, chart, intrinsics.image_size, margin=options.erosion + 2) if ahead.all() else (slice(None), slice(None))
    left, top = window[1].start or 0, window[0].start or 0
    size = (chart.width, chart.height)
    # OpenCV puts whole numbers at the centres of pixels and texels.
    half = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    warp = np.array([[1.0, 0.0, -left - 0.5], [0.0, 1.0, -top - 0.5], [0.0, 0.0, 1.0]]) @ pixels_from_texels @ half
    if buffer.face[window].size == 0:
        return np.zeros((chart.height, chart.width, 3), dtype=np.uint8), np.zeros((chart.height, chart.width), dtype=bool)
    seen = _seen(buffer, window, intrinsics, pose, chart, options)
    part = _not_finer_than_texels(image[window], pixels_from_texels, chart)
    color = cv2.warpPerspective(part, warp, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    valid = cv2.warpPerspective(seen, warp, size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP, borderValue=0) > 0
    return color, valid & ahead


def _window(pixels_from_texels: Mat3, chart: FaceChart, image_size: tuple[int, int], margin: int) -> tuple[slice, slice]:
    """Rows and columns of the image that hold a chart which lies before the camera as a whole."""
    corners = np.array([[0, 0, 1], [chart.width, 0, 1], [0, chart.height, 1], [chart.width, chart.height, 1]]) @ pixels_from_texels.T
    xy = corners[:, :2] / corners[:, 2:]
    low = np.clip(np.floor(xy.min(axis=0)) - margin, 0, image_size).astype(int)
    high = np.clip(np.ceil(xy.max(axis=0)) + margin, 0, image_size).astype(int)
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _cam_from_texels(chart: FaceChart, pose: Rigid) -> Mat3:
    """Homogeneous texel coordinates of the chart to the camera's frame."""
    to_plane = np.stack([chart.texel * chart.axis_u, chart.texel * chart.axis_v, chart.origin], axis=1)
    matrix = pose.rotation @ to_plane
    matrix[:, 2] += pose.translation
    return matrix


def _ahead(chart: FaceChart, pose: Rigid) -> Bool[np.ndarray, "rows columns"]:
    """True at the texels before the camera: a homography shows those behind it as well."""
    a, b, c = _cam_from_texels(chart, pose)[2]
    return (a * (np.arange(chart.width) + 0.5) + b * (np.arange(chart.height)[:, None] + 0.5) + c) > 1e-6


def _not_finer_than_texels(image: ColorImage, pixels_from_texels: Mat3, chart: FaceChart) -> ColorImage:
    """The image, smoothed where several of its pixels fall on one texel (the atlas had to be made coarser), so that the texture does not alias."""
    centre = np.array([[chart.width / 2, chart.height / 2, 1.0], [chart.width / 2 + 1, chart.height / 2, 1.0], [chart.width / 2, chart.height / 2 + 1, 1.0]])
    xyw = centre @ pixels_from_texels.T
    if (xyw[:, 2] <= 1e-9).any():
        return image
    xy = xyw[:, :2] / xyw[:, 2:]
    step = float(min(np.linalg.norm(xy[1] - xy[0]), np.linalg.norm(xy[2] - xy[0])))
    if not 1.5 < step < 1e3:
        return image
    sigma = 0.5 * np.sqrt(step**2 - 1.0)
    return cv2.GaussianBlur(image, (0, 0), sigma)


def _seen(
    buffer: FaceBuffer, window: tuple[slice, slice], intrinsics: Intrinsics, pose: Rigid, chart: FaceChart, options: BakeOptions
) -> UInt8[np.ndarray, "height width"]:
    """255 where the face is the nearest (or as near as the nearest), away from where something else begins; of a window of the image."""
    normal_in_cam = pose.rotation @ np.cross(chart.axis_v, chart.axis_u)
    offset = normal_in_cam @ pose.apply(chart.origin[None])[0]
    height, width = buffer.face.shape
    x = ((np.arange(width) + 0.5 - intrinsics.principal_point[0]) / intrinsics.focal)[window[1]]
    y = ((np.arange(height) + 0.5 - intrinsics.principal_point[1]) / intrinsics.focal)[window[0]]
    slope = (normal_in_cam[0] * x + normal_in_cam[1] * y[:, None] + normal_in_cam[2]).astype(np.float32)
    face, nearest = buffer.face[window], buffer.depth[window]
    depth = np.where(face >= 0, nearest, np.float32(0))
    # |plane depth - nearest depth| <= tolerance * nearest depth, with plane depth = offset / slope, and free of the division.
    near = np.abs(np.float32(offset) - slope * depth) <= options.views.depth_tolerance * depth * np.abs(slope)
    seen = (near & (face >= 0)) | (face == chart.face)
    side = 2 * options.erosion + 1
    return cv2.erode(seen.astype(np.uint8) * 255, np.ones((side, side), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)


def _tones(looks: dict[int, _Looks]) -> Float[np.ndarray, "frames 3 256"]:
    """For each frame and channel, the evened-out value of each recorded one."""
    num_frames = max((int(look.frame.max()) + 1 for look in looks.values()), default=1)
    gain, bias = even_out([FaceSamples(look.frame, look.color, look.valid) for look in looks.values()], num_frames)
    return (np.arange(256.0) - bias[..., None]) / gain[..., None]


def _place(chart: FaceChart, gutter: int) -> tuple[slice, slice]:
    return (slice(chart.row - gutter, chart.row + chart.height + gutter), slice(chart.column - gutter, chart.column + chart.width + gutter))


def _grown(mask: Bool[np.ndarray, "height width"], radius: int) -> Bool[np.ndarray, "height width"]:
    """The mask and what is within so many texels of it. Of what was seen: the rim that the erosion took was seen too, if not cleanly."""
    side = 2 * radius + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
