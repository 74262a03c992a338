"""The real command line in a process of its own."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture(scope="session")
def start() -> Start:
    """Start `planewright WORDS`; its output is read as text."""

    def begin(*words: str | Path, python: tuple[str, ...] = ()) -> "subprocess.Popen[str]":
        # A hash seed of its own for each process: results must not depend on the order of a set.
        environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONHASHSEED", "PLANEWRIGHT_DEBUG")}
        command = [sys.executable, *python, "-m", "planewright", *map(str, words)]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8", env=environment)

    return begin


@pytest.fixture(scope="session")
def run(start: Start) -> Callable[..., "subprocess.CompletedProcess[str]"]:
    """Run `planewright WORDS` to its end."""

    def go(*words: str | Path) -> "subprocess.CompletedProcess[str]":
        with start(*words) as process:
            output, error = process.communicate(timeout=600)
        return subprocess.CompletedProcess(process.args, process.returncode, output, error)

    return go
