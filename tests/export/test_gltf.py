"""Binary glTF: valid by the Khronos validator, the same in an independent reader, and back in our own."""

import io
from pathlib import Path

import numpy as np
import pygltflib
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from planewright.errors import OutputError, ResultError
from planewright.export.gltf import encode_glb, read_glb, write_glb


def values(document: pygltflib.GLTF2, index: int, kind: str) -> np.ndarray:
    accessor = document.accessors[index]
    view = document.bufferViews[accessor.bufferView]
    data = document.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    return np.frombuffer(data, kind).reshape(accessor.count, -1)


def test_another_reader_finds_the_same_faces_and_texture(make_model, tmp_path: Path) -> None:
    model = make_model(["front", "left", "roof"])
    write_glb(model, tmp_path / "model.glb")
    document = pygltflib.GLTF2().load(str(tmp_path / "model.glb"))
    assert [node.name for node in document.nodes] == ["front", "left", "roof"]
    for node, face in zip(document.nodes, model.faces, strict=True):
        (part,) = document.meshes[node.mesh].primitives
        x, y, z = values(document, part.attributes.POSITION, "<f4").T
        # z up becomes y up: (x, y, z) -> (x, z, -y).
        assert_allclose(np.stack([x, -z, y], axis=1), face.vertices, atol=1e-6)
        x, y, z = values(document, part.attributes.NORMAL, "<f4").T
        assert_allclose(np.stack([x, -z, y], axis=1), np.tile(face.normal, (len(face.vertices), 1)), atol=1e-6)
        assert_allclose(values(document, part.attributes.TEXCOORD_0, "<f4"), face.uv, atol=1e-7)
        assert_array_equal(values(document, part.indices, "<u2").reshape(-1, 3), face.triangles)
    view = document.bufferViews[document.images[0].bufferView]
    image = np.array(Image.open(io.BytesIO(document.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength])))
    assert np.sqrt(np.mean((image.astype(float) - model.atlas) ** 2)) < 2.5
    (sampler,) = document.samplers
    assert sampler.wrapS == sampler.wrapT == pygltflib.CLAMP_TO_EDGE


@pytest.mark.parametrize("case", ["plain", "hostile", "empty", "centimetres", "up unknown"])
def test_the_khronos_validator_has_nothing_to_say(make_model, hostile_names, khronos, tmp_path: Path, case: str) -> None:
    model = {
        "plain": lambda: make_model(["a", "b", "c"]),
        "hostile": lambda: make_model(hostile_names),
        "empty": lambda: make_model([]),
        "centimetres": lambda: make_model(["a"], unit="cm"),
        "up unknown": lambda: make_model(["a"], world_up=None),
    }[case]()
    write_glb(model, tmp_path / "model.glb")
    report = khronos(tmp_path / "model.glb")
    # An image whose sides are not powers of two is worth an information; only WebGL 1 minded.
    messages = [message for message in report["issues"]["messages"] if message["code"] != "IMAGE_NPOT_DIMENSIONS"]
    assert messages == []


def test_our_own_reader_gives_the_model_back(make_model, hostile_names, tmp_path: Path) -> None:
    for unit, up, view_up in (("cm", [0.6, 0.0, 0.8], None), (None, None, [0.0, -1.0, 0.0]), ("m", [0.0, 0.0, 1.0], None)):
        model = make_model(hostile_names, unit=unit, world_up=None if up is None else np.array(up), view_up=None if view_up is None else np.array(view_up))
        write_glb(model, tmp_path / "model.glb")
        back = read_glb(tmp_path / "model.glb")
        assert [face.id for face in back.faces] == hostile_names
        assert back.unit == unit
        for face, found in zip(model.faces, back.faces, strict=True):
            assert_allclose(found.vertices, face.vertices, atol=2e-6)
            assert_allclose(found.normal, face.normal, atol=1e-6)
            assert_allclose(found.uv, face.uv, atol=1e-6)
            assert_array_equal(found.triangles, face.triangles)
        assert_array_equal(back.inferred, model.inferred)
        assert (back.world_up is None) == (up is None)
        assert_allclose(back.world_up if up is not None else back.view_up, up if up is not None else view_up, atol=1e-12)


def test_lengths_are_metres_where_a_unit_is_known(make_model, tmp_path: Path) -> None:
    plain = pygltflib.GLTF2().load_from_bytes(encode_glb(make_model(["a"])))
    inches = pygltflib.GLTF2().load_from_bytes(encode_glb(make_model(["a"], unit="in")))
    assert_allclose(values(inches, 0, "<f4"), 0.0254 * values(plain, 0, "<f4"), rtol=1e-6)


def test_the_same_model_gives_the_same_bytes(make_model) -> None:
    assert encode_glb(make_model(["a", "b"])) == encode_glb(make_model(["a", "b"]))


def test_damage_is_told_and_not_guessed(make_model, tmp_path: Path) -> None:
    path = tmp_path / "model.glb"
    good = encode_glb(make_model(["a", "b"]))
    for bad in (b"", b"glTF", good[:-5], good[:200], good.replace(b"planewright", b"someoneelse"), b"\0" + good[1:]):
        path.write_bytes(bad)
        with pytest.raises(ResultError, match=r"model\.glb"):
            read_glb(path)
    with pytest.raises(ResultError):
        read_glb(tmp_path / "absent.glb")


def test_a_folder_that_is_not_there_is_told(make_model, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="nowhere"):
        write_glb(make_model(["a"]), tmp_path / "nowhere" / "model.glb")
