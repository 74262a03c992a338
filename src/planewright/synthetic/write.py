"""A clip written down: H.264 video, `sketch.json`, `truth.json`."""

import json
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from planewright.errors import OutputError
from planewright.export.atomic import whole_file, write_whole
from planewright.progress import Progress, silent, steps
from planewright.sketch.graph import Sketch
from planewright.synthetic.clip import SyntheticClip
from planewright.synthetic.observe import draw, truth


def write_video(clip: SyntheticClip, file: Path, fps: int = 30, *, progress: Progress = silent) -> None:
    """H.264 in MP4, frame by frame: memory does not grow with the clip.

    One encoder thread and `cpu-independent`, so that the same clip gives the same bytes: with x264's AVX-512 routines eight encodings
    of the same six frames at 960x540 gave five different files.

    Raises OutputError where the file cannot be written.
    """
    width, height = clip.intrinsics.image_size
    codec = {"crf": str(clip.options.crf), "preset": "veryfast", "threads": "1", "x264-params": "cpu-independent=1"}
    with whole_file(file) as temporary, av.open(str(temporary), "w") as container:
        stream = container.add_stream("libx264", rate=fps, options=codec)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.time_base = Fraction(1, fps)
        renderer = clip.renderer
        for number in steps(range(clip.num_frames), "Drawing frames", progress):
            frame = av.VideoFrame.from_ndarray(renderer.frame(number), format="rgb24")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def sketch_json(sketch: Sketch) -> dict[str, object]:
    """The drawn part of a sketch as `planewright-sketch`: points, edges, faces."""
    content: dict[str, object] = {
        "format": "planewright-sketch",
        "version": 1,
        "points": [{"id": p.id, "marks": {str(k): list(xy) for k, xy in sorted(p.marks.items())}} for p in sketch.points],
        "edges": [list(e) for e in sketch.edges],
    }
    if sketch.image_size is not None:
        content["image_size"] = list(sketch.image_size)
    if sketch.faces:
        content["faces"] = [{"id": f.id, "loop": list(f.loop), "holes": [list(h) for h in f.holes], "open": f.open} for f in sketch.faces]
    return content


def write_clip(clip: SyntheticClip, folder: Path, with_faces: bool = True, *, progress: Progress = silent) -> tuple[Path, Path, Path]:
    """`clip.mp4`, `sketch.json` and `truth.json` in a folder that is made when missing; returns their paths. Without faces the sketch has edges only."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"The folder {folder} cannot be made: {error.strerror or error}. Choose another output folder.") from error
    video, drawing, known = folder / "clip.mp4", folder / "sketch.json", folder / "truth.json"
    sketch = draw(clip, np.random.default_rng((clip.options.seed, 2)), with_faces=with_faces)
    write_whole(drawing, json.dumps(sketch_json(sketch), indent=1).encode())
    write_whole(known, json.dumps(truth(clip)).encode())
    write_video(clip, video, progress=progress)
    return video, drawing, known
