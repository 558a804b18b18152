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
from dctorque_can.logs.messages import ChannelNumbers, frames_from_messages, message_from_frame
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

from .frames_strategy import a_frame, assert_same_frames, frame, frames_of

START = 1_700_000_000_000_000
UNIX_TIMES = st.integers(START, START + 10**9)


def by_python_can(path) -> Frames:
    with can.LogReader(path) as reader:
        return frames_from_messages(list(reader), ChannelNumbers())


def read(path, batch=100_000):
    log = open_log(path)
    frames = Frames.concatenate(log.frames(batch))
    assert log.fraction == 1.0
    return frames, log


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


CANDUMP_LINES = st.one_of(
    st.sampled_from(
        [
            "(1436509052.249713) vcan0 044#2A366C2BBA",
            "(1436509052.449847) vcan0 0F6#7ADFE07BD2 R",
            "(0.0) can1 12345678#0102030405060708 T",
            "(1436509052.5) can0 7FF#",
            "(1436509052.5) 3 7ff#aabb t",
            "(1436509052.500000) can0 123#R",
            "(1436509052.500000) can0 123#R8 R",
            "(1436509052.500000) can0 123##1AABB",
            "(1436509052.500000) can0 123##3" + "AB" * 64,
            "(1436509052.500000) can0 20000080#0000000000000000",
            "(1436509052.500000) can0 20000004#0102",
            "(1436509052.500000) can0 1234#01",
            "(1436509052.500000) can0 123#010203040506070809",
            "(1436509052.5000004999) can0 123#01",
            "(1436509052.1234567891) can0 123#01",
            "  (1436509052.500000)  can0   123#01  ",
            "(1436509052.500000) a_very_long_channel_name 123#01",
            "(1436509052.500000) slcan0 123#01",
            "",
            "   ",
        ]
    ),
    st.builds(
        "({}.{:06d}) can{} {:03X}#{} {}".format,
        st.integers(0, 2**32),
        st.integers(0, 999_999),
        st.integers(0, 300),
        st.integers(0, 0x7FF),
        st.binary(max_size=8).map(bytes.hex),
        st.sampled_from("RT"),
    ),
)
ASC_LINES = st.one_of(
    st.sampled_from(
        [
            "   0.010000 1  123             Rx   d 8 01 02 03 04 05 06 07 08",
            "0.5 2 18EBFF00x Tx d 3 A0 0f Ff Length = 0 BitCount = 4 ID = 1x",
            "   0.010000 1  123             Rx   r 5",
            "   0.010000 1  123             Rx   r",
            "   0.010000 1  ErrorFrame",
            "   0.010000 1  ErrorFrame ECC: 10100010",
            "   0.010000 1  123             Rx   d 0",
            "   0.010000 1  123             Rx   d 8 01 02",
            "   0.010000 1  123             RX   d 1 01",
            "   0.010000 1  123             Rx   d c 01 02 03 04 05 06 07 08 09 0a 0b 0c",
            "   0.010000 1  123             Rx   d 2 1 2",
            "   0.010000 1  Statistic: D 0 R 0 XD 7020 XR 0 E 0 O 0 B 33.76%",
            "   0.010000 CAN 1 Status:chip status error active",
            "   0.010000 CANFD   1 Rx        123                                   1 0 9 12"
            " 00 01 02 03 04 05 06 07 08 09 0A 0B        0    0     3000        0        0        0        0",
            "   0.010000 CANFD   2 Tx   1ABCDEFx                        SomeName   0 1 8  8"
            " 00 01 02 03 04 05 06 07        0    0     3000        0        0        0        0        0",
            "   0.010000 CANFD   1 Rx        123                                   0 0 8  0        0    0  3000",
            "   0.010000 CANFD   1 Rx        123                                   0 0 8  4 1 2 3 4 0  0  3000",
            "   0.010000 CANFD   1 Rx   ErrorFrame   Not Acknowledge error, dominant error flag",
            "0.1000005 1 1 Rx d 1 01",
            "0.10000050000000001 1 1 Rx d 1 01",
            "0.1 0 1 Rx d 1 01",
            "0.1 01 1 Rx d 1 01",
            "0.1\t1\t1\tRx\td\t1\t01",
            "// a comment",
            "Begin Triggerblock Mon Mar 12 01:23:45.678 PM 2018",
            "   0.000000 Start of measurement",
            "End TriggerBlock",
            "1.0 J1939TP FEE3p 6 0 0 - Rx d 23 A0 0F A6 60",
            "",
        ]
    ),
    st.builds(
        "{}.{:06d} {}  {:X}{} {}   d {} {}".format,
        st.integers(0, 10**6),
        st.integers(0, 999_999),
        st.integers(1, 40),
        st.integers(0, 0x7FF),
        st.sampled_from(["", "x"]),
        st.sampled_from(["Rx", "Tx"]),
        st.just(3),
        st.binary(min_size=3, max_size=3).map(lambda data: data.hex(" ")),
    ),
)
ASC_HEADS = [
    "date Sam Sep 30 15:06:13.191 2017\nbase hex  timestamps absolute\ninternal events logged\n",
    "date Sam Sep 30 15:06:13.191 2017\nbase hex  timestamps absolute\nno internal events logged\n"
    "// version 9.0.0\n",
]


