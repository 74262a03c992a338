import hashlib
import os
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planewright.errors import UsageError, VideoError
from planewright.video.clip import open_clip
from planewright.video.frame_range import FrameRange
from planewright.video.limits import VideoLimits

Write = Callable[..., Path]
Read = Callable[[np.ndarray], int]


def test_every_frame_comes_once_in_presentation_order(write_video: Write, number_in: Read) -> None:
    clip = open_clip(write_video(count=40, options={"bf": "2"}))
    assert clip.info.num_frames == 40
    assert clip.info.fps == 30.0
    assert clip.numbers == range(40)
    assert [(number, number_in(image)) for number, image in clip.gray(clip.numbers)] == [(number, number) for number in range(40)]


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("a.mp4", "libx264", {"bf": "2"}),
        ("a.mkv", "libx264", {"bf": "2"}),
        ("a.mov", "mpeg4", {}),
        ("a.avi", "mjpeg", {}),
        ("a.avi", "mpeg4", {"bf": "2"}),
        ("a.ts", "libx264", {"bf": "2"}),
        ("a.webm", "libvpx-vp9", {"cpu-used": "8", "deadline": "realtime"}),
        ("a.mp4", "libx265", {"x265-params": "log-level=none:pools=1:frame-threads=1"}),
    ],
)
def test_a_subset_is_the_same_as_reading_everything(write_video: Write, number_in: Read, name: str, codec: str, options: dict[str, str]) -> None:
    pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    clip = open_clip(write_video(name, 60, codec=codec, pix_fmt=pix_fmt, options=options))
    everything = dict(clip.gray(clip.numbers))
    assert [number_in(image) for image in everything.values()] == list(range(60))
    for wanted in ([59], [3, 31, 32, 58], [0, 50], range(40, 60, 7)):
        some = dict(clip.gray(wanted))
        assert list(some) == list(wanted)
        for number, image in some.items():
            assert_array_equal(image, everything[number])
    assert [number for number, _ in clip.color([7, 49])] == [7, 49]
    assert list(clip.color([])) == list(clip.gray([])) == []


def test_variable_frame_rate_keeps_numbers_and_times(write_video: Write, number_in: Read) -> None:
    stamps = np.cumsum([7, 20, 20, 60, 10, 90, 20, 21, 300, 5] * 5).tolist()
    clip = open_clip(write_video("a.mkv", 50, stamps=stamps))
    assert [number_in(image) for _, image in clip.gray(clip.numbers)] == list(range(50))
    # Matroska rounds to milliseconds.
    np.testing.assert_allclose(clip.info.times, (np.array(stamps) - stamps[0]) / 600, atol=2e-3)
    assert [number_in(image) for _, image in clip.gray([8, 37, 49])] == [8, 37, 49]
    assert abs(clip.info.fps - 49 * 600 / (stamps[-1] - stamps[0])) < 0.2


def test_stamps_that_repeat_do_not_hide_frames(write_video: Write, number_in: Read) -> None:
    clip = open_clip(write_video("a.mkv", 40, stamps=np.cumsum([20, 20, 0, 20] * 10).tolist(), codec="ffv1"))
    assert [(n, number_in(image)) for n, image in clip.gray([0, 2, 3, 18, 39])] == [(n, n) for n in (0, 2, 3, 18, 39)]
    assert clip.info.num_frames == 40
    assert any("do not increase" in sentence for sentence in clip.info.warnings)


