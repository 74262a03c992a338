"""Whether a frame looks at a corner as the faces there look: what nobody sketched (a hand, a plant, a pillar) hides corners too.

A face near its corner keeps its colours, but for the exposure, while what passes before it has others, and what stands before it shows
another place of itself in every frame. So the frames that see a patch agree with each other, and with those in which the person marked the
corner. The look on which most agree is the patch's own; how the agreeing frames scatter about it is what a frame may differ by; and a frame
that differs by more shows something else. What changes slowly as the camera moves (gloss, shade) is followed: an occluder comes suddenly.
A bare patch before which something of its own colour passes says little, and then little is
said: its odds are those of two colours being alike by chance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from planewright.arrays import Bool, Float, Int
from planewright.tracking.appearance_kernels import agreement, agreements, chain, follow_look, middle_look


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
    drift: float = 4.0
    """What the colour of a place may change by while it is seen from one degree further on (gloss, light that falls otherwise on what turns).
    A model house on a turning table changes by 3, and 15 % of its corners were called covered with 0; far corners of a hall behind plants are told
    worse the larger it is."""
    renewal: float = 0.3
    """Share by which a frame that shows the patch draws the look to itself, within what `drift` allows."""
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


def even_exposure(values: Float[np.ndarray, "rows samples 3"]) -> Float[np.ndarray, "rows 3"]:
    """Each frame's exposure: its median ratio to the samples' medians, channel by channel. Values divided by it are alike in all frames."""
    # The exposure is one number a channel: some hundreds of samples tell it.
    some = values[:, :: max(1, values.shape[1] // 600)].astype(np.float64)
    # Values that are cut off have no ratio, and dark ones none to speak of.
    some[some >= CUT_OFF] = np.nan
    gain = np.ones((len(values), 3))
    for _ in range(3):
        usual = _median(some / gain[:, None])
        ratio = np.where(usual > 15.0, some / np.maximum(usual, 1.0), np.nan)
        count = np.isfinite(ratio[..., 0]).sum(axis=1)[:, None]
        found = _median(ratio.transpose(1, 0, 2))
        gain = 1.0 + np.where(np.isfinite(found), found - 1.0, 0.0) * count / (count + 30.0)
        gain /= np.median(gain, axis=0)
    return gain


CUT_OFF = 250.0
"""Grey level from which a value is not told from a larger one."""


def _median(values: Float[np.ndarray, "n ..."]) -> Float[np.ndarray, "..."]:
    """Over the first axis, NaN left out and where there is nothing."""
    ordered = np.sort(values, axis=0)  # NaN last
    count = np.isfinite(values).sum(axis=0)
    low, high = np.maximum((count - 1) // 2, 0), np.minimum(count // 2, max(len(values) - 1, 0))
    if len(values) == 0:
        return np.full(values.shape[1:], np.nan)
    return 0.5 * (np.take_along_axis(ordered, low[None], 0)[0] + np.take_along_axis(ordered, high[None], 0)[0])


@dataclass(frozen=True, eq=False)
class PatchViews:
    """One patch in all frames."""

    values: Float[np.ndarray, "rows samples 3"]
    """Colours, exposure taken out; NaN where a sample is not seen."""
    ceiling: Float[np.ndarray, "rows 3"]
    """Values from here on are cut off."""
    distance: Float[np.ndarray, "rows samples"]
    """Of the samples from the face's border, pixels in each frame."""
    radius: Float[np.ndarray, "samples"]
    """Of the samples from the corner, pixels."""
    scale: Float[np.ndarray, "rows"]
    """How small each frame shows the patch, pixels per world unit in the direction in which it is smallest."""
    sigma: Float[np.ndarray, "rows"]
    """How uncertain the place of the corner is, pixels."""
    turned: Float[np.ndarray, "rows"]
    """Degrees by which each frame looks at the patch from elsewhere than the one before."""
    marked: Bool[np.ndarray, "rows"]
    """Frames in which the person marked the corner."""


