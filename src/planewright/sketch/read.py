"""`sketch.json` (version 1) to a `Sketch` and back. Strict: what it accepts can be relied on everywhere else.

Keys that this version does not know are kept: those of the file, of its points and of its faces are written back by `sketch_to_json`.
"""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar, cast, get_args

from planewright.errors import SketchError
from planewright.sketch.graph import (
    Edge,
    FaceId,
    KnownCamera,
    KnownLength,
    PointId,
    RelationKind,
    Sketch,
    SketchFace,
    SketchPoint,
    SketchRelation,
    Stance,
    Up,
)
from planewright.sketch.json_values import Place, parse_json, shown

FORMAT, VERSION = "planewright-sketch", 1

Unit = Literal["m", "cm", "mm", "ft", "in"]
Item = TypeVar("Item")


@dataclass(frozen=True, kw_only=True)
class SketchLimits:
    """A sketch beyond a limit is refused early: a person draws hundreds of points, not millions."""

    max_bytes: int = 64 * 1024**2
    """Size of the file; looked at before it is parsed."""
    max_points: int = 10_000
    max_marks: int = 200_000
    """Marks of all points together."""
    max_edges: int = 20_000
    max_faces: int = 2_000
    max_relations: int = 10_000
    """Relations; also lengths, also loops in `not_faces`."""
    max_id_bytes: int = 10_240
    """Of one id in UTF-8."""
    max_coordinate: float = 1e7
    """Largest coordinate of a mark, in pixels either way."""


def read_sketch(source: Path | dict[str, object] | str, limits: SketchLimits = SketchLimits()) -> Sketch:
    """The sketch in a file (a path), in JSON text (a string that starts with a brace) or in a parsed document.

    An edge drawn twice is kept once. Faces may be named in relations without being there when the sketch gives no faces: they are found later.

    Raises:
        SketchError: the message names the file, the key and the cure.
    """
    name, document = _load(source, limits)
    return _Reader(limits).sketch(Place(name, "", document))


def sketch_to_json(sketch: Sketch) -> dict[str, object]:
    """The document of a sketch. Faces that were found in the graph are left out: they are found again."""
    nested = {key: cast("Mapping[str, Mapping[str, object]]", sketch.extra.get(key, {})) for key in ("points", "faces")}
    out: dict[str, object] = {"format": FORMAT, "version": VERSION}
    if sketch.image_size is not None:
        out["image_size"] = list(sketch.image_size)
    out["points"] = [_point_to_json(point) | dict(nested["points"].get(point.id, {})) for point in sketch.points]
    given = [face for face in sketch.faces if not face.found]
    for key, values in (
        ("edges", [list(edge) for edge in sketch.edges]),
        ("faces", [_face_to_json(face) | dict(nested["faces"].get(face.id, {})) for face in given]),
        ("not_faces", [list(loop) for loop in sketch.not_faces]),
        ("relations", [_relation_to_json(relation) for relation in sketch.relations]),
        ("lengths", [{"edge": list(known.edge), "length": known.length, "sigma": known.sigma} for known in sketch.lengths]),
    ):
        if values:
            out[key] = values
    if sketch.unit is not None:
        out["unit"] = sketch.unit
    if sketch.up is not None:
        out["up"] = _up_to_json(sketch.up)
    if sketch.camera is not None:
        out["camera"] = {"focal": sketch.camera.focal, "sigma": sketch.camera.sigma}
    return out | {key: value for key, value in sketch.extra.items() if key not in nested}


