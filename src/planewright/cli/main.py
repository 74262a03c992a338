"""The command line's door: Ctrl-C works from the first moment, and every error becomes a sentence and an exit status."""

import os
import sys
import tempfile
import traceback
from typing import NoReturn

from planewright.cli.interrupt import STOPPED, install, leave
from planewright.errors import Cancelled, InputError, PlanewrightError

LONGEST_MESSAGE = 2000
"""Characters; ids and names in a message come from files and may be long."""


def main() -> NoReturn:
    """Run the command line and leave with its exit status."""
    install()
    status = run()
    if status == STOPPED:
        # Python's own way out waits for the threads of decoders and kernels: up to a second on a busy machine, after the answer was given.
        leave(STOPPED)
    sys.exit(status)


def run() -> int:
    """Run the command that `sys.argv` names; its exit status."""
    # The one place where modules of this package are imported late: `install()` must come first, so that Ctrl-C works while they load.
    from planewright.cli.app import app

    try:
        app(prog_name="planewright")
    except Cancelled as stop:
        say(str(stop) or "Stopped.")
        return STOPPED
    except PlanewrightError as error:
        say(str(error))
        return error.exit_status
    except SystemExit as done:
        return done.code if isinstance(done.code, int) else int(done.code is not None)
    except OSError as error:
        # A path that the system refuses to look at, such as a name that is too long. Files that are read or written have their own words.
        if error.filename is None:
            return unexpected(error)
        say(f"{error.filename}: {error.strerror}. Check the path.")
        return InputError.exit_status
    except Exception as error:
        return unexpected(error)
    return 0


def unexpected(error: Exception) -> int:
    """Ask for a report of an error that nobody foresaw; the details go to a file."""
    if os.environ.get("PLANEWRIGHT_DEBUG") == "1":
        traceback.print_exc()
        return 1
    with tempfile.NamedTemporaryFile("w", prefix="planewright-", suffix=".log", delete=False, encoding="utf-8", errors="replace") as log:
        log.write("".join(traceback.format_exception(error)))
    say(f"planewright met an error that it did not expect ({type(error).__name__}); please report it together with the details in {log.name}")
    return 1


def say(message: str) -> None:
    """One message to standard error, as plain text: control characters are shown, not obeyed, and its length is bounded."""
    shown = "".join(character if character.isprintable() or character == "\n" else repr(character)[1:-1] for character in message)
    if len(shown) > LONGEST_MESSAGE:
        shown = f"{shown[: LONGEST_MESSAGE // 2]} ... {shown[-LONGEST_MESSAGE // 2 :]}"
    encoding = sys.stderr.encoding or "utf-8"
    print(shown.encode(encoding, "backslashreplace").decode(encoding), file=sys.stderr)  # noqa: T201
