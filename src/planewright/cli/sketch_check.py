"""`planewright sketch check`: what a drawing says, and what is wrong with it."""

from pathlib import Path

from rich.console import Console

from planewright.cli.summary import plain
from planewright.errors import SketchError
from planewright.sketch.checks import check_sketch
from planewright.sketch.faces import find_faces
from planewright.sketch.read import read_sketch
from planewright.video.clip import open_clip

MOST = 40
"""Faces and findings that are listed one by one."""


def run(sketch: Path, clip: Path | None) -> None:
    """Print the faces and the findings. Raises SketchError where a finding is an error, so that scripts see it in the exit status."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    drawing = find_faces(read_sketch(sketch))
    info = None if clip is None else open_clip(clip).info
    marked = sorted({frame for point in drawing.points for frame in point.marks})
    console.print(f"{len(drawing.points)} points, {sum(len(point.marks) for point in drawing.points)} marks in {len(marked)} frames")
    console.print(f"{len(drawing.edges)} edges, {len(drawing.faces)} faces, {len(drawing.relations)} relations, {len(drawing.lengths)} lengths")
    for face in drawing.faces[:MOST]:
        origin = "found" if face.found else "given"
        holes = f", {len(face.holes)} holes" if face.holes else ""
        console.print(f"  face {plain(face.id, 40)} ({origin}{', open' if face.open else ''}): {plain(' '.join(face.loop), 120)}{holes}")
    if len(drawing.faces) > MOST:
        console.print(f"  and {len(drawing.faces) - MOST} more")
    findings = check_sketch(drawing, image_size=info.image_size if info else None, num_frames=info.num_frames if info else None)
    errors = [finding for finding in findings if finding.severity == "error"]
    for finding in findings[:MOST]:
        console.print(f"{finding.severity}: {plain(finding.sentence)}")
    if errors:
        raise SketchError(f"{sketch.name} cannot be reconstructed as it stands: {len(errors)} error{'s' if len(errors) > 1 else ''}.")
    console.print("Nothing is wrong with it." if not findings else "It can be reconstructed.")
