"""The report is one page of text and pictures: nothing in it runs, is fetched, or is taken for markup."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from planewright.pipeline.report import make_report
from planewright.pipeline.result import Result
from planewright.planes.planar_scene import PlanarScene
from planewright.synthetic.clip import SyntheticClip

PAGE = ("html", "head", "meta", "title", "style", "body", "main", "header", "p", "h1", "h2", "section", "div", "span", "b", "i", "ul", "li", "figure")
PARTS = ("svg", "image", "path", "circle", "text", "figcaption", "table", "thead", "tbody", "tr", "th", "td", "footer")
ELEMENTS = {*PAGE, *PARTS}


class Reader(HTMLParser):
    """Elements, attributes and text of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.elements: set[str] = set()
        self.attributes: list[tuple[str, str]] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.add(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_data(self, data: str) -> None:
        self.text += data


def read(page: bytes) -> Reader:
    reader = Reader()
    reader.feed(page.decode("utf-8"))
    return reader


def page(result: Result, clip: SyntheticClip) -> Reader:
    return read(make_report(clip.frames, result, [("features", "1.2 s")], [("unit", "scene units"), ("seed", "0")]))


def test_the_page_shows_the_sketch_the_model_over_the_clip_and_the_model_alone(true_result: Result, scene_clip: SyntheticClip) -> None:
    reader = page(true_result, scene_clip)
    images = [value for name, value in reader.attributes if name == "href"]
    assert all(re.fullmatch(r"data:image/jpeg;base64,[A-Za-z0-9+/=]+", image) for image in images)
    assert len(images) == 2 + 9 + 6
    for words in ("Frame 0", "Frame 23", "The camera's path from above", "Adjacency", "3.4 degrees off.", "A warning."):
        assert words in reader.text


@pytest.mark.parametrize(
    "text", ["<script>alert(1)</script>", "\"'><img src=x onerror=alert(1)>", "</style></svg><script>", "{{ 7 * 7 }}", "\ud800", "x" * 10_000]
)
def test_names_from_files_stay_text(renamed, scene_clip: SyntheticClip, text: str) -> None:
    reader = page(renamed(text), scene_clip)
    assert reader.elements <= ELEMENTS
    assert not [name for name, _ in reader.attributes if name.startswith("on") or name == "src"]
    assert text[:10].encode("utf-8", "replace").decode() in reader.text


def test_control_characters_show_as_such(renamed, scene_clip: SyntheticClip) -> None:
    text = page(renamed("a\x00b\x1b[31m\u202ec\x85"), scene_clip).text
    assert not set(text) & set("\x00\x1b\u202e\x85")
    assert "a\ufffdb\ufffd[31m\ufffdc\ufffd" in text


def test_a_result_with_nothing_known_still_has_a_page(true_result: Result, scene_clip: SyntheticClip) -> None:
    scene = true_result.scene
    nothing = PlanarScene(
        scene.sketch,
        np.full_like(scene.points, np.nan),
        np.zeros_like(scene.point_known),
        np.full_like(scene.point_covariance, np.nan),
        np.full_like(scene.normals, np.nan),
        np.full_like(scene.offsets, np.nan),
        np.zeros_like(scene.face_known),
        np.full_like(scene.plane_covariance, np.nan),
    )
    empty = replace(
        true_result, structure=replace(true_result.structure, scene=nothing, relations=(), adjacency=()), model=replace(true_result.model, faces=())
    )
    assert "not determined" in page(empty, scene_clip).text
