"""A small model, and the Khronos validator."""

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planewright.geometry.rigid import rotations_from_vectors
from planewright.model.planar_model import FaceMesh, PlanarModel

HOSTILE = ["roof front", 'a"b\\c', "</script><b>", "new\nline\rf 1 2 3", "../../etc/passwd", "\u202eübung 屋根", "", "#", "0"]
"""Names that files in the wild could carry; the sketch allows any text that is not empty."""

TOOLS = Path(__file__).parents[1] / "tools"


def box_model(names: list[str], seed: int = 0, **changes: Any) -> PlanarModel:
    """One square or pentagon with collinear corners for each name, anywhere, over a smooth atlas."""
    rng = np.random.default_rng(seed)
    faces: list[FaceMesh] = []
    for i, name in enumerate(names):
        frame, origin = rotations_from_vectors(rng.normal(size=(1, 3)))[0], rng.normal(size=3) * 2
        flat = np.array([[0, 0], [2, 0], [2, 1], [0, 1]] if i % 2 else [[0, 0], [1, 0], [2, 0], [2, 1], [0.5, 2]], dtype=np.float64)
        triangles = [[0, 1, 2], [0, 2, 3]] if i % 2 else [[0, 1, 3], [1, 2, 3], [0, 3, 4]]
        faces.append(FaceMesh(name, frame[2], flat @ frame[:2] + origin, np.array(triangles), 0.1 + 0.35 * flat))
    y, x = np.mgrid[0:48, 0:80]
    atlas = np.stack([3 * x, 5 * y, 120 + 40 * np.sin(x / 9)], axis=-1).clip(0, 255).astype(np.uint8)
    inferred = np.zeros((48, 80), dtype=bool)
    inferred[10:20, 30:47] = True
    values: dict[str, Any] = {"unit": None, "world_up": np.array([0.0, 0.0, 1.0]), "inferred": inferred} | changes
    return PlanarModel(faces=tuple(faces), atlas=atlas, **values)


@pytest.fixture(scope="session")
def make_model() -> Callable[..., PlanarModel]:
    return box_model


@pytest.fixture(scope="session")
def hostile_names() -> list[str]:
    return HOSTILE


@pytest.fixture(scope="session")
def khronos(request: pytest.FixtureRequest) -> Callable[[Path], dict[str, Any]]:
    """The report of the Khronos validator on a file; installed once by npm into pytest's cache."""

    def unavailable(reason: str) -> None:
        if os.environ.get("CI"):
            pytest.fail(f"The Khronos validator must run in CI: {reason}")
        pytest.skip(f"The Khronos validator is not available: {reason}")

    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        unavailable("Node.js with npm is not on the PATH")
    folder = Path(request.config.cache.mkdir("gltf-validator"))
    for name in ("package.json", "package-lock.json", ".npmrc", "validate_gltf.js"):
        shutil.copy(TOOLS / name, folder / name)
    lock = (TOOLS / "package-lock.json").read_bytes()
    installed = folder / "installed-from.json"
    if not installed.exists() or installed.read_bytes() != lock:
        done = subprocess.run([str(npm), "ci", "--ignore-scripts", "--no-audit", "--no-fund"], cwd=folder, capture_output=True, text=True, encoding="utf-8")
        if done.returncode != 0:
            unavailable(f"npm ci failed: {done.stderr[-300:]}")
        installed.write_bytes(lock)

    def validate(path: Path) -> dict[str, Any]:
        done = subprocess.run([str(node), "validate_gltf.js", str(path.resolve())], cwd=folder, capture_output=True, text=True, encoding="utf-8", check=True)
        return json.loads(done.stdout)

    return validate
