"""The walk from a clip and a drawing to a model, one function a stage, in order. Values in, values out; no disk."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from planewright.arrays import Float
from planewright.errors import GeometryError, SketchError
from planewright.features.features import Features
from planewright.features.follow import FollowOptions, follow_features
from planewright.geometry.lens import Lens
from planewright.progress import Progress, silent
from planewright.refine.rounds import RefineOptions, Structure
from planewright.registration.follow import RegistrationOptions, follow_faces
from planewright.registration.grid import face_features
from planewright.registration.registered import Registered
from planewright.sfm.cameras import Cameras
from planewright.sfm.solve import Refused, SfmOptions, Solved, solve_cameras
from planewright.sketch.checks import check_sketch
from planewright.sketch.faces import find_faces
from planewright.sketch.graph import Sketch, SketchPoint
from planewright.texture.bake import BakeOptions
from planewright.tracking.follow import CornerOptions
from planewright.video.clip import ClipInfo
from planewright.video.frames import Frames


@dataclass(frozen=True, kw_only=True)
class StageOptions:
    """The options of every stage."""

    features: FollowOptions = field(default_factory=FollowOptions)
    """How scene features are followed."""
    faces: RegistrationOptions = field(default_factory=RegistrationOptions)
    """How whole faces are followed where features do not tell where the camera was."""
    cameras: SfmOptions = field(default_factory=SfmOptions)
    """How cameras are solved from them."""
    structure: RefineOptions = field(default_factory=RefineOptions)
    """How corners, planes and relations are found."""
    corners: CornerOptions = field(default_factory=CornerOptions)
    """How corners are located in every frame."""
    texture: BakeOptions = field(default_factory=BakeOptions)
    """How the atlas is filled."""


@dataclass(frozen=True, eq=False)
class Filmed:
    """Where the camera was, and how that was found."""

    solved: Solved
    notes: tuple[str, ...]


def checked_sketch(sketch: Sketch, clip: ClipInfo, numbers: Sequence[int]) -> tuple[Sketch, tuple[str, ...]]:
    """The sketch with its faces, and what a person should know about it.

    Args:
        numbers: the frames that take part.

    Raises:
        SketchError: with everything that is wrong.
    """
    found = find_faces(sketch)
    findings = check_sketch(found, image_size=clip.image_size, num_frames=clip.num_frames)
    errors = [finding.sentence for finding in findings if finding.severity == "error"]
    if errors:
        raise SketchError(" ".join(errors[:5]) + (f" There are {len(errors) - 5} more." if len(errors) > 5 else ""))
    return found, (*(finding.sentence for finding in findings if finding.severity == "warning"), *unused_marks(found, numbers))


def unused_marks(sketch: Sketch, numbers: Sequence[int]) -> tuple[str, ...]:
    """Says which marks lie in frames that do not take part. Raises SketchError where no face keeps three marked corners."""
    taking_part = set(numbers)
    marked = {point.id: taking_part.intersection(point.marks) for point in sketch.points}
    idle = sorted({frame for point in sketch.points for frame in point.marks} - taking_part)
    if not idle:
        return ()
    places = f"Marks in frame{'s' if len(idle) > 1 else ''} {', '.join(map(str, idle[:5]))}{', ...' if len(idle) > 5 else ''}"
    if not any(sum(bool(marked[corner]) for corner in face.loop) >= 3 for face in sketch.faces):
        raise SketchError(
            f"{places} do not count, for those frames are left out, and without them no face has three marked corners. "
            "Choose frames that include them, or mark the corners of a face in the frames that are used."
        )
    return (f"{places} are not used: those frames are left out.",)


def find_cameras(
    frames: Frames,
    features: Features,
    sketch: Sketch,
    options: StageOptions,
    rng: np.random.Generator,
    *,
    faces: Callable[[], Registered] | None = None,
    progress: Progress = silent,
) -> Filmed:
    """Cameras from the features of the whole image; where those do not tell, from the features on the drawn faces; at last from the faces as wholes.

    A turntable, or an object carried before a still background, shows two motions: the larger part of the image may be the part that does not matter.
    Faces with hardly a feature of their own are registered whole, each pixel counting a little.

    Args:
        faces: the faces followed as wholes, for whoever needs them as well; asked only where features do not tell.

    Raises:
        GeometryError: none of them tells where the camera was.
    """
    first = solve_cameras(features, np.array(frames.numbers), frames.image_size, known=sketch.camera, options=options.cameras, rng=rng, progress=progress)
    if isinstance(first, Solved):
        return Filmed(first, ())
    regions = face_regions(sketch)
    if not regions:
        raise GeometryError(first.reason)
    numbers, known = np.array(frames.numbers), sketch.camera
    inside = follow_features(frames, options.features, regions=regions, progress=progress)
    second = solve_cameras(inside, numbers, frames.image_size, known=known, options=options.cameras, rng=rng, progress=progress)
    alone = f"The cameras come from features on the drawn faces alone: {first.reason}"
    if isinstance(second, Solved) and second.cameras.posed.mean() >= ENOUGH_POSED:
        return Filmed(second, (alone,))
    whole = face_features(follow_faces(frames, sketch, options.faces, progress=progress) if faces is None else faces())
    third = solve_cameras(whole, numbers, frames.image_size, known=known, options=options.cameras, rng=rng, progress=progress)
    if isinstance(second, Solved):
        if isinstance(third, Refused) or third.cameras.posed.sum() <= second.cameras.posed.sum():
            return Filmed(second, (alone,))
        few = f"Their features by themselves give cameras to {second.summary.frames_posed} frames only."
    elif isinstance(third, Solved):
        few = f"Their features by themselves are not enough: {second.reason}"
    else:
        also = "" if second.code == first.code else f" The drawn faces by themselves do not tell either: {second.reason}"
        raise GeometryError(first.reason + also)
    third = replace(third, cameras=widened_focal(third.cameras, POINTS_OF_A_FACE_SAY))
    return Filmed(third, (f"The cameras come from the drawn faces, followed as wholes. {few}",))


ENOUGH_POSED = 0.9
"""Share of the frames with a camera below which another way is tried: turntables with texture had them in all frames, nearly bare cartons in 54 % of them."""

POINTS_OF_A_FACE_SAY = 3.2
"""Forty points of a face, 80 coordinates, are read off 8 numbers: the focal length is known the square root of that ratio worse than they pretend."""


def widened_focal(cameras: Cameras, factor: float) -> Cameras:
    """The same cameras with that much less trust in their focal length."""
    focal, (low, high) = cameras.intrinsics.focal, cameras.focal_interval
    # The interval is wider upwards: what it spans in ratios grows alike on both sides, and stays above nothing.
    wide = (focal * (low / focal) ** factor, None if high is None else focal * (high / focal) ** factor)
    return replace(cameras, focal_sigma=factor * cameras.focal_sigma, focal_interval=wide)


def face_regions(sketch: Sketch) -> Mapping[int, Sequence[Float[np.ndarray, "_corners 2"]]]:
    """Frame -> the polygons of the faces that have at least three corners marked there, in pixels."""
    marks = {point.id: point.marks for point in sketch.points}
    regions: dict[int, list[Float[np.ndarray, "_corners 2"]]] = {}
    for face in sketch.faces:
        for frame in sorted({frame for corner in face.loop for frame in marks[corner]}):
            polygon = [marks[corner][frame] for corner in face.loop if frame in marks[corner]]
            if len(polygon) >= 3:
                regions.setdefault(frame, []).append(np.array(polygon, dtype=np.float64))
    return regions


def check_structure(structure: Structure) -> None:
    """Raises GeometryError where not one face could be placed: there is no model then."""
    if structure.scene.face_known.any():
        return
    because = " ".join(structure.notes[:3])
    raise GeometryError(f"The cameras were found, but no drawn face could be placed in space. {because}".strip() + " Mark the corners in one more frame.")


def without_distortion(sketch: Sketch, lens: Lens) -> Sketch:
    """The sketch with its marks where the straight frames show them."""
    if lens.straight:
        return sketch

    def moved(point: SketchPoint) -> SketchPoint:
        straight = {frame: lens.to_straight(frame, np.array([xy], dtype=np.float64))[0] for frame, xy in point.marks.items()}
        return replace(point, marks={frame: (float(x), float(y)) for frame, (x, y) in straight.items()})

    return replace(sketch, points=tuple(moved(point) for point in sketch.points))
