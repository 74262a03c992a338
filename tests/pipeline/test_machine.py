"""What a run says about the machine."""

import getpass
import platform
import sys

import numpy as np
import pytest

from planewright.pipeline.machine import machine, peak_memory_bytes, versions

ROUGHLY = 2**23
"""Bytes: the system counts each processor's pages apart, and adds them up now and then."""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not say")
def test_the_peak_of_memory_rises_with_what_is_held_and_does_not_fall() -> None:
    size = 256 * 2**20
    before = peak_memory_bytes()
    held = np.ones(size // 8)
    during = peak_memory_bytes()
    del held
    after = peak_memory_bytes()
    assert before is not None and during is not None and after is not None
    assert during >= max(size, before) - ROUGHLY
    assert after >= during - ROUGHLY


def test_nothing_names_the_machine_or_its_owner() -> None:
    told = f"{machine()} {versions()}"
    for name in (platform.node(), getpass.getuser()):
        assert len(name) < 5 or name not in told
    assert versions()["numpy"] is not None
