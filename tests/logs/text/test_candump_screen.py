"""What candump shows on the screen, with its options: the same frames as its log form."""

import os
import time

import pytest

from dctorque_can.logs.errors import LogReadError
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

from ..frames_strategy import assert_same_frames, frame, frames_of
from ..reading import read

T = 1_700_000_000_000_000
DATA = bytes([1, 2, 3, 0xAB])
CASES = {
    " (1700000000.000000)  can0  123   [4]  01 02 03 AB": frame(T, 0x123, DATA),
    " (1700000000.000000)  can0  00000123   [4]  01 02 03 AB": frame(T, 0x123 | EXTENDED_ID, DATA),
    " (1700000000.000000)  can0  123   [4]  01 02 03 AB   '....'": frame(T, 0x123, DATA),
    " (1700000000.000000)  can0  123   [4]  AB`03`02`01": frame(T, 0x123, DATA),
    " (1700000000.000000)  can0  123   [4]  00000001 00000010 00000011 10101011": frame(T, 0x123, DATA),
    " (1700000000.000000)  can0  TX - -  123   [4]  01 02 03 AB": frame(T, 0x123, DATA, FrameFlag.TRANSMITTED),
    " (1700000000.000000)  can0  RX B E  123  [04]  01 02 03 AB": frame(
        T, 0x123, DATA, FrameFlag.FD | FrameFlag.BITRATE_SWITCH | FrameFlag.ERROR_STATE
    ),
    " (1700000000.000000)  can0  123  [12]  00 01 02 03 04 05 06 07 08 09 0A 0B": frame(
        T, 0x123, bytes(range(12)), FrameFlag.FD
    ),
    " (1700000000.000000)  can0  123   {E}  00 01 02 03 04 05 06 07": frame(T, 0x123, bytes(range(8))),
    " (1700000000.000000)  can0  123   [0] ": frame(T, 0x123, b""),
    " (1700000000.000000)  can0  123   [8]  remote request": frame(T, 0x123, b"", FrameFlag.REMOTE, length=8),
    "\x1b[1m (1700000000.000000)  can0\x1b[0m  123   [4]  01 02 03 AB": frame(T, 0x123, DATA),
    " (001.500000)  can0  123   [4]  01 02 03 AB": frame(1_500_000, 0x123, DATA),
    "(1700000000.000000) can0 123#010203AB_F": frame(T, 0x123, DATA),
    "(1700000000.000000) can0 123#R8_9": frame(T, 0x123, b"", FrameFlag.REMOTE, length=8),
    "(1700000000.000000) can0 123#R3": frame(T, 0x123, b"", FrameFlag.REMOTE, length=3),
}


@pytest.mark.parametrize("line", CASES)
@pytest.mark.parametrize("form", ["plain", "crlf", "bom", "last line"])
def test_one_line(tmp_path, line, form):
    path = tmp_path / "x.log"
    text = line if form == "last line" else line + ("\r\n" if form == "crlf" else "\n")
    path.write_bytes((b"\xef\xbb\xbf" if form == "bom" else b"") + text.encode())
    frames, log = read(path)
    assert_same_frames(frames, frames_of([CASES[line]]))
    if form != "last line":
        assert log.problems == []


def test_an_error_frame(tmp_path):
    path = tmp_path / "x.log"
    path.write_text(" (1700000000.000000)  can0  20000004   [8]  00 00 00 00 00 00 00 00   ERRORFRAME\n")
    frames, _ = read(path)
    assert frames.flags.tolist() == [int(FrameFlag.ERROR)]


def test_times_from_the_frame_before_are_summed(tmp_path):
    """-td cannot be told from -tz by one line, but times from the first frame never fall."""
    path = tmp_path / "x.log"
    steps = [0.0, 0.01, 0.002, 0.5]
    path.write_text("".join(f" (00{step:.6f})  can0  123   [1]  00\n" for step in steps))
    assert read(path)[0].t_us.tolist() == [0, 10_000, 12_000, 512_000]
    path.write_text("".join(f" (00{step:.6f})  can0  123   [1]  00\n" for step in (0.0, 0.01, 0.012, 0.5)))
    assert read(path)[0].t_us.tolist() == [0, 10_000, 12_000, 500_000]


@pytest.fixture
def berlin(monkeypatch):
    monkeypatch.setitem(os.environ, "TZ", "Europe/Berlin")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def test_dates_are_of_this_machines_time_zone(tmp_path, berlin):
    path = tmp_path / "x.log"
    path.write_text(" (2023-11-14 23:13:20.250000)  can0  123   [1]  00\n")
    assert read(path)[0].t_us.tolist() == [T + 250_000]


def test_the_screen_without_times_is_refused_with_what_helps(tmp_path):
    path = tmp_path / "x.log"
    path.write_text("  can0  123   [8]  01 02 03 04 05 06 07 08\n  can0  18FEF100   [2]  01 02\n")
    with pytest.raises(LogReadError, match="screen of candump without times; record with candump -L, or with"):
        read(path)


def test_lines_of_both_forms_keep_their_order_and_bad_ones_are_counted(tmp_path):
    path = tmp_path / "x.log"
    path.write_text(
        "(1700000000.000000) can0 001#00\n"
        " (1700000000.100000)  can0  002   [1]  00\n"
        " (1700000000.200000)  can0  003   [3]  00\n"
        "(1700000000.300000) can0 004#00\n"
    )
    frames, log = read(path)
    assert frames.can_id.tolist() == [1, 2, 4]
    assert "1 lines can not be read, the first is line 3" in log.problems[0]


def test_utf_16_is_named(tmp_path):
    path = tmp_path / "x.log"
    for encoding in ("utf-16", "utf-16-le", "utf-16-be"):
        path.write_bytes("(1700000000.000000) can0 123#00\n".encode(encoding))
        with pytest.raises(LogReadError, match="is UTF-16 text, as PowerShell writes it; save it as UTF-8"):
            read(path)