def _load(source: Path | dict[str, object] | str, limits: SketchLimits) -> tuple[str, object]:
    if isinstance(source, dict):
        return "sketch", source
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("{"):
        if len(source) > limits.max_bytes:
            raise SketchError(f"The sketch has {len(source)} characters; the limit is {limits.max_bytes}. Is it a sketch?")
        return "sketch", parse_json("sketch", source)
    path = Path(source)
    name = path.name or str(path)
    try:
        with path.open("rb") as file:
            data = file.read(limits.max_bytes + 1)
    except (OSError, ValueError) as error:
        raise SketchError(f"The sketch {shown(name)} cannot be read: {getattr(error, 'strerror', None) or error}. Check the path.") from error
    if len(data) > limits.max_bytes:
        raise SketchError(f"The sketch {shown(name)} is larger than {limits.max_bytes // 1024**2} MiB, the limit. Is it a sketch?")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SketchError(f"The sketch {shown(name)} is not UTF-8 text (byte {error.start}). Save it as UTF-8 JSON.") from error
    return name, parse_json(name, text)


_KNOWN_KEYS = ("format", "version", "image_size", "points", "edges", "faces", "not_faces", "relations", "lengths", "unit", "up", "camera")


class _Reader:
    """Reads one document; holds the limits and the ids seen so far."""

    def __init__(self, limits: SketchLimits) -> None:
        self.limits = limits
        self.points: set[str] = set()
        self.faces: set[str] | None = None
        """None: the sketch gives no faces, so any name may be found later."""
        self.num_marks = 0

    def sketch(self, document: Place) -> Sketch:
        self._version(document)
        raw_points = document["points"].items(self.limits.max_points)
        for place in raw_points:
            identity = self._id(place["id"])
            if identity in self.points:
                place["id"].fail(f"appears twice ({shown(identity)}). Every point has its own id")
            self.points.add(identity)
        points = tuple(self._point(place) for place in raw_points)
        edges: dict[frozenset[PointId], Edge] = {}
        for place in document.items_of("edges", self.limits.max_edges):
            edge = self._edge(place)
            edges.setdefault(frozenset(edge), edge)
        raw_faces = document.items_of("faces", self.limits.max_faces)
        if raw_faces:
            self.faces = set()
            for place in raw_faces:
                identity = self._id(place["id"])
                if identity in self.faces:
                    place["id"].fail(f"appears twice ({shown(identity)}). Every face has its own id")
                self.faces.add(identity)
        return Sketch(
            points=points,
            image_size=self._optional(document, "image_size", self._image_size),
            edges=tuple(edges.values()),
            faces=tuple(self._face(place) for place in raw_faces),
            not_faces=tuple(self._loop(place) for place in document.items_of("not_faces", self.limits.max_relations)),
            relations=tuple(self._relation(place) for place in document.items_of("relations", self.limits.max_relations)),
            lengths=tuple(self._length(place) for place in document.items_of("lengths", self.limits.max_relations)),
            unit=self._optional(document, "unit", lambda place: place.one_of(get_args(Unit))),
            up=self._optional(document, "up", self._up),
            camera=self._optional(document, "camera", self._camera),
            extra=self._extra(document, raw_points, raw_faces),
        )

    def _version(self, document: Place) -> None:
        if document["format"].text() != FORMAT:
            document["format"].fail(f"is {shown(document['format'].value)}; a sketch says {FORMAT!r}. Is this the right file?")
        version = document["version"].integer(0, 10**9)
        if version > VERSION:
            document["version"].fail(f"is {version}, newer than this program knows ({VERSION}). Update planewright, or save the sketch as version {VERSION}")
        if version != VERSION:
            document["version"].fail(f"is {version}; versions count from 1")

    @staticmethod
    def _optional(document: Place, key: str, read: Callable[[Place], Item]) -> Item | None:
        place = document.get(key)
        return None if place is None else read(place)

    @staticmethod
    def _extra(document: Place, points: Iterable[Place], faces: Iterable[Place]) -> dict[str, object]:
        extra = document.others(_KNOWN_KEYS)
        for key, places, known in (("points", points, ("id", "marks", "hidden")), ("faces", faces, ("id", "loop", "holes", "open"))):
            kept = {place["id"].text(): others for place in places if (others := place.others(known))}
            if kept:
                extra[key] = kept
        return extra

    def _id(self, place: Place) -> str:
        identity = place.text()
        size = len(identity.encode("utf-8", "surrogatepass"))
        if size == 0:
            place.fail("is empty. Give it a name")
        if size > self.limits.max_id_bytes:
            place.fail(f"has {size} bytes; the limit is {self.limits.max_id_bytes}. Use a shorter name")
        return identity

    def _point_id(self, place: Place) -> PointId:
        identity = self._id(place)
        if identity not in self.points:
            place.fail(f"names the point {shown(identity)}, which is not in points. Add the point, or take it out here")
        return PointId(identity)

    def _face_id(self, place: Place) -> FaceId:
        identity = self._id(place)
        if self.faces is not None and identity not in self.faces:
            place.fail(f"names the face {shown(identity)}, which is not in faces. Add the face, or take it out here")
        return FaceId(identity)

    def _image_size(self, place: Place) -> tuple[int, int]:
        width, height = place.items(2, exactly=True)
        return width.integer(1, 1_000_000), height.integer(1, 1_000_000)

    def _point(self, place: Place) -> SketchPoint:
        marks = tuple((self._frame(mark), self._mark(mark)) for mark in place["marks"].members(self.limits.max_marks))
        self.num_marks += len(marks)
        if self.num_marks > self.limits.max_marks:
            place.fail(f"brings the number of marks above {self.limits.max_marks}, the limit. Leave out marks that tell nothing new")
        hidden = tuple(self._span(span) for span in place.items_of("hidden", 10_000))
        return SketchPoint(PointId(place["id"].text()), dict(sorted(marks)), hidden)

    @staticmethod
    def _frame(place: Place) -> int:
        key = place.key
        if not (key.isascii() and key.isdigit() and len(key) <= 9 and str(int(key)) == key):
            place.fail("is not the number of a frame. Frames are whole numbers from 0, written without leading zeros")
        return int(key)

    def _mark(self, place: Place) -> tuple[float, float]:
        bound = self.limits.max_coordinate
        x, y = place.items(2, exactly=True)
        return x.number(-bound, bound), y.number(-bound, bound)

    @staticmethod
    def _span(place: Place) -> tuple[int, int]:
        first, last = (end.integer(0, 999_999_999) for end in place.items(2, exactly=True))
        if first > last:
            place.fail(f"runs backwards ({first} to {last}). Write the first frame, then the last")
        return first, last

    def _edge(self, place: Place) -> Edge:
        a, b = (self._point_id(end) for end in place.items(2, exactly=True))
        if a == b:
            place.fail(f"joins the point {shown(a)} to itself. An edge has two ends; remove it or correct one")
        return a, b

    def _loop(self, place: Place) -> tuple[PointId, ...]:
        loop = tuple(self._point_id(corner) for corner in place.items(self.limits.max_points))
        if len(loop) < 3:
            place.fail(f"has {len(loop)} corners; a plane needs 3. Add corners, or delete it")
        seen: set[PointId] = set()
        for corner in loop:
            if corner in seen:
                place.fail(f"passes the point {shown(corner)} twice. Split it into loops that pass every point once")
            seen.add(corner)
        return loop

    def _face(self, place: Place) -> SketchFace:
        holes = tuple(self._loop(hole) for hole in place.items_of("holes", self.limits.max_faces))
        is_open = place.get("open")
        return SketchFace(FaceId(place["id"].text()), self._loop(place["loop"]), holes, False if is_open is None else is_open.boolean())

    def _relation(self, place: Place) -> SketchRelation:
        kind = cast(RelationKind, place["kind"].one_of(get_args(RelationKind)))
        stance_place = place.get("stance")
        stance = cast(Stance, "require" if stance_place is None else stance_place.one_of(get_args(Stance)))
        faces = tuple(self._face_id(face) for face in place.items_of("faces", self.limits.max_faces))
        edges = tuple(self._edge(edge) for edge in place.items_of("edges", self.limits.max_edges))
        degrees_place, about_place = place.get("degrees"), place.get("about")
        degrees = None if degrees_place is None else degrees_place.number(0.0, 180.0)
        about = None if about_place is None else self._face_id(about_place)
        self._enough(place, kind, len(faces), len(edges), degrees, about)
        return SketchRelation(kind, stance, faces, edges, degrees, about)

    @staticmethod
    def _enough(place: Place, kind: RelationKind, faces: int, edges: int, degrees: float | None, about: FaceId | None) -> None:
        match kind:
            case "vertical" | "horizontal":
                if faces + edges < 1:
                    place.fail(f"({kind}) names nothing. Name at least one face or edge")
            case "equal_length":
                if edges < 2:
                    place.fail("(equal_length) needs two edges at least. Name them in edges")
            case "symmetric":
                if faces < 2 or about is None:
                    place.fail("(symmetric) needs two faces in faces, and in about the face they mirror in")
            case "angle":
                if degrees is None:
                    place.fail("(angle) needs degrees, between 0 and 180")
                if faces != 2 and edges != 2:
                    place.fail("(angle) stands between exactly two faces or two edges. Name them")
            case "parallel" | "orthogonal" | "coplanar":
                if faces + edges < 2:
                    place.fail(f"({kind}) needs two faces (or edges) at least. Name them in faces")

    def _length(self, place: Place) -> KnownLength:
        return KnownLength(self._edge(place["edge"]), place["length"].positive(), place["sigma"].positive())

    def _up(self, place: Place) -> Up:
        given = [key for key in ("face", "edge", "direction") if place.get(key) is not None]
        if len(given) != 1:
            place.fail("names one of face, edge or direction, and only one")
        if given == ["face"]:
            return Up(face=self._face_id(place["face"]))
        if given == ["edge"]:
            return Up(edge=self._edge(place["edge"]))
        x, y, z = (value.number(-1e9, 1e9) for value in place["direction"].items(3, exactly=True))
        if max(abs(x), abs(y), abs(z)) < 1e-9:
            place["direction"].fail("points nowhere: all three numbers are 0")
        return Up(direction=(x, y, z))

    @staticmethod
    def _camera(place: Place) -> KnownCamera:
        return KnownCamera(place["focal"].positive(), place["sigma"].positive())


