"""What a run has finished so far, kept in DIR/.work until the result stands, so that a run that was broken off goes on from there."""

import contextlib
import dataclasses
import hashlib
import io
import json
import logging
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planewright.export.atomic import write_whole
from planewright.pipeline.folder import make_folder, remove_leftovers
from planewright.pipeline.plain import Tree, UnreadableTree, from_tree, to_tree

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Finished:
    """A stage's value as the next stages see it, and what it cost."""

    value: Any
    seconds: float
    resumed: bool
    """Read from a file of an earlier run."""


def fingerprint(value: object) -> str:
    """A hash of a dataclass of arrays and plain values: equal values have equal fingerprints."""
    arrays: list[np.ndarray] = []
    tree = to_tree(value, arrays)
    digest = hashlib.sha256(json.dumps(tree, sort_keys=True).encode())
    for array in arrays:
        digest.update(f"{array.dtype.str}{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Checkpoints:
    """Files STAGE.KEY.npz in a folder; without a folder values are only brought into the form in which a file would give them back."""

    folder: Path | None
    key: str
    """Fingerprint of everything the values depend on: inputs, options, seed, version."""

    def open(self) -> None:
        """Make the folder and drop what belongs to other inputs or options. Raises OutputError."""
        if self.folder is None:
            return
        make_folder(self.folder)
        remove_leftovers(self.folder)
        for path in self.folder.glob("*.npz"):
            if not path.name.endswith(f".{self._short_key}.npz"):
                path.unlink(missing_ok=True)

    def load(self, stage: str, kind: object) -> Finished | None:
        """What an earlier run found, or None. A file that cannot be read counts as absent."""
        path = self._path(stage)
        if path is None or not path.exists():
            return None
        try:
            return _unpack(path.read_bytes(), kind)
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, UnreadableTree) as error:
            log.warning("%s cannot be read (%s); the stage is done again.", path.name, error)
            return None

    def save(self, stage: str, value: Any, kind: object, seconds: float) -> Finished:
        """Keep a value; it comes back as later runs will read it. Raises OutputError."""
        packed = _pack(value, seconds)
        path = self._path(stage)
        if path is not None:
            write_whole(path, packed)
        return dataclasses.replace(_unpack(packed, kind), resumed=False)

    def remove(self) -> None:
        """The result stands: drop everything."""
        if self.folder is None:
            return
        for path in self.folder.glob("*.npz"):
            path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # somebody put a file of their own there
            self.folder.rmdir()

    @property
    def _short_key(self) -> str:
        return self.key[:16]

    def _path(self, stage: str) -> Path | None:
        return None if self.folder is None else self.folder / f"{stage}.{self._short_key}.npz"


def _pack(value: object, seconds: float) -> bytes:
    arrays: list[np.ndarray] = []
    header: Tree = {"value": to_tree(value, arrays), "seconds": seconds, "num_arrays": len(arrays)}
    buffer = io.BytesIO()
    named: dict[str, Any] = {f"array{i}": array for i, array in enumerate(arrays)}
    np.savez(buffer, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **named)
    return buffer.getvalue()


def _unpack(packed: bytes, kind: object) -> Finished:
    with np.load(io.BytesIO(packed), allow_pickle=False) as file:
        header = json.loads(file["header"].tobytes())
        arrays = [file[f"array{i}"] for i in range(header["num_arrays"])]
    return Finished(from_tree(header["value"], arrays, kind), header["seconds"], resumed=True)
