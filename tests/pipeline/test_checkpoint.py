"""Finished stages: kept, found again, and never mixed up with those of another run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

from planewright.errors import OutputError
from planewright.pipeline.checkpoint import Checkpoints, fingerprint


@dataclass(frozen=True, eq=False)
class Value:
    numbers: Float[np.ndarray, "n"]
    note: str


VALUE = Value(np.linspace(0.0, 1.0, 7), "a note")


def opened(folder: Path, key: str) -> Checkpoints:
    checkpoints = Checkpoints(folder / ".work", key)
    checkpoints.open()
    return checkpoints


def test_a_value_is_found_again_with_its_time(tmp_path: Path) -> None:
    opened(tmp_path, "a" * 64).save("cameras", VALUE, Value, 1.5)
    found = opened(tmp_path, "a" * 64).load("cameras", Value)
    assert found is not None
    assert found.resumed
    assert found.seconds == 1.5
    assert found.value.note == VALUE.note
    np.testing.assert_array_equal(found.value.numbers, VALUE.numbers)


def test_another_key_finds_nothing_and_clears_what_was_there(tmp_path: Path) -> None:
    opened(tmp_path, "a" * 64).save("cameras", VALUE, Value, 1.5)
    assert opened(tmp_path, "b" * 64).load("cameras", Value) is None
    assert not list((tmp_path / ".work").iterdir())


@pytest.mark.parametrize("damage", [lambda data: data[:100], lambda data: b"", lambda data: data[:-60] + bytes(60), lambda data: b"x" * len(data)])
def test_a_damaged_file_counts_as_absent(tmp_path: Path, damage) -> None:
    checkpoints = opened(tmp_path, "a" * 64)
    checkpoints.save("cameras", VALUE, Value, 1.5)
    (path,) = (tmp_path / ".work").iterdir()
    path.write_bytes(damage(path.read_bytes()))
    assert checkpoints.load("cameras", Value) is None


def test_leftovers_of_a_kill_are_cleared(tmp_path: Path) -> None:
    opened(tmp_path, "a" * 64)
    (tmp_path / ".work" / ".cameras.12ab34cd.part.npz").write_bytes(b"half")
    opened(tmp_path, "a" * 64)
    assert not list((tmp_path / ".work").iterdir())


def test_nothing_is_left_once_the_result_stands(tmp_path: Path) -> None:
    checkpoints = opened(tmp_path, "a" * 64)
    checkpoints.save("cameras", VALUE, Value, 1.5)
    checkpoints.remove()
    assert not list(tmp_path.iterdir())


def test_without_a_folder_values_take_the_same_form() -> None:
    view = Value(np.arange(14.0)[::2], "a view")
    finished = Checkpoints(None, "a" * 64).save("cameras", view, Value, 0.0)
    assert finished.value.numbers.flags.c_contiguous
    assert not finished.resumed
    np.testing.assert_array_equal(finished.value.numbers, view.numbers)


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be made"):
        Checkpoints(tmp_path / "file" / ".work", "a" * 64).open()


def test_fingerprints_tell_values_apart() -> None:
    assert fingerprint(VALUE) == fingerprint(Value(VALUE.numbers.copy(), "a note"))
    nudged = VALUE.numbers.copy()
    nudged[3] = np.nextafter(nudged[3], 1.0)
    others = [Value(nudged, "a note"), Value(VALUE.numbers, "another"), Value(VALUE.numbers.astype(np.float32), "a note"), (VALUE, 1)]
    assert len({fingerprint(value) for value in (VALUE, *others)}) == 5
