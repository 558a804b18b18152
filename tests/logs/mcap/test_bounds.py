"""Counts, sizes and names that lie: no compiled loop reads or writes where nothing is.

A fault of this kind ends the process or damages it, so the worst files are read by a process of their own.
`NUMBA_BOUNDSCHECK=1` makes an IndexError of every one of them; `tools/check` runs these tests so, too.
"""

import struct

import numpy as np
import pytest
from mcap.opcode import Opcode

from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap.layout import FD_FRAME_TYPE, FRAME_TYPE
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.recover import recover

from ..reading import read, read_apart
from .crafted import cdr_fd_frame, cdr_frame, chunk, definitions, message, record, write_mcap

BIG = (1 << 63) - 1
LENGTHS = [0, 1, 21, 1000, 0x7FFF_FFFF, 0xFFFF_FFFF, BIG, BIG - 8, BIG + 1, (1 << 64) - 1, (1 << 64) - 9]


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("opcode", [Opcode.MESSAGE, Opcode.SCHEMA, Opcode.MESSAGE_INDEX, 0x80])
def test_a_record_of_a_chunk_that_lies_about_its_length_is_told(tmp_path, length, opcode):
    good = message(cdr_frame(1))
    bad = record(opcode, bytes(30), length)
    path = write_mcap(tmp_path / "x.mcap", definitions(), chunk(good + bad + good), chunk(good))
    frames, log = read(path)
    assert 2 <= len(frames) <= 3
    assert log.problems
    recovery = recover(path, tmp_path / "y.mcap")
    assert recovery.messages == len(frames)
    assert recovery.lost


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("opcode", [Opcode.MESSAGE, Opcode.MESSAGE_INDEX])
def test_a_record_outside_of_chunks_that_lies_about_its_length_is_told(tmp_path, length, opcode):
    good = message(cdr_frame(1))
    path = write_mcap(tmp_path / "x.mcap", definitions(), good, record(opcode, bytes(length % 22), length), good)
    frames, log = read(path)
    assert 1 <= len(frames) <= 2
    if opcode == Opcode.MESSAGE or length > 21:
        assert log.problems
    recover(path, tmp_path / "y.mcap")


@pytest.mark.parametrize("cdr", [cdr_frame, cdr_fd_frame])
def test_frame_messages_of_any_length_and_any_told_length_of_the_data(tmp_path, cdr):
    """Each shorter than a frame is counted as damaged; no frame has more data than its type holds."""
    whole = cdr(1)
    kind = FRAME_TYPE if cdr is cdr_frame else FD_FRAME_TYPE
    cut = [message(whole[:size]) for size in range(len(whole))]
    told = [message(cdr(1, size)) for size in (0, 8, 9, 64, 65, 255)]
    path = write_mcap(tmp_path / "x.mcap", definitions(kind), chunk(b"".join(cut + told)))
    frames, log = read(path)
    most = 8 if cdr is cdr_frame else 64
    assert frames.length.tolist() == [min(size, most) for size in (0, 8, 9, 64, 65, 255)]
    assert f"{len(whole)} frame messages are damaged and left out" in log.problems[0]


@pytest.mark.parametrize("name", [0, 1, 9, 100, 0x7FFF_FFFF, 0xFFFF_FFF0, 0xFFFF_FFFF])
def test_a_frame_name_that_lies_about_its_length(tmp_path, name):
    path = write_mcap(tmp_path / "x.mcap", definitions(), chunk(message(cdr_frame(1, name=name))))
    frames, log = read(path)
    assert len(frames) + len(log.problems) == 1


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
@pytest.mark.parametrize("size", [0, 1, 100_000, 1 << 40, BIG, (1 << 64) - 1])
def test_a_chunk_that_lies_about_its_unpacked_size_is_read_or_told(tmp_path, compression, size):
    good = chunk(message(cdr_frame(1)))
    path = write_mcap(
        tmp_path / "x.mcap", definitions(), good, chunk(message(cdr_frame(2)), compression, size), good
    )
    frames, log = read(path)
    assert len(frames) == 3 or log.problems
    assert len(frames) >= 2


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_chunk_that_unpacks_to_too_much_is_told(tmp_path, compression, monkeypatch):
    monkeypatch.setattr("dctorque_can.logs.mcap.file.LARGEST_CHUNK", 1 << 20)
    good = chunk(message(cdr_frame(1)))
    for size in (None, 1000):
        path = write_mcap(tmp_path / "x.mcap", definitions(), good, chunk(bytes(2 << 20), compression, size), good)
        frames, log = read(path)
        assert len(frames) == 2
        assert len(log.problems) == 1
        assert "a chunk unpacks to more than 1 MiB" in log.problems[0]


@pytest.mark.parametrize("filling", [bytes(9), record(0x80, b"")])
def test_millions_of_empty_records_in_a_chunk(tmp_path, filling):
    """They were walked one by one, in Python."""
    good = message(cdr_frame(1))
    path = write_mcap(tmp_path / "x.mcap", definitions(), chunk(good + filling * 3_000_000 + good, "zstd"))
    count, problems = read_apart(path)
    assert (count, len(problems)) == ((1, 1) if filling == bytes(9) else (2, 0))


@pytest.mark.parametrize(
    "fields", ["float64 a\nfloat64 a\n", "float64[99999999999999999999] a\n", "float64[0] a\n"]
)
def test_a_table_whose_schema_makes_no_sense_is_refused(tmp_path, fields):
    text = "builtin_interfaces/Time stamp\n" + fields
    path = write_mcap(
        tmp_path / "x.mcap",
        definitions("a/msg/B", text, "/t"),
        chunk(message(struct.pack("<4BiI", 0, 1, 0, 0, 1, 0))),
    )
    if "[0]" in fields:
        assert len(read_table(path, "/t")) == 1
    else:
        with pytest.raises(LogReadError, match="make no table"):
            read_table(path, "/t")


def test_message_numbers_up_to_the_last(tmp_path):
    last = (1 << 16) - 1
    path = write_mcap(tmp_path / "x.mcap", definitions(number=last), chunk(message(cdr_frame(1), channel=last)))
    assert len(read(path)[0]) == 1
    np.testing.assert_array_equal(read(path)[0].can_id, [1])
    assert recover(path, tmp_path / "y.mcap").messages == 1