def assert_read_as_by_python_can(path, closed):
    """A last line without a line end may be told, and left out when bytes of it are missing."""
    frames, log = read(path)
    expected = by_python_can(path)
    if closed:
        assert log.problems == []
    left_out = sum("is cut off and left out" in problem for problem in log.problems)
    assert len(frames) in (len(expected), len(expected) - left_out)
    assert len(log.problems) <= 1
    assert_same_frames(frames, expected[: len(frames)])


@settings(max_examples=80)
@given(st.lists(CANDUMP_LINES, max_size=30), st.sampled_from(["\n", "\r\n"]), st.booleans())
def test_any_candump_line_means_what_python_can_says(lines, end, closed):
    text = end.join(["(0.000000) can0 001#", *lines]) + (end if closed else "")
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "x.log"
        path.write_bytes(text.encode())
        assert_read_as_by_python_can(path, closed)


@settings(max_examples=80)
@given(
    st.sampled_from(ASC_HEADS), st.lists(ASC_LINES, max_size=30), st.sampled_from(["\n", "\r\n"]), st.booleans()
)
def test_any_asc_line_means_what_python_can_says(head, lines, end, closed):
    text = head.replace("\n", end) + end.join(lines) + (end if closed else "")
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "x.asc"
        path.write_bytes(text.encode())
        assert_read_as_by_python_can(path, closed)


def test_decimal_asc(tmp_path):
    path = tmp_path / "x.asc"
    path.write_text(
        "date Sam Sep 30 15:06:13.191 2017\nbase dec  timestamps absolute\ninternal events logged\n"
        "0.5 1 100 Rx d 2 10 255\n0.6 1 101 Rx d 1 99\n"
    )
    frames, log = read(path)
    assert log.problems == []
    assert_same_frames(
        frames, frames_of([frame(500_000, 100, bytes([10, 255])), frame(600_000, 101, bytes([99]))])
    )


def test_relative_asc_times_are_told(tmp_path):
    path = tmp_path / "x.asc"
    path.write_text("base hex  timestamps relative\ninternal events logged\n0.5 1 1 Rx d 1 01\n")
    assert "timestamps" in read(path)[1].problems[0]


@given(st.integers(0, 4_000_000_000_000_000), st.integers(0, 12))
def test_times_are_rounded_as_python_rounds_the_float(t, digits):
    """Decimal text to µs must equal ``round(float(text) * 1e6)``, also beyond six digits."""
    whole, fraction = divmod(t, 10**6)
    text = f"{whole}.{fraction:06d}" + "5" * digits
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "x.log"
        path.write_text(f"({text}) can0 123#00\n")
        frames, _ = read(path)
    assert frames.t_us.tolist() == [round(float(text) * 1e6)]


