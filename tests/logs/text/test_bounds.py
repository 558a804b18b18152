"""Counts, sizes and names that lie: no compiled loop reads or writes where nothing is.

A fault of this kind ends the process or damages it, so the worst files are read by a process of their own.
`NUMBA_BOUNDSCHECK=1` makes an IndexError of every one of them; `tools/check` runs these tests so, too.
"""

import gzip

import pytest

from ..reading import read, read_apart


@pytest.mark.parametrize("suffix", [".log", ".asc"])
def test_more_lines_than_rows_at_once(tmp_path, monkeypatch, suffix):
    """With lines between them that only python-can reads."""
    monkeypatch.setattr("dctorque_can.logs.text.blocks._ROWS_AT_ONCE", 3)
    line = {".log": "(1.{:06d}) can0 {:03X}#01", ".asc": "1.{:06d} 1 {:X} Rx d 1 01"}[suffix]
    odd = {".log": "(2.0) can0 7FF#R", ".asc": "2.0 1 7FF Rx r"}[suffix]
    head = {".log": "", ".asc": "base hex  timestamps absolute\ninternal events logged\n"}[suffix]
    for period in (1, 2, 5):
        lines = [odd if i % period == period - 1 else line.format(i, i) for i in range(50)]
        path = tmp_path / f"x{suffix}"
        path.write_text(head + "\n".join(lines) + "\n")
        frames, log = read(path)
        assert log.problems == []
        assert frames.can_id.tolist() == [0x7FF if i % period == period - 1 else i for i in range(50)]


@pytest.mark.parametrize(
    "name", ["007", "0", "00", "1234567890123456", "can0", "a" * 16, "a" * 17, "x" + "9" * 5000]
)
def test_every_channel_name_of_a_candump_log_ends(tmp_path, name):
    """A name that python-can writes otherwise was learnt for ever; one of 5000 digits is no number for Python."""
    path = tmp_path / "x.log"
    path.write_text(f"(1.0) can1 123#00\n(1.0) {name} 123#01\n(1.0) {name} 124#02\n")
    count, problems = read_apart(path)
    assert (count, problems) == (3, [])


@pytest.mark.parametrize("count", [300, 5000])
def test_more_channels_than_frames_can_tell_apart(tmp_path, count):
    path = tmp_path / "x.log"
    path.write_text("".join(f"(1.0) x{i:05d}a 123#00\n" for i in range(count)))
    frames, log = read(path)
    assert log.problems == []
    assert len(frames) == count
    assert frames.channel.tolist()[:300] == [min(i, 255) for i in range(300)]


def prefixes(line):
    return [line[:size] for size in range(len(line) + 1)]


def test_lines_shorter_than_any_frame(tmp_path):
    """Every beginning of a line, as a line and as the end of the file."""
    whole = {
        ".log": ["(1.0) can0 12345678##3" + "AB" * 64 + " T", "(1.0) can0 123#0102030405060708 R"],
        ".asc": [
            "1.0 1  123x  Rx   d 8 01 02 03 04 05 06 07 08",
            "1.0 CANFD 1 Rx 123 Name 1 0 9 12 00 01 02 03 04 05 06 07 08 09 0A 0B",
        ],
    }
    heads = {".log": "(1.0) can0 123#00\n", ".asc": "base hex  timestamps absolute\ninternal events logged\n"}
    for suffix, lines in whole.items():
        path = tmp_path / f"x{suffix}"
        path.write_text(heads[suffix] + "\n".join(part for line in lines for part in prefixes(line)) + "\n")
        frames, log = read(path)
        assert len(frames) >= 2
        assert len(log.problems) <= 1
        for part in (part for line in lines for part in prefixes(line)):
            path.write_text(heads[suffix] + part)
            frames, log = read(path)
            assert len(frames) <= 2
            assert len(log.problems) <= 2


def test_an_asc_length_of_thousands_of_digits_is_told(tmp_path):
    path = tmp_path / "x.asc"
    path.write_text("base hex  timestamps absolute\n1.0 1 1 Rx d 1 01\n1.0 CANFD 1 Rx 110 n 1 0 3 " + "9" * 5000)
    frames, log = read(path)
    assert len(frames) == 1
    assert log.problems


def test_a_line_without_end_is_left_out_and_told(tmp_path):
    good = b"(1.000000) can0 123#01\n"
    content = good * 3 + b"(1.000000) can0 123#" + b"0" * (30 << 20) + b"\n" + good * 2
    for path in (tmp_path / "x.log", tmp_path / "x.log.gz"):
        path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
        frames, log = read(path)
        assert len(frames) == 5
        assert "1 lines can not be read, the first is line 4: '(1.000000) can0 123#000" in log.problems[0]
