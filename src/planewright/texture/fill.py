"""Colours for texels that nothing was seen of: a smooth continuation of their neighbours."""

import cv2
import numpy as np

from planewright.arrays import Bool, ColorImage, Float


def fill_unseen(image: ColorImage, seen: Bool[np.ndarray, "height width"]) -> ColorImage:
    """The image with every texel that was not seen filled in; seen texels stay as they are. Where nothing was seen at all, mid grey.

    Push-pull (Gortler et al. 1996, section 3.2.2): averages of what was seen, ever coarser until there is no hole, then back down into the holes.
    """
    if not seen.any():
        return np.full_like(image, 128)
    filled = _pull(image.astype(np.float32), seen.astype(np.float32))
    return np.where(seen[..., None], image, np.clip(np.rint(filled), 0, 255).astype(np.uint8))


def _pull(color: Float[np.ndarray, "height width 3"], weight: Float[np.ndarray, "height width"]) -> Float[np.ndarray, "height width 3"]:
    height, width = weight.shape
    if weight.min() >= 1.0 or max(height, width) == 1:
        return color
    # Pairs of texels become one; an odd last row or column is repeated.
    pad = ((0, height % 2), (0, width % 2))
    weights = np.pad(weight, pad, mode="edge")
    sums = np.pad(color * weight[..., None], (*pad, (0, 0)), mode="edge")
    half = (weights.shape[0] // 2, 2, weights.shape[1] // 2, 2)
    weight_half = weights.reshape(half).sum(axis=(1, 3))
    color_half = sums.reshape(*half, 3).sum(axis=(1, 3)) / np.maximum(weight_half, 1e-6)[..., None]
    coarse = _pull(color_half, np.minimum(weight_half, 1.0))
    fine = cv2.resize(coarse, (2 * half[2], 2 * half[0]), interpolation=cv2.INTER_LINEAR)[:height, :width].reshape(height, width, 3)
    return color * weight[..., None] + fine * (1.0 - weight[..., None])
