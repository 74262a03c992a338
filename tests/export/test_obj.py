"""OBJ, as an independent reader sees it."""

from pathlib import Path

import numpy as np
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from planewright.export.obj import one_word, write_obj


def test_another_reader_finds_the_same_triangles_texture_coordinates_and_image(make_model, tmp_path: Path) -> None:
    model = make_model(["front", "left", "roof"])
    write_obj(model, tmp_path / "house.obj")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["house.mtl", "house.obj", "house.png"]
    found = trimesh.load(tmp_path / "house.obj", force="mesh", process=False, maintain_order=True)
    rotated = np.concatenate([face.vertices[face.triangles] for face in model.faces])[..., [0, 2, 1]] * [1, 1, -1]
    assert_allclose(found.triangles, rotated, atol=1e-7)
    # Seen from the front the corners are counter-clockwise.
    normals = np.concatenate([np.tile(face.normal, (len(face.triangles), 1)) for face in model.faces])[:, [0, 2, 1]] * [1, 1, -1]
    assert (np.einsum("ij,ij->i", found.face_normals, normals) > 0.999).all()
    uv = np.concatenate([face.uv[face.triangles] for face in model.faces])
    assert_allclose(found.visual.uv[found.faces] * [1, -1] + [0, 1], uv, atol=1e-7)
    assert_array_equal(np.array(Image.open(tmp_path / "house.png")), model.atlas)


def test_no_name_can_add_a_line_or_leave_the_folder(make_model, hostile_names, tmp_path: Path) -> None:
    model = make_model(hostile_names)
    path = tmp_path / "my model.obj"
    write_obj(model, path)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["my model.obj", "my_model.mtl", "my_model.png"]
    lines = path.read_text(encoding="utf-8").split("\n")
    words = [line.split(" ") for line in lines[:-1]]
    assert {line[0] for line in words} == {"mtllib", "usemtl", "o", "v", "vt", "vn", "f"}
    assert [len(line) for line in words if line[0] == "o"] == [2] * len(hostile_names)
    assert sum(line[0] == "v" for line in words) == sum(len(face.vertices) for face in model.faces)


def test_ordinary_names_stay_as_they_are() -> None:
    assert one_word("roof_front-2.b") == "roof_front-2.b"
    assert one_word("Dachfläche") == "Dachfläche"
    assert one_word("a b\nc") == "a_b_c"
    assert one_word("") == "_"
    assert len(one_word("x" * 10_000)) < 200
