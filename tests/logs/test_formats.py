"""Every text and binary format against python-can's own readers, which are the rule for what a file says."""

import gzip
import importlib
import sys
import tempfile
from pathlib import Path

import can
import can.io.mf4
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.errors import LogReadError, LogWriteError
from dctorque_can.logs.messages import ChannelNumbers, MessageRoom, frames_from_messages, message_from_frame
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

from .frames_strategy import a_frame, assert_same_frames, frame, frames_of
from .reading import START, by_python_can, read

UNIX_TIMES = st.integers(START, START + 10**9)


@settings(max_examples=50)
@given(st.lists(a_frame(times=UNIX_TIMES), min_size=1, max_size=30), st.sampled_from([".asc", ".blf", ".log"]))
def test_fast_readers_give_what_python_can_gives(rows, suffix):
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / f"x{suffix}"
        write_frames(path, frames_of(rows))
        frames, log = read(path)
        assert log.problems == []
        assert_same_frames(frames, by_python_can(path))


@settings(max_examples=25)
@given(
    st.lists(a_frame(times=UNIX_TIMES, errors=False), min_size=1, max_size=30).map(
        lambda rows: sorted(rows, key=lambda row: row[0])
    )
)
def test_round_trips_keep_what_the_format_can_hold(rows):
    """What goes in comes out, but for what `write_frames` says a format does not keep."""
    frames = frames_of(rows)
    data = frames[(frames.flags & FrameFlag.REMOTE) == 0]
    classic = data[(data.flags & FrameFlag.FD) == 0]
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        for suffix, kept in ((".blf", frames), (".log", data), (".mcap", frames)):
            if not len(kept):
                continue
            write_frames(folder / f"x{suffix}", kept)
            assert_same_frames(read(folder / f"x{suffix}")[0], kept)
        write_frames(folder / "x.asc", frames)
        got = read(folder / "x.asc")[0]
        frames.t_us[:] -= frames.t_us[0]
        # CAN FD without data has the form of a remote frame for python-can's ASC reader
        empty_fd = ((frames.flags & FrameFlag.FD) != 0) & (frames.length == 0)
        assert_same_frames(got[~empty_fd], frames[~empty_fd])
        if len(classic):
            write_frames(folder / "x.csv", classic)
            got = read(folder / "x.csv")[0]
            for column in ("t_us", "can_id", "length"):
                np.testing.assert_array_equal(getattr(got, column), getattr(classic, column))
            np.testing.assert_array_equal(got.data[:, :8], classic.data[:, :8])
            write_frames(folder / "x.trc", classic)
            got = read(folder / "x.trc")[0]
            np.testing.assert_array_equal(np.diff(got.t_us), np.diff(classic.t_us))
            np.testing.assert_array_equal(got.can_id, classic.can_id)
            np.testing.assert_array_equal(got.data[:, :8], classic.data[:, :8])


def test_mf4(tmp_path):
    pytest.importorskip("asammdf")
    path = tmp_path / "x.mf4"
    frames = frames_of([frame(START + 1000 * i, 0x100 + i, bytes([i]), channel=i % 2) for i in range(20)])
    write_frames(path, frames)
    got, log = read(path)
    assert log.problems == []
    np.testing.assert_array_equal(np.diff(got.t_us), np.diff(frames.t_us))
    got.t_us[:] = frames.t_us
    assert_same_frames(got, frames)


def test_an_mf4_is_closed_once_however_it_was_read(tmp_path):
    pytest.importorskip("asammdf")
    path = tmp_path / "x.mf4"
    write_frames(path, frames_of([frame(START + i, 0x100) for i in range(20)]))
    for wanted in (0, 1, 20):
        with open_log(path) as log:
            count = sum(len(part) for _, part in zip(range(wanted), log.frames(batch=1), strict=False))
            assert count == wanted


