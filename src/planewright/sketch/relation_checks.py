"""Relations that cannot all hold, found without looking at the views.

Directions (normals of faces, directions of edges) that are required to be parallel form a class. Within a class nothing can be at an angle; between
two classes there is one angle. Edges and faces are kept apart, for the one lies in the other.
"""

from collections.abc import Iterator
from itertools import combinations

from planewright.sketch.graph import Sketch, SketchRelation
from planewright.sketch.json_values import shown

Thing = tuple[str, ...]
"""("face", id) or ("edge", smaller id, larger id)."""

_SAME_ANGLE = 0.01
"""Degrees: two required angles closer than this say the same."""


def contradictions(sketch: Sketch) -> Iterator[tuple[str, int]]:
    """A sentence and the number of the relation that cannot hold beside those before it."""
    classes = _Classes()
    for relation in sketch.relations:
        if relation.stance == "require":
            _join(relation, classes)
    angles: dict[tuple[Thing, Thing], tuple[float, int]] = {}
    upright: dict[Thing, tuple[str, int]] = {}
    for number, relation in enumerate(sketch.relations):
        if relation.stance == "forbid":
            yield from _forbidden(relation, number, sketch, classes)
            continue
        if relation.kind in ("vertical", "horizontal"):
            for thing in _things(relation):
                other, before = upright.setdefault(classes.of(thing), (relation.kind, number))
                if other != relation.kind:
                    yield f"relations[{number}] requires {_named(thing)} to be {relation.kind}, relations[{before}] makes it {other}. Keep one.", number
        wanted = _angle(relation)
        if wanted is None:
            continue
        for a, b in _pairs(relation):
            root_a, root_b = classes.of(a), classes.of(b)
            if root_a == root_b and wanted > _SAME_ANGLE:
                yield (
                    f"relations[{number}] requires {wanted:g} degrees between {_named(a)} and {_named(b)}, which others require to be parallel. Drop one.",
                    number,
                )
                continue
            key = (min(root_a, root_b), max(root_a, root_b))
            angle, before = angles.setdefault(key, (wanted, number))
            if abs(angle - wanted) > _SAME_ANGLE:
                text = f"relations[{number}] requires {wanted:g} degrees between {_named(a)} and {_named(b)}, relations[{before}] makes it {angle:g}. Keep one."
                yield text, number


class _Classes:
    """Things that are parallel to each other."""

    def __init__(self) -> None:
        self.parent: dict[Thing, Thing] = {}

    def of(self, thing: Thing) -> Thing:
        """The one that stands for the class."""
        while (above := self.parent.get(thing, thing)) != thing:
            self.parent[thing] = self.parent.get(above, above)
            thing = above
        return thing

    def join(self, a: Thing, b: Thing) -> None:
        """Make two classes one."""
        low, high = sorted((self.of(a), self.of(b)))
        self.parent[high] = low


def _join(relation: SketchRelation, classes: _Classes) -> None:
    things = _things(relation)
    if relation.kind in ("parallel", "coplanar"):
        for a, b in _pairs(relation):
            classes.join(a, b)
    elif relation.kind == "horizontal":
        # Horizontal faces have one normal; horizontal edges may point anywhere around.
        for thing in things:
            if thing[0] == "face":
                classes.join(thing, ("face", "", "horizontal"))
    elif relation.kind == "vertical":
        for thing in things:
            if thing[0] == "edge":
                classes.join(thing, ("edge", "", "vertical"))


def _forbidden(relation: SketchRelation, number: int, sketch: Sketch, classes: _Classes) -> Iterator[tuple[str, int]]:
    for before, other in enumerate(sketch.relations):
        if other.stance == "require" and other.kind == relation.kind and other.degrees == relation.degrees:
            shared = {frozenset(pair) for pair in _pairs(relation)} & {frozenset(pair) for pair in _pairs(other)}
            alone = set(_things(relation)) & set(_things(other)) if relation.kind in ("vertical", "horizontal") else set[Thing]()
            if shared or alone:
                yield f"relations[{number}] forbids what relations[{before}] requires ({relation.kind}). Keep one of them.", number
                return
    if relation.kind == "parallel":
        for a, b in _pairs(relation):
            if classes.of(a) == classes.of(b):
                yield f"relations[{number}] forbids {_named(a)} and {_named(b)} to be parallel, which other relations require. Drop one.", number


def _angle(relation: SketchRelation) -> float | None:
    """The angle between directions without sign, in degrees."""
    match relation.kind:
        case "parallel" | "coplanar":
            return 0.0
        case "orthogonal":
            return 90.0
        case "angle" if relation.degrees is not None:
            return min(relation.degrees, 180.0 - relation.degrees)
        case _:
            return None


def _things(relation: SketchRelation) -> list[Thing]:
    things: list[Thing] = [("face", face) for face in relation.faces]
    return things + [("edge", min(edge), max(edge)) for edge in relation.edges]


def _pairs(relation: SketchRelation) -> list[tuple[Thing, Thing]]:
    """Pairs of one sort, at most from the first 100 of each."""
    things = _things(relation)
    return [(a, b) for sort in ("face", "edge") for a, b in combinations([t for t in things if t[0] == sort][:100], 2) if a != b]


def _named(thing: Thing) -> str:
    return f"face {shown(thing[1])}" if thing[0] == "face" else f"the edge from {shown(thing[1])} to {shown(thing[2])}"
