"""Every line of ASC and candump means what python-can says; what it can not read is counted."""

import gzip
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.logs.convert import write_frames

from ..frames_strategy import assert_same_frames, frame, frames_of
from ..reading import START, by_python_can, read

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


def test_relative_asc_times_are_summed(tmp_path):
    path = tmp_path / "x.asc"
    path.write_text("base hex  timestamps relative\ninternal events logged\n" + 3 * "0.5 1 1 Rx d 1 01\n")
    frames, log = read(path)
    assert frames.t_us.tolist() == [500_000, 1_000_000, 1_500_000]
    assert log.problems == []


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
    monkeypatch.setattr("dctorque_can.logs.text.unzip.BLOCK_SIZE", 1000)
    frames = frames_of([frame(START + 100 * i, 0x100, i.to_bytes(4, "big"), channel=i % 3) for i in range(500)])
    for suffix in (".log", ".asc"):
        path = tmp_path / f"x{suffix}"
        write_frames(path, frames)
        got, log = read(path, batch=77)
        assert log.problems == []
        assert_same_frames(got, by_python_can(path))
