"""Shape aliases used on every floor. Axis words mean the same thing everywhere they appear."""

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, UInt8

Vec2 = Float[np.ndarray, "2"]
Vec3 = Float[np.ndarray, "3"]
Mat3 = Float[np.ndarray, "3 3"]
GrayImage = UInt8[np.ndarray, "height width"]
ColorImage = UInt8[np.ndarray, "height width 3"]
"""Red, green, blue."""

__all__ = ["Bool", "ColorImage", "Float", "Float64", "GrayImage", "Int", "Mat3", "UInt8", "Vec2", "Vec3"]
