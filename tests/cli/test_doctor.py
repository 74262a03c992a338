"""`planewright doctor` says what is there and what is missing."""

import pytest

import planewright as package
from planewright.cli import doctor


def test_it_lists_every_requirement_with_its_version(planewright) -> None:
    outcome = planewright("doctor")
    assert outcome.status == 0
    assert f"planewright                     {package.__version__}" in outcome.out
    for name in ("numpy", "opencv-contrib-python-headless", "av", "numba"):
        assert name in outcome.out
    assert "Everything" in outcome.out


def test_a_missing_package_is_named_with_the_way_to_get_it(planewright, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "requirements", lambda: ["numpy", "no-such-package"])
    monkeypatch.setattr(doctor, "versions", lambda: {"numpy": "2.0", "no-such-package": None})
    outcome = planewright("doctor")
    assert outcome.status == 0
    assert "pip install --force-reinstall no-such-package" in outcome.out
