"""Files that are either whole or not there: a reader never meets half a file, and a full disk leaves the old one as it was."""

import os
import secrets
from pathlib import Path

from planewright.errors import OutputError


def write_whole(path: Path, data: bytes) -> None:
    """Write `data` to `path`, by way of a temporary file in the same folder: a rename is only atomic within a file system. Raises OutputError."""
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.part{path.suffix}")
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}. Choose a folder that exists and has room.") from error
    finally:
        temporary.unlink(missing_ok=True)