def patch_odds(views: PatchViews, options: AppearanceOptions = AppearanceOptions()) -> Float[np.ndarray, "rows"]:
    """Logarithm of the odds that each frame shows the patch and not something before it; 0 where a frame says nothing.

    The look on which most frames agree, followed from there both ways as the light on it changes (see `follow_look`).
    """
    odds = np.zeros(len(views.values))
    near = np.exp(-views.radius / options.weight_radius).astype(np.float64)
    # The edge of a loosely known face is anywhere: what lies beyond it comes in from as far.
    width = np.hypot(options.bleed_width, views.sigma)
    values = np.where((views.distance > options.border)[..., None], views.values, np.nan).astype(np.float64)
    rows = np.nonzero(np.isfinite(values[..., 0]).sum(axis=1) >= 4)[0]
    if len(rows) < 5:
        return odds
    found = _look(values[rows], views.ceiling[rows], near, views.marked[rows], options)
    if found is None:
        return odds
    look, scatter, agree = found
    variance = np.maximum(scatter, options.least_scatter) ** 2
    known = np.isfinite(look[:, 0])
    # What a view that shows the patch smaller, or larger, than those that made the look does to its texture.
    agreeing = rows[agree]
    usual = max(float(np.median(views.scale[agreeing])), 1e-12)
    scale = np.maximum(views.scale, 1e-12)
    blurred = 1.0 - np.minimum(scale / usual, usual / scale)
    missing = blurred[:, None] * np.std(look[known], axis=0)
    beyond = options.bleed * ndtr(-views.distance.astype(np.float64) / width[:, None])
    follow_look(
        values, views.ceiling, near, look, variance, beyond, missing, views.turned, int(agreeing[len(agreeing) // 2]), options.other_scatter,
        options.stray, options.independent, options.most, options.drift, options.renewal, odds,
    )  # fmt: skip
    return odds


def _look(
    seen: Float[np.ndarray, "rows samples 3"],
    ceiling: Float[np.ndarray, "rows 3"],
    near: Float[np.ndarray, "samples"],
    marked: Bool[np.ndarray, "rows"],
    options: AppearanceOptions,
) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples 3"], Bool[np.ndarray, "rows"]] | None:
    """The look on which most frames agree, how the agreeing ones scatter about it, and which they are; None where no two samples are left.

    Of at most 60 frames, and the marked ones: the frame with which most agree, then the median of those that agree with it, twice more.
    """
    some = np.unique(np.concatenate([np.linspace(0, len(seen) - 1, min(len(seen), 60)).round().astype(np.int64), np.nonzero(marked)[0]]))
    seen, ceiling, at_mark = np.ascontiguousarray(seen[some]), np.ascontiguousarray(ceiling[some]), marked[some]
    mutual = np.zeros((len(some), len(some)))
    agreements(seen, ceiling, near, options.alike, mutual)
    votes = mutual.sum(axis=1)
    # A mark whose look no other frame shares was made where the person guessed, or just then something passed.
    shared = at_mark & ((mutual > 0.5).sum(axis=1) >= 2)
    if shared.any():
        votes = votes + options.mark_votes * len(some) * mutual[:, shared].mean(axis=1)
    best = int(np.argmax(votes))
    alike = mutual[:, best]
    look, scatter = np.empty(seen.shape[1:]), np.empty(seen.shape[1:])
    agree = np.ones(len(seen), bool)
    for step in range(3):
        agree = alike >= max(options.as_alike * float(np.percentile(alike, 90)), 0.25)
        if not agree.any():
            agree = alike >= alike.max()
        middle_look(seen, ceiling, agree, look, scatter)
        if step < 2:
            alike = np.array([agreement(seen[k], ceiling[k], look, np.full(3, np.inf), near, options.alike) for k in range(len(seen))])
    if np.isfinite(look[:, 0]).sum() < 2:
        return None
    which = np.zeros(len(marked), bool)
    which[some[agree]] = True
    return look, scatter, which


def smooth_states(
    odds: Float[np.ndarray, "rows"], possible: Bool[np.ndarray, "rows"], options: AppearanceOptions = AppearanceOptions()
) -> Float[np.ndarray, "rows"]:
    """Probability that a corner is not covered, from the odds of all frames, by forward and backward recursion over two states (Rabiner 1989, III A).

    possible: frames in which the model does not hide the corner; each run of them is a chain of its own. The probability is 1 elsewhere.
    """
    probability, ahead = np.ones(len(odds)), np.empty(len(odds))
    rows = np.nonzero(possible)[0]
    for run in np.split(rows, np.nonzero(np.diff(rows) > 1)[0] + 1):
        if len(run):
            chain(odds, int(run[0]), int(run[-1]) + 1, options.stay, options.visible, probability, ahead)
    return probability


def uncovered(
    values: Float[np.ndarray, "rows samples 3"],
    distance: Float[np.ndarray, "rows samples"],
    radius: Float[np.ndarray, "samples"],
    start: Int[np.ndarray, "patches_1"],
    corner: Int[np.ndarray, "patches"],
    scale: Float[np.ndarray, "rows patches"],
    sigma: Float[np.ndarray, "rows points"],
    turned: Float[np.ndarray, "rows points"],
    possible: Bool[np.ndarray, "rows points"],
    marked: Bool[np.ndarray, "rows points"],
    options: AppearanceOptions = AppearanceOptions(),
) -> Float[np.ndarray, "rows points"]:
    """Probability that nothing unsketched covers a corner, 1 where nothing speaks about it. See `patch_odds` and `smooth_states`."""
    gain = even_exposure(values)
    odds = np.zeros(possible.shape)
    for p, c in enumerate(corner):
        part = slice(int(start[p]), int(start[p + 1]))
        views = PatchViews(
            values[:, part] / gain[:, None], CUT_OFF / gain, distance[:, part], radius[part], scale[:, p], sigma[:, c], turned[:, c], marked[:, c]
        )
        odds[:, c] += patch_odds(views, options)
    odds[marked] = options.most
    return np.stack([smooth_states(odds[:, c], possible[:, c], options) for c in range(possible.shape[1])], axis=1).reshape(possible.shape)
