"""Progress: lines where there is no terminal, JSON lines for programs, nothing when quiet; and it stops when told to."""

import json

import pytest

from planewright.cli import reporting as module
from planewright.cli.reporting import Lines, reporting
from planewright.errors import Cancelled
from planewright.progress import steps


def test_each_step_gets_a_line_and_not_every_report(capsys: pytest.CaptureFixture[str]) -> None:
    with reporting(quiet=False, as_json=False) as progress:
        for title in ("Following features", "Posing frames"):
            for _ in steps(range(1000), title, progress):
                pass
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.splitlines() == ["Following features", "Posing frames"]


def test_a_long_step_says_how_far_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    lines = Lines(0.0, as_json=False)
    lines("Posing frames", 0, 4)
    lines("Posing frames", 2, 4)
    lines("Looking", 7, None)
    assert capsys.readouterr().err.splitlines() == ["Posing frames", "Posing frames (2 of 4)", "Looking (7)"]


def test_json_lines_are_json_and_end_with_the_whole(capsys: pytest.CaptureFixture[str]) -> None:
    with reporting(quiet=False, as_json=True) as progress:
        for _ in steps(range(100), "Posing frames", progress):
            pass
    shown = capsys.readouterr()
    events = [json.loads(line) for line in shown.out.splitlines()]
    assert events[0] == {"event": "progress", "step": "Posing frames", "done": 0, "total": 100}
    assert events[-1] == {"event": "progress", "step": "Posing frames", "done": 100, "total": 100}
    assert len(events) < 20
    assert shown.err == ""


def test_quiet_is_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    with reporting(quiet=True, as_json=False) as progress:
        progress("Posing frames", 0, 4)
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("", "")


@pytest.mark.parametrize("as_json", [False, True])
def test_the_next_report_after_ctrl_c_stops_the_work(monkeypatch: pytest.MonkeyPatch, as_json: bool) -> None:
    with reporting(quiet=False, as_json=as_json) as progress:
        progress("Posing frames", 0, 4)
        monkeypatch.setattr(module, "stop_asked", lambda: True)
        with pytest.raises(Cancelled):
            progress("Posing frames", 1, 4)