def test_bad_lines_are_counted_and_left_out(tmp_path):
    good = "(1.000000) can0 123#01\n"
    cases = {
        "x.log": good * 3 + "(x) nonsense\n" + good + "(1.0) can0\n" + good,
        "x.asc": ASC_HEADS[0]
        + "0.1 1 1 Rx d 1 01\n" * 3
        + "0.2 1 zz Rx d 1 01\n"
        + "0.3 1 1 Rx d 1 02\n" * 2
        + "0.4 1 zz Rx d 1 0g\n",
        "x.csv": "timestamp,arbitration_id,extended,remote,error,dlc,data\n"
        + "1.0,0x1,0,0,0,1,AQ==\n" * 3
        + "1.0,0x1,0,0\n"
        + "1.0,0x1,0,0,0,1,AQ==\n" * 2
        + "?\n",
        "x.trc": ";$FILEVERSION=2.1\n;$STARTTIME=43000.5\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
        + "1 1.0 DT 1 0100 Rx - 1 01\n" * 3
        + "1 x DT 1 0100 Rx - 1 01\n"
        + "1 1.0 DT 1 0100 Rx - 1 01\n" * 2
        + "1 1.0 DT 1 zz Rx - 1 01\n",
    }
    first_bad = {"x.log": "(x)", "x.asc": "0.2", "x.csv": "1.0,0x1,0,0\n", "x.trc": "1 x"}
    for name, text in cases.items():
        path = tmp_path / name
        path.write_text(text)
        bad_line = text[: text.index(first_bad[name])].count("\n") + 1
        frames, log = read(path)
        assert len(frames) == 5, name
        assert len(log.problems) == 1
        assert f"2 lines can not be read, the first is line {bad_line}:" in log.problems[0]


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize(
    ("suffix", "last", "frames", "words"),
    [
        (".asc", " 9.651861 1  110 ", 2, "no line end: cut off?"),
        (".asc", " 9.651861 1  110 Rx   d 8 B0 0D 23 FA A0 1", 2, "is cut off and left out: line 5: '9.651861"),
        (".asc", " 9.651861 1  110 Rx   d 2 B0 1", 2, "is cut off and left out"),
        (".asc", " 9.651861 1  110 Rx   d 8", 2, "is cut off and left out"),
        (".asc", " 9.651861 1  110 Rx   d 2 B0 0D", 3, None),
        (".asc", " 9.651861 1  110 Rx   d 2 B0 0D\r", 3, None),
        (".asc", " 9.651861 1  110 Rx   r", 3, "no line end: cut off?"),
        (".asc", " 9.651861 CANFD 1 Rx 110 1 0 3 3 01 02 0", 2, "is cut off and left out"),
        (".asc", " 9.651861 CANFD 1 Rx 110 name 1 0 3 3 01 02", 2, "is cut off and left out"),
        (".asc", " 9.651861 CANFD 1 Rx 110 name 1 0 3 3 01 02 03", 3, None),
        (".asc", "End TriggerBlock", 2, None),
        (".log", "(1704067205.995778) can0 120#830E23F8A01", 2, "is cut off and left out: line 3: '(1704"),
        (".log", "(1704067205.995778) can0 120#830E23F8", 3, "no line end: cut off? line 3"),
        (".log", "(1704067205.995778) can0 120#830E23F8A0112233", 3, None),
        (".log", "(1704067205.995778) can0 120#830E R", 3, None),
        (".log", "(1704067205.995778) can0 120##1830E2", 2, "is cut off and left out"),
        (".log", "(1704067205.995778) can0 120##1830E", 3, "no line end: cut off?"),
        (".log", "(1704067205.9", 2, "no line end: cut off?"),
        (".log", "", 2, None),
    ],
)
def test_a_last_line_without_line_end(tmp_path, suffix, last, frames, words, zipped):
    """Frames that lack bytes are left out and told; those that might lack some are kept and told."""
    begin = {
        ".asc": "base hex  timestamps absolute\ninternal events logged\n" + "0.1 1 1 Rx d 1 01\n" * 2,
        ".log": "(1.000000) can0 123#01\n" * 2,
    }[suffix]
    path = tmp_path / f"x{suffix}{'.gz' if zipped else ''}"
    content = (begin + last).encode()
    path.write_bytes(gzip.compress(content) if zipped else content)
    got, log = read(path)
    assert len(got) == frames
    if words is None:
        assert log.problems == []
    else:
        assert any(words in problem for problem in log.problems)


def test_lines_across_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr("dctorque_can.logs.text_blocks.BLOCK_SIZE", 1000)
    frames = frames_of([frame(START + 100 * i, 0x100, i.to_bytes(4, "big"), channel=i % 3) for i in range(500)])
    for suffix in (".log", ".asc"):
        path = tmp_path / f"x{suffix}"
        write_frames(path, frames)
        got, log = read(path, batch=77)
        assert log.problems == []
        assert_same_frames(got, by_python_can(path))


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


def write_blf(path, frames, **options):
    with can.BLFWriter(path, **options) as writer:
        for i in range(len(frames)):
            writer.on_message_received(message_from_frame(frames, i))


def mixed_frames(n):
    kinds = [
        {"data": b"\x01\x02"},
        {"data": bytes(range(64)), "flags": FrameFlag.FD | FrameFlag.BITRATE_SWITCH},
        {"flags": FrameFlag.REMOTE, "length": 3},
        {"flags": FrameFlag.ERROR},
        {"can_id": 0x123456 | int(EXTENDED_ID), "data": bytes(8), "flags": FrameFlag.TRANSMITTED, "channel": 2},
    ]
    return frames_of([frame(t_us=START + 10 * i, **kinds[i % 5]) for i in range(n)])


