"""What a run used of the machine, and on what it ran: for `run.json` and `planewright doctor`."""

import contextlib
import importlib.metadata
import os
import platform
import re
import sys
from pathlib import Path

import planewright


def peak_memory_bytes() -> int | None:
    """The largest amount of memory that this process has held so far, or None where the system does not say.

    Linux counts the program that started this one in `ru_maxrss`, up to the moment of `exec`; its status file does not.
    """
    if sys.platform == "win32":
        return None
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    import resource  # exists on POSIX only

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def requirements() -> list[str]:
    """Names of the packages that planewright needs, without extras."""
    lines = importlib.metadata.requires("planewright") or []
    return sorted((re.split(r"[^A-Za-z0-9._-]", line)[0] for line in lines if "extra ==" not in line), key=str.lower)


def version_of(package: str) -> str | None:
    """The installed version, or None."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def versions() -> dict[str, str | None]:
    """Versions of planewright, Python and what planewright stands on."""
    return {"planewright": planewright.__version__, "python": platform.python_version()} | {name: version_of(name) for name in requirements()}


def machine() -> dict[str, str | int | None]:
    """System, processor and number of cores; nothing that names the machine or its owner."""
    return {"system": platform.system(), "release": platform.release(), "processor": platform.machine(), "cores": os.cpu_count()}
