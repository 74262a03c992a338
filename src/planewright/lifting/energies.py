"""What a choice of planes costs, one or none a face, and the choice that costs least."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from planewright.arrays import Bool, UInt8
from planewright.lifting.choice import choose_labels
from planewright.lifting.hypothesis import Hypothesis
from planewright.lifting.located import corner_depths
from planewright.lifting.photometric import photo_cost, plane_from_world
from planewright.lifting.task import Task

WEAK = 1.0
"""A plane from pixels that earns less does not stand against one through corners."""
EXPLAINED = 40.0
"""Energy a share of pixels that other faces explain, above 0.3: nothing else outweighs a face all of whose pixels show others."""
DEPTHS = 0.3
"""Spread of the logarithms of depths in a scene."""


def choose_planes(
    task: Task,
    found: Sequence[Sequence[Hypothesis]],
    masks: Mapping[int, Mapping[int, UInt8[np.ndarray, "height width"]]],
    rng: np.random.Generator,
) -> tuple[list[Hypothesis | None], float]:
    """One hypothesis or none a face, so that planes agree at shared corners and no two faces share their pixels; and the energy of the choice.

    The energy: `Hypothesis.energy` of each chosen plane; `disagreement` for each corner that two chosen faces share, and for each that far
    marks tell of; up to +28 where a face's pixels are explained by other chosen faces drawn there.

    Args:
        found: hypotheses of each face.
        masks: polygons of faces that share pixels with others, by view and face.
    """
    faces = range(task.num_faces)
    energies = _Energies(task, found, masks)
    usable = _usable(energies)
    neighbours = [[g for g in faces if g != f and set(task.corners[f]) & set(task.corners[g])] for f in faces]
    order = sorted(faces, key=lambda f: min((found[f][h].energy for h in usable[f]), default=9.0))
    labels, energy = choose_labels(usable, energies.unary, energies.pair, energies.crowd, neighbours, order, rng)
    return [found[f][h] if h >= 0 else None for f, h in enumerate(labels)], energy


class _Energies:
    """The three terms of the energy; those of pairs are kept, for a search asks for them often."""

    def __init__(self, task: Task, found: Sequence[Sequence[Hypothesis]], masks: Mapping[int, Mapping[int, UInt8[np.ndarray, "height width"]]]):
        self.task, self.found, self.masks = task, found, masks
        self.depths = [[corner_depths(task, f, guess) for guess in guesses] for f, guesses in enumerate(found)]
        self.drawn_over = [[np.nonzero(guess.covered.any(axis=0))[0].tolist() for guess in guesses] for guesses in found]
        self._pairs: dict[tuple[int, int, int, int], float] = {}
        self._explained: dict[tuple[int, int, int, int], Bool[np.ndarray, "probe"]] = {}

    def unary(self, f: int, h: int) -> float:
        energy = self.found[f][h].energy
        for c, (z, sigma) in self.depths[f][h].items():
            if c in self.task.triangulated:
                there, sure = self.task.triangulated[c]
                energy += disagreement(np.log(z / there), np.hypot(sigma, sure))
        return energy

    def pair(self, f: int, h: int, g: int, k: int) -> float:
        key = (f, h, g, k) if f < g else (g, k, f, h)
        if key not in self._pairs:
            self._pairs[key] = self._at_shared_corners(*key)
        return self._pairs[key]

    def crowd(self, f: int, h: int, labels: Sequence[int]) -> float:
        """For the share of the face's pixels that other chosen faces explain."""
        mine = self.found[f][h]
        by_others = np.zeros(len(mine.probe), bool)
        for g in self.drawn_over[f][h]:
            if labels[g] >= 0:
                key = (f, h, g, labels[g])
                if key not in self._explained:
                    mask = self.masks.get(mine.view, {}).get(g)
                    self._explained[key] = mine.covered[:, g] & explained(self.task, mine, self.found[g][labels[g]], mask)
                by_others |= self._explained[key]
        return EXPLAINED * max(0.0, float(by_others.mean()) - 0.3)

    def _at_shared_corners(self, f: int, h: int, g: int, k: int) -> float:
        # a plane through corners agrees with the faces that located them by its making: that is no evidence, a contradiction is
        circular = self.found[f][h].view < 0 or self.found[g][k].view < 0
        energy = 0.0
        for c, (za, sa) in self.depths[f][h].items():
            if c in self.depths[g][k]:
                zb, sb = self.depths[g][k][c]
                cost = disagreement(np.log(za / zb), np.hypot(sa, sb))
                # a corner of n faces has n - 1 to agree with: together they say it once
                energy += cost if cost > 0 else 0.0 if circular else cost / max(1, self.task.faces_at[c] - 1)
        return energy


def _usable(energies: _Energies) -> list[list[int]]:
    """Hypotheses of each face that have all its corners before the camera and something to say."""
    out: list[list[int]] = []
    for guesses, depths in zip(energies.found, energies.depths, strict=True):
        ahead = [h for h, at in enumerate(depths) if all(z > 0 for z, _ in at.values())]
        # beside a plane through corners known by other faces, one at which the views hardly agree is no witness
        by_corners = any(guesses[h].view < 0 for h in ahead)
        out.append([h for h in ahead if not by_corners or guesses[h].view < 0 or guesses[h].energy < -WEAK])
    return out


def explained(task: Task, mine: Hypothesis, other: Hypothesis, mask: UInt8[np.ndarray, "height width"] | None) -> Bool[np.ndarray, "probe"]:
    """Which of the probe points show the other face: those that lie behind it, and all where its plane carries the pixels that both
    are drawn over into other views as well as this one does (within what is worth it of the robust cost a pixel).

    Args:
        mask: the other face's polygon in the view of `mine`, where it is known.
    """
    center = task.views.centers[mine.view]
    toward = mine.probe - center
    along = toward @ other.normal
    reach = (other.offset - center @ other.normal) / np.where(np.abs(along) < 1e-12, 1e-12, along)
    hidden = (reach > 0) & (reach < 1.0 - task.tolerances.same_depth)
    if mine.found is None:
        return hidden | ((mine.view >= 0) & (np.abs(reach - 1.0) < task.tolerances.same_depth))
    if hidden.all() or mask is None:
        return hidden
    reference = mine.found.reference
    shared = mask[reference.pixels[:, 1].astype(int), reference.pixels[:, 0].astype(int)] > 0
    plane = plane_from_world(task.views, reference, other.normal, other.offset)
    if shared.sum() < 30 or plane is None:
        return hidden
    part = replace(reference, pixels=reference.pixels[shared], basis=reference.basis[shared], values=reference.values[shared])
    own, theirs = (photo_cost(task.views, part, q, task.photometric) for q in (mine.found.plane, plane))
    return hidden | (theirs < own + task.tolerances.worth)


def disagreement(difference: float, sigma: float) -> float:
    """What two depths (logarithms) of a corner cost: minus the log-likelihood ratio of "the same corner" against any depth of the scene,
    with a chance of 0.1 % that one of the clicks is wrong. About -4 where they agree to half a percent, +6.9 where they do not."""
    same = np.exp(-0.5 * (difference / sigma) ** 2) / sigma
    # a depth that is out of all range earns nothing by being out of range
    other = np.exp(-0.5 * (difference / max(DEPTHS, sigma)) ** 2) / DEPTHS
    return -float(np.log(0.999 * same / other + 0.001))
