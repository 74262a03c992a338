"""Whether a frame looks at a corner as the faces there look: what nobody sketched (a hand, a plant, a pillar) hides corners too.

A face near its corner keeps its colours, but for the exposure, while what passes before it has others, and what stands before it shows
another place of itself in every frame. So the frames that see a patch agree with each other, and with those in which the person marked the
corner. The look on which most agree is the patch's own; how the agreeing frames scatter about it is what a frame may differ by; and a frame
that differs by more shows something else. A bare patch before which something of its own colour passes says little, and then little is
said: its odds are those of two colours being alike by chance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from planewright.arrays import Bool, Float, Int


@dataclass(frozen=True, kw_only=True)
class AppearanceOptions:
    """How colours are compared, and how frames follow each other. Grey levels unless said otherwise."""

    alike: float = 9.0
    """Two frames agree about a sample when they differ by less than about this."""
    as_alike: float = 0.75
    """Frames agree with a look when they are this share as much like it as the most alike tenth are. With less, frames in which a plant stands before a
    wall's foot count too where they are many (a hall's hidden F1 is .84 with .5)."""
    mark_votes: float = 3.0
    """The frames in which the corner is marked have this many votes for the patch's look, as a share of all frames that see it: there the person saw it."""
    least_scatter: float = 4.0
    """Standard deviation of a sample that is always allowed for: noise and coding."""
    bleed: float = 80.0
    """Contrast at the border of a face, which a sample near it may take in."""
    bleed_width: float = 1.3
    """Standard deviation of what a sample takes in, pixels: its own width, the picture's blur, and the border being beside its place."""
    border: float = 1.2
    """Samples nearer to the border than this in a frame are not looked at in it, pixels."""
    other_scatter: float = 45.0
    """Standard deviation of the colours of something else."""
    stray: float = 0.05
    """Share of samples that differ for no reason."""
    independent: float = 3.0
    """A patch counts as this many independent samples: what hides one place hides the next."""
    weight_radius: float = 6.0
    """The weight of samples falls by e over this distance from the corner, pixels."""
    most: float = 8.0
    """Largest logarithm of the odds that one patch in one frame may have."""
    stay: float = 0.98
    """Chance that a corner is covered in a frame as in the one before, or is not."""
    visible: float = 0.95
    """Share of the frames in which a corner that the model does not hide is visible."""


def even_exposure(values: Float[np.ndarray, "rows samples 3"]) -> Float[np.ndarray, "rows samples 3"]:
    """The colours with each frame's exposure taken out: divided by the frame's median ratio to the samples' medians, channel by channel."""
    values = values.astype(np.float64)
    gain = np.ones((len(values), 3))
    for _ in range(3):
        usual = _median(values / gain[:, None])
        # Dark samples have no ratio to speak of.
        ratio = np.where(usual > 15.0, values / np.maximum(usual, 1.0), np.nan)
        count = np.isfinite(ratio[..., 0]).sum(axis=1)[:, None]
        found = np.array([_median(row) for row in ratio])
        gain = 1.0 + np.where(np.isfinite(found), found - 1.0, 0.0) * count / (count + 30.0)
        gain /= np.median(gain, axis=0)
    return values / gain[:, None]


def _median(values: Float[np.ndarray, "n ..."]) -> Float[np.ndarray, "..."]:
    """Over the first axis, NaN left out and where there is nothing."""
    ordered = np.sort(values, axis=0)  # NaN last
    count = np.isfinite(values).sum(axis=0)
    low, high = np.maximum((count - 1) // 2, 0), np.minimum(count // 2, max(len(values) - 1, 0))
    if len(values) == 0:
        return np.full(values.shape[1:], np.nan)
    return 0.5 * (np.take_along_axis(ordered, low[None], 0)[0] + np.take_along_axis(ordered, high[None], 0)[0])


def patch_odds(
    values: Float[np.ndarray, "rows samples 3"],
    distance: Float[np.ndarray, "rows samples"],
    radius: Float[np.ndarray, "samples"],
    scale: Float[np.ndarray, "rows"],
    marked: Bool[np.ndarray, "rows"],
    options: AppearanceOptions = AppearanceOptions(),
) -> Float[np.ndarray, "rows"]:
    """Logarithm of the odds that each frame shows the patch and not something before it; 0 where a frame says nothing.

    Args:
        values: colours, exposure taken out; NaN where a sample is not seen.
        distance: of the samples from the face's border, pixels in each frame.
        radius: of the samples from the corner, pixels.
        scale: how small each frame shows the patch, pixels per world unit in the direction in which it is smallest.
        marked: frames in which the person marked the corner.
    """
    odds = np.zeros(len(values))
    near = np.exp(-radius / options.weight_radius)
    values = np.where((distance > options.border)[..., None], values, np.nan)
    rows = np.nonzero(np.isfinite(values[..., 0]).sum(axis=1) >= 4)[0]
    if len(rows) < 5:
        return odds
    seen = values[rows]
    look, agree = _look(seen, near, marked[rows], options)
    scatter = np.maximum(1.4826 * _median(np.abs(seen[agree] - look)), options.least_scatter)
    known = np.isfinite(look) & np.isfinite(scatter)
    look, scatter = np.where(known, look, np.nan), np.where(known, scatter, 1.0)
    # What a view that shows the patch smaller, or larger, than those that made the look does to its texture.
    usual = float(np.median(scale[rows][agree]))
    blurred = 1.0 - np.minimum(scale[rows] / usual, usual / scale[rows])
    texture = np.nanstd(look, axis=0) if known.any() else np.zeros(3)
    variance = scatter**2 + (options.bleed * ndtr(-distance[rows] / options.bleed_width))[..., None] ** 2 + (blurred[:, None, None] * texture) ** 2
    off = seen - look
    shows = (1.0 - options.stray) * np.exp(-0.5 * off**2 / variance) / np.sqrt(variance) + options.stray / 150.0
    other = 0.8 * np.exp(-0.5 * (off / options.other_scatter) ** 2) / options.other_scatter + 0.2 / 150.0
    log_odds = np.log(shows / other).mean(axis=2)
    there = np.isfinite(log_odds)
    weight = there * near
    mean = (np.where(there, log_odds, 0.0) * weight).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-9)
    enough = np.minimum(1.0, there.sum(axis=1) / 8.0)
    odds[rows] = np.clip(options.independent * enough * mean, -options.most, options.most)
    return odds


