"""What every test shares: one thread of linear algebra, and clips with known truth, each drawn once a test run."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

from planewright.synthetic.houses import demo_scene
from planewright.synthetic.write import write_clip


@pytest.fixture(scope="session", autouse=True)
def one_thread_of_linear_algebra() -> Iterator[None]:
    """As `reconstruct` does it: on two busy cores the small systems of the structured adjustment take 55 s with two threads and 2.2 s with one."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="session")
def small_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with clip.mp4, sketch.json and truth.json: the shed in 24 frames of 320x180, which is enough for all but two corners."""
    folder = tmp_path_factory.mktemp("small_clip")
    write_clip(demo_scene(24, (320, 180)), folder)
    return folder
