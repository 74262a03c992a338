# pyright: basic
"""Compiled loops over what all frames show of a patch. Samples that are not seen are NaN."""

from math import exp, log, sqrt
from typing import no_type_check

import numpy as np
from numba import njit

# `no_type_check` keeps the shape checker of the tests from wrapping a kernel before Numba sees it.


@njit(cache=True)
@no_type_check
def agreement(values, ceiling, look, look_ceiling, near, alike):
    """From 0 (nothing) to 1 (the same): how much a frame's samples (S, 3) are like a look (S, 3); 0 where they share less than 30 % of them.

    ceiling, look_ceiling (3,): values from here on are cut off in the frame, in the look. near (S,): weights.
    """
    total = all_ = same = 0.0
    for s in range(len(near)):
        all_ += near[s]
        if values[s, 0] == values[s, 0] and look[s, 0] == look[s, 0]:
            total += near[s]
            for c in range(3):
                top = min(ceiling[c], look_ceiling[c])
                off = (min(values[s, c], top) - min(look[s, c], top)) / alike
                if off * off < 40.0:
                    same += near[s] * exp(-0.5 * off * off) / 3.0
    return same / total if total > 0.3 * all_ else 0.0


@njit(cache=True)
@no_type_check
def agreements(values, ceiling, near, alike, out):
    """`agreement` of each of the frames (K, S, 3) with each, into out (K, K)."""
    for a in range(len(values)):
        for b in range(a + 1):
            out[a, b] = out[b, a] = agreement(values[a], ceiling[a], values[b], ceiling[b], near, alike)


@njit(cache=True)
@no_type_check
def middle_look(values, ceiling, use, look, scatter):
    """Medians of the frames (K, S, 3) in use (K,) into look (S, 3), and 1.4826 times the median distance from them into scatter (S, 3).

    Values that are cut off count only where fewer than three are not. NaN where no frame sees the sample.
    """
    kept = np.empty(len(values))
    for s in range(look.shape[0]):
        for c in range(3):
            n = cut = 0
            for k in range(len(values)):
                if use[k] and values[k, s, c] == values[k, s, c]:
                    if values[k, s, c] < ceiling[k, c]:
                        kept[n] = values[k, s, c]
                        n += 1
                    else:
                        cut += 1
            if n < 3 and cut > 0:
                n = 0
                for k in range(len(values)):
                    if use[k] and values[k, s, c] == values[k, s, c]:
                        kept[n] = values[k, s, c]
                        n += 1
            if n == 0:
                look[s, c] = scatter[s, c] = np.nan
                continue
            look[s, c] = np.median(kept[:n])
            for i in range(n):
                kept[i] = abs(kept[i] - look[s, c])
            scatter[s, c] = 1.4826 * np.median(kept[:n])


@njit(cache=True)
@no_type_check
def follow_look(values, ceiling, near, look, variance, beyond, missing, turned, start, other, stray, independent, most, drift, renewal, odds):
    """Logarithm of the odds that frames show a patch, whose look may change slowly, and not something before it.

    values (K, S, 3), ceiling (K, 3): where they are cut off. near (S,): weights. look, variance (S, 3): the look on which most frames
    agree, and what it scatters by. beyond (K, S): what comes in from beyond the border, missing (K, 3): what a frame that shows the patch
    at another size lacks of its texture, both standard deviations. turned (K,):
    degrees by which the patch is seen from elsewhere than in the frame before. start: the frame from which the look is followed, both ways.
    renewal, drift: a frame that clearly shows the patch (odds of e to e^3) draws the look to itself by up to this share, and by no more
    than drift for each degree: one that only might show it would lead the look on to what stands before. A frame
    is compared with where the look has come to, and with `look` itself, and the better of the two counts.
    Fills odds (K,): 0 where fewer than 4 samples are seen.
    """
    rows, samples = values.shape[:2]
    now, seen = np.empty((samples, 3)), np.empty(samples, np.bool_)
    for way in (1, -1):
        now[:] = look
        far = 0.0
        k = start
        while 0 <= k < rows:
            if k != start:
                far += turned[k if way == 1 else k + 1]
            there = 0
            total = local = common = 0.0
            for s in range(samples):
                seen[s] = values[k, s, 0] == values[k, s, 0] and look[s, 0] == look[s, 0]
                if not seen[s]:
                    continue
                there += 1
                total += near[s]
                for c in range(3):
                    value, top = values[k, s, c], ceiling[k, c]
                    noise = variance[s, c] + beyond[k, s] ** 2 + missing[k, c] ** 2
                    for which in range(2):
                        off = value - min(look[s, c] if which == 0 else now[s, c], top)
                        differs = 0.8 * exp(-0.5 * (off / other) ** 2) / other + 0.2 / 150.0
                        gain = near[s] * log(((1.0 - stray) * exp(-0.5 * off * off / noise) / sqrt(noise) + stray / 150.0) / differs) / 3.0
                        if which == 0:
                            common += gain
                        else:
                            local += gain
            if there >= 4:
                found = max(local, common) / total * independent * min(1.0, there / 8.0)
                found = min(max(found, -most), most)
                if way == 1 or k != start:
                    odds[k] = found
                share = renewal * min(max(0.5 * (found - 1.0), 0.0), 1.0)
                limit = drift * min(far, 1.0)
                for s in range(samples):
                    if seen[s]:
                        for c in range(3):
                            top = ceiling[k, c]
                            now[s, c] += min(max(share * (min(values[k, s, c], top) - min(now[s, c], top)), -limit), limit)
                far = 0.0
            k += way


@njit(cache=True)
@no_type_check
def chain(odds, first, last, stay, visible, probability, ahead):
    """Forward and backward recursion over two states, of the frames first to last - 1: fills probability (K,). ahead (K,): room for work."""
    leave = 1.0 - stay
    vc, cv = 2.0 * leave * (1.0 - visible), 2.0 * leave * visible  # from visible to covered, and back
    p = visible
    for k in range(first, last):
        if k > first:
            p = p * (1.0 - vc) + (1.0 - p) * cv
        a = p * exp(min(max(odds[k], -30.0), 30.0))
        p = a / (a + 1.0 - p)
        ahead[k] = p
    back_v = back_c = 1.0
    for k in range(last - 1, first - 1, -1):
        a, b = ahead[k] * back_v, (1.0 - ahead[k]) * back_c
        probability[k] = a / (a + b)
        lv, lc = back_v * exp(min(max(odds[k], -30.0), 30.0)), back_c
        back_v, back_c = (1.0 - vc) * lv + vc * lc, cv * lv + (1.0 - cv) * lc
        size = back_v + back_c
        back_v, back_c = back_v / size, back_c / size
