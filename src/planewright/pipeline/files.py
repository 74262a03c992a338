"""Files that are either whole or not there: written under a temporary name beside their place, then renamed."""

import os
import secrets
from collections.abc import Callable
from pathlib import Path

from planewright.errors import OutputError

TEMPORARY = ".part"


def make_folder(folder: Path) -> None:
    """The folder and those above it. Raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"The folder {folder} cannot be made: {error.strerror}. Choose another output folder.") from error


def write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Let `write` fill a temporary file in the same folder, then give it its name. Raises OutputError."""
    # The suffix stays last: some writers choose the format by it.
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{TEMPORARY}{path.suffix}")
    try:
        write(temporary)
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}. Free some space, or choose another output folder.") from error
    finally:
        temporary.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """A file with this content. Raises OutputError."""

    def write(temporary: Path) -> None:
        temporary.write_bytes(content)

    write_whole(path, write)


def remove_leftovers(folder: Path) -> None:
    """Temporary files of a run that was ended while it wrote."""
    for path in folder.glob(f".*{TEMPORARY}*"):
        path.unlink(missing_ok=True)