@pytest.mark.parametrize("options", [{}, {"compression_level": 0}, {"max_container_size": 1000}])
def test_blf_containers(tmp_path, options):
    """Objects that go on in the next container, uncompressed containers, mixed kinds of objects."""
    path = tmp_path / "x.blf"
    write_blf(path, mixed_frames(5000), **options)
    frames, log = read(path)
    assert log.problems == []
    assert_same_frames(frames, by_python_can(path))
    assert len(frames) == 5000


def blf_object(kind, body, version=1, ticks=123_456, unit=2):
    """One object by hand, after the layout in `can.io.blf`."""
    from can.io.blf import OBJ_HEADER_BASE_STRUCT

    head = (
        can.io.blf.OBJ_HEADER_V1_STRUCT.pack(unit, 0, 0, ticks)
        if version == 1
        else can.io.blf.OBJ_HEADER_V2_STRUCT.pack(unit, 0, 0, ticks)
    )
    size = OBJ_HEADER_BASE_STRUCT.size + len(head)
    return (
        OBJ_HEADER_BASE_STRUCT.pack(b"LOBJ", size, version, size + len(body), kind)
        + head
        + body
        + bytes(len(body) % 4)
    )


def blf_file(path, objects):
    writer = can.BLFWriter(path)
    writer.on_message_received(can.Message(timestamp=START / 1e6, arbitration_id=1))
    writer._buffer.append(objects)
    writer._buffer_size += len(objects)
    writer.stop()


@settings(max_examples=60)
@given(st.data())
def test_blf_objects_of_other_writers(data):
    """CAN_MESSAGE2, CAN_FD_MESSAGE_64 (also too short for what it tells), headers of version 2, 10 µs ticks."""
    number = st.integers(0, 255)
    blf = can.io.blf
    objects = b""
    for _ in range(data.draw(st.integers(1, 6))):
        kind = data.draw(st.sampled_from(["message2", "fd64", "fd", "error", "other"]))
        version, unit = data.draw(st.sampled_from([1, 2])), data.draw(st.sampled_from([1, 2]))
        ticks = data.draw(st.integers(0, 10**12))
        channel, dlc, valid = data.draw(number), data.draw(number), data.draw(number)
        can_id, flags = data.draw(st.integers(0, 2**32 - 1)), data.draw(st.integers(0, 2**16 - 1))
        if kind == "message2":
            body = blf.CAN_MSG_STRUCT.pack(channel, flags & 255, dlc, can_id, b"abcdefgh") + bytes(8)
            objects += blf_object(blf.CAN_MESSAGE2, body, version, ticks, unit)
        elif kind == "fd64":
            payload = data.draw(st.binary(max_size=80))
            offset = data.draw(st.sampled_from([0, 0, 90, 200]))
            head = blf.CAN_FD_MSG_64_STRUCT.pack(
                channel, dlc, valid, 0, can_id, 0, flags, 0, 0, 0, 0, 0, dlc % 2, offset, 0
            )
            objects += blf_object(blf.CAN_FD_MESSAGE_64, head + payload, version, ticks, unit)
        elif kind == "fd":
            body = blf.CAN_FD_MSG_STRUCT.pack(
                channel, flags & 255, dlc, can_id, 0, 0, flags >> 8, valid, bytes(range(64))
            )
            objects += blf_object(blf.CAN_FD_MESSAGE, body, version, ticks, unit)
        elif kind == "error":
            body = blf.CAN_ERROR_EXT_STRUCT.pack(channel, 0, 0, 0, 0, dlc, 0, can_id, 0, b"12345678")
            objects += blf_object(blf.CAN_ERROR_EXT, body, version, ticks, unit)
        else:
            objects += blf_object(96, data.draw(st.binary(max_size=20)), version, ticks, unit)
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "x.blf"
        blf_file(path, objects)
        frames, log = read(path)
        assert log.problems == []
        assert_same_frames(frames, by_python_can(path))


def test_cut_and_damaged_blf(tmp_path):
    path = tmp_path / "x.blf"
    frames = mixed_frames(5000)
    write_blf(path, frames, max_container_size=10_000)
    expected = by_python_can(path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    got, log = read(path)
    assert 1000 < len(got) < 4000
    assert_same_frames(got, expected[: len(got)])
    assert len(log.problems) == 1
    damaged = bytearray(content)
    damaged[len(content) // 2 : len(content) // 2 + 40] = bytes(40)
    path.write_bytes(damaged)
    got, log = read(path)
    assert 4000 < len(got) < 5000
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
