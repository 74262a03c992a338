"""`planewright export`: the model of a finished result in another format."""

from pathlib import Path

from planewright.export.formats import export_model, read_result_model


def run(result: Path, format: str, output: Path, *, force: bool) -> None:
    """Write the file. Raises UsageError where it is there already, or the format is unknown; ResultError where there is no result."""
    folder = result if result.is_dir() else result.parent
    model = read_result_model(folder)
    export_model(model, format, output, force=force)
