"""What a finished run says in a few lines."""

from pathlib import Path

from rich.console import Console

from planewright.pipeline.result import Result, reprojection_errors, rmse

MOST_WARNINGS = 8


def print_summary(result: Result, output: Path) -> None:
    """The figures to read first, what to look out for, and where the files are. All text is shown as it is, without markup."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    scene, cameras, relations = result.scene, result.cameras, result.structure.relations
    error = rmse(reprojection_errors(result)[1])
    low, high = cameras.focal_interval
    console.print(f"{int(scene.face_known.sum())} of {len(scene.sketch.faces)} faces, {int(scene.point_known.sum())} of {len(scene.sketch.points)} corners")
    console.print(f"{sum(relation.state == 'enforced' for relation in relations)} relations enforced, of {len(relations)} looked at")
    console.print(f"{int(cameras.posed.sum())} of {len(cameras.frame)} frames posed")
    console.print(f"focal length {cameras.intrinsics.focal:.1f} px, 95 % interval {low:.1f} to {'unbounded' if high is None else f'{high:.1f}'}")
    if error is not None:
        console.print(f"reprojection {error:.2f} px")
    for warning in result.warnings[:MOST_WARNINGS]:
        console.print(f"note: {plain(warning)}")
    if len(result.warnings) > MOST_WARNINGS:
        console.print(f"note: {len(result.warnings) - MOST_WARNINGS} more in report.html")
    console.print(f"{output / 'report.html'}")


def plain(text: str, length: int = 300) -> str:
    """Text from a file on one line, without control characters, and not longer than a message should be."""
    shown = "".join(character if character.isprintable() else " " for character in text[: length + 1])
    return shown if len(shown) <= length else f"{shown[: length - 3]}..."
