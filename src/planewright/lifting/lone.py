"""Points that no plane locates: the depth of the patch around their mark."""

from dataclasses import replace

import numpy as np

from planewright.arrays import Vec3
from planewright.lifting.located import Located
from planewright.lifting.photometric import hypotheses, plane_to_world, reference_from_mask
from planewright.lifting.rays import meet
from planewright.lifting.task import Task

PATCH = 5
"""Working pixels to each side of a point that is located as a patch of its own. Corners of four clips with truth, taken as points without
faces: median depth error 1.1, .8, 2.2, 2.8 pixels of motion with 5; 1.2, 1.3, 5.0, 3.1 with 7; 1.4, 1.1, 8.6, 4.7 with 10."""


def locate_lone_points(task: Task, located: Located) -> Located:
    """The points that were not known yet, where the patch around one of their first three marks tells a depth."""
    points, known, spread = located.points.copy(), located.known.copy(), located.spread.copy()
    for c in np.nonzero(~located.known)[0]:
        found = [hit for row in task.rays.of_point(int(c))[:3] if (hit := _patch_at(task, int(row))) is not None]
        if found:
            # the first of those with which the views agree best
            points[c] = max(found, key=lambda hit: hit[0])[1]
            known[c], spread[c] = True, 5 * task.tolerances.plane_sigma
    return replace(located, points=points, known=known, spread=spread)


def _patch_at(task: Task, row: int) -> tuple[float, Vec3] | None:
    """How well the views agree with the best plane around a mark, and where the mark's ray meets it."""
    views, rays, options = task.views, task.rays, replace(task.photometric, keep=1)
    view = int(rays.view[row])
    x, y = (int(v) for v in rays.xy[row])
    rho_range = task.rho_range(view)
    if rho_range is None:
        return None
    mask = np.zeros(views.images.shape[1:], bool)
    mask[max(y - PATCH, 0) : y + PATCH + 1, max(x - PATCH, 0) : x + PATCH + 1] = True
    reference = reference_from_mask(views, view, mask, options)
    planes = [] if reference is None else hypotheses(views, reference, rho_range, (), options)
    if reference is None or not planes or planes[0].zncc <= 0.6:
        return None
    normal, offset = plane_to_world(views, reference, planes[0].plane)
    depth, _ = meet(rays, np.array([row]), normal, offset)
    return (planes[0].zncc, rays.origin[row] + depth[0] * rays.direction[row]) if depth[0] > 0 else None
