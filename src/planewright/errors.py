"""The error tree.

PlanewrightError
├── UsageError      the command or call cannot be carried out as asked: a finished result is in the way (exit status 2)
├── InputError      what was handed in cannot be used (exit status 3)
│   ├── VideoError      the clip cannot be read
│   ├── SketchError     the sketch cannot describe a planar model as it stands
│   ├── OutputError     the result cannot be written
│   └── ResultError     a result file is missing, damaged, or newer than this version
├── GeometryError   the views do not determine the answer: no parallax, rotation only (exit status 4)
└── Cancelled       the person stopped the work (exit status 130)

A message says what is wrong, where, and what to do next, in plain sentences.
"""


class PlanewrightError(Exception):
    """Base of all errors that planewright raises on purpose; its text is meant for the person who runs it."""

    exit_status: int = 1


class UsageError(PlanewrightError):
    """The command or call cannot be carried out as asked."""

    exit_status = 2


class InputError(PlanewrightError):
    """What was handed in cannot be used."""

    exit_status = 3


class VideoError(InputError):
    """The clip cannot be read."""


class SketchError(InputError):
    """The sketch cannot describe a planar model as it stands."""


class OutputError(InputError):
    """The result cannot be written."""


class ResultError(InputError):
    """A result file is missing, damaged, or newer than this version."""


class GeometryError(PlanewrightError):
    """The views do not determine the answer."""

    exit_status = 4


class Cancelled(PlanewrightError):
    """The person stopped the work."""

    exit_status = 130
