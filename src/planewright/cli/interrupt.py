"""Ctrl-C and SIGTERM: the work stops at its next report, or is ended after a moment where it cannot report.

Python runs a signal handler only between two bytecodes, so a handler alone waits for as long as a compilation or a kernel runs. The signal
is therefore also written to a socket by the C-level handler (`signal.set_wakeup_fd`), and a thread that waits there ends the process.
Ending it is safe at any moment: results are written under a temporary name and then renamed.
"""

import contextlib
import os
import signal
import socket
import sys
import threading
import time
from types import FrameType
from typing import NoReturn

STOPPED = 130
GRACE_SECONDS = 1.0
"""How long the work may take to stop by itself. The promise is two seconds in all; the rest is for a loaded machine."""

_asked = threading.Event()


def stop_asked() -> bool:
    """Whether the person asked to stop."""
    return _asked.is_set()


def install() -> None:
    """From here on Ctrl-C and SIGTERM lead to exit status 130."""
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _ask)
    signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader, writer), name="interrupt", daemon=True).start()


def _ask(number: int, frame: FrameType | None) -> None:
    del number, frame
    _asked.set()


def _watch(reader: socket.socket, writer: socket.socket) -> None:
    """Wait for SIGINT or SIGTERM, then for the grace, then end the process. `writer` is held so that it stays open."""
    while not {signal.SIGINT, signal.SIGTERM} & set(reader.recv(64)):
        pass
    _asked.set()
    time.sleep(GRACE_SECONDS)
    end_now()
    del writer


def end_now() -> None:
    """Leave at once with status 130; a terminal gets its cursor back."""
    if sys.stderr.isatty():
        os.write(2, b"\x1b[?25h")
    os.write(2, b"Stopped.\n")
    os._exit(STOPPED)


def leave(status: int) -> NoReturn:
    """End the process without waiting for any of its threads."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(status)
