"""Arbitrary frames for hypothesis, and columns compared bit for bit."""

import numpy as np
from hypothesis import strategies as st

from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

COLUMNS = ("t_us", "can_id", "length", "flags", "channel")
NO_FLAG = FrameFlag(0)
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)


def frame(
    t_us=0, can_id=0x100, data=b"", flags=NO_FLAG, channel=0, length=None
) -> tuple[int, int, bytes, int, int, int]:
    return t_us, can_id, data, int(flags), channel, len(data) if length is None else length


def frames_of(rows) -> Frames:
    width = 64 if any(len(row[2]) > 8 for row in rows) else 8
    frames = Frames.empty(len(rows), width)
    for i, (t_us, can_id, data, flags, channel, length) in enumerate(rows):
        frames.t_us[i], frames.can_id[i], frames.length[i] = t_us, can_id, length
        frames.flags[i], frames.channel[i] = flags, channel
        frames.data[i, : len(data)] = np.frombuffer(data, np.uint8)
    return frames


def assert_same_frames(got: Frames, expected: Frames) -> None:
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(got, column), getattr(expected, column), err_msg=column)
    pad = max(got.data.shape[1], expected.data.shape[1])
    np.testing.assert_array_equal(
        np.pad(got.data, ((0, 0), (0, pad - got.data.shape[1]))),
        np.pad(expected.data, ((0, 0), (0, pad - expected.data.shape[1]))),
    )


identifiers = st.one_of(
    st.integers(0, 0x7FF), st.integers(0, 0x1FFF_FFFF).map(lambda number: number | int(EXTENDED_ID))
)
FEW_CHANNELS = st.integers(0, 3)
directions = st.sampled_from([NO_FLAG, FrameFlag.TRANSMITTED])


@st.composite
def a_frame(draw, times, fd=True, errors=True, channels=FEW_CHANNELS, directions=directions):
    kinds = ["data", "remote", *(["fd"] if fd else []), *(["error"] if errors else [])]
    kind = draw(st.sampled_from(kinds))
    flags, length, data = draw(directions), None, b""
    if kind == "data":
        data = draw(st.binary(max_size=8))
    elif kind == "fd":
        size = draw(st.sampled_from(FD_LENGTHS))
        data = draw(st.binary(min_size=size, max_size=size))
        flags |= FrameFlag.FD | draw(st.sampled_from([NO_FLAG, FrameFlag.BITRATE_SWITCH, FrameFlag.ERROR_STATE]))
    elif kind == "remote":
        flags |= FrameFlag.REMOTE
        length = draw(st.integers(0, 8))
    else:
        flags = FrameFlag.ERROR
    return frame(draw(times), draw(identifiers), data, flags, draw(channels), length)
