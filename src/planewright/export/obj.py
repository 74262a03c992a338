"""Writes Wavefront OBJ: NAME.obj with NAME.mtl and NAME.png beside it. By hand, since it is a few lines of text and names must be made safe."""

from pathlib import Path

import cv2
import numpy as np

from planewright.export.atomic import write_whole
from planewright.export.up import metres_per_unit, y_up_from_world
from planewright.model.planar_model import PlanarModel

LONGEST_WORD = 120
"""Characters of a name; many readers of OBJ take lines of limited length."""


def write_obj(model: PlanarModel, path: Path) -> None:
    """The model as OBJ, y up, in metres where a length is known; one object a face. Raises OutputError."""
    for file, data in encode_obj(model, path).items():
        write_whole(file, data)


def encode_obj(model: PlanarModel, path: Path) -> dict[Path, bytes]:
    """The files of `write_obj`. The OBJ comes last: whoever waits for it finds the others in place.

    The texture is a PNG: tools that read OBJ are often used to go on editing, and each saving of a JPEG would lose a little more.
    """
    stem = one_word(path.stem)
    rotation, scale = y_up_from_world(model), metres_per_unit(model)
    lines = [f"mtllib {stem}.mtl", "usemtl texture"]
    first = 1
    for number, face in enumerate(model.faces, 1):
        lines.append(f"o {one_word(face.id)}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in face.vertices @ rotation.T * scale + 0.0]
        # OBJ has v upwards.
        lines += [f"vt {u:.9g} {1 - v:.9g}" for u, v in face.uv]
        x, y, z = rotation @ face.normal + 0.0
        lines.append(f"vn {x:.9g} {y:.9g} {z:.9g}")
        lines += ["f " + " ".join(f"{corner}/{corner}/{number}" for corner in triangle) for triangle in face.triangles + first]
        first += len(face.vertices)
    material = ["newmtl texture", "Ka 1 1 1", "Kd 1 1 1", "Ks 0 0 0", "illum 1", f"map_Kd {stem}.png"]
    return {path.with_name(f"{stem}.png"): png(model.atlas), path.with_name(f"{stem}.mtl"): _text(material), path: _text(lines)}


def one_word(name: str) -> str:
    """A name that cannot be taken for anything else in a line of text: letters, digits, and `._-`; everything else becomes `_`."""
    word = "".join(letter if letter.isalnum() or letter in "._-" else "_" for letter in name[:LONGEST_WORD])
    return word or "_"


def png(image: np.ndarray) -> bytes:
    """An RGB image as PNG."""
    return cv2.imencode(".png", image[..., ::-1])[1].tobytes()


def _text(lines: list[str]) -> bytes:
    return ("\n".join(lines) + "\n").encode("utf-8")
