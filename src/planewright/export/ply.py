"""Writes binary PLY: NAME.ply with NAME.png beside it. By hand: one header and two arrays, and no library writes texture coordinates the common way."""

from pathlib import Path

import cv2
import numpy as np

from planewright.arrays import UInt8
from planewright.export.atomic import write_whole
from planewright.export.obj import one_word, png
from planewright.model.planar_model import FaceMesh, PlanarModel


def write_ply(model: PlanarModel, path: Path) -> None:
    """The model as PLY: world coordinates and unit as they are (z up once up is known), for surveying and analysis. Raises OutputError."""
    for file, data in encode_ply(model, path).items():
        write_whole(file, data)


def encode_ply(model: PlanarModel, path: Path) -> dict[Path, bytes]:
    """The files of `write_ply`, the PLY last.

    Each vertex has its normal, its texture coordinates (s, t; t upwards, as Blender and MeshLab read them; the image is named in a comment), and the
    average colour of its face for the programs that know no texture.
    """
    stem = one_word(path.stem)
    kind = np.dtype(
        [(name, "<f8") for name in "xyz"] + [(name, "<f4") for name in ("nx", "ny", "nz", "s", "t")] + [(c, "u1") for c in ("red", "green", "blue")]
    )
    vertices = np.zeros(sum(len(face.vertices) for face in model.faces), dtype=kind)
    triangles = np.zeros(sum(len(face.triangles) for face in model.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"] = 3
    vertex = triangle = 0
    for face in model.faces:
        here = vertices[vertex : vertex + len(face.vertices)]
        for names, values in (("xyz", face.vertices), (("nx", "ny", "nz"), np.tile(face.normal, (len(here), 1)))):
            for axis, name in enumerate(names):
                here[name] = values[:, axis]
        here["s"], here["t"] = face.uv[:, 0], 1 - face.uv[:, 1]
        for name, value in zip(("red", "green", "blue"), average_color(face, model), strict=True):
            here[name] = value
        triangles["corners"][triangle : triangle + len(face.triangles)] = face.triangles + vertex
        vertex += len(face.vertices)
        triangle += len(face.triangles)
    types = {"<f8": "double", "<f4": "float", "|u1": "uchar"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment TextureFile {stem}.png",
        f"element vertex {len(vertices)}",
        *(f"property {types[kind[name].str]} {name}" for name in kind.names or ()),
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    return {path.with_name(f"{stem}.png"): png(model.atlas), path: ("\n".join(header) + "\n").encode("ascii") + vertices.tobytes() + triangles.tobytes()}


def average_color(face: FaceMesh, model: PlanarModel) -> UInt8[np.ndarray, "3"]:
    """The mean of the texture within a face."""
    height, width = model.inferred.shape
    mask = np.zeros((height, width), dtype=np.uint8)
    # Triangle by triangle, since fillPoly leaves out what is covered twice; 4 bits of fraction.
    for corners in np.rint((face.uv * [width, height] - 0.5) * 16).astype(np.int32)[face.triangles]:
        cv2.fillPoly(mask, [corners], 1, shift=4)
    inside = mask > 0
    return model.atlas[inside].mean(axis=0).round().astype(np.uint8) if inside.any() else np.full(3, 128, dtype=np.uint8)
