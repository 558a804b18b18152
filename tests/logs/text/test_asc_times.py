"""Times of ASC logs: relative, with a comma, before the start, and the date at which they begin."""

import os
import time
from datetime import UTC, datetime

import pytest

from dctorque_can.logs.reader import open_log
from dctorque_can.logs.text.asc_times import start_of
from dctorque_can.pipeline.frames import Frames

from ..reading import read

HEAD = "date Thu Apr 28 10:44:52.480 am 2022\nbase hex  timestamps {}\ninternal events logged\n"
ROW = "{} 1  123             Rx   d 2 01 02\n"


@pytest.fixture(autouse=True)
def utc(monkeypatch):
    monkeypatch.setitem(os.environ, "TZ", "UTC")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def write(path, kind, rows, end="\n"):
    path.write_bytes((HEAD.format(kind) + "".join(rows)).replace("\n", end).encode())
    return path


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_relative_times_count_from_the_line_before_whatever_that_is(tmp_path, end):
    rows = [
        "   0.000000 Start of measurement\n",
        ROW.format("   0.010000"),
        "   0.500000 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\n",
        ROW.format("   0.000001"),
        ROW.format("  10.000000"),
    ]
    frames, log = read(write(tmp_path / "x.asc", "relative", rows, end))
    assert frames.t_us.tolist() == [10_000, 510_001, 10_510_001]
    assert log.problems == []


def test_relative_times_of_a_long_file(tmp_path):
    rows = [ROW.format("0.000100")] * 200_000  # more than a block
    frames, _ = read(write(tmp_path / "x.asc", "relative", rows))
    assert frames.t_us.tolist() == [100 * k for k in range(1, 200_001)]


def test_decimal_commas(tmp_path):
    rows = [ROW.format("   0,010000"), ROW.format("  12,345678")]
    assert read(write(tmp_path / "x.asc", "absolute", rows))[0].t_us.tolist() == [10_000, 12_345_678]
    assert read(write(tmp_path / "x.asc", "relative", rows))[0].t_us.tolist() == [10_000, 12_355_678]


def test_negative_times_are_read_and_told(tmp_path):
    rows = [ROW.format("  -0.002000"), ROW.format("  -0.001000"), ROW.format("   0.001000")]
    frames, log = read(write(tmp_path / "x.asc", "absolute", rows))
    assert frames.t_us.tolist() == [-2000, -1000, 1000]
    assert "2 frames have negative times" in log.problems[0]
    assert len(log.problems) == 1


@pytest.mark.parametrize(
    ("text", "moment"),
    [
        ("date Thu Apr 28 10:44:52.480 am 2022", datetime(2022, 4, 28, 10, 44, 52, 480_000, UTC)),
        ("date Thu Apr 28 10:44:52.480 pm 2022", datetime(2022, 4, 28, 22, 44, 52, 480_000, UTC)),
        ("date Thu Apr 28 12:00:00 am 2022", datetime(2022, 4, 28, 0, 0, 0, 0, UTC)),
        ("date Mit Mai 4 15:06:13,001 2022", datetime(2022, 5, 4, 15, 6, 13, 1000, UTC)),
        ("date Son Mär 6 15:06:13.19 2022", datetime(2022, 3, 6, 15, 6, 13, 190_000, UTC)),
        (
            "date Fre Dez 30 15:06:13.191 2022\nBegin Triggerblock Sam Dez 31 01:02:03.004 2022",
            datetime(2022, 12, 31, 1, 2, 3, 4000, UTC),
        ),
        ("date Fre Dez 30 15:06:13 2022\nBegin Triggerblock\n", datetime(2022, 12, 30, 15, 6, 13, 0, UTC)),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_the_date_of_the_start(text, moment, encoding):
    assert start_of(text.encode(encoding)) == round(moment.timestamp() * 1e6)


@pytest.mark.parametrize("text", ["", "date", "date Thu Foo 28 10:44:52 2022", "date Thu Feb 30 10:44:52 2022"])
def test_a_date_that_is_not_understood(text):
    assert start_of(text.encode()) is None


def test_the_parts_of_a_rotated_log_run_on(tmp_path):
    for name, begin in (("a", "00:00:01.000"), ("b", "00:00:03.500")):
        (tmp_path / f"{name}.asc").write_text(
            f"date Mon Jan 01 {begin} 2024\nbase hex  timestamps absolute\ninternal events logged\n"
            f"Begin Triggerblock Mon Jan 01 {begin} 2024\n" + ROW.format("0.000000") + ROW.format("2.400000")
        )
    times = []
    for name in "ab":
        with open_log(tmp_path / f"{name}.asc") as log:
            times += Frames.concatenate(log.dated_frames()).t_us.tolist()
    first = 1_704_067_201_000_000
    assert times == [first, first + 2_400_000, first + 2_500_000, first + 4_900_000]
    with open_log(tmp_path / "b.asc") as log:
        assert Frames.concatenate(log.frames()).t_us.tolist() == [0, 2_400_000]
