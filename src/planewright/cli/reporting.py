"""Where progress goes: a bar on a terminal, plain lines elsewhere, JSON lines for programs, or nowhere."""

import json
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager

import rich.progress
from rich.console import Console

from planewright.cli.interrupt import stop_asked
from planewright.errors import Cancelled
from planewright.progress import Progress

LINE_SECONDS = 5.0
"""A step that goes on gets another plain line after this time."""
JSON_SECONDS = 0.25


class Lines:
    """A line at the start of each step, and another every few seconds while it lasts."""

    def __init__(self, seconds: float, as_json: bool) -> None:
        self.seconds, self.as_json = seconds, as_json
        self.title, self.written = "", 0.0

    def __call__(self, title: str, done: int, total: int | None) -> None:
        """Write a line where it is time for one."""
        now = time.monotonic()
        if title == self.title and done != total and now - self.written < self.seconds:
            return
        if self.as_json:
            print(json.dumps({"event": "progress", "step": title, "done": done, "total": total}), flush=True)  # noqa: T201
        elif title != self.title or done != total:
            print(title if done == 0 else f"{title} ({done} of {total})" if total else f"{title} ({done})", file=sys.stderr, flush=True)  # noqa: T201
        self.title, self.written = title, now


class Bar:
    """A bar for the step that runs; finished steps stay above it with their time."""

    def __init__(self, bar: rich.progress.Progress) -> None:
        self.bar = bar
        self.tasks: dict[str, rich.progress.TaskID] = {}

    def __call__(self, title: str, done: int, total: int | None) -> None:
        """Move the bar of this step."""
        if title not in self.tasks:
            self.tasks[title] = self.bar.add_task(title, total=total)
        self.bar.update(self.tasks[title], completed=done, total=total)


@contextmanager
def reporting(*, quiet: bool, as_json: bool) -> Generator[Progress]:
    """The progress callback that fits the place where the command runs. It raises `Cancelled` after Ctrl-C."""
    if quiet and not as_json:
        yield _stoppable(None)
    elif as_json:
        yield _stoppable(Lines(JSON_SECONDS, as_json=True))
    elif sys.stderr.isatty():
        columns = (
            rich.progress.TextColumn("{task.description}", markup=False),
            rich.progress.BarColumn(),
            rich.progress.MofNCompleteColumn(),
            rich.progress.TimeElapsedColumn(),
        )
        with rich.progress.Progress(*columns, console=Console(stderr=True)) as bar:
            yield _stoppable(Bar(bar))
    else:
        yield _stoppable(Lines(LINE_SECONDS, as_json=False))


def _stoppable(show: Progress | None) -> Progress:
    def report(title: str, done: int, total: int | None) -> None:
        if stop_asked():
            raise Cancelled("Stopped. Finished stages are kept; the same command goes on from there.")
        if show is not None:
            show(title, done, total)

    return report
