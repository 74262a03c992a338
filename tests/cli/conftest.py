"""The command line inside this process: the words as a shell would hand them over, the status as a shell would see it."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from planewright.cli import main


@dataclass(frozen=True)
class Outcome:
    """What a shell sees."""

    status: int
    out: str
    err: str


@pytest.fixture
def planewright(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Run `planewright WORDS`."""
    monkeypatch.delenv("PLANEWRIGHT_DEBUG", raising=False)

    def run(*words: str | Path) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["planewright", *map(str, words)])
        status = main.run()
        shown = capsys.readouterr()
        return Outcome(status, shown.out, shown.err)

    return run
