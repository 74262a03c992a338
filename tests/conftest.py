"""Clips with known truth that several rooms look at; each is drawn once a test run."""

from pathlib import Path

import pytest

from planewright.synthetic.houses import demo_scene
from planewright.synthetic.write import write_clip


@pytest.fixture(scope="session")
def small_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with clip.mp4, sketch.json and truth.json: the shed in 24 frames of 320x180, which is enough for all but two corners."""
    folder = tmp_path_factory.mktemp("small_clip")
    write_clip(demo_scene(24, (320, 180)), folder)
    return folder
