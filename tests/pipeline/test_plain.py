"""A value that is written as plain JSON and arrays comes back as it was."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float

from planewright.pipeline.plain import UnreadableTree, from_tree, to_tree


class Colour(IntEnum):
    RED = 3


@dataclass(frozen=True, eq=False)
class Inner:
    values: Float[np.ndarray, "..."]
    name: str


@dataclass(frozen=True, eq=False)
class Outer:
    inner: tuple[Inner, ...]
    marks: Mapping[int, tuple[float, float]]
    colour: Colour
    number: float | None
    other: Inner | None = None
    extra: Mapping[str, object] = field(default_factory=dict)


def round_trip(value: object, kind: object) -> object:
    arrays: list[np.ndarray] = []
    tree = json.loads(json.dumps(to_tree(value, arrays)))
    return from_tree(tree, arrays, kind)


@settings(max_examples=50, deadline=None)
@given(
    st.dictionaries(st.integers(), st.tuples(st.floats(allow_nan=False), st.floats(allow_nan=False))),
    st.none() | st.floats(allow_nan=False),
    st.text(),
    st.dictionaries(
        st.text(), st.recursive(st.none() | st.booleans() | st.integers() | st.text(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner))
    ),
)
def test_plain_values_come_back(marks: dict[int, tuple[float, float]], number: float | None, name: str, extra: dict[str, object]) -> None:
    value = Outer((Inner(np.arange(3.0), name),), marks, Colour.RED, number, extra=extra)
    back = round_trip(value, Outer)
    assert isinstance(back, Outer)
    assert back.marks == marks
    assert back.number == number
    assert back.inner[0].name == name
    assert back.extra == extra
    assert back.colour is Colour.RED


@pytest.mark.parametrize(
    "array", [np.zeros((0, 3)), np.array(2.5), np.asfortranarray(np.arange(12.0).reshape(3, 4)), np.arange(12.0)[::3], np.array([np.nan, -0.0])]
)
def test_arrays_come_back_bit_by_bit_and_contiguous(array: np.ndarray) -> None:
    back = round_trip(Inner(array, "a"), Inner)
    assert isinstance(back, Inner)
    assert back.values.shape == array.shape
    assert back.values.dtype == array.dtype
    assert back.values.tobytes() == array.tobytes()
    assert back.values.flags.c_contiguous


def test_a_union_comes_back_as_the_class_it_was() -> None:
    assert isinstance(round_trip(Inner(np.zeros(2), "a"), Inner | Outer), Inner)


def test_a_tree_can_name_no_class_beyond_the_type_hints() -> None:
    with pytest.raises(UnreadableTree):
        from_tree({"class": "Path", "fields": {"args": "x"}}, [], Outer)


def test_objects_are_refused() -> None:
    with pytest.raises(TypeError):
        to_tree(Inner(np.array([object()]), "a"), [])
    with pytest.raises(TypeError):
        to_tree(object(), [])
