"""Pictures of the report: frames as JPEG inside the page, everything drawn over them as SVG. All text passes the template's escaping."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from planewright.arrays import ColorImage, Float

JPEG_QUALITY = 82
"""A frame of 720 pixels takes 40 to 90 kB; the eye sees no difference at this size."""


@dataclass(frozen=True)
class Shape:
    """One SVG element: a path, a circle or a text, with a class of the page's style sheet and a colour of its own where it needs one."""

    kind: str
    """path, circle or text."""
    css: str
    d: str = ""
    x: float = 0.0
    y: float = 0.0
    r: float = 0.0
    text: str = ""
    hue: int | None = None
    """Degrees on the colour circle."""


@dataclass(frozen=True)
class Picture:
    """A frame or a diagram: an image below, shapes above, in the coordinates of `width` and `height`."""

    title: str
    width: float
    height: float
    shapes: tuple[Shape, ...] = ()
    image: str | None = None
    """A data URI."""
    note: str = ""


def data_uri(image: ColorImage, width: int) -> str:
    """The image as JPEG, not wider than `width` pixels."""
    if image.shape[1] > width:
        image = np.asarray(cv2.resize(image, (width, round(image.shape[0] * width / image.shape[1])), interpolation=cv2.INTER_AREA))
    done, data = cv2.imencode(".jpg", np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2BGR)), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert done
    return "data:image/jpeg;base64," + base64.b64encode(np.asarray(data).tobytes()).decode()


def path_d(xy: Float[np.ndarray, "points 2"] | Sequence[Any], closed: bool = False) -> str:
    """The `d` of an SVG path through points."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in np.asarray(xy, dtype=np.float64)) + ("Z" if closed else "")


def stride(numbers: Sequence[int]) -> int:
    """Step between the frames that take part."""
    return numbers[1] - numbers[0] if len(numbers) > 1 else 1


def hue_of(index: int) -> int:
    """Neighbouring numbers get hues far apart: steps of the golden angle."""
    return round(index * 137.508 + 210) % 360
