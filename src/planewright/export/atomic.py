"""Files that are either whole or not there: a reader never meets half a file, and a full disk leaves the old one as it was."""

import contextlib
import os
import secrets
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from planewright.errors import OutputError


@contextmanager
def whole_file(path: Path) -> Generator[Path]:
    """The path of a temporary file to write; it becomes `path` when the block ends well, and goes when it does not. Raises OutputError.

    It lies in the same folder, since a rename is only atomic within a file system, and ends like `path`, since some writers go by that.
    """
    temporary = path.with_name(f".{secrets.token_hex(6)}.part{path.suffix}")
    try:
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}. Choose a folder that exists and has room.") from error
    finally:
        with contextlib.suppress(OSError):  # what went wrong is told already
            temporary.unlink(missing_ok=True)


def write_whole(path: Path, data: bytes) -> None:
    """Write `data` to `path` by way of a temporary file. Raises OutputError."""
    with whole_file(path) as temporary:
        temporary.write_bytes(data)
