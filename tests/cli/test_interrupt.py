"""Ctrl-C and SIGTERM end the process with status 130, whatever it is doing."""

import os
import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows sends Ctrl-C to a console, not to a process")

BUSY = {
    "python code": "while True: pass",
    "a sleeping library": "import ctypes\nwhile True: ctypes.CDLL(None).sleep(600)",
    "loading libraries": "while True:\n    import importlib, json; importlib.reload(json)",
    "swallowing errors": "while True:\n    try: stop_asked()\n    except BaseException: pass",
    "waiting for a thread": "import threading; threading.Event().wait()",
}


def start(body: str) -> "subprocess.Popen[str]":
    code = f"from planewright.cli.interrupt import install, stop_asked; install(); print('ready', flush=True)\n{body}"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("busy", BUSY)
def test_the_process_ends_whatever_it_does(busy: str, number: signal.Signals) -> None:
    with start(BUSY[busy]) as process:
        process.send_signal(number)
        _, error = process.communicate(timeout=30)
    assert process.returncode == 130
    assert error == "Stopped.\n"


def test_work_that_asks_may_end_by_itself() -> None:
    with start("while not stop_asked(): pass\nprint('tidied'); raise SystemExit(130)") as process:
        process.send_signal(signal.SIGINT)
        output, error = process.communicate(timeout=30)
    assert (process.returncode, output, error) == (130, "tidied\n", "")
