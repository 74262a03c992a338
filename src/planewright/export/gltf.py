"""Writes and reads binary glTF 2.0 (Khronos specification 2.0.1): one file with geometry and texture.

Written by hand: it is one JSON object and one block of bytes, and the libraries at hand add what does not belong into it (a generator string with a
version, buffer views without targets, samplers that repeat) or leave out what we want (names, an unlit material, a clamped sampler).
"""

import base64
import json
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from planewright.arrays import Bool, ColorImage, Float, Int, UInt8
from planewright.errors import ResultError
from planewright.export.atomic import write_whole
from planewright.export.up import metres_per_unit, y_up_from_world
from planewright.model.planar_model import FaceMesh, PlanarModel

JPEG_QUALITY = 92
"""Without chroma subsampling. An atlas of 18 faces (1127 x 573) took 150 kB at 45 dB, and 785 kB as PNG; the clip had been compressed harder before."""

FLOAT, UNSIGNED_SHORT, UNSIGNED_INT = 5126, 5123, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
LINEAR, LINEAR_MIPMAP_LINEAR, CLAMP_TO_EDGE = 9729, 9987, 33071
MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942


def write_glb(model: PlanarModel, path: Path) -> None:
    """The model as binary glTF: y up, metres where a length is known. The same model gives the same bytes. Raises OutputError."""
    write_whole(path, encode_glb(model))


