"""PLY, as an independent reader sees it."""

from pathlib import Path

import numpy as np
import trimesh
from numpy.testing import assert_allclose

from planewright.export.ply import average_color, write_ply


def test_another_reader_finds_world_coordinates_and_colors(make_model, tmp_path: Path) -> None:
    model = make_model(["front", "left", "roof"], unit="cm")
    write_ply(model, tmp_path / "house.ply")
    found = trimesh.load(tmp_path / "house.ply", process=False)
    assert_allclose(found.triangles, np.concatenate([face.vertices[face.triangles] for face in model.faces]), atol=1e-12)
    normals = np.concatenate([np.tile(face.normal, (len(face.triangles), 1)) for face in model.faces])
    assert (np.einsum("ij,ij->i", found.face_normals, normals) > 0.999).all()


def test_the_header_says_what_the_bytes_hold(make_model, hostile_names, tmp_path: Path) -> None:
    model = make_model(hostile_names)
    write_ply(model, tmp_path / "a b.ply")
    header, _, body = (tmp_path / "a b.ply").read_bytes().partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert "comment TextureFile a_b.png" in lines
    assert (tmp_path / "a_b.png").exists()
    num_vertices, num_triangles = (sum(len(part) for part in parts) for parts in ([f.vertices for f in model.faces], [f.triangles for f in model.faces]))
    assert f"element vertex {num_vertices}" in lines
    assert f"element face {num_triangles}" in lines
    # 3 doubles, 5 floats, 3 bytes a vertex; a count and 3 indices a triangle.
    assert len(body) == num_vertices * (24 + 20 + 3) + num_triangles * 13
    first = np.frombuffer(body, "<f8", 3)
    assert_allclose(first, model.faces[0].vertices[0], atol=0)


def test_the_color_of_a_face_is_the_average_of_its_texels(make_model) -> None:
    model = make_model(["only", "square"])
    square = model.faces[1]
    left, right = square.uv[:, 0].min() * 80, square.uv[:, 0].max() * 80
    color = average_color(square, model)
    assert abs(color[0] - 3 * ((left + right) / 2 - 0.5)) < 3


def test_an_empty_model_is_a_valid_file(make_model, tmp_path: Path) -> None:
    write_ply(make_model([]), tmp_path / "none.ply")
    assert b"element vertex 0\n" in (tmp_path / "none.ply").read_bytes()
