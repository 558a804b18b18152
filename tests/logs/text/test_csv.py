"""CSV as SavvyCAN, PEAK-Converter, cabana and spreadsheets write it: the frames that the text says."""

import gzip

import numpy as np
import pytest

from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.text.csv_dialect import dialect_of
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

from ..frames_strategy import assert_same_frames, frame, frames_of
from ..reading import read

FIRST = frame(1_500_000, 0x123, bytes([1, 2, 0xAB]), channel=0)
SECOND = frame(1_510_000, 0x18FEF100 | EXTENDED_ID, bytes(range(8)), channel=1)
TABLES = {
    "savvycan": (
        "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n"
        "1500000,00000123,false,Rx,0,3,01,02,AB,,,,,,\n"
        "1510000,18FEF100,true,Rx,1,8,00,01,02,03,04,05,06,07,\n"
    ),
    "savvycan in seconds": (
        "Time Stamp,ID,Extended,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n"
        "1.500000,00000123,false,0,3,01,02,AB\n"
        "1.510000,18FEF100,true,1,8,00,01,02,03,04,05,06,07\n"
    ),
    "cabana": "time,addr,bus,data\n1.5,0x123,0,0x0102ab\n1.51,0x18fef100,1,0x0001020304050607\n",
    "addresses in decimal": "time,addr,bus,data\n1.5,291,0,0102ab\n1.51,419361024,1,0001020304050607\n",
    "german": (
        'Zeit;x\n"Time [ms]";"CAN-ID (hex)";Channel;DLC;"Data (hex)"\n'
        '1500,0;123;0;3;"01 02 AB"\n1510,0;18FEF100x;1;8;00 01 02 03 04 05 06 07\n'
    ),
    "tabs": "time_us\tid\tch\tbytes\n1500000\t123h\t0\t01-02-AB\n1510000\t18FEF100\t1\t00:01:02:03:04:05:06:07\n",
    "peak with names": (
        "; PEAK-Converter\nMessage Number,Time Offset (ms),Bus,Type,ID (hex),Reserved,Data Length Code,"
        "D0,D1,D2,D3,D4,D5,D6,D7\n"
        "1,1500.0,0,DT,0123,-,3,01,02,AB\n2,1510.0,1,DT,18FEF100,-,8,00,01,02,03,04,05,06,07\n"
    ),
    "peak with letters": (
        ";$FILEVERSION=2.1\n;$COLUMNS=N,O,B,d,T,I,R,L,D\n;---+--\n"
        "1,1500.0,0,Rx,DT,0123,-,3,01,02,AB\n2,1510.0,1,Rx,DT,18FEF100,-,8,00,01,02,03,04,05,06,07\n"
    ),
    "peak with letters and semicolons": (
        ";$FILEVERSION=2.1\n;$COLUMNS=N,O,B,d,T,I,R,L,D\n;---+--\n"
        "1;1500,0;0;Rx;DT;0123;-;3;01;02;AB\n2;1510,0;1;Rx;ST;;;4;00;00;00;08\n"
        "3;1510,0;1;Rx;DT;18FEF100;-;8;00;01;02;03;04;05;06;07\n"
    ),
}


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("form", ["plain", "bom", "crlf", "gz"])
def test_two_frames(tmp_path, name, form):
    content = TABLES[name].encode()
    path = tmp_path / "x.csv"
    if form == "bom":
        content = b"\xef\xbb\xbf" + content
    if form == "crlf":
        content = content.replace(b"\n", b"\r\n")
    if form == "gz":
        path, content = tmp_path / "x.csv.gz", gzip.compress(content)
    path.write_bytes(content)
    frames, log = read(path)
    assert log.problems == []
    assert_same_frames(frames, frames_of([FIRST, SECOND]))


def test_what_else_a_row_may_say(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text(
        ";$COLUMNS=N,O,B,d,T,I,R,L,D\n"
        "1,0.0,1,Tx,DT,00000123,-,1,01\n"  # eight digits: 29 bits
        "2,1.0,1,Rx,RR,0124,-,4\n"
        "3,2.0,1,Rx,FB,0125,-,12,00,01,02,03,04,05,06,07,08,09,0A,0B\n"
        "4,3.0,1,Rx,FD,0126,-,0\n"
    )
    frames, log = read(path)
    assert log.problems == []
    fd = FrameFlag.FD | FrameFlag.BITRATE_SWITCH
    expected = [
        frame(0, 0x123 | EXTENDED_ID, b"\x01", FrameFlag.TRANSMITTED, 1),
        frame(1000, 0x124, b"", FrameFlag.REMOTE, 1, length=4),
        frame(2000, 0x125, bytes(range(12)), fd, 1),
        frame(3000, 0x126, b"", FrameFlag.FD, 1),
    ]
    assert_same_frames(frames, frames_of(expected))


@pytest.mark.parametrize(
    ("time", "t_us"),
    [
        ("1700000000.25", 1_700_000_000_250_000),
        ("1700000000250", 1_700_000_000_250_000),
        ("1700000000250000", 1_700_000_000_250_000),
        ("1700000000250000000", 1_700_000_000_250_000),
        ("2023-11-14T22:13:20.250+00:00", 1_700_000_000_250_000),
        ("0.000001", 1),
    ],
)
def test_times_without_a_unit_are_read_by_their_size(tmp_path, time, t_us):
    path = tmp_path / "x.csv"
    path.write_text(f"timestamp,can_id,data\n{time},123,00\n")
    assert read(path)[0].t_us.tolist() == [t_us]


def test_bad_rows_are_counted_and_the_first_is_shown(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("time,id,len,data\n0.1,123,2,0102\n0.2,12Z,2,0102\n0.3,123,4,0102\n,,,\n0.4,123,2,0304\n")
    frames, log = read(path)
    assert frames.t_us.tolist() == [100_000, 400_000]
    assert log.problems == [f"{path}: 3 lines can not be read, the first is line 3: '0.2,12Z,2,0102'"]


def test_a_file_that_is_cut_off_in_its_compression(tmp_path):
    rows = "".join(f"{k / 100},123,{k % 256:02x}\n" for k in range(20_000))
    packed = gzip.compress(("time,id,data\n" + rows).encode())
    path = tmp_path / "x.csv.gz"
    path.write_bytes(packed[: len(packed) // 2])
    frames, log = read(path)
    assert len(frames) > 5000
    np.testing.assert_array_equal(frames.t_us, np.arange(len(frames)) * 10_000)
    assert "cut off" in log.problems[-1]


def test_columns_that_nobody_knows_are_an_error_that_says_what_is_needed(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("speed,torque,gear\n1,2,3\n")
    with pytest.raises(
        LogReadError, match=r"not known: 'speed,torque,gear'; needed is a line of column names with time"
    ):
        read(path)
    assert dialect_of("time,data\n0,0\n") is None
    assert dialect_of(";$COLUMNS=N,O\n") is None
