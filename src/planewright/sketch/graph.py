"""What the person drew: points with marks, edges, faces, and what they said about them. Mirrors `sketch.json` (docs/file-format.md)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NewType

PointId = NewType("PointId", str)
FaceId = NewType("FaceId", str)
Edge = tuple[PointId, PointId]

RelationKind = Literal["parallel", "orthogonal", "coplanar", "angle", "equal_length", "symmetric", "vertical", "horizontal"]
Stance = Literal["require", "forbid"]


@dataclass(frozen=True)
class SketchPoint:
    """A corner, or a point of its own."""

    id: PointId
    marks: Mapping[int, tuple[float, float]]
    """Frame number -> where the person clicked it, in pixels of the frame as displayed."""
    hidden: tuple[tuple[int, int], ...] = ()
    """Spans of frames (both ends belong to it) in which the person says it cannot be seen."""


@dataclass(frozen=True)
class SketchFace:
    """A planar face: an outer loop of at least three corners, and holes."""

    id: FaceId
    loop: tuple[PointId, ...]
    holes: tuple[tuple[PointId, ...], ...] = ()
    open: bool = False
    """The loop is a chain; its border between the last corner and the first was not seen."""
    found: bool = False
    """Found in the drawn graph, not given by the person."""

    @property
    def corners(self) -> tuple[PointId, ...]:
        """Corners of the loop, then of the holes."""
        return (*self.loop, *(corner for hole in self.holes for corner in hole))


@dataclass(frozen=True)
class SketchRelation:
    """What the person requires or forbids."""

    kind: RelationKind
    stance: Stance
    faces: tuple[FaceId, ...] = ()
    edges: tuple[Edge, ...] = ()
    degrees: float | None = None
    about: FaceId | None = None


@dataclass(frozen=True)
class KnownLength:
    """A length the person measured, in the sketch's unit."""

    edge: Edge
    length: float
    sigma: float


@dataclass(frozen=True)
class Up:
    """What points up: a face's normal, an edge (bottom to top), or a direction in the world."""

    face: FaceId | None = None
    edge: Edge | None = None
    direction: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class KnownCamera:
    """What is known of the focal length beforehand, in pixels."""

    focal: float
    sigma: float


@dataclass(frozen=True)
class Sketch:
    """The drawing. Immutable: an edit makes a new one."""

    points: tuple[SketchPoint, ...]
    image_size: tuple[int, int] | None = None
    edges: tuple[Edge, ...] = ()
    faces: tuple[SketchFace, ...] = ()
    not_faces: tuple[tuple[PointId, ...], ...] = ()
    relations: tuple[SketchRelation, ...] = ()
    lengths: tuple[KnownLength, ...] = ()
    unit: str | None = None
    up: Up | None = None
    camera: KnownCamera | None = None
    extra: Mapping[str, object] = field(default_factory=dict)
    """Keys of the file that this version does not know; they are written back."""