def encode_glb(model: PlanarModel) -> bytes:
    """The bytes of `write_glb`.

    Each face is a node with a mesh of its own, named by its id, so that it can be picked in a viewer; all share one material and one texture. The
    material is unlit (KHR_materials_unlit), since the light of the room is in the texture already, and double-sided, since a model made from a clip is
    seldom closed and would vanish from behind.
    """
    binary = _Binary()
    rotation, scale = y_up_from_world(model), metres_per_unit(model)
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "planewright"},
        "extras": {
            "planewright": {"y_up_from_world": rotation.tolist(), "unit": model.unit, "up_known": model.world_up is not None, **_inferred(model.inferred)}
        },
        "scene": 0,
        "scenes": [{"name": "planewright", "nodes": list(range(len(model.faces)))} if model.faces else {"name": "planewright"}],
    }
    if model.faces:
        meshes: list[dict[str, Any]] = []
        for face in model.faces:
            count = len(face.vertices)
            positions = binary.add_vectors((face.vertices @ rotation.T * scale).astype(np.float32), bounds=True)
            normals = binary.add_vectors(_unit(np.tile(rotation @ face.normal, (count, 1))))
            uv = binary.add_vectors(face.uv.astype(np.float32))
            indices = binary.add_indices(face.triangles, count)
            attributes = {"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uv}
            meshes.append({"name": face.id, "primitives": [{"attributes": attributes, "indices": indices, "material": 0}]})
        document |= {
            "extensionsUsed": ["KHR_materials_unlit"],
            "nodes": [{"name": face.id, "mesh": i} for i, face in enumerate(model.faces)],
            "meshes": meshes,
            "materials": [
                {
                    "name": "texture",
                    "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0},
                    "doubleSided": True,
                    "extensions": {"KHR_materials_unlit": {}},
                }
            ],
            "textures": [{"source": 0, "sampler": 0}],
            "samplers": [{"magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE}],
            "images": [{"name": "atlas", "mimeType": "image/jpeg", "bufferView": binary.add_bytes(_jpeg(model.atlas))}],
            "accessors": binary.accessors,
            "bufferViews": binary.views,
            "buffers": [{"byteLength": len(binary.data)}],
        }
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode("utf-8")
    chunks = [_chunk(JSON_CHUNK, text + b" " * (-len(text) % 4))]
    if binary.data:
        chunks.append(_chunk(BINARY_CHUNK, bytes(binary.data)))
    body = b"".join(chunks)
    return struct.pack("<III", MAGIC, 2, 12 + len(body)) + body


class _Binary:
    """The block of bytes, and the views and accessors that describe it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add_bytes(self, data: bytes, target: int | None = None) -> int:
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)} | ({} if target is None else {"target": target}))
        self.data += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def add_vectors(self, values: Float[np.ndarray, "vertices axes"], *, bounds: bool = False) -> int:
        values = values.astype("<f4")
        view = self.add_bytes(values.tobytes(), ARRAY_BUFFER)
        accessor: dict[str, Any] = {"bufferView": view, "componentType": FLOAT, "count": len(values), "type": f"VEC{values.shape[1]}"}
        if bounds:
            accessor |= {"min": [float(v) for v in values.min(axis=0)], "max": [float(v) for v in values.max(axis=0)]}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def add_indices(self, triangles: Int[np.ndarray, "triangles 3"], num_vertices: int) -> int:
        # The largest value of a type restarts a strip and must not be used as an index.
        short = num_vertices < 65535
        view = self.add_bytes(triangles.astype("<u2" if short else "<u4").tobytes(), ELEMENT_ARRAY_BUFFER)
        self.accessors.append({"bufferView": view, "componentType": UNSIGNED_SHORT if short else UNSIGNED_INT, "count": triangles.size, "type": "SCALAR"})
        return len(self.accessors) - 1


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _chunk(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", len(data), kind) + data


def _jpeg(image: ColorImage) -> bytes:
    full_chroma = int(cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
    options = [int(cv2.IMWRITE_JPEG_QUALITY), JPEG_QUALITY, int(cv2.IMWRITE_JPEG_SAMPLING_FACTOR), full_chroma]
    return cv2.imencode(".jpg", image[..., ::-1], options)[1].tobytes()


def _inferred(mask: Bool[np.ndarray, "height width"]) -> dict[str, str]:
    """The mask of filled-in texels as a small PNG beside the texture: viewers ignore it, and our own reader gets it back."""
    if not mask.any():
        return {}
    packed: UInt8[np.ndarray, "bytes"] = cv2.imencode(".png", mask.astype(np.uint8) * 255, [int(cv2.IMWRITE_PNG_BILEVEL), 1])[1]
    return {"inferred_png": base64.b64encode(packed.tobytes()).decode("ascii")}


def read_glb(path: Path) -> PlanarModel:
    """A model that `write_glb` wrote, in world coordinates and its own unit again, to the precision of 32-bit floats and of the JPEG texture.

    Raises ResultError where the file is missing, damaged, or was not written by planewright.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ResultError(f"{path} cannot be read: {error.strerror or error}. Run planewright reconstruct again.") from error
    try:
        return _decode(data)
    except (KeyError, IndexError, ValueError, TypeError, struct.error, cv2.error) as error:
        raise ResultError(f"{path} is damaged or was not written by planewright. Run planewright reconstruct again.") from error


def _decode(data: bytes) -> PlanarModel:
    magic, version, length = struct.unpack_from("<III", data)
    if (magic, version, length) != (MAGIC, 2, len(data)):
        raise ValueError("not a whole glTF 2.0 file")
    text_length, kind = struct.unpack_from("<II", data, 12)
    document = json.loads(data[20 : 20 + text_length].decode("utf-8"))
    binary = data[28 + text_length :]
    extras = document["extras"]["planewright"]
    rotation = np.array(extras["y_up_from_world"], dtype=np.float64).reshape(3, 3)
    unit = extras["unit"]
    up = rotation[1].copy()
    known = bool(extras["up_known"])
    blank = PlanarModel((), np.full((1, 1, 3), 128, np.uint8), unit, up if known else None, np.zeros((1, 1), bool), None if known else up)
    if kind != JSON_CHUNK or not document.get("meshes"):
        return blank

    def array(index: int) -> Any:
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        kinds = {FLOAT: "<f4", UNSIGNED_SHORT: "<u2", UNSIGNED_INT: "<u4"}
        axes = {"VEC3": 3, "VEC2": 2, "SCALAR": 1}[accessor["type"]]
        values = np.frombuffer(binary, kinds[accessor["componentType"]], accessor["count"] * axes, view["byteOffset"])
        return values.reshape(-1, axes)

    faces: list[FaceMesh] = []
    for mesh in document["meshes"]:
        (part,) = mesh["primitives"]
        vertices = array(part["attributes"]["POSITION"]).astype(np.float64) @ rotation / metres_per_unit(blank)
        normal = rotation.T @ array(part["attributes"]["NORMAL"])[0].astype(np.float64)
        triangles = array(part["indices"]).astype(np.int64).reshape(-1, 3)
        if triangles.size and triangles.max() >= len(vertices):
            raise ValueError("an index beyond the vertices")
        faces.append(FaceMesh(str(mesh["name"]), normal, vertices, triangles, array(part["attributes"]["TEXCOORD_0"]).astype(np.float64)))
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    atlas = _image(binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]], cv2.IMREAD_COLOR)[..., ::-1]
    inferred = np.zeros(atlas.shape[:2], dtype=bool)
    if "inferred_png" in extras:
        inferred = _image(base64.b64decode(extras["inferred_png"]), cv2.IMREAD_GRAYSCALE) > 0
    return PlanarModel(tuple(faces), np.ascontiguousarray(atlas), unit, blank.world_up, inferred, blank.view_up)


def _image(data: bytes, mode: int) -> Any:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), mode)
    if image is None:
        raise ValueError("a damaged image")
    return image
