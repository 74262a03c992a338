"""From a decoded frame to 8-bit grey and RGB as displayed, by one rule on every machine.

Grey is luma. Limited range (16 to 235 of 255, and its multiples at 10 and 12 bits) is stretched to 0..255: round((code - black) * 255 / (white - black)).
Deeper pictures are reduced by the same rule. HLG (ITU-R BT.2100) was made to be shown as it is on an ordinary screen and is left so. PQ (SMPTE
ST 2084) codes are turned into light, compressed by Reinhard's curve with 203 cd/m2 as white and 1000 cd/m2 as brightest, and coded with gamma
2.2, channel by channel for colour and on luma for grey. RGB pictures become grey by BT.601 weights, as OpenCV has them.

Colour is computed from the planes, chroma interpolated bilinearly, with the frame's own matrix (BT.601, 709 or 2020; where it is not named:
709 from 720 lines on, else 601). swscale is only asked for pixel formats that are rare.
"""

from dataclasses import dataclass
from functools import lru_cache

import av
import cv2
import numpy as np

from planewright.arrays import ColorImage, Float, GrayImage

_PQ, _FULL = 16, 2
_YUV_MATRIX = {1: (0.2126, 0.0722), 5: (0.299, 0.114), 6: (0.299, 0.114), 9: (0.2627, 0.0593), 10: (0.2627, 0.0593)}
"""AVColorSpace -> the weights of red and blue in luma."""


@dataclass(frozen=True)
class Orientation:
    """How stored pixels become displayed ones: mirrored first, then turned, then stretched to square pixels."""

    quarter_turns: int = 0
    """Turns by 90 degrees against the clock."""
    mirrored: bool = False
    """Left and right swapped before the turn."""
    width_scale: float = 1.0
    """Width over height of a stored pixel."""

    def displayed_size(self, stored: tuple[int, int]) -> tuple[int, int]:
        """Width, height as displayed."""
        width, height = max(1, round(stored[0] * self.width_scale)), stored[1]
        return (height, width) if self.quarter_turns % 2 else (width, height)

    def apply(self, image: np.ndarray) -> np.ndarray:
        """The image as displayed."""
        if self.width_scale != 1.0:
            image = cv2.resize(image, (max(1, round(image.shape[1] * self.width_scale)), image.shape[0]), interpolation=cv2.INTER_LINEAR)
        if self.mirrored:
            image = image[:, ::-1]
        return np.ascontiguousarray(np.rot90(image, self.quarter_turns))


def gray_pixels(frame: av.VideoFrame) -> GrayImage:
    """Grey as stored (not yet turned)."""
    if not _is_planar_yuv(frame):
        return np.asarray(cv2.cvtColor(_reformatted(frame, "rgb24"), cv2.COLOR_RGB2GRAY))
    luma = _plane(frame, 0)
    table = _luma_table(frame.format.components[0].bits, _full_range(frame), int(frame.color_trc) == _PQ)
    return luma.copy() if table is None else table[luma]


def color_pixels(frame: av.VideoFrame) -> ColorImage:
    """RGB as stored (not yet turned)."""
    if not _is_planar_yuv(frame):
        return _reformatted(frame, "rgb24")
    if len(frame.format.components) < 3:
        return np.asarray(cv2.cvtColor(gray_pixels(frame), cv2.COLOR_GRAY2RGB))
    size = (frame.width, frame.height)
    planes = [_plane(frame, 0), *(cv2.resize(_plane(frame, k), size, interpolation=cv2.INTER_LINEAR) for k in (1, 2))]
    bits = frame.format.components[0].bits
    weights = _YUV_MATRIX.get(int(frame.colorspace), _YUV_MATRIX[1] if max(size) >= 1280 or min(size) >= 720 else _YUV_MATRIX[5])
    matrix = _rgb_from_yuv(bits, _full_range(frame), weights)
    yuv = cv2.merge(planes)
    if bits == 8:
        return np.asarray(cv2.transform(yuv, matrix))
    rgb = np.clip(cv2.transform(yuv.astype(np.float32), matrix), 0.0, 255.0)
    if int(frame.color_trc) != _PQ:
        return np.rint(rgb).astype(np.uint8)
    return _pq_codes(1024)[np.rint(rgb * (1023 / 255)).astype(np.int64)]


