"""The commands and their options (docs/file-format.md lists them). Each hands over to its module, which is imported only when its command runs:
the numerical libraries take a second or two to load, and `--version` or a misspelt option should not wait for them."""

from pathlib import Path
from typing import Annotated

import typer

import planewright

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
sketch_app = typer.Typer(no_args_is_help=True, help="Look at a drawing.")
app.add_typer(sketch_app, name="sketch")

Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress.")]
Json = Annotated[bool, typer.Option("--json", help="Write progress as JSON lines to standard output.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of every random choice; the same seed gives the same result.")]
Threads = Annotated[int, typer.Option(min=1, help="Threads of the pixel kernels; the result does not depend on it.")]
Force = Annotated[bool, typer.Option("--force", help="Replace a finished result in the output folder.")]


def _version(asked: bool) -> bool:
    if asked:
        typer.echo(f"planewright {planewright.__version__}")
        raise typer.Exit
    return asked


@app.callback()
def planewright_command(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and leave.")] = False,
) -> None:
    """Clean, textured, editable planar 3D models from a handheld clip and a drawn sketch."""
    del version


@app.command()
def reconstruct(
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="A video file, or a folder of numbered images.")],
    sketch: Annotated[Path, typer.Option("--sketch", metavar="SKETCH", help="The drawing: a sketch.json.")],
    output: Annotated[Path, typer.Option("--output", metavar="DIR", help="Folder for the result; it is made if it is not there.")],
    frames: Annotated[str | None, typer.Option("--frames", metavar="A:B[:STEP]", help="Use only frames A to B - 1, each STEP-th.")] = None,
    seed: Seed = 0,
    threads: Threads = 1,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Make the model: camera, corners, planes, relations, texture, files."""
    from planewright.cli import reconstruct as command

    command.run(clip, sketch, output, frames=frames, seed=seed, threads=threads, force=force, quiet=quiet, json=json)


@app.command()
def demo(
    output: Annotated[Path, typer.Option("--output", metavar="DIR", help="Folder for the clip, the sketch and the result.")] = Path("planewright-demo"),
    seed: Seed = 0,
    threads: Threads = 1,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Make a clip with known truth, reconstruct it, and show how far off the result is."""
    from planewright.cli import demo as command

    command.run(output, seed=seed, threads=threads, force=force, quiet=quiet, json=json)


@sketch_app.command("check")
def sketch_check(
    sketch: Annotated[Path, typer.Argument(metavar="SKETCH", help="A sketch.json.")],
    clip: Annotated[Path | None, typer.Option("--clip", metavar="CLIP", help="The clip it was drawn on, to check marks against its size and length.")] = None,
) -> None:
    """Say what a drawing holds, which faces it has, and what is wrong with it."""
    from planewright.cli import sketch_check as command

    command.run(sketch, clip)


@app.command()
def export(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="The folder of a finished result.")],
    format: Annotated[str, typer.Option("--format", metavar="F", help="The file format to write.")],
    output: Annotated[Path, typer.Option("--output", metavar="FILE", help="The file to write.")],
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Write the model of a finished result in another format."""
    from planewright.cli import export as command

    command.run(result, format, output, force=force)


@app.command()
def doctor() -> None:
    """Show what is installed, what is missing and how to get it."""
    from planewright.cli import doctor as command

    command.run()
