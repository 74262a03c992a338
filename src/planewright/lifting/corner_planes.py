"""Planes of a face through corners that other faces, or marks far apart, have located."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planewright.arrays import Int, Vec3
from planewright.geometry.plane import fit_plane
from planewright.lifting.hypothesis import CORNERS, Hypothesis
from planewright.lifting.located import Located, face_in_view
from planewright.lifting.photometric import photo_cost, plane_from_world
from planewright.lifting.rays import meet
from planewright.lifting.task import Task


def from_corners(task: Task, located: Located, face: int, found: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Planes through known corners of the face: through all of them, and where those disagree, through all but one each.

    Where the pixels agree with such a plane as well as with one that was fitted to them, they speak for it too.

    Args:
        found: the hypotheses that the face has so far.
    """
    out: list[Hypothesis] = []
    for guess in planes_through(task, located, face):
        lender = _lender(task, found, guess)
        if lender is None:
            out.append(guess)
            continue
        turn = 1.0 if float(guess.normal @ lender.normal) > 0 else -1.0
        support = guess.support - lender.energy / CORNERS
        out.append(replace(guess, normal=turn * guess.normal, offset=turn * guess.offset, support=support, agreed=True))
    return out


def _lender(task: Task, found: Sequence[Hypothesis], guess: Hypothesis) -> Hypothesis | None:
    """The plane of the pixels' own that earns most of those which they tell from `guess` by no more than what is worth it."""
    best: Hypothesis | None = None
    for other in found:
        if other.found is None or other.energy >= (0.0 if best is None else best.energy):
            continue
        plane = plane_from_world(task.views, other.found.reference, guess.normal, guess.offset)
        if plane is None:
            continue
        own, theirs = (photo_cost(task.views, other.found.reference, q, task.photometric) for q in (other.found.plane, plane))
        if theirs < own + task.tolerances.worth:
            best = other
    return best


def planes_through(task: Task, located: Located, face: int) -> list[Hypothesis]:
    """Planes through corners that are known without the face; through two of them and one more where there are just two."""
    independent = [c for c in dict.fromkeys(task.corners[face]) if located.known[c] and (c in task.triangulated or located.told_by[c] - {face})]
    known = np.array([c for c in independent if located.spread[c] < 20 * task.tolerances.plane_sigma], int)
    if len(known) == 2:
        return _standing(task, located, face, known)
    if guess := _through(task, located, known):
        return [guess]
    if not 4 <= len(known) <= 12:
        return []
    return [guess for c in known if (guess := _through(task, located, known[known != c]))]


def _standing(task: Task, located: Located, face: int, known: Int[np.ndarray, "two"]) -> list[Hypothesis]:
    """Planes through two known corners and one that nothing has located yet, but that is drawn over another face: most likely it
    stands on it, as a box does on the ground."""
    rays = task.rays
    out: list[Hypothesis] = []
    for c in task.corners[face]:
        rows = rays.of_point(c)[:1]
        if located.known[c] or len(rows) == 0:
            continue
        depths = _depths_on_faces_beneath(task, located, c, rows)
        if not depths or min(depths) <= 0:
            continue
        xyz = np.concatenate([located.points[known], rays.origin[rows] + min(depths) * rays.direction[rows]])
        normal, offset = _towards(task, int(rows[0]), *fit_plane(xyz, np.ones(3)))
        if np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)[1] > 8.0 * task.tolerances.plane_sigma * float(np.median(depths)):
            out.append(Hypothesis(normal, offset, float("nan"), -1, xyz, np.zeros((3, task.num_faces), bool), support=0.7))
    return out


def _depths_on_faces_beneath(task: Task, located: Located, corner: int, row: Int[np.ndarray, "one"]) -> list[float]:
    """Depths at which a mark's ray meets the chosen planes of the faces that it is drawn over."""
    view = int(task.rays.view[row[0]])
    x, y = (int(v) for v in task.rays.xy[row[0]])
    depths: list[float] = []
    for g, ground in enumerate(located.chosen):
        drawn = None if ground is None or corner in task.corners[g] else face_in_view(task, located, view, g)
        if ground is not None and drawn is not None and 0 <= y < len(drawn[0]) and 0 <= x < drawn[0].shape[1] and drawn[0][y, x]:
            depths.append(float(meet(task.rays, row, ground.normal, ground.offset)[0][0]))
    return depths


def _through(task: Task, located: Located, corners: Int[np.ndarray, "corners"]) -> Hypothesis | None:
    """The plane through known corners; None where they are on a line, or disagree."""
    if len(corners) < 3:
        return None
    xyz = located.points[corners]
    first = np.array([task.rays.of_point(int(c))[0] for c in corners])
    sigma = located.spread[corners] * np.linalg.norm(xyz - task.rays.origin[first], axis=1)
    weight = 1.0 / sigma**2
    normal, offset = fit_plane(xyz, weight)
    center = weight @ xyz / weight.sum()
    # the second singular value of the corners in units of their sigmas says whether they are off a line
    across = np.linalg.svd((xyz - center) / np.maximum(sigma, 0.2 * sigma.max())[:, None], compute_uv=False)[1]
    if across < 3.0 or (np.abs(xyz @ normal - offset) > 4.0 * sigma).any():
        return None
    normal, offset = _towards(task, int(first[0]), normal, offset)
    nobody = np.zeros((len(xyz), task.num_faces), bool)
    return Hypothesis(normal, offset, float("nan"), -1, xyz, nobody, support=1.0 if len(corners) == 3 else 2.0)


def _towards(task: Task, row: int, normal: Vec3, offset: float) -> tuple[Vec3, float]:
    """The plane with its normal on the side of a mark's camera."""
    return (normal, offset) if float(normal @ task.rays.origin[row]) > offset else (-normal, -offset)