@pytest.mark.parametrize("suffix", [".log", ".asc", ".csv", ".trc"])
def test_gzipped_text(tmp_path, suffix):
    frames = frames_of([frame(START + 100 * i, 0x100, i.to_bytes(4, "big")) for i in range(5000)])
    plain, zipped = tmp_path / f"x{suffix}", tmp_path / f"x{suffix}.gz"
    write_frames(plain, frames)
    content = plain.read_bytes()
    zipped.write_bytes(gzip.compress(content[:9999]) + gzip.compress(content[9999:]))
    expected, _ = read(plain)
    assert_same_frames(read(zipped)[0], expected)
    zipped.write_bytes(zipped.read_bytes()[:-3000])
    frames, log = read(zipped)
    assert 100 < len(frames) < 5000
    assert_same_frames(frames[:-1], expected[: len(frames) - 1])
    assert log.problems


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # asammdf leaves bad.mf4 open
def test_what_is_no_log_is_refused_with_what_would_be_right(tmp_path):
    def refused(name, content, words):
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(LogReadError, match=words):
            open_log(path)

    blf, mcap = b"LOGG" + bytes(200), b"\x89MCAP0\r\n"
    refused("missing.asc", None, "missing.asc: there is no such file")
    refused("x.txt", b"hello", r"x.txt: the suffix says no known log format; known are .asc, .blf")
    refused("x", b"hello", "no known log format")
    refused("x.blf.gz", b"hello", "no known log format")
    refused("x.gz", b"hello", "no known log format")
    for suffix in (".asc", ".blf", ".log", ".trc", ".csv", ".mf4", ".mcap"):
        refused(f"empty{suffix}", b"", "is empty")
        refused(f"noise{suffix}", np.random.default_rng(0).bytes(5000), f"is no {suffix} file")
    refused("x.asc", blf, "is no .asc file; by its first bytes it is .blf")
    refused("x.blf", mcap, "is no .blf file; by its first bytes it is .mcap")
    refused("short.blf", b"LOGG", "is no BLF file")
    refused("x.log", b"hello\nworld\n", "no line at its beginning looks like")
    refused("x.asc", b"hello\nworld\n", "no line at its beginning looks like 'base hex")
    refused("x.csv", b"a,b\n1,2\n", "no line at its beginning looks like 'timestamp,arb")
    refused("x.trc", b"hello\n", "no line at its beginning looks like")
    refused("x.log.gz", b"hello", "is no .gz file")
    refused("bad.mf4", b"MDF " + bytes(5000), "can not be read as .mf4")
    with pytest.raises(LogReadError, match="is a directory; give one log file"):
        open_log(tmp_path)


@pytest.fixture
def _without_asammdf(monkeypatch):
    """As where it is not installed."""
    monkeypatch.setitem(sys.modules, "asammdf", None)
    importlib.reload(can.io.mf4)
    yield
    monkeypatch.undo()
    importlib.reload(can.io.mf4)


@pytest.mark.usefixtures("_without_asammdf")
def test_mf4_without_asammdf_names_the_extra(tmp_path):
    (tmp_path / "x.mf4").write_bytes(b"MDF " + bytes(100))
    with pytest.raises(LogReadError, match=r"pip install 'dctorque-can\[mf4\]'"):
        open_log(tmp_path / "x.mf4")
    with pytest.raises(LogWriteError, match=r"pip install 'dctorque-can\[mf4\]'"):
        write_frames(tmp_path / "y.mf4", frames_of([frame()]))


def test_what_can_not_be_written(tmp_path):
    with pytest.raises(LogWriteError, match="no known log format"):
        write_frames(tmp_path / "x.txt", Frames.empty())
    for suffix in (".asc", ".mcap", ".blf"):
        with pytest.raises(LogWriteError, match="No such file or directory"):
            write_frames(tmp_path / "missing" / f"x{suffix}", frames_of([frame()]))


def test_channel_names_become_numbers():
    numbers = ChannelNumbers()
    assert [numbers[name] for name in ("can1", "vcan1", "slcan0", "x", None, "can1", 7, "can300")] == [
        1,
        0,
        2,
        3,
        0,
        1,
        7,
        255,
    ]


def test_messages_of_a_bus_become_frames():
    message = can.Message(timestamp=1.0000004, arbitration_id=0x1ABCDEF, is_rx=False, data=[1, 2], channel="vcan0")
    frames = frames_from_messages([message], 3)
    assert_same_frames(
        frames,
        frames_of([frame(1_000_000, 0x1ABCDEF | int(EXTENDED_ID), b"\1\2", FrameFlag.TRANSMITTED, 3)]),
    )
    nothing = frames_from_messages([])
    assert len(nothing) == 0
    strange = frames_from_messages([can.Message(timestamp=float("nan")), can.Message(timestamp=float("inf"))])
    assert strange.t_us[0] == 0
    assert strange.t_us[1] > 2**62


def test_a_room_for_messages_gives_the_same_frames_again_and_again():
    """Long data and numbers of a batch leave nothing behind in the next one."""
    kinds = (
        frame(1, 0x7FF, b"\1\2\3\4\5\6\7\xff", FrameFlag.TRANSMITTED),
        frame(2, 0x1ABCDEF | int(EXTENDED_ID), b"\7"),
        frame(3, 0x10, bytes(range(1, 65)), FrameFlag.FD | FrameFlag.BITRATE_SWITCH),
        frame(4, 0x11, b"", FrameFlag.REMOTE, length=8),
        frame(5, 0x12, b"", FrameFlag.ERROR),
        frame(6, 0x13, b"\1\2"),
    )
    frames = frames_of(kinds)
    messages = [message_from_frame(frames, i) for i in range(len(frames))]
    room = MessageRoom(len(messages))
    for batch in (slice(None), slice(1), slice(None, None, -1), slice(3, 5), slice(0), slice(5, 6), slice(1, 2)):
        assert_same_frames(room.frames(messages[batch]), frames[batch])
