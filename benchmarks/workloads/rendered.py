"""Clips drawn by `planewright.synthetic`, kept until the code that draws them changes."""

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import planewright.synthetic
from benchmarks.workloads.workload import ClipFiles, Workload
from planewright.synthetic import (
    SyntheticClip,
    boxes,
    demo_scene,
    desktop,
    hall,
    library,
    object_on_turntable,
    rotating_camera,
    single_plane,
    still_camera,
    toy_house,
    write_clip,
)


def rendered() -> list[Workload]:
    """The shed twice (other paint, other tremor) and without drawn faces, the toy house, one with bare walls through a lens that bends lines,
    cartons, a hall, a desk and a library from the air, a turntable, and three that must be refused.
    """
    size = (640, 360)
    return [
        Workload("demo", partial(_draw, demo_scene), quick=True),
        Workload("demo_1", partial(_draw, partial(demo_scene, seed=1)), quick=True),
        Workload("demo_edges", partial(_draw, demo_scene, with_faces=False), quick=True),
        Workload("toy_house", partial(_draw, toy_house)),
        Workload("bare_house", partial(_draw, partial(toy_house, 150, bare=True, seed=1, distortion=(-0.08, 0.02)))),
        Workload("boxes", partial(_draw, boxes)),
        Workload("hall", partial(_draw, hall)),
        Workload("desktop", partial(_draw, desktop)),
        Workload("library", partial(_draw, library)),
        Workload("turntable", partial(_draw, partial(object_on_turntable, 80, size))),
        Workload("still_camera", partial(_draw, partial(still_camera, 40, size)), expected_status=4, quick=True),
        Workload("rotating_camera", partial(_draw, partial(rotating_camera, 40, size)), expected_status=4, quick=True),
        Workload("single_plane", partial(_draw, partial(single_plane, 40, size)), expected_status=4, quick=True),
    ]


def _draw(make: Callable[[], SyntheticClip], folder: Path, with_faces: bool = True) -> ClipFiles:
    """Draw the clip unless the same code has drawn it here before."""
    stamp, print_now = folder / "drawn_by.txt", _fingerprint(make, with_faces)
    files = (folder / "clip.mp4", folder / "sketch.json", folder / "truth.json")
    if not (stamp.exists() and stamp.read_text(encoding="utf-8") == print_now and all(f.exists() for f in files)):
        stamp.unlink(missing_ok=True)
        files = write_clip(make(), folder, with_faces)
        stamp.write_text(print_now, encoding="utf-8")
    return ClipFiles(files[0], files[1], (files[2],))


def _fingerprint(make: Callable[[], SyntheticClip], with_faces: bool) -> str:
    """Of the code that draws, and what it is asked to draw."""
    digest = hashlib.sha256()
    for file in sorted(Path(planewright.synthetic.__file__).parent.glob("*.py")):
        digest.update(file.read_bytes())
    words = make if isinstance(make, partial) else partial(make)
    digest.update(repr((words.func.__name__, words.args, sorted(words.keywords.items()), with_faces)).encode())
    return digest.hexdigest()
