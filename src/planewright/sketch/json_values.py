"""Values of a JSON document that know where they stand, so that every complaint names the file and the key."""

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NoReturn, cast

from planewright.errors import SketchError

_MOST_DIGITS = 100
"""Of a whole number; Python takes quadratic time over long ones, and refuses beyond 4300 digits."""


def parse_json(name: str, text: str) -> object:
    """The parsed text. Refuses NaN, infinity and keys that stand twice in one object. Raises SketchError."""
    try:
        return json.loads(text.removeprefix("\ufeff"), parse_constant=_refuse_constant, parse_int=_whole_number, object_pairs_hook=_unique)
    except json.JSONDecodeError as error:
        raise SketchError(f"{shown(name)} is not valid JSON: {error.msg} (line {error.lineno}, column {error.colno}). Correct it there.") from error
    except RecursionError as error:
        raise SketchError(f"{shown(name)} is nested too deeply to be a sketch.") from error
    except ValueError as error:
        raise SketchError(f"{shown(name)}: {error}.") from error


def shown(value: object, length: int = 48) -> str:
    """A value as text for a message: in quotes, escaped down to printable ASCII without markup, and cut where it is long."""
    # Text is cut before it is written out, lest a message costs more than the document.
    text = json.dumps(value[: 2 * length] if isinstance(value, str) else value, default=str)
    text = text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026").replace("\x7f", "\\u007f")
    return text if len(text) <= length else text[: length - 3] + "..."


@dataclass(frozen=True)
class Place:
    """A value and the path to it, such as `points[3].marks.12`."""

    file: str
    path: str
    value: object
    key: str = ""
    """The last part of the path, where it is a key of the document."""

    def fail(self, what: str) -> NoReturn:
        """Raise SketchError: file, key, and `what` as the rest of the sentence."""
        raise SketchError(f"{shown(self.file)}: {self.path or 'the document'} {what}.")

    def get(self, key: str) -> "Place | None":
        """The member, or None where there is none."""
        members = self._object()
        return self._member(key, members[key]) if key in members else None

    def __getitem__(self, key: str) -> "Place":
        found = self.get(key)
        if found is None:
            self.fail(f"lacks the key {key!r}. Add it")
        return found

    def members(self, limit: int) -> "list[Place]":
        """All members of an object, in order."""
        members = self._object()
        if len(members) > limit:
            self.fail(f"has {len(members)} entries; the limit is {limit}")
        return [self._member(key, value) for key, value in members.items()]

    def others(self, known: Iterable[str]) -> dict[str, object]:
        """The members whose keys are not known."""
        return {key: value for key, value in self._object().items() if key not in known}

    def items(self, limit: int, exactly: bool = False) -> "list[Place]":
        """The elements of a list of at most (or exactly) `limit`."""
        if not isinstance(self.value, list | tuple):
            self.fail(f"is {_kind(self.value)}; a list belongs here")
        values = cast("list[object]", self.value)
        if exactly and len(values) != limit:
            self.fail(f"has {len(values)} elements; it takes {limit}")
        if len(values) > limit:
            self.fail(f"has {len(values)} elements; the limit is {limit}")
        return [Place(self.file, f"{self.path}[{index}]", value) for index, value in enumerate(values)]

    def items_of(self, key: str, limit: int) -> "list[Place]":
        """The elements of an optional list."""
        place = self.get(key)
        return [] if place is None else place.items(limit)

    def text(self) -> str:
        """A string."""
        if not isinstance(self.value, str):
            self.fail(f"is {_kind(self.value)}; text belongs here")
        return self.value

    def one_of(self, allowed: tuple[str, ...]) -> str:
        """One of the allowed words."""
        if not isinstance(self.value, str) or self.value not in allowed:
            self.fail(f"is {shown(self.value)}; it is one of {', '.join(allowed)}")
        return self.value

    def boolean(self) -> bool:
        """true or false."""
        if not isinstance(self.value, bool):
            self.fail(f"is {shown(self.value)}; true or false belongs here")
        return self.value

    def integer(self, low: int, high: int) -> int:
        """A whole number from low to high."""
        if isinstance(self.value, bool) or not isinstance(self.value, int):
            self.fail(f"is {shown(self.value)}; a whole number belongs here")
        if not low <= self.value <= high:
            self.fail(f"is {shown(self.value)}; it lies between {low} and {high}")
        return self.value

    def number(self, low: float, high: float) -> float:
        """A finite number from low to high."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            self.fail(f"is {shown(self.value)}; a number belongs here")
        if not low <= self.value <= high:
            bad = "not finite" if isinstance(self.value, float) and not math.isfinite(self.value) else shown(self.value)
            self.fail(f"is {bad}; it lies between {low:g} and {high:g}")
        return float(self.value)

    def positive(self) -> float:
        """A finite number above 0 (1e-9 to 1e12)."""
        return self.number(1e-9, 1e12)

    def _object(self) -> dict[str, object]:
        if not isinstance(self.value, dict):
            self.fail(f"is {_kind(self.value)}; an object in braces belongs here")
        return cast("dict[str, object]", self.value)

    def _member(self, key: str, value: object) -> "Place":
        label = key if key.isidentifier() and len(key) <= 32 else key if key.isdigit() and len(key) <= 9 else shown(key)
        return Place(self.file, f"{self.path}.{label}" if self.path else label, value, key)


def _kind(value: object) -> str:
    names: dict[type, str] = {bool: "true or false", str: "text", int: "a number", float: "a number", list: "a list", dict: "an object", type(None): "null"}
    return names.get(type(value), "something else")


def _whole_number(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"a number of {len(text)} digits stands in it; {_MOST_DIGITS} are enough for any")
    return int(text)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number that JSON knows; write finite numbers only")


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    members = dict(pairs)
    if len(members) != len(pairs):
        seen: set[str] = set()
        for key, _ in pairs:
            if key in seen:
                raise ValueError(f"the key {shown(key)} stands twice in one object; keep one of them")
            seen.add(key)
    return members
