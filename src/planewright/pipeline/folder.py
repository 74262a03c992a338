"""The folder of a result."""

from pathlib import Path

from planewright.errors import OutputError


def make_folder(folder: Path) -> None:
    """The folder and those above it. Raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"The folder {folder} cannot be made: {error.strerror or error}. Choose another output folder.") from error


def remove_leftovers(folder: Path) -> None:
    """Temporary files (export.atomic) of a run that was ended while it wrote."""
    for path in folder.glob(".*.part*"):
        path.unlink(missing_ok=True)
