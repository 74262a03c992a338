import pytest
from hypothesis import given
from hypothesis import strategies as st

from planewright.errors import UsageError
from planewright.video.frame_range import FrameRange


@given(st.integers(0, 50), st.integers(1, 50), st.integers(1, 9), st.integers(1, 80))
def test_a_range_is_a_slice(start: int, length: int, step: int, num_frames: int) -> None:
    text = f"{start}:{start + length}:{step}"
    expected = list(range(num_frames))[start : start + length : step]
    chosen = FrameRange.parse(text)
    assert FrameRange.parse(str(chosen)) == chosen
    if expected:
        assert list(chosen.of(num_frames)) == expected
    else:
        with pytest.raises(UsageError, match="leaves no frame"):
            chosen.of(num_frames)


def test_ends_may_be_left_out() -> None:
    assert list(FrameRange.parse(":").of(5)) == [0, 1, 2, 3, 4]
    assert list(FrameRange.parse("3:").of(5)) == [3, 4]
    assert list(FrameRange.parse(":2").of(5)) == [0, 1]
    assert list(FrameRange.parse("::2").of(5)) == [0, 2, 4]


@pytest.mark.parametrize("text", ["", "5", "a:b", "-3:5", "5:5", "9:2", "0:10:0", "1:2:3:4", "1.5:3", "\u0663:\u0665", "0:9999999999", "x" * 500])
def test_anything_else_is_a_clear_error(text: str) -> None:
    with pytest.raises(UsageError, match="START:STOP") as raised:
        FrameRange.parse(text)
    assert len(str(raised.value)) < 250
