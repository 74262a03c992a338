from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from PIL import Image

from planewright.errors import VideoError
from planewright.video.clip import open_clip

Read = Callable[[np.ndarray], int]
QUADRANTS = np.full((48, 64, 3), 20, dtype=np.uint8)
QUADRANTS[:24, :32, 0] = QUADRANTS[:24, 32:, 1] = QUADRANTS[24:, :32, 2] = 240


def test_a_folder_of_images_is_a_clip_in_natural_order(tmp_path: Path, numbered: Callable[..., np.ndarray], number_in: Read) -> None:
    for number in range(12):
        Image.fromarray(numbered(number)).save(tmp_path / f"frame_{number}.png")
    (tmp_path / "notes.txt").write_text("no image")
    clip = open_clip(tmp_path)
    assert clip.info.num_frames == 12
    assert clip.image_size == (96, 64)
    assert [number_in(image) for _, image in clip.gray(clip.numbers)] == list(range(12))
    assert_array_equal(next(clip.color([10]))[1], numbered(10))
    assert clip.info.warnings == ()


def test_image_folders_that_are_off_are_told(tmp_path: Path, numbered: Callable[..., np.ndarray]) -> None:
    for number in (1, 2, 3, 5, 6):
        Image.fromarray(numbered(number)).save(tmp_path / f"{number:03d}.jpg")
    assert any("skip between 003.jpg and 005.jpg" in sentence for sentence in open_clip(tmp_path).info.warnings)
    Image.fromarray(numbered(7, (48, 64))).save(tmp_path / "007.jpg")
    with pytest.raises(VideoError, match=r"007\.jpg \(frame 5\) has 48x64 pixels"):
        open_clip(tmp_path)
    (tmp_path / "007.jpg").write_bytes(b"\xff\xd8 nothing")
    with pytest.raises(VideoError, match=r"007\.jpg is not an image"):
        open_clip(tmp_path)


def test_a_damaged_image_is_named_when_it_is_read(tmp_path: Path, numbered: Callable[..., np.ndarray]) -> None:
    for number in range(3):
        Image.fromarray(numbered(number)).save(tmp_path / f"{number}.png")
    data = (tmp_path / "1.png").read_bytes()
    (tmp_path / "1.png").write_bytes(data[: len(data) // 2])
    clip = open_clip(tmp_path)
    with pytest.raises(VideoError, match=r"1\.png \(frame 1\) is damaged"):
        list(clip.gray(clip.numbers))


def test_image_kinds_and_exif_turns(tmp_path: Path) -> None:
    turned = Image.Exif()
    turned[0x0112] = 6  # the camera was held upright: turn by 90 degrees with the clock
    Image.fromarray(QUADRANTS).save(tmp_path / "1.png", exif=turned)
    clip = open_clip(tmp_path)
    assert clip.image_size == (48, 64)
    assert_array_equal(next(clip.color([0]))[1], np.rot90(QUADRANTS, -1))
    (tmp_path / "1.png").unlink()
    Image.fromarray(np.full((64, 48), 32896, dtype=np.uint16)).save(tmp_path / "1.png")
    Image.fromarray(np.full((64, 48), 77, dtype=np.uint8)).save(tmp_path / "2.png")
    clip = open_clip(tmp_path)
    assert [int(image[5, 5]) for _, image in clip.gray([0, 1])] == [128, 77]
    assert next(clip.color([1]))[1][5, 5].tolist() == [77, 77, 77]
