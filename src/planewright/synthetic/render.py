"""Frames of a scene: visible surfaces, filtered textures, sun and sky, motion blur, noise, and an exposure that drifts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from planewright.arrays import ColorImage, Float, GrayImage, Int, UInt8
from planewright.geometry.camera import Intrinsics
from planewright.geometry.rigid import Rigid
from planewright.synthetic import kernels
from planewright.synthetic.motion import Motion, Visit
from planewright.synthetic.polygons import Polygons, flatten, subset
from planewright.synthetic.scene import Carrier, Scene, Surface
from planewright.synthetic.textures import Painter

_NEAR = 0.02
"""Scene units; what comes nearer to the camera is cut."""
_LEVELS = 7
_BAND = 8
"""Rows that are drawn as of one time where the sensor is read row by row: at 15 pixels a frame half a band lies within 0.06 pixels of its own time."""
_CARRIERS: tuple[Carrier, ...] = ("world", "object", "visitor")
_BRIGHTNESS = 1.3
"""Exposure of the camera: a surface at right angles to the sun under an open sky shows its paint 1.3 times as bright."""


def _sample_places(samples: int) -> Float[np.ndarray, "samples 2"]:
    """Where in the pixel each sub-frame samples: all rows and all columns differ, and the mean is the pixel's centre."""
    order = [1, 3, 0, 2] if samples == 4 else [(k * (samples // 2 + samples % 2 + 1)) % samples for k in range(samples)]
    if len(set(order)) < samples:
        order = list(range(samples))
    return (np.column_stack([order, np.arange(samples)]) + 0.5) / samples


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """What stands between the scene and the pixels."""

    samples: int = 4
    """Sub-frames a frame, each at its own time in the exposure and its own place in the pixel."""
    shutter: float = 0.5
    """Exposure time as a share of the time between frames; the truth of a frame is the middle of its exposure."""
    readout: float = 0.0
    """Time from the first to the last row's exposure as a share of the time between frames (a rolling shutter); the middle of a frame is its middle row's."""
    noise: float = 2.0
    """Standard deviation of the sensor noise, grey levels."""
    exposure_drift: float = 0.12
    """Largest change of brightness over the clip, as a share."""
    crf: int = 23
    """Constant rate factor of the H.264 encoder; 23 is its default, from about 34 on blocks show."""
    seed: int = 0
    """Seed of the paint and the noise."""


@dataclass(frozen=True, eq=False)
class CompiledScene:
    """A scene made ready: geometry as arrays, painted and lit textures with their smaller levels."""

    polygons: Polygons
    carrier: Int[np.ndarray, "polygons"]
    """0 where nothing carries it, 1 with the turning object, 2 with the visitor."""
    density: Float[np.ndarray, "polygons"]
    """Texels a scene unit."""
    gain: Float[np.ndarray, "polygons"]
    """Light of a whole polygon, where it is not in the texture."""
    texture: Int[np.ndarray, "polygons"]
    level_start: Int[np.ndarray, "textures levels"]
    level_size: Int[np.ndarray, "textures levels 2"]
    """Rows, columns."""
    texels: UInt8[np.ndarray, "texels 3"]


def _pyramid(image: Float[np.ndarray, "rows columns 3"]) -> list[UInt8[np.ndarray, "_rows _columns 3"]]:
    """The image and its halves by area averaging; a level k texel covers 2^k by 2^k texels exactly (borders repeat)."""
    levels = [np.clip(np.rint(image), 0, 255).astype(np.uint8)]
    while len(levels) < _LEVELS:
        last = levels[-1]
        padded = cv2.copyMakeBorder(last, 0, last.shape[0] % 2, 0, last.shape[1] % 2, cv2.BORDER_REPLICATE)
        half = (max(1, padded.shape[1] // 2), max(1, padded.shape[0] // 2))
        levels.append(np.asarray(cv2.resize(padded, half, interpolation=cv2.INTER_AREA), np.uint8))
    return levels


def _rays(scene: Scene) -> tuple[Float[np.ndarray, "sun 3"], Float[np.ndarray, "sky 3"]]:
    """Eight places on the sun's disc (6 degrees wide: soft shadows), and 48 directions of the sky as long as it looks far."""
    golden = np.pi * (3 - 5**0.5)
    toward = np.asarray(scene.sun, float) / np.linalg.norm(scene.sun)
    side = np.cross(toward, [0.3, 0.5, 0.81])
    side /= np.linalg.norm(side)
    up = np.cross(toward, side)
    k = np.arange(8)
    disc = 0.05 * np.sqrt((k + 0.5) / 8)[:, None] * (np.cos(golden * k)[:, None] * side + np.sin(golden * k)[:, None] * up)
    m = np.arange(48)
    share = (m + 0.5) / 48
    sky = np.column_stack([np.sqrt(share) * np.cos(golden * m), np.sqrt(share) * np.sin(golden * m), np.sqrt(1 - share)])
    return 3.0 * scene.diagonal * (toward + disc), scene.sky_reach * scene.diagonal * sky


def compile_scene(scene: Scene, seed: int) -> CompiledScene:
    """Paint and light every surface once, for all frames."""
    rng = np.random.default_rng(seed)
    surfaces = scene.surfaces
    facet = np.array([s.facet for s in surfaces])
    polygons = flatten(surfaces, rng.uniform(0.0, 0.5, (len(surfaces), 2)) * facet[:, None])
    sun, sky = _rays(scene)
    # A visitor casts no shadow on what is painted once for all frames, and none falls on it.
    lighters = {visiting: subset(polygons, np.array([(s.carrier == "visitor") == visiting for s in surfaces])) for visiting in (False, True)}
    gain = np.ones(len(surfaces))
    texture = np.zeros(len(surfaces), np.int64)
    images: list[Float[np.ndarray, "rows columns 3"]] = []
    shared: dict[Painter, int] = {}
    for p, s in enumerate(surfaces):
        lighter = lighters[s.carrier == "visitor"]
        if s.facet:
            if s.paint not in shared:
                side = 0.01 + max(float(polygons.extent(k).max()) for k, other in enumerate(surfaces) if other.paint is s.paint)
                shared[s.paint] = len(images)
                images.append(s.paint(side, side, s.density, rng))
            texture[p] = shared[s.paint]
            gain[p] = _BRIGHTNESS * lighter.light(s.loops[0].mean(axis=0)[None], s.normal[None], sun, sky, scene.ambient)[0]
        else:
            width, height = polygons.extent(p)
            texture[p] = len(images)
            image = s.paint(float(width), float(height), s.density, rng)
            images.append(image * _light_map((image.shape[0], image.shape[1]), s, polygons.frames[p], lighter, sun, sky, scene.ambient)[..., None])
    level_start = np.zeros((len(images), _LEVELS), np.int64)
    level_size = np.zeros((len(images), _LEVELS, 2), np.int64)
    texels: list[UInt8[np.ndarray, "n 3"]] = []
    total = 0
    for t, image in enumerate(images):
        for k, level in enumerate(_pyramid(image)):
            level_start[t, k], level_size[t, k] = total, level.shape[:2]
            texels.append(level.reshape(-1, 3))
            total += level.shape[0] * level.shape[1]
    carrier = np.array([_CARRIERS.index(s.carrier) for s in surfaces])
    return CompiledScene(polygons, carrier, np.array([s.density for s in surfaces]), gain, texture, level_start, level_size, np.concatenate(texels))


def _light_map(
    size: tuple[int, int],
    surface: Surface,
    frame: Float[np.ndarray, "3 4"],
    polygons: Polygons,
    sun: Float[np.ndarray, "sun 3"],
    sky: Float[np.ndarray, "sky 3"],
    ambient: float,
) -> Float[np.ndarray, "rows columns"]:
    """Light on every texel: traced on a grid of at most 72 by 72 places, smooth in between."""
    rows, columns = (int(np.clip(n / 8, 6, 72)) for n in size)
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns * size[1] / surface.density, (np.arange(rows) + 0.5) / rows * size[0] / surface.density)
    points = (np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)]) - frame[:, 3]) @ frame[:, :3]
    light = polygons.light(points, np.tile(surface.normal, (len(points), 1)), sun, sky, ambient)
    light = (_BRIGHTNESS * light).reshape(rows, columns).astype(np.float32)
    return cv2.resize(light, (size[1], size[0]), interpolation=cv2.INTER_LINEAR)


@dataclass(frozen=True, eq=False)
class Renderer:
    """Draws frames on demand: nothing is kept between frames, so a clip may be as long as one likes."""

    scene: Scene
    compiled: CompiledScene
    path: Motion
    intrinsics: Intrinsics
    options: RenderOptions
    visit: Visit | None = None

    @cached_property
    def lens(self) -> "_Lens":
        """Where the straight-lined picture is drawn, and how it is bent."""
        return _straight_view(self.intrinsics)

    def frame(self, number: int) -> ColorImage:
        """The frame of that number, RGB; the same bytes whenever and in whatever order it is drawn."""
        width, height = self.lens.straight.image_size
        total = np.zeros((height, width, 3), np.float32)
        samples = self.options.samples
        hit = np.zeros((height, width), np.int64)
        for k, place in enumerate(_sample_places(samples)):
            time = number + self.options.shutter * ((k + 0.5) / samples - 0.5)
            for sample in self._bands(time, (float(place[0]), float(place[1]))):
                sample.add_to(total, self.compiled)
                hit[sample.rows] += sample.index >= 0
        if hit.min() < samples:
            total += (samples - hit)[..., None].astype(np.float32) * np.asarray(self.scene.background, np.float32)
        total = self.lens.bend(total, cv2.INTER_CUBIC)
        rng = np.random.default_rng((self.options.seed, number))
        phase = 2 * np.pi * np.random.default_rng((self.options.seed, 1 << 40)).uniform()
        # Slow as auto exposure: about two and a half swings in 300 frames.
        exposure = 1 + self.options.exposure_drift * np.sin(2 * np.pi * number / 120 + phase)
        total *= np.float32(exposure / samples)
        if self.options.noise > 0:
            total += np.float32(self.options.noise) * rng.standard_normal(total.shape, np.float32)
        return np.clip(np.rint(total), 0, 255).astype(np.uint8)

    def surface_index(self, number: int) -> Int[np.ndarray, "height width"]:
        """Which surface of the scene the middle of every pixel shows in the middle of the exposure; -1 for none."""
        straight = np.concatenate([band.index for band in self._bands(float(number), (0.5, 0.5))]).astype(np.float32)
        return self.lens.bend(straight, cv2.INTER_NEAREST).astype(np.int64)

    def _bands(self, time: float, place: tuple[float, float]) -> Iterator["_Sample"]:
        """What is nearest at one place of every pixel, each row at its own time; `time` is that of the middle row."""
        height = self.lens.straight.image_size[1]
        if self.options.readout == 0.0:
            yield self._sample(time, place, slice(0, height))
            return
        for first in range(0, height, _BAND):
            last = min(first + _BAND, height)
            yield self._sample(time + self.options.readout * (0.5 * (first + last) / height - 0.5), place, slice(first, last))

    def _sample(self, time: float, place: tuple[float, float], rows: slice) -> "_Sample":
        """What is nearest at one place of every pixel of some rows at one time."""
        c, polygons = self.compiled, self.compiled.polygons
        cam_from_world = self.path.cam_from_world(time)
        world_from_visitor = self.visit.world_from_visitor(time) if self.visit else None
        # A visitor that is not there stands behind the camera.
        cam_from_visitor = cam_from_world @ world_from_visitor if world_from_visitor else Rigid(np.eye(3), np.array([0.0, 0.0, -1e6]))
        poses = (cam_from_world, cam_from_world @ self.path.world_from_object(time), cam_from_visitor)
        rotation, translation = np.array([p.rotation for p in poses])[c.carrier], np.array([p.translation for p in poses])[c.carrier]
        vertices = np.einsum("vij,vj->vi", rotation[polygons.owner], polygons.vertices) + translation[polygons.owner]
        # Row a . x + d in the world is (a R^T) . x_cam + d - (a R^T) . t in the camera frame.
        axes = np.empty_like(polygons.frames)
        axes[..., :3] = polygons.frames[..., :3] @ rotation.transpose(0, 2, 1)
        axes[..., 3] = polygons.frames[..., 3] - np.einsum("pij,pj->pi", axes[..., :3], translation)
        normal, offset = axes[:, 2, :3], axes[:, 2, 3]
        slope = -normal / np.where(np.abs(offset) < 1e-9, 1e-9, offset)[:, None]
        # Some rows of an image are an image whose principal point lies higher.
        focal, (cx, cy) = self.lens.straight.focal, self.lens.straight.principal_point - np.array([0.0, rows.start])
        inverse_depth = np.column_stack([slope[:, 0] / focal, slope[:, 1] / focal, slope[:, 2] - slope[:, 0] * cx / focal - slope[:, 1] * cy / focal])
        camera = (float(focal), float(cx), float(cy), *place)
        width, height = self.lens.straight.image_size[0], rows.stop - rows.start
        index = np.full((height, width), -1, np.int64)
        kernels.rasterize(vertices, polygons.loop_start, polygons.polygon_loop, inverse_depth, camera, _NEAR, np.zeros((height, width)), index)
        return _Sample(rows, index, np.ascontiguousarray(axes[:, :2]), inverse_depth, camera)


@dataclass(frozen=True, eq=False)
class _Lens:
    """A camera without distortion that sees all that the real one sees, and where each pixel of the real one looks in its picture."""

    straight: Intrinsics
    place: Float[np.ndarray, "height width 2"] | None
    """For `cv2.remap`; None where the lens does not distort."""

    def bend(self, image: Float[np.ndarray, "..."], interpolation: int) -> Float[np.ndarray, "..."]:
        """The picture as the real lens shows it."""
        if self.place is None:
            return image
        return np.asarray(cv2.remap(image, self.place, None, interpolation, borderMode=cv2.BORDER_REPLICATE), np.float32)  # pyright: ignore[reportCallIssue, reportArgumentType]


def _straight_view(intrinsics: Intrinsics) -> _Lens:
    if not intrinsics.distortion:
        return _Lens(intrinsics, None)
    width, height = intrinsics.image_size
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    straight = intrinsics.pinhole().to_pixels(intrinsics.normalize(np.column_stack([columns.ravel(), rows.ravel()])))
    # Two pixels more than the outermost ray, for the cubic.
    low, high = np.floor(straight.min(axis=0)) - 2, np.ceil(straight.max(axis=0)) + 2
    wide = Intrinsics(intrinsics.focal, intrinsics.principal_point - low, (int(high[0] - low[0]), int(high[1] - low[1])))
    return _Lens(wide, (straight - low - 0.5).reshape(height, width, 2).astype(np.float32))


@dataclass(frozen=True, eq=False)
class _Sample:
    """One sub-frame before it is coloured; see `kernels.shade`."""

    rows: slice
    """Of the image; `index` has only these."""
    index: Int[np.ndarray, "height width"]
    axes: Float[np.ndarray, "polygons 2 4"]
    inverse_depth: Float[np.ndarray, "polygons 3"]
    camera: tuple[float, float, float, float, float]

    def add_to(self, total: Float[np.ndarray, "all_rows width 3"], c: CompiledScene) -> None:
        """Add its colours to `total`."""
        textures = (c.texture, c.level_start, c.level_size, c.texels)
        kernels.shade(self.index, self.axes, self.inverse_depth, self.camera, c.density, c.gain, *textures, total[self.rows])


@dataclass(frozen=True, eq=False)
class RenderedFrames:
    """The `Frames` of a scene without a file in between: every frame is drawn when it is asked for."""

    renderer: Renderer
    numbers: Sequence[int]

    @property
    def image_size(self) -> tuple[int, int]:
        """Width, height."""
        return self.renderer.intrinsics.image_size

    def color(self, numbers: Sequence[int]) -> Iterator[tuple[int, ColorImage]]:
        """The named frames, RGB."""
        for number in numbers:
            yield number, self.renderer.frame(number)

    def gray(self, numbers: Sequence[int]) -> Iterator[tuple[int, GrayImage]]:
        """The named frames in grey (Rec. 601 luma, as video has it)."""
        for number, image in self.color(numbers):
            yield number, np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
