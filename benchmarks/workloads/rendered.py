"""Clips drawn by `planewright.synthetic`, kept until the code that draws them changes."""

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import planewright.synthetic
from benchmarks.workloads.workload import ClipFiles, Workload
from planewright.synthetic import (
    HARD,
    SyntheticClip,
    boxes,
    demo_scene,
    desktop,
    hall,
    library,
    rotating_camera,
    single_plane,
    still_camera,
    toy_house,
    write_clip,
)


def rendered() -> list[Workload]:
    """The five twins; the hard set; the shed twice (other paint, other tremor) and without drawn faces; and three that must be refused."""
    size = (640, 360)
    twins = (boxes, hall, toy_house, desktop, library)
    refused = (still_camera, rotating_camera, single_plane)
    return [
        Workload("demo", partial(_draw, demo_scene), "quick", quick=True),
        Workload("demo_1", partial(_draw, partial(demo_scene, seed=1)), "quick", quick=True),
        Workload("demo_edges", partial(_draw, demo_scene, with_faces=False), "quick", quick=True),
        *(Workload(make.__name__, partial(_draw, make), "twin") for make in twins),
        *(Workload(make.__name__, partial(_draw, make), "hard") for make in HARD),
        *(Workload(make.__name__, partial(_draw, partial(make, 40, size)), "refused", expected_status=4, quick=True) for make in refused),
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
