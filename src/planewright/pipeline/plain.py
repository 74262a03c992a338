"""Frozen dataclasses of arrays and plain values as one tree of JSON and a list of arrays, and back. Nothing is pickled.

The tree says which containers it holds; which classes may appear in it is read off the type hints of the class that is asked for, so a file
can name no other. Arrays come back C-contiguous with the same bytes: a stage that is fed from a file computes the same bits as one that is
fed from memory.
"""

import dataclasses
import typing
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

import numpy as np

Tree = Any
"""JSON: a scalar stands for itself; everything else is an object with one of the keys "array", "tuple", "list", "map", "enum", "class"."""


class UnreadableTree(ValueError):
    """The tree does not hold what was asked for."""


def to_tree(value: object, arrays: list[np.ndarray]) -> Tree:
    """The tree of a value; its arrays are appended to `arrays`. Raises TypeError for a value of another kind."""
    match value:
        case Enum():
            return {"enum": type(value).__name__, "value": value.value}
        case None | bool() | int() | str():
            return value
        case np.generic():
            return to_tree(value.item(), arrays)
        case float():
            return value
        case np.ndarray():
            if value.dtype.hasobject:
                raise TypeError("An array of Python objects cannot be written.")
            arrays.append(np.ascontiguousarray(value).reshape(value.shape))
            return {"array": len(arrays) - 1}
        case tuple():
            return {"tuple": [to_tree(item, arrays) for item in typing.cast(tuple[object, ...], value)]}
        case list():
            return {"list": [to_tree(item, arrays) for item in typing.cast(list[object], value)]}
        case Mapping():
            pairs = typing.cast(Mapping[object, object], value).items()
            return {"map": [[to_tree(key, arrays), to_tree(item, arrays)] for key, item in pairs]}
        case _ if dataclasses.is_dataclass(value) and not isinstance(value, type):
            fields = {field.name: to_tree(getattr(value, field.name), arrays) for field in dataclasses.fields(value) if field.init}
            return {"class": type(value).__name__, "fields": fields}
        case _:
            raise TypeError(f"A {type(value).__name__} is neither a dataclass, an array nor a plain value.")


def from_tree(tree: Tree, arrays: Sequence[np.ndarray], kind: object) -> Any:
    """The value of a tree. `kind` is the type it must have: a dataclass, or a union of them. Raises UnreadableTree."""
    return _build(tree, arrays, _classes(kind))


def _build(tree: Tree, arrays: Sequence[np.ndarray], classes: Mapping[str, type]) -> Any:
    match tree:
        case None | bool() | int() | float() | str():
            return tree
        case {"array": int(index)} if 0 <= index < len(arrays):
            return arrays[index]
        case {"tuple": list(items)}:
            return tuple(_build(item, arrays, classes) for item in items)
        case {"list": list(items)}:
            return [_build(item, arrays, classes) for item in items]
        case {"map": list(pairs)}:
            return {_build(key, arrays, classes): _build(item, arrays, classes) for key, item in pairs}
        case {"enum": str(name), "value": value} if name in classes and issubclass(classes[name], Enum):
            return classes[name](value)
        case {"class": str(name), "fields": dict(fields)} if name in classes:
            return classes[name](**{key: _build(item, arrays, classes) for key, item in fields.items()})
        case _:
            raise UnreadableTree(f"Neither a plain value nor one of {sorted(classes)}.")


def _classes(kind: object) -> dict[str, type]:
    """Every dataclass and enum that a value of this type can hold, by name."""
    found: dict[str, type] = {}
    waiting = [kind]
    while waiting:
        hint = waiting.pop()
        waiting += typing.get_args(hint)
        if not isinstance(hint, type) or typing.get_origin(hint) is not None:
            continue
        if found.get(hint.__name__, hint) is not hint:
            raise TypeError(f"Two classes are called {hint.__name__}.")
        if dataclasses.is_dataclass(hint) and hint.__name__ not in found:
            waiting += typing.get_type_hints(hint).values()
            found[hint.__name__] = hint
        elif issubclass(hint, Enum):
            found[hint.__name__] = hint
    return found
