"""`planewright export`: the model of a finished result in another format."""

from pathlib import Path

from planewright.export.formats import export_model, read_result_model


def run(result: Path, format: str, output: Path, *, force: bool) -> None:
    """Write the file. Raises UsageError where it is there already, or the format is unknown; ResultError where there is no result."""
    model = read_result_model(result.parent if result.is_file() else result)
    export_model(model, format, output, force=force)
