"""The sketch lifted to 3D: which plane each face lies on, and from that where the corners are.

Each face gathers hypotheses (planes that the pixels agree with) from every frame in which three of its corners are located.
A hypothesis may be wrong though its pixels agree: what stands in front of a hidden face is a plane too. So the set is chosen
together: planes must meet the click rays of shared corners at the same depth, and two faces may not explain the same pixels
by the same plane. What is known then locates further corners, in further frames, and the faces left over try again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from planewright.arrays import Bool, Float
from planewright.lifting.corner_planes import from_corners
from planewright.lifting.energies import choose_planes
from planewright.lifting.hypothesis import Hypothesis
from planewright.lifting.located import Located, locate, nothing_located
from planewright.lifting.lone import locate_lone_points
from planewright.lifting.photometric import PhotometricOptions, relative_sigma
from planewright.lifting.search import Searches, search, search_scene
from planewright.lifting.task import Task, Tolerances, task_of
from planewright.lifting.views import Views
from planewright.progress import Progress, silent
from planewright.sfm.cameras import ScenePoints
from planewright.sketch.graph import Sketch


@dataclass(frozen=True, kw_only=True)
class LiftOptions:
    """How the sketch is lifted."""

    photometric: PhotometricOptions = field(default_factory=PhotometricOptions)
    click_sigma: float = 1.0
    """Standard deviation of a click an axis, pixels of the clip."""
    plane_sigma: float = 3.0
    """Depth error allowed to a plane on top of what the click gives, in pixels of motion (`Views.depth_per_pixel`); formal sigmas of
    planes are far too small."""
    rounds: int = 5
    """How often faces that found no plane try again with the corners known by then."""
    same_depth: float = 2.5
    """A face is hidden by another drawn over it that stands this far before it, in pixels of motion."""
    witness_frames: int = 4
    """Scene features count as seen in a view when they were observed within this many frames of it."""
    behind: float = 6.0
    """A feature seen inside a face's polygon contradicts a plane that it lies behind by more than this, in pixels of motion: faces are opaque."""
    worth: float = 0.25
    """A plane must explain the pixels it shares with another drawn face better than that face's by this much a pixel (log-likelihood)."""


@dataclass(frozen=True, eq=False)
class Lifted:
    """The first 3D state of the sketch."""

    points: Float[np.ndarray, "points 3"]
    point_known: Bool[np.ndarray, "points"]
    normals: Float[np.ndarray, "faces 3"]
    """Towards the cameras that saw the face; where it comes from corners, towards one in which they were marked."""
    offsets: Float[np.ndarray, "faces"]
    face_known: Bool[np.ndarray, "faces"]
    from_pixels: Bool[np.ndarray, "faces"]
    """False where the plane only comes from corners known otherwise."""
    plane_sigma: Float[np.ndarray, "faces"]
    """How sure the pixels are of a plane: the relative standard deviation of the depth of the face's corners on it, the largest of them; zero
    where it does not come from pixels."""
    corners: tuple[tuple[int, ...], ...]
    """Rows of each face's corners, holes included."""


def lift_sketch(
    views: Views, sketch: Sketch, scene: ScenePoints, options: LiftOptions = LiftOptions(), *, rng: np.random.Generator, progress: Progress = silent
) -> Lifted:
    """Planes and corners of the sketch in the world, as far as the views give them."""
    task = task_of(views, sketch, scene, options.photometric, tolerances(options, views))
    located, searches = nothing_located(task), Searches()
    found: list[list[Hypothesis]] = [[] for _ in range(task.num_faces)]
    if not sketch.faces:
        located = locate(task, (), located)  # by marks alone; the rounds are about faces
    before: tuple[int, int, float] | None = None
    for turn in range(options.rounds):
        for f in range(task.num_faces):
            progress(f"Lifting faces, round {turn + 1}", f, task.num_faces)
            pixels = [guess for guess in found[f] if guess.view >= 0]
            chosen = located.chosen[f]
            if chosen is None or chosen.found is None:
                pixels += search(task, located, searches, f, rng)
                if turn >= 1 and not pixels:
                    pixels = search_scene(task, located, searches, f, rng)
            found[f] = [*pixels, *from_corners(task, located, f, pixels)]
        choice, energy = choose_planes(task, found, searches.masks, rng)
        located = locate(task, choice, located)
        now = (int(located.known.sum()), sum(guess is not None for guess in choice), energy)
        if turn >= 2 and now == before:
            break
        before = now
    return _lifted(task, located, found)


def tolerances(options: LiftOptions, views: Views) -> Tolerances:
    """The options in the units of the views."""
    return Tolerances(
        mark_sigma=options.click_sigma * views.scale,
        plane_sigma=options.plane_sigma * views.depth_per_pixel,
        same_depth=options.same_depth * views.depth_per_pixel,
        behind=options.behind * views.depth_per_pixel,
        witness_frames=options.witness_frames,
        worth=options.worth,
    )


def _lifted(task: Task, located: Located, found: Sequence[Sequence[Hypothesis]]) -> Lifted:
    """The planes chosen, for faces without one the plane through their corners; and the depths of points that these leave open."""
    faces = task.num_faces
    normals, offsets, known, sigma = np.full((faces, 3), np.nan), np.full(faces, np.nan), np.zeros(faces, bool), np.zeros(faces)
    for f, choice in enumerate(located.chosen):
        guess = choice or next(iter(from_corners(task, located, f, found[f])), None)
        if guess is not None:
            normals[f], offsets[f], known[f] = guess.normal, guess.offset, True
            if guess.found is not None:
                corners = located.points[[c for c in task.corners[f] if located.known[c]]]
                sigma[f] = max((relative_sigma(task.views, guess.found, at) for at in corners), default=0.0)
    from_pixels = np.array([guess is not None and (guess.view >= 0 or guess.agreed) for guess in located.chosen], bool)
    complete = locate_lone_points(task, located)
    return Lifted(complete.points, complete.known, normals, offsets, known, from_pixels, sigma, task.corners)
