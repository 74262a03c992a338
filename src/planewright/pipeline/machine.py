"""What a run used of the machine, and on what it ran: for `run.json` and `planewright doctor`."""

import importlib.metadata
import os
import platform
import re
import sys

import planewright


def peak_memory_bytes() -> int | None:
    """The largest amount of memory that this process has held so far, or None where the system does not say."""
    if sys.platform == "win32":
        return None
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
