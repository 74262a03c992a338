"""One clip from beginning to end: stages in order, each kept when it is finished, the result written whole or not at all."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

import planewright
from planewright.errors import GeometryError, UsageError
from planewright.export.atomic import write_whole
from planewright.export.gltf import encode_glb
from planewright.features.features import Features
from planewright.features.follow import follow_features
from planewright.model.atlas import Atlas
from planewright.model.build import build_model
from planewright.pipeline.checkpoint import Checkpoints, Finished, fingerprint
from planewright.pipeline.folder import make_folder, remove_leftovers
from planewright.pipeline.in_image import TRACKS_FILE, ImageTracks, told, tracks_document, tracks_in_image
from planewright.pipeline.machine import machine, peak_memory_bytes, versions
from planewright.pipeline.plain import to_tree
from planewright.pipeline.report import make_report
from planewright.pipeline.result import Result, document, to_json
from planewright.pipeline.stages import Filmed, StageOptions, check_structure, checked_sketch, find_cameras, without_distortion
from planewright.pipeline.threads import limited_threads
from planewright.pipeline.world import place
from planewright.progress import Progress, silent
from planewright.refine.rounds import Structure, refine_structure
from planewright.registration.follow import follow_faces
from planewright.registration.registered import Registered
from planewright.sketch.graph import Sketch
from planewright.sketch.read import read_sketch
from planewright.texture.bake import bake_texture
from planewright.tracking.follow import follow_corners
from planewright.tracking.tracks import Tracks
from planewright.video.clip import Clip, open_clip
from planewright.video.frame_range import FrameRange
from planewright.video.inspect import ClipFindings, inspect_clip
from planewright.video.kept_frames import KeptFrames
from planewright.video.undistort import UndistortedFrames

Value = TypeVar("Value")

RESULT_FILE = "reconstruction.json"
"""Written last: a folder that holds it holds a finished result."""


@dataclass(frozen=True, kw_only=True)
class ReconstructOptions:
    """What a run may be told."""

    frames: FrameRange = field(default_factory=FrameRange)
    """The frames that take part; all by default."""
    seed: int = 0
    """Seed of every random choice."""
    threads: int = 1
    """Of the pixel kernels; the result does not depend on it."""
    stages: StageOptions = field(default_factory=StageOptions)
    """The options of every stage."""


@dataclass(frozen=True)
class Stage:
    """What a stage took."""

    name: str
    seconds: float
    resumed: bool


def reconstruct(
    clip: Path | str,
    sketch: Sketch | Path | str,
    options: ReconstructOptions = ReconstructOptions(),
    *,
    output: Path | str | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Result:
    """Cameras, corners, planes, relations and a textured model from a clip and a drawing.

    Args:
        clip: a video file, or a folder of numbered images.
        sketch: the drawing, or the file that holds it.
        options: frames, seed, threads, and the options of every stage.
        output: the folder for the files of the result (docs/file-format.md); without it nothing is written. A run that was broken off there goes
            on after its last finished stage.
        force: replace a finished result in that folder.
        progress: called often; raise `Cancelled` in it to stop.

    Raises:
        UsageError: the folder holds a finished result, or the frames name none.
        VideoError, SketchError: the clip or the sketch cannot be used.
        OutputError: the result cannot be written.
        GeometryError: the views do not determine the answer.
        Cancelled: `progress` said so.
    """
    folder = None if output is None else Path(output)
    if folder is not None:
        if (folder / RESULT_FILE).exists() and not force:
            raise UsageError(f"{folder} holds a finished result. Choose another folder, or replace it with --force (force=True).")
        make_folder(folder)
    drawing = sketch if isinstance(sketch, Sketch) else read_sketch(Path(sketch))
    with limited_threads(options.threads):
        return _Run(open_clip(clip, options.frames, progress=progress), drawing, options, folder, progress).walk()


class _Run:
    """The walk of one clip. Holds what every stage needs: the checkpoints, the clock, the callback."""

    def __init__(self, clip: Clip, sketch: Sketch, options: ReconstructOptions, folder: Path | None, progress: Progress) -> None:
        self.clip, self.drawing, self.options, self.folder, self.progress = clip, sketch, options, folder, progress
        self.stages: list[Stage] = []
        # Features, structure and tracks look at the same grey frames: decoded once, as far as there is room, they take 1.2 s of a 20 s walk less.
        self.kept = KeptFrames(clip)
        self.followed: Registered | None = None
        result_depends_on = (clip.info.sha256, sketch, replace(options, threads=1), planewright.__version__)
        self.checkpoints = Checkpoints(None if folder is None else folder / ".work", fingerprint(result_depends_on))

    def walk(self) -> Result:
        """The result. Where the views set none, the corners' tracks in the image are written, and the reason goes on its way."""
        try:
            return self.solve()
        except GeometryError as refusal:
            if self.folder is None:
                raise
            found = self.in_image()
            where = told(found)
            if where is None:
                raise
            write_whole(self.folder / TRACKS_FILE, to_json(tracks_document(found, str(refusal))))
            raise GeometryError(f"{refusal} {where}") from refusal

    def faces(self) -> Registered:
        """The drawn faces followed as wholes; once, for cameras and for tracks without cameras."""
        if self.followed is None:
            sketch = checked_sketch(self.drawing, self.clip.info, self.clip.numbers)[0]
            self.followed = follow_faces(self.kept, sketch, self.options.stages.faces, progress=self.progress)
        return self.followed

    def in_image(self) -> ImageTracks:
        """The corners without cameras."""
        clip = self.clip
        sketch = checked_sketch(self.drawing, clip.info, clip.numbers)[0]
        return ImageTracks(clip.info, sketch, tracks_in_image(self.faces(), sketch, clip.numbers))

    def solve(self) -> Result:
        """All stages in order."""
        clip, stages, progress = self.clip, self.options.stages, self.progress
        sketch, sketch_notes = checked_sketch(self.drawing, clip.info, clip.numbers)
        self.checkpoints.open()

        looked = self.finish("look", ClipFindings, lambda: inspect_clip(clip, progress=progress))
        kept = self.kept
        features = self.finish("features", Features, lambda: follow_features(kept, stages.features, progress=progress))

        def cameras_from(features: Features) -> Filmed:
            return find_cameras(kept, features, sketch, stages, self.random("cameras"), faces=self.faces, progress=progress)

        filmed = self.finish("cameras", Filmed, lambda: cameras_from(features))
        cameras, points = filmed.solved.cameras, filmed.solved.points
        frames = UndistortedFrames(kept, cameras.lens)
        straight = without_distortion(sketch, cameras.lens)
        rng = self.random("structure")
        structure = self.finish(
            "structure", Structure, lambda: refine_structure(frames, straight, cameras, points, stages.structure, rng=rng, progress=progress)
        )
        check_structure(structure)
        placed = place(structure, cameras)
        structure, cameras, scene = placed.structure, placed.cameras, placed.structure.scene
        tracks = self.finish("tracks", Tracks, lambda: follow_corners(frames, scene, cameras, stages.corners, progress=progress))
        atlas = self.finish("texture", Atlas, lambda: bake_texture(frames, scene, cameras, stages.texture, progress=progress))
        model = build_model(scene, atlas, cameras=cameras, unit=placed.unit, world_up=placed.world_up)

        warnings = (
            *clip.info.warnings,
            *looked.sentences,
            *sketch_notes,
            *filmed.notes,
            *filmed.solved.summary.warnings,
            *structure.notes,
            *placed.notes,
            *model.notes,
        )
        # What leaves the walk speaks of the frames as displayed, and so does the sketch in it.
        structure = replace(structure, scene=replace(scene, sketch=sketch))
        result = Result(clip.info, cameras, structure, tracks, model, tuple(dict.fromkeys(warnings)))
        if self.folder is not None:
            self.write(result, self.folder)
            self.checkpoints.remove()
        return result

    def finish(self, name: str, kind: type[Value], work: Callable[[], Value]) -> Value:
        """The value of a stage: what an earlier run kept, or what `work` finds now."""
        finished = self.checkpoints.load(name, kind)
        if finished is None:
            start = time.perf_counter()
            finished = self.checkpoints.save(name, work(), kind, time.perf_counter() - start)
        self.note(name, finished)
        return cast(Value, finished.value)

    def note(self, name: str, finished: Finished) -> None:
        self.stages.append(Stage(name, finished.seconds, finished.resumed))

    def random(self, stage: str) -> np.random.Generator:
        """A generator of its own for each stage: a resumed run draws the same numbers as an unbroken one."""
        return np.random.default_rng([self.options.seed, *stage.encode()])

    def write(self, result: Result, folder: Path) -> None:
        """All files of the result; the one that marks it as finished comes last."""
        start = time.perf_counter()
        remove_leftovers(folder)
        (folder / TRACKS_FILE).unlink(missing_ok=True)  # of an earlier run that was refused
        (folder / RESULT_FILE).unlink(missing_ok=True)  # of the result that is replaced: a run that breaks off from here on is unfinished
        write_whole(folder / "model.glb", encode_glb(result.model))
        report = make_report(self.clip, result, [(stage.name, _time(stage)) for stage in self.stages], self.facts(result), progress=self.progress)
        write_whole(folder / "report.html", report)
        everything = to_json(document(result))
        self.stages.append(Stage("export", time.perf_counter() - start, resumed=False))
        write_whole(folder / "run.json", to_json(self.record()))
        write_whole(folder / RESULT_FILE, everything)

    def record(self) -> dict[str, Any]:
        """The content of `run.json`."""
        return {
            "format": "planewright-run",
            "version": 1,
            "seconds": {stage.name: round(stage.seconds, 3) for stage in self.stages},
            "resumed": [stage.name for stage in self.stages if stage.resumed],
            "peak_memory_bytes": peak_memory_bytes(),
            "versions": versions(),
            "machine": machine(),
            "seed": self.options.seed,
            "options": _plain_options(to_tree(self.options, [])),
        }

    def facts(self, result: Result) -> list[tuple[str, str]]:
        peak = peak_memory_bytes()
        info, lens, shutter = self.clip.info, result.cameras.intrinsics, result.cameras.shutter
        return [
            ("clip", f"{info.image_size[0]} x {info.image_size[1]} pixels, {info.num_frames} frames, {info.fps:.2f} a second"),
            ("sha256", info.sha256),
            ("lens", ", ".join([f"f = {lens.focal:.2f} px", *(f"k{i + 1} = {k:+.4f}" for i, k in enumerate(lens.distortion))])),
            ("shutter", "all rows at once" if shutter is None else f"rows follow each other over {shutter.readout:+.2f} frames"),
            ("unit", result.model.unit or "scene units"),
            ("frames used", str(self.options.frames)),
            ("seed", str(self.options.seed)),
            ("peak memory", "unknown" if peak is None else f"{peak / 2**20:.0f} MiB"),
            ("planewright", planewright.__version__),
        ]


def _time(stage: Stage) -> str:
    return f"{stage.seconds:.1f} s" + (" (earlier)" if stage.resumed else "")


def _plain_options(tree: Any) -> Any:
    """The options as nested JSON objects, without the marks of the containers."""
    match tree:
        case {"class": str(), "fields": dict(fields)}:
            return {str(name): _plain_options(value) for name, value in cast(dict[str, Any], fields).items()}
        case {"tuple": list(items)} | {"list": list(items)}:
            return [_plain_options(item) for item in cast(list[Any], items)]
        case {"map": list(pairs)}:
            return {str(key): _plain_options(value) for key, value in cast(list[tuple[Any, Any]], pairs)}
        case {"enum": str(), "value": value}:
            return value
        case _:
            return tree