def _look(
    seen: Float[np.ndarray, "rows samples 3"], near: Float[np.ndarray, "samples"], marked: Bool[np.ndarray, "rows"], options: AppearanceOptions
) -> tuple[Float[np.ndarray, "samples 3"], Bool[np.ndarray, "rows"]]:
    """The look on which most frames agree, and those frames.

    The frame with which most agree (of at most 80, and the marked ones), then the median of those that agree with it, twice more.
    """
    some = np.unique(np.concatenate([np.linspace(0, len(seen) - 1, min(len(seen), 80)).round().astype(np.int64), np.nonzero(marked)[0]]))
    agreement = np.stack([_agreement(seen[some], seen[k], near, options.alike) for k in some])
    votes = agreement.sum(axis=1)
    # A mark whose look no other frames share was made where the person guessed, or just then something passed.
    at_mark = marked[some] & ((agreement > 0.5).sum(axis=1) >= 3)
    if at_mark.any():
        votes = votes + options.mark_votes * len(some) * agreement[:, at_mark].mean(axis=1)
    look = seen[some[int(np.argmax(votes))]]
    agree = np.ones(len(seen), bool)
    for _ in range(3):
        alike = _agreement(seen, look, near, options.alike)
        agree = alike >= max(options.as_alike * float(np.percentile(alike, 90)), 0.25)
        if not agree.any():
            agree = alike >= alike.max()
        look = _median(seen[agree])
    return look, agree


def _agreement(
    seen: Float[np.ndarray, "rows samples 3"], look: Float[np.ndarray, "samples 3"], near: Float[np.ndarray, "samples"], alike: float
) -> Float[np.ndarray, "rows"]:
    """From 0 (nothing) to 1 (the same), over the samples that both have; 0 where they share less than 30 % of them."""
    same = np.exp(-0.5 * ((seen - look) / alike) ** 2).mean(axis=2)
    weight = np.isfinite(same) * near
    total = weight.sum(axis=1)
    return np.where(total > 0.3 * near.sum(), (np.where(weight > 0, same, 0.0) * weight).sum(axis=1) / np.maximum(total, 1e-9), 0.0)


def smooth_states(
    odds: Float[np.ndarray, "rows"], possible: Bool[np.ndarray, "rows"], options: AppearanceOptions = AppearanceOptions()
) -> Float[np.ndarray, "rows"]:
    """Probability that a corner is not covered, from the odds of all frames, by forward and backward recursion over two states (Rabiner 1989, III A).

    possible: frames in which the model does not hide the corner; each run of them is a chain of its own. The probability is 1 elsewhere.
    """
    probability = np.ones(len(odds))
    rows = np.nonzero(possible)[0]
    leave = 1.0 - options.stay
    prior = np.array([options.visible, 1.0 - options.visible])
    # From visible to covered and back, with `prior` as the share of time in each.
    move = np.array([[1.0 - 2.0 * leave * prior[1], 2.0 * leave * prior[1]], [2.0 * leave * prior[0], 1.0 - 2.0 * leave * prior[0]]])
    for run in np.split(rows, np.nonzero(np.diff(rows) > 1)[0] + 1):
        likelihood = np.stack([np.exp(np.clip(odds[run], -30.0, 30.0)), np.ones(len(run))], axis=1)
        forward, backward = np.zeros((len(run), 2)), np.ones((len(run), 2))
        state = prior
        for k in range(len(run)):
            state = (state if k == 0 else state @ move) * likelihood[k]
            state = state / state.sum()
            forward[k] = state
        for k in range(len(run) - 2, -1, -1):
            after = move @ (backward[k + 1] * likelihood[k + 1])
            backward[k] = after / after.sum()
        both = forward * backward
        probability[run] = both[:, 0] / both.sum(axis=1)
    return probability


def uncovered(
    values: Float[np.ndarray, "rows samples 3"],
    distance: Float[np.ndarray, "rows samples"],
    radius: Float[np.ndarray, "samples"],
    start: Int[np.ndarray, "patches_1"],
    corner: Int[np.ndarray, "patches"],
    scale: Float[np.ndarray, "rows patches"],
    possible: Bool[np.ndarray, "rows points"],
    marked: Bool[np.ndarray, "rows points"],
    options: AppearanceOptions = AppearanceOptions(),
) -> Float[np.ndarray, "rows points"]:
    """Probability that nothing unsketched covers a corner, 1 where nothing speaks about it. See `patch_odds` and `smooth_states`."""
    even = even_exposure(values)
    odds = np.zeros(possible.shape)
    for p, c in enumerate(corner):
        part = slice(int(start[p]), int(start[p + 1]))
        odds[:, c] += patch_odds(even[:, part], distance[:, part], radius[part], scale[:, p], marked[:, c], options)
    odds[marked] = options.most
    return np.stack([smooth_states(odds[:, c], possible[:, c], options) for c in range(possible.shape[1])], axis=1).reshape(possible.shape)
