"""A page of benchmarks/reports from what `benchmarks.tracks` and `benchmarks.speed` measured: tables, diagrams, and what is and is not kept.

python -m benchmarks.report NAME.md [--tracks DIR] [--speed DIR]

Diagrams are written beside the page, their names beginning with its own. Nothing on the page is typed by hand, so that it can be made again.
"""

import argparse
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.speed_page import speed_report, time_against_span
from benchmarks.tables import TITLES, curves, tracks_report


def page(tracks: Mapping[str, Any] | None, speed: Mapping[str, Any] | None, stem: str) -> tuple[str, dict[str, str]]:
    """The page, and the diagrams that belong beside it: file name -> SVG."""
    text: list[str] = []
    diagrams: dict[str, str] = {}
    if tracks is not None:
        body, _ = tracks_report(tracks)
        text.append(body)
        for group, total in tracks["totals"].items():
            diagrams[f"{stem}-{group}.svg"] = curves(group, total)
            text.append(f"![{TITLES.get(group, group)}]({stem}-{group}.svg)\n")
    if speed is not None:
        text.append(speed_report(speed).replace("# How long", "## How long", 1).replace("\n## ", "\n### "))
        for part, what in (("corrections", "a correction"), ("paths", "the shortest path")):
            if speed.get(part):
                diagrams[f"{stem}-{part}.svg"] = time_against_span(speed[part], what, part == "corrections")
                text.append(f"![Time of {what} by the frames it touches]({stem}-{part}.svg)\n")
    # where its writer kept the results is nobody's business, and nothing to repeat
    return re.sub(r" --output \S+?(?=[\s`])", "", "\n".join(text)), diagrams


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--tracks", type=Path, help="the folder that benchmarks.tracks wrote")
    parser.add_argument("--speed", type=Path, help="the folder that benchmarks.speed wrote")
    args = parser.parse_args()
    if args.tracks is None and args.speed is None:
        parser.error("Name at least one of --tracks and --speed.")
    read = [
        None if folder is None else json.loads((folder / file).read_text(encoding="utf-8"))
        for folder, file in ((args.tracks, "tracks.json"), (args.speed, "speed.json"))
    ]
    text, diagrams = page(*read, args.file.stem)
    args.file.write_text(text, encoding="utf-8")
    for name, svg in diagrams.items():
        (args.file.parent / name).write_text(svg, encoding="utf-8")


if __name__ == "__main__":
    main()
