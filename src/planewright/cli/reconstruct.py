"""`planewright reconstruct`: the whole job on a clip and a sketch."""

import json as json_text
from pathlib import Path

from planewright.cli.reporting import reporting
from planewright.cli.summary import print_summary
from planewright.pipeline.result import Result
from planewright.pipeline.run import ReconstructOptions
from planewright.pipeline.run import reconstruct as reconstruct_clip
from planewright.video.frame_range import FrameRange


def run(clip: Path, sketch: Path, output: Path, *, frames: str | None, seed: int, threads: int, force: bool, quiet: bool, json: bool) -> Result:
    """Reconstruct, write the result, and say in a few lines what came out. Raises PlanewrightError."""
    options = ReconstructOptions(frames=FrameRange() if frames is None else FrameRange.parse(frames), seed=seed, threads=threads)
    with reporting(quiet=quiet, as_json=json) as progress:
        result = reconstruct_clip(clip, sketch, options, output=output, force=force, progress=progress)
    if json:
        print(json_text.dumps({"event": "done", "output": output.name}), flush=True)  # noqa: T201
    elif not quiet:
        print_summary(result, output)
    return result
