"""`planewright demo`: a clip with known truth, made on the spot, through the whole job, and how far off the result is."""

import json as json_text
from pathlib import Path

from rich.console import Console

from planewright.cli import reconstruct
from planewright.cli.reporting import reporting
from planewright.errors import UsageError
from planewright.export.atomic import write_whole
from planewright.pipeline.run import RESULT_FILE
from planewright.sketch.read import read_sketch
from planewright.synthetic.difficulty import clip_difficulty
from planewright.synthetic.houses import demo_scene
from planewright.synthetic.score import Figures, score
from planewright.synthetic.write import write_clip
from planewright.video.clip import open_clip

SHOWN = (
    ("within_2px_pct", "corners within 2 px of the truth", "{:.1f} %"),
    ("plain_lk_within_2px_pct", "  the same by plain Lucas-Kanade, frame to frame", "{:.1f} %"),
    ("median_px", "median error of a corner", "{:.2f} px"),
    ("focal_error_pct", "focal length", "{:+.2f} %"),
    ("rotation_median_deg", "camera rotation, median", "{:.4f} degrees"),
    ("ate_pct", "camera path, of the scene's size", "{:.4f} %"),
    ("corner_rms_pct", "corners in space, of the scene's size", "{:.2f} %"),
    ("normal_mean_deg", "face normals, mean", "{:.2f} degrees"),
    ("normal_max_deg", "face normals, worst", "{:.2f} degrees"),
    ("parallel_recall", "parallel faces found", "{:.0%}"),
    ("orthogonal_recall", "right angles found", "{:.0%}"),
    ("near_misses_enforced", "near misses enforced by mistake", "{}"),
    ("planarity_max", "largest distance of a corner from its plane", "{:.1e} of the scene's size"),
)
"""Figures of `synthetic.score` that the demo shows: key, words, format."""


def run(output: Path, *, seed: int, threads: int, force: bool, quiet: bool, json: bool) -> None:
    """Make DIR/input/{clip.mp4, sketch.json, truth.json}, reconstruct into DIR, print the errors and keep them as DIR/errors.json."""
    if (output / RESULT_FILE).exists() and not force:
        raise UsageError(f"{output} holds a finished result. Choose another folder, or replace it with --force.")
    with reporting(quiet=quiet, as_json=json) as progress:
        clip, sketch, truth = write_clip(demo_scene(seed=seed), output / "input", progress=progress)
    reconstruct.run(clip, sketch, output, frames=None, seed=seed, threads=threads, force=force, quiet=quiet, json=json)
    found = json_text.loads((output / RESULT_FILE).read_text(encoding="utf-8"))
    known = json_text.loads(truth.read_text(encoding="utf-8"))
    plain = clip_difficulty(open_clip(clip), read_sketch(sketch), known)
    figures: Figures = score(found, known) | {"plain_lk_within_2px_pct": plain.within_2px_pct}
    write_whole(output / "errors.json", (json_text.dumps(figures, indent=1) + "\n").encode())
    if json:
        print(json_text.dumps({"event": "errors", "errors": figures}), flush=True)  # noqa: T201
    else:
        print_errors(figures)


def print_errors(figures: Figures) -> None:
    """The errors against the truth, one a line."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    console.print("\nagainst the truth:")
    for key, words, form in SHOWN:
        value = figures.get(key)
        if value is not None:
            console.print(f"  {words:50}{form.format(value)}")