def _point_to_json(point: SketchPoint) -> dict[str, object]:
    out: dict[str, object] = {"id": point.id, "marks": {str(frame): list(xy) for frame, xy in sorted(point.marks.items())}}
    if point.hidden:
        out["hidden"] = [list(span) for span in point.hidden]
    return out


def _face_to_json(face: SketchFace) -> dict[str, object]:
    out: dict[str, object] = {"id": face.id, "loop": list(face.loop)}
    if face.holes:
        out["holes"] = [list(hole) for hole in face.holes]
    if face.open:
        out["open"] = True
    return out


def _relation_to_json(relation: SketchRelation) -> dict[str, object]:
    out: dict[str, object] = {"kind": relation.kind, "stance": relation.stance}
    if relation.faces:
        out["faces"] = list(relation.faces)
    if relation.edges:
        out["edges"] = [list(edge) for edge in relation.edges]
    if relation.degrees is not None:
        out["degrees"] = relation.degrees
    if relation.about is not None:
        out["about"] = relation.about
    return out


def _up_to_json(up: Up) -> dict[str, object]:
    if up.face is not None:
        return {"face": up.face}
    if up.edge is not None:
        return {"edge": list(up.edge)}
    assert up.direction is not None
    return {"direction": list(up.direction)}


def save_text(sketch: Sketch) -> str:
    """The text of `sketch.json`: UTF-8 JSON that reads well and is the same for the same sketch."""
    return json.dumps(sketch_to_json(sketch), ensure_ascii=False, indent=1, allow_nan=False) + "\n"