QUADRANTS = np.full((48, 64, 3), 20, dtype=np.uint8)
QUADRANTS[:24, :32, 0] = QUADRANTS[:24, 32:, 1] = QUADRANTS[24:, :32, 2] = 240


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
@pytest.mark.parametrize("mirrored", [False, True])
def test_frames_are_turned_as_the_container_says(write_video: Write, degrees: int, mirrored: bool) -> None:
    path = write_video(images=[QUADRANTS] * 3, options={"crf": "5"}, prepare=lambda stream: stream.set_display_rotation(degrees, hflip=mirrored))
    expected = np.rot90(QUADRANTS, degrees // 90)
    expected = expected[:, ::-1] if mirrored else expected
    clip = open_clip(path)
    image = next(clip.color([1]))[1]
    assert clip.image_size == (expected.shape[1], expected.shape[0]) == (image.shape[1], image.shape[0])
    # Chroma at half resolution blurs the quadrants' borders, so their middles are compared.
    height, width = image.shape[:2]
    for y, x in [(height // 4, width // 4), (height // 4, 3 * width // 4), (3 * height // 4, width // 4), (3 * height // 4, 3 * width // 4)]:
        np.testing.assert_allclose(image[y, x].astype(float), expected[y, x], atol=12)
    gray = next(clip.gray([1]))[1]
    assert gray.shape == (height, width)
    assert gray.flags.c_contiguous


def test_pixels_that_are_not_square_are_stretched(write_video: Write) -> None:
    clip = open_clip(write_video(size=(96, 64), prepare=lambda stream: setattr(stream.codec_context, "sample_aspect_ratio", Fraction(4, 3))))
    assert clip.image_size == (128, 64)
    assert next(clip.gray([0]))[1].shape == (64, 128)


def test_odd_sizes_and_portrait(write_video: Write, number_in: Read) -> None:
    clip = open_clip(write_video("a.mp4", 4, size=(65, 99), pix_fmt="yuv444p"))
    assert clip.image_size == (65, 99)
    assert next(clip.color([3]))[1].shape == (99, 65, 3)
    assert number_in(next(clip.gray([3]))[1]) == 3


@pytest.mark.parametrize(
    ("pix_fmt", "codec"),
    [
        ("yuv420p10le", "libx265"),
        ("yuv422p10le", "libx264"),
        ("yuv444p", "libx264"),
        ("gray", "ffv1"),
        ("gray10le", "ffv1"),
        ("bgr0", "ffv1"),
        ("yuv411p", "ffv1"),
        ("yuv420p16le", "ffv1"),
    ],
)
def test_depths_and_layouts_give_the_same_grey(write_video: Write, numbered: Callable[..., np.ndarray], pix_fmt: str, codec: str) -> None:
    options = {"crf": "1", "x265-params": "log-level=none:pools=1:frame-threads=1"} if codec == "libx265" else {"crf": "1"} if codec == "libx264" else {}
    clip = open_clip(write_video("a.mkv", 3, pix_fmt=pix_fmt, codec=codec, options=options))
    image = next(clip.gray([2]))[1]
    assert image.dtype == np.uint8
    assert np.abs(image.astype(float) - numbered(2)[..., 0]).mean() < 2.0
    color = next(clip.color([2]))[1]
    assert np.abs(color.astype(float) - numbered(2)).mean() < 2.0


def test_transparency_is_ignored(write_video: Write, number_in: Read) -> None:
    clip = open_clip(write_video("a.mkv", 3, codec="ffv1", pix_fmt="yuva420p"))
    assert number_in(next(clip.gray([2]))[1]) == 2
    assert next(clip.color([1]))[1].shape == (64, 96, 3)


def test_gif_is_a_clip(write_video: Write, number_in: Read) -> None:
    clip = open_clip(write_video("a.gif", 9, codec="gif", pix_fmt="gray"))
    assert [number_in(image) for _, image in clip.gray(clip.numbers)] == list(range(9))
    assert [number_in(image) for _, image in clip.gray([5, 8])] == [5, 8]


def test_one_frame_is_enough(write_video: Write) -> None:
    clip = open_clip(write_video(count=1))
    assert clip.info.num_frames == 1
    assert clip.info.times == (0.0,)
    assert len(list(clip.gray(clip.numbers))) == 1


def test_a_range_leaves_frames_out_without_renumbering(write_video: Write, number_in: Read) -> None:
    clip = open_clip(write_video(count=30), FrameRange.parse("5:25:5"))
    assert list(clip.numbers) == [5, 10, 15, 20]
    assert clip.info.num_frames == 30
    assert [(n, number_in(image)) for n, image in clip.gray(clip.numbers)] == [(5, 5), (10, 10), (15, 15), (20, 20)]
    with pytest.raises(UsageError, match="leaves no frame"):
        open_clip(write_video(count=30), FrameRange.parse("40:50"))


def test_the_same_pixels_every_time(write_video: Write) -> None:
    clip = open_clip(write_video(count=25))
    first = hashlib.sha256(b"".join(image.tobytes() for _, image in clip.color(clip.numbers))).hexdigest()
    assert all(hashlib.sha256(b"".join(i.tobytes() for _, i in clip.color(clip.numbers))).hexdigest() == first for _ in range(3))
    assert clip.info.sha256 == hashlib.sha256(clip.path.read_bytes()).hexdigest()
    assert clip.info.name == "clip.mp4"


def test_images_may_be_kept(write_video: Write, number_in: Read) -> None:
    clip = open_clip(write_video(count=12))
    kept = list(clip.gray(clip.numbers))
    assert [number_in(image) for _, image in kept] == list(range(12))
    assert all(image.flags.writeable for _, image in kept)


def test_frames_outside_the_clip_are_refused(write_video: Write) -> None:
    clip = open_clip(write_video(count=5))
    for wanted in ([5], [-1], [2, 1000]):
        with pytest.raises(VideoError, match="has no frame"):
            list(clip.gray(wanted))
    with pytest.raises(ValueError, match="increase"):
        list(clip.gray([3, 2]))


@pytest.mark.parametrize("name", ["with space.mp4", "#1?.mp4", "concat:a.mp4", "naïve ☃ 日本.mp4", "-i.mp4", "%d.mp4", "x" * 200 + ".mp4", "no_suffix"])
@pytest.mark.skipif(sys.platform == "win32", reason="Windows forbids some of these names")
def test_odd_names_are_names(write_video: Write, name: str) -> None:
    path = write_video(count=3)
    assert open_clip(path.rename(path.with_name(name))).info.num_frames == 3


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux lets a name be any bytes")
def test_names_that_are_no_text_are_opened(write_video: Write) -> None:
    path = write_video(count=3)
    assert open_clip(path.rename(path.with_name(os.fsdecode(b"a\xff.mp4")))).info.num_frames == 3


def test_what_is_no_clip_is_refused_with_a_cure(tmp_path: Path, write_video: Write) -> None:
    text = tmp_path / "notes.mp4"
    text.write_text("not a video at all\n" * 100)
    empty = tmp_path / "empty.mp4"
    empty.touch()
    folder = tmp_path / "folder"
    folder.mkdir()
    playlist = tmp_path / "list.m3u8"
    playlist.write_text(f"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{write_video(count=3)}\n#EXT-X-ENDLIST\n")
    listing = tmp_path / "list.txt"
    listing.write_text("ffconcat version 1.0\nfile clip.mp4\n")
    for path, words in [
        (text, "not a video"),
        (empty, "0 bytes"),
        (folder, "no images"),
        (tmp_path / "missing.mp4", "cannot be found"),
        (playlist, "not a video"),
        (listing, "not a video"),
        (tmp_path / ("y" * 300), "cannot be found"),
        (Path("a\0b"), "cannot be"),
    ]:
        with pytest.raises(VideoError, match=words) as raised:
            open_clip(path)
        assert str(tmp_path) not in str(raised.value)


def test_sound_alone_is_no_clip(tmp_path: Path) -> None:
    path = tmp_path / "song.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), dtype=np.float32), format="fltp", layout="mono")
        frame.sample_rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(VideoError, match="only audio"):
        open_clip(path)


def test_a_clip_cut_short_is_used_as_far_as_it_goes(write_video: Write, number_in: Read) -> None:
    path = write_video("a.mp4", 60, options={"movflags": "faststart"})
    whole = path.read_bytes()
    # The index stands in front of the pictures in this copy, so that a cut loses only pictures.
    with av.open(str(path)) as source, av.open(str(path.with_name("fast.mp4")), "w", options={"movflags": "faststart"}) as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    fast = path.with_name("fast.mp4")
    fast.write_bytes(fast.read_bytes()[: int(0.7 * len(whole))])
    clip = open_clip(fast)
    assert 10 <= clip.info.num_frames < 60
    assert any("60" in sentence for sentence in clip.info.warnings)
    last = clip.info.num_frames - 1
    assert [number_in(image) for _, image in clip.gray([0, last // 2])] == [0, last // 2]
    assert len(list(clip.color(clip.numbers))) == last + 1


def test_a_container_that_tells_only_its_length_is_missed_too(write_video: Write) -> None:
    path = write_video("a.mkv", 90, images=list(np.random.default_rng(3).integers(0, 255, (90, 64, 96, 3), dtype=np.uint8)))
    assert open_clip(path).info.warnings == ()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    clip = open_clip(path)
    assert clip.info.num_frames < 60
    assert any("3.0 seconds" in sentence for sentence in clip.info.warnings)


def test_damage_is_told_and_numbers_stay_those_of_a_full_reading(write_video: Write) -> None:
    path = write_video("a.ts", 60, images=list(np.random.default_rng(3).integers(0, 255, (60, 64, 96, 3), dtype=np.uint8)))
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(5)
    for place in rng.integers(len(data) // 3, len(data) // 2, 60):
        data[place] ^= 0xFF
    path.write_bytes(bytes(data))
    clip = open_clip(path)
    assert any("damaged" in sentence for sentence in clip.info.warnings)
    everything = dict(clip.gray(clip.numbers))
    assert list(everything) == list(clip.numbers)
    for number, image in clip.gray([clip.info.num_frames // 2, clip.info.num_frames - 1]):
        assert_array_equal(image, everything[number])


def test_a_change_of_size_is_refused_where_it_happens(write_video: Write, tmp_path: Path) -> None:
    first, second = write_video("a.ts", 10, size=(96, 64)), write_video("b.ts", 10, size=(128, 80))
    joined = tmp_path / "joined.ts"
    joined.write_bytes(first.read_bytes() + second.read_bytes())
    with pytest.raises(VideoError, match=r"changes from 96x64 to 128x80 at frame \d+"):
        open_clip(joined)


def test_limits_are_kept(write_video: Write) -> None:
    path = write_video(count=20)
    for limits, words in [
        (VideoLimits(max_frames=10), "limit"),
        (VideoLimits(max_side=90), "beyond the limit"),
        (VideoLimits(max_pixels=96 * 63), "beyond the limit|not one frame"),
        (VideoLimits(max_bytes=100), "limit"),
    ]:
        with pytest.raises(VideoError, match=words):
            open_clip(path, limits=limits)
    with pytest.raises(VideoError, match="16x16"):
        open_clip(write_video("small.mkv", 3, size=(8, 8), codec="ffv1", pix_fmt="yuv444p"))


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv"])
def test_the_packet_table_of_a_long_clip_tells_the_same_frames(write_video: Write, name: str) -> None:
    path = write_video(name, 60, options={"bf": "2"})
    decoded, table = open_clip(path), open_clip(path, limits=VideoLimits(scan_pixels=0.0))
    assert table.info.num_frames == decoded.info.num_frames
    np.testing.assert_allclose(table.info.times, decoded.info.times, atol=1e-9)
    for (a, one), (b, other) in zip(decoded.gray([5, 40, 59]), table.gray([5, 40, 59]), strict=True):
        assert a == b
        assert_array_equal(one, other)


def test_long_reading_can_be_stopped(write_video: Write) -> None:
    class Stop(Exception):
        pass

    def stop(title: str, done: int, total: int | None) -> None:
        raise Stop

    with pytest.raises(Stop):
        open_clip(write_video(), progress=stop)
