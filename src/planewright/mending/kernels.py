# pyright: basic
"""Compiled loops over windows and layers. Pixels are array coordinates here: the centre of the top-left pixel is (0, 0)."""

from typing import no_type_check

import numpy as np
from numba import njit

from planewright.geometry.bilinear_kernels import bilinear

# `no_type_check` keeps the shape checker of the tests from wrapping a kernel before Numba sees it.


@njit(cache=True)
@no_type_check
def cut_patch(image, x, y, affine, half, out):
    """The patch of (2 half + 1)^2 samples at (x, y) + affine @ (column, row), into out (samples,), with mean zero and length one.

    Returns its standard deviation in grey levels, or -1 where it leaves the image; a patch without contrast becomes zero.
    """
    n = 0
    total = 0.0
    for v in range(-half, half + 1):
        for u in range(-half, half + 1):
            value = bilinear(image, x + affine[0, 0] * u + affine[0, 1] * v, y + affine[1, 0] * u + affine[1, 1] * v)
            if value < 0.0:
                return -1.0
            out[n] = value
            total += value
            n += 1
    mean = total / n
    square = 0.0
    for k in range(n):
        out[k] -= mean
        square += out[k] * out[k]
    sigma = np.sqrt(square / n)
    scale = 1.0 / np.sqrt(square) if sigma > 1.0 else 0.0
    for k in range(n):
        out[k] *= scale
    return sigma


@njit(cache=True)
@no_type_check
def node_costs(image, nodes, affines, references, half, patch_weight, lines, line_weight, out):
    """What the image says against each node of a layer.

    nodes (N, 2); affines (R, 2, 2) from each reference's patch to this frame; references (R, samples) as `cut_patch` leaves them; lines (L, 4): unit
    normal, offset (normal . x = offset) and weight of each edge found in this frame. Fills out (N,): patch_weight (1 - best ZNCC) +
    line_weight times the weighted mean of a bounded distance, r^2 / (1 + r^2) per edge with r in pixels.
    """
    count = references.shape[0]
    patch = np.empty(references.shape[1])
    total_weight = 0.0
    for e in range(lines.shape[0]):
        total_weight += lines[e, 3]
    for i in range(nodes.shape[0]):
        x, y = nodes[i, 0], nodes[i, 1]
        best = -1.0
        seen = False
        for r in range(count):
            if cut_patch(image, x, y, affines[r], half, patch) < 0.0:
                continue
            seen = True
            score = 0.0
            for k in range(patch.shape[0]):
                score += patch[k] * references[r, k]
            best = max(best, score)
        # outside the image nothing is said for or against: as much as an unrelated patch
        cost = patch_weight * (1.0 - best if seen else 1.0)
        if total_weight > 0.0:
            away = 0.0
            for e in range(lines.shape[0]):
                d = lines[e, 0] * x + lines[e, 1] * y - lines[e, 2]
                away += lines[e, 3] * d * d / (1.0 + d * d)
            cost += line_weight * away / total_weight
        out[i] = cost


@njit(cache=True)
@no_type_check
def next_layer(nodes, cost, traced, stiffness, next_nodes, next_cost, reached, came_from):
    """One layer of the shortest path, every node to every node.

    nodes (N, 2) with the cost (N,) of getting there; traced (N, 2): where each is traced to in the next frame; stiffness (N,): weight of the
    squared distance from there, px^-2; next_nodes (M, 2) with their own next_cost (M,). Fills reached (M,) and came_from (M,).
    """
    for j in range(next_nodes.shape[0]):
        best = np.inf
        at = 0
        for i in range(nodes.shape[0]):
            dx, dy = next_nodes[j, 0] - traced[i, 0], next_nodes[j, 1] - traced[i, 1]
            c = cost[i] + 0.5 * stiffness[i] * (dx * dx + dy * dy)
            if c < best:
                best = c
                at = i
        reached[j] = best + next_cost[j]
        came_from[j] = at
