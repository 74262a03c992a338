"""`report.html`: one page that works offline and runs nothing; everything that came from a file is shown as text."""

from collections.abc import Sequence

import jinja2

from planewright.pipeline.report_diagrams import camera_picture, error_picture, lanes_picture
from planewright.pipeline.report_pictures import overlay_pictures, sketch_picture, trails_picture
from planewright.pipeline.report_tables import adjacency_table, correction_table, face_table, point_table, relation_table
from planewright.pipeline.result import Result, reprojection_errors, rmse
from planewright.pipeline.views import model_views
from planewright.progress import Progress, silent
from planewright.video.frames import Frames


def make_report(frames: Frames, result: Result, stages: Sequence[tuple[str, str]], facts: Sequence[tuple[str, str]], *, progress: Progress = silent) -> bytes:
    """The page.

    Args:
        frames: the clip, as displayed.
        result: what was found.
        stages: name and time of each stage, as text.
        facts: what else is to be known about the run, name and value.
        progress: called for each frame that is drawn.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("planewright.pipeline"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=visible,
    )
    page = environment.get_template("report.html.j2").render(
        name=result.clip.name,
        tiles=tiles(result),
        warnings=result.warnings,
        sketch=sketch_picture(frames, result),
        overlays=overlay_pictures(frames, result, progress),
        views=model_views(result.model, result.cameras),
        lanes=lanes_picture(result.tracks, result.scene, frames.numbers),
        errors=error_picture(result, frames.numbers),
        trails=trails_picture(frames, result),
        cameras=camera_picture(result.cameras, result.scene, result.model),
        tables=[correction_table(result), face_table(result.scene), relation_table(result), adjacency_table(result), point_table(result.scene, result.tracks)],
        stages=stages,
        facts=facts,
    )
    return page.encode("utf-8", "replace")


UNSEEN = {code: "\N{REPLACEMENT CHARACTER}" for code in (*range(9), 11, 12, *range(14, 32), *range(127, 160), *range(0x202A, 0x202F), *range(0x2066, 0x206A))}
"""Characters that HTML forbids, and those that turn the direction of the text after them."""


def visible(value: object) -> object:
    """Text without control characters; everything else, and what the page's own macros made, as it is."""
    return value.translate(UNSEEN) if type(value) is str else value


def tiles(result: Result) -> list[tuple[str, str, str]]:
    """The figures to read first: what, value, remark."""
    scene, cameras = result.scene, result.cameras
    error = rmse(reprojection_errors(result)[1])
    low, high = cameras.focal_interval
    enforced = sum(relation.state == "enforced" for relation in result.structure.relations)
    return [
        ("Faces", f"{int(scene.face_known.sum())}", f"of {len(scene.sketch.faces)} drawn or found"),
        ("Corners", f"{int(scene.point_known.sum())}", f"of {len(scene.sketch.points)} drawn"),
        ("Relations", f"{enforced}", f"enforced, of {len(result.structure.relations)} looked at"),
        ("Frames", f"{int(cameras.posed.sum())}", f"posed, of {len(cameras.frame)} used and {result.clip.num_frames} in the clip"),
        ("Focal length", f"{cameras.intrinsics.focal:.1f} px", f"95 %: {low:.1f} to " + ("unbounded" if high is None else f"{high:.1f} px")),
        ("Reprojection", "none" if error is None else f"{error:.2f} px", "root mean square of measured corners"),
    ]