def _is_planar_yuv(frame: av.VideoFrame) -> bool:
    layout = frame.format
    if layout.is_rgb or layout.has_palette or layout.is_bit_stream or layout.is_big_endian:
        return False
    colors = [c for c in layout.components if not c.is_alpha]
    return bool(colors) and len({c.plane for c in layout.components}) == len(layout.components) and _known_depth(frame)


def _known_depth(frame: av.VideoFrame) -> bool:
    name = frame.format.name
    return name.startswith(("yuv", "gray")) and not name.startswith("grayf") and frame.format.components[0].bits <= 16


def _plane(frame: av.VideoFrame, index: int) -> np.ndarray:
    plane = frame.planes[index]
    dtype = np.uint8 if frame.format.components[index].bits <= 8 else np.dtype("<u2")
    rows = np.frombuffer(memoryview(plane), dtype=np.uint8).reshape(plane.height, plane.line_size)
    return rows.view(dtype)[:, : plane.width]


def _reformatted(frame: av.VideoFrame, name: str) -> ColorImage:
    return np.ascontiguousarray(frame.to_ndarray(format=name))


def _full_range(frame: av.VideoFrame) -> bool:
    name = frame.format.name
    return int(frame.color_range) == _FULL or name.startswith(("yuvj", "gray"))


def _black_white(bits: int, full: bool) -> tuple[float, float]:
    return (0.0, 2.0**bits - 1) if full else (16.0 * 2 ** (bits - 8), 235.0 * 2 ** (bits - 8))


@lru_cache(maxsize=16)
def _luma_table(bits: int, full: bool, pq: bool) -> np.ndarray | None:
    """Grey of every code; None where the code is the grey."""
    if bits == 8 and full and not pq:
        return None
    black, white = _black_white(bits, full)
    signal = np.clip((np.arange(2**bits if bits <= 8 else 65536) - black) / (white - black), 0.0, 1.0)
    if pq:
        return _pq_codes(1024)[np.rint(signal * 1023).astype(np.int64)]
    return np.floor(signal * 255 + 0.5).astype(np.uint8)


@lru_cache(maxsize=1)
def _pq_codes(count: int) -> np.ndarray:
    """8-bit codes of `count` PQ signals from 0 to 1 (SMPTE ST 2084 eq. 4.1; Reinhard et al. 2002 eq. 4)."""
    m1, m2, c1, c2, c3 = 1305 / 8192, 2523 / 32, 107 / 128, 2413 / 128, 2392 / 128
    root = np.linspace(0.0, 1.0, count) ** (1 / m2)
    light = 10_000 * (np.maximum(root - c1, 0.0) / (c2 - c3 * root)) ** (1 / m1) / 203
    white = 1000 / 203
    compressed = np.minimum(light * (1 + light / white**2) / (1 + light), 1.0)
    return np.rint(255 * compressed ** (1 / 2.2)).astype(np.uint8)


@lru_cache(maxsize=16)
def _rgb_from_yuv(bits: int, full: bool, weights: tuple[float, float]) -> Float[np.ndarray, "3 4"]:
    """RGB in 0..255 as a linear function of (Y, Cb, Cr, 1) codes: ITU-R BT.601, BT.709 and BT.2020 with their weights of red and blue."""
    red, blue = weights
    green = 1.0 - red - blue
    black, white = _black_white(bits, full)
    y = 255.0 / (white - black)
    chroma = 255.0 / ((2.0**bits - 1) if full else 224.0 * 2 ** (bits - 8))
    middle = 2.0 ** (bits - 1)
    cr_r, cb_b = 2 * (1 - red) * chroma, 2 * (1 - blue) * chroma
    cr_g, cb_g = -cr_r * red / green, -cb_b * blue / green
    rows = np.array([[y, 0.0, cr_r], [y, cb_g, cr_g], [y, cb_b, 0.0]])
    offset = -rows @ np.array([black, middle, middle])
    return np.column_stack([rows, offset])
