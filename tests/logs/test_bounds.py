"""Crafted logs: counts, sizes and names that lie. No compiled loop reads or writes where nothing is.

A fault of this kind ends the process or damages it, so the worst are read by a process of their own.
`NUMBA_BOUNDSCHECK=1` makes every one of them an IndexError; `tools/check` runs this folder so, too.
"""

import gzip
import struct
import subprocess
import sys
import zlib

import can
import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode

from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap_layout import FD_FRAME_TYPE, FRAME_TYPE
from dctorque_can.logs.mcap_reader import read_table
from dctorque_can.logs.reader import open_log
from dctorque_can.logs.recover import recover
from dctorque_can.pipeline.frames import FrameFlag, Frames

READ = """
import sys
from dctorque_can.logs.reader import open_log
with open_log(sys.argv[1]) as log:
    print(sum(map(len, log.frames())), *log.problems, sep="\\n")
"""


def read(path):
    with open_log(path) as log:
        frames = Frames.concatenate(log.frames())
    return frames, log.problems


def read_apart(path):
    """Return the number of frames and the problems, read by another process, which must end well."""
    done = subprocess.run([sys.executable, "-c", READ, str(path)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    count, *problems = done.stdout.splitlines()
    return int(count), problems


# BLF


def blf_object(kind, body, size=None, ticks=0, version=1):
    head = can.io.blf.OBJ_HEADER_V1_STRUCT if version == 1 else can.io.blf.OBJ_HEADER_V2_STRUCT
    whole = 16 + head.size + len(body)
    base = struct.pack("<4sHHLL", b"LOBJ", 16 + head.size, version, whole if size is None else size, kind)
    return base + head.pack(2, 0, 0, ticks) + body


def can_message(number, **options):
    return blf_object(can.io.blf.CAN_MESSAGE, struct.pack("<HBBL8s", 1, 0, 8, number, b"12345678"), **options)


def container(objects, size=None, told=None, method=2):
    packed = zlib.compress(objects, 9) if method == 2 else objects
    head = struct.pack("<H6xL4x", method, len(objects) if told is None else told)
    base = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(packed) if size is None else size, 10)
    return base + head + packed + bytes(len(packed) % 4)


def write_blf(path, *containers, start=144):
    header = can.io.blf.FILE_HEADER_STRUCT.pack(
        b"LOGG", start, *([0] * 8), 0, 0, 0, 0, *(2024, 1, 1, 1, 0, 0, 0, 0), *([0] * 8)
    )
    path.write_bytes(header.ljust(144, b"\0") + b"".join(containers))
    return path


def test_blf_objects_that_claim_16_bytes(tmp_path):
    """Room for frames was counted by a size that no object has to have."""
    objects = struct.pack("<4sHHLL", b"LOBJ", 32, 1, 16, 1) * 200_000 + bytes(64)
    count, problems = read_apart(write_blf(tmp_path / "x.blf", container(objects)))
    assert count == 0
    assert len(problems) == 1
    assert "200000 damaged objects in containers are left out" in problems[0]


@pytest.mark.parametrize("size", [0, 1, 15, 16, 31, 32, 39, 47])
@pytest.mark.parametrize("kind", [1, 73, 86, 100, 101])
def test_a_blf_object_too_small_for_what_it_holds_is_left_out_and_told(tmp_path, size, kind):
    """The frames around it are read; a CAN FD 64 object alone may hold fewer bytes than its frame has."""
    body = struct.pack("<HBBL8s", 1, 0, 8, 0x123, b"12345678").ljust(84, b"\1")
    small = blf_object(kind, body, size)
    assert size < 32 + 16
    frames, problems = read(write_blf(tmp_path / "x.blf", container(can_message(1) + small + can_message(2))))
    assert frames.can_id.tolist() == [1, 2]
    assert len(problems) == 1
    assert "1 damaged objects in containers are left out" in problems[0]


@pytest.mark.parametrize("size", [0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, 5000])
def test_a_blf_object_that_claims_what_follows_it_hides_nothing(tmp_path, size):
    objects = can_message(1) + can_message(2, size=size) + can_message(3)
    frames, problems = read(write_blf(tmp_path / "x.blf", container(objects), container(can_message(4))))
    assert frames.can_id.tolist() == [1, 3, 4]
    assert len(problems) == 1
    assert "1 damaged objects" in problems[0]


def test_the_last_blf_object_is_told_when_it_is_not_whole(tmp_path):
    frames, problems = read(write_blf(tmp_path / "x.blf", container(can_message(1) + can_message(2)[:-3])))
    assert frames.can_id.tolist() == [1]
    assert "1 damaged objects in containers are left out (45 bytes lost)" in problems[0]


def test_many_damaged_blf_objects_cost_no_more_than_their_bytes(tmp_path):
    """Each by itself looked through all that follow."""
    objects = can_message(1, ticks=1 << 60) * 100_000 + can_message(2)
    count, problems = read_apart(write_blf(tmp_path / "x.blf", container(objects)))
    assert count == 1
    assert "100000 damaged objects in containers are left out (4800000 bytes lost)" in problems[0]


@pytest.mark.parametrize("told", [0, 1, 0xFFFF_FFFF])
@pytest.mark.parametrize("method", [0, 2])
def test_a_blf_container_may_lie_about_its_unpacked_size(tmp_path, told, method):
    frames, problems = read(
        write_blf(
            tmp_path / "x.blf", container(can_message(1), told=told, method=method), container(can_message(2))
        )
    )
    assert frames.can_id.tolist() == [1, 2]
    assert ["a container is cut off" in problem for problem in problems] == [True] * (told > 48)


@pytest.mark.parametrize("size", [0, 15, 16, 31, 100_000, 0x7FFF_FFFF, 0xFFFF_FFFF])
def test_a_blf_container_with_a_wrong_size_costs_itself(tmp_path, size):
    bad = container(can_message(2), size=size)
    frames, problems = read(
        write_blf(tmp_path / "x.blf", container(can_message(1)), bad, container(can_message(3)))
    )
    assert [number for number in frames.can_id.tolist() if number != 2] == [1, 3]
    assert problems


def test_a_blf_container_that_unpacks_to_too_much_is_left_out(tmp_path):
    path = write_blf(tmp_path / "x.blf", container(bytes(65 << 20)), container(can_message(2)))
    frames, problems = read(path)
    assert frames.can_id.tolist() == [2]
    assert "unpacks to more than 64 MiB" in problems[0]


def test_damaged_places_of_a_blf_are_counted_when_they_are_many(tmp_path):
    frames, problems = read(
        write_blf(tmp_path / "x.blf", *[container(b"", size=16)] * 1000, container(can_message(2)))
    )
    assert frames.can_id.tolist() == [2]
    assert len(problems) == 21
    assert "980 more damaged places" in problems[-1]


@pytest.mark.parametrize("start", [0, 143, 100_000, 0xFFFF_FFFF])
def test_a_blf_header_that_lies_about_its_size_is_told(tmp_path, start):
    frames, problems = read(write_blf(tmp_path / "x.blf", container(can_message(1)), start=start))
    assert len(frames) == (start < 144)
    assert len(problems) == 1


@pytest.mark.parametrize("kind", [100, 101])
def test_a_blf_fd_frame_among_short_ones_has_its_64_bytes(tmp_path, kind):
    data = bytes(range(64))
    blf = can.io.blf
    body = (
        blf.CAN_FD_MSG_STRUCT.pack(1, 0, 15, 7, 0, 0, 1, 64, data)
        if kind == 100
        else blf.CAN_FD_MSG_64_STRUCT.pack(1, 15, 64, 0, 7, 0, 0x1000, 0, 0, 0, 0, 0, 0, 0, 0) + data
    )
    objects = can_message(1) * 1000 + blf_object(kind, body) + can_message(2) * 1000
    frames, problems = read(write_blf(tmp_path / "x.blf", container(objects)))
    assert problems == []
    assert frames.can_id.tolist() == [1] * 1000 + [7] + [2] * 1000
    assert frames.length[1000] == 64
    assert bytes(frames.data[1000]) == data
    assert (frames.flags[1000] & FrameFlag.FD) != 0


def test_more_blf_frames_than_rows_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr("dctorque_can.logs.blf._ROWS_AT_ONCE", 3)
    frames, problems = read(write_blf(tmp_path / "x.blf", container(b"".join(map(can_message, range(10))))))
    assert problems == []
    assert frames.can_id.tolist() == list(range(10))


# Text


@pytest.mark.parametrize("suffix", [".log", ".asc"])
def test_more_lines_than_rows_at_once(tmp_path, monkeypatch, suffix):
    """With lines between them that only python-can reads."""
    monkeypatch.setattr("dctorque_can.logs.text_blocks._ROWS_AT_ONCE", 3)
    line = {".log": "(1.{:06d}) can0 {:03X}#01", ".asc": "1.{:06d} 1 {:X} Rx d 1 01"}[suffix]
    odd = {".log": "(2.0) can0 7FF#R", ".asc": "2.0 1 7FF Rx r"}[suffix]
    head = {".log": "", ".asc": "base hex  timestamps absolute\ninternal events logged\n"}[suffix]
    for period in (1, 2, 5):
        lines = [odd if i % period == period - 1 else line.format(i, i) for i in range(50)]
        path = tmp_path / f"x{suffix}"
        path.write_text(head + "\n".join(lines) + "\n")
        frames, problems = read(path)
        assert problems == []
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
    frames, problems = read(path)
    assert problems == []
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
        frames, problems = read(path)
        assert len(frames) >= 2
        assert len(problems) <= 1
        for part in (part for line in lines for part in prefixes(line)):
            path.write_text(heads[suffix] + part)
            frames, problems = read(path)
            assert len(frames) <= 2
            assert len(problems) <= 2


def test_an_asc_length_of_thousands_of_digits_is_told(tmp_path):
    path = tmp_path / "x.asc"
    path.write_text("base hex  timestamps absolute\n1.0 1 1 Rx d 1 01\n1.0 CANFD 1 Rx 110 n 1 0 3 " + "9" * 5000)
    frames, problems = read(path)
    assert len(frames) == 1
    assert problems


def test_a_line_without_end_is_left_out_and_told(tmp_path):
    good = b"(1.000000) can0 123#01\n"
    content = good * 3 + b"(1.000000) can0 123#" + b"0" * (30 << 20) + b"\n" + good * 2
    for path in (tmp_path / "x.log", tmp_path / "x.log.gz"):
        path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
        frames, problems = read(path)
        assert len(frames) == 5
        assert "1 lines can not be read, the first is line 4: '(1.000000) can0 123#000" in problems[0]


# MCAP


def record(opcode, body, length=None):
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def string(text):
    return struct.pack("<I", len(text)) + text.encode()


def definitions(type_name=FRAME_TYPE, text="x", topic="/can0", number=7):
    schema = struct.pack("<H", number) + string(type_name) + string("ros2msg") + string(text)
    channel = struct.pack("<HH", number, number) + string(topic) + string("cdr") + struct.pack("<I", 0)
    return record(Opcode.SCHEMA, schema) + record(Opcode.CHANNEL, channel)


def cdr_frame(can_id, size=8, data=bytes(8), name=5):
    head = struct.pack("<4BiII", 0, 1, 0, 0, 1, 0, name) + b"can0\0\0\0\0"
    return head + struct.pack("<IBBBB", can_id, 0, 0, 0, size) + data


def cdr_fd_frame(can_id, size=64, data=bytes(64)):
    head = struct.pack("<4BiII", 0, 1, 0, 0, 1, 0, 5) + b"can0\0\0\0\0"
    return head + struct.pack("<IBBBBBBB", can_id, 0, 0, 0, 1, 0, 0, size) + data


def message(payload, channel=7, length=None):
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", channel, 0, 0, 0) + payload, length)


def chunk(records, compression="", size=None, packed=None):
    packs = {"": bytes, "lz4": lz4.frame.compress, "zstd": zstandard.compress}
    packed = packs[compression](records) if packed is None else packed
    head = struct.pack("<QQQI", 0, 0, len(records) if size is None else size, 0) + string(compression)
    return record(Opcode.CHUNK, head + struct.pack("<Q", len(packed)) + packed)


def write_mcap(path, *records):
    """A file that is closed, without an index."""
    magic = b"\x89MCAP0\r\n"
    header = record(Opcode.HEADER, string("ros2") + string("test"))
    footer = record(Opcode.FOOTER, struct.pack("<QQI", 0, 0, 0))
    end = record(Opcode.DATA_END, bytes(4)) + footer + magic
    path.write_bytes(magic + header + b"".join(records) + end)
    return path


BIG = (1 << 63) - 1
LENGTHS = [0, 1, 21, 1000, 0x7FFF_FFFF, 0xFFFF_FFFF, BIG, BIG - 8, BIG + 1, (1 << 64) - 1, (1 << 64) - 9]


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("opcode", [Opcode.MESSAGE, Opcode.SCHEMA, Opcode.MESSAGE_INDEX, 0x80])
def test_a_record_of_a_chunk_that_lies_about_its_length_is_told(tmp_path, length, opcode):
    good = message(cdr_frame(1))
    bad = record(opcode, bytes(30), length)
    path = write_mcap(tmp_path / "x.mcap", definitions(), chunk(good + bad + good), chunk(good))
    frames, problems = read(path)
    assert 2 <= len(frames) <= 3
    assert problems
    recovery = recover(path, tmp_path / "y.mcap")
    assert recovery.messages == len(frames)
    assert recovery.lost


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("opcode", [Opcode.MESSAGE, Opcode.MESSAGE_INDEX])
def test_a_record_outside_of_chunks_that_lies_about_its_length_is_told(tmp_path, length, opcode):
    good = message(cdr_frame(1))
    path = write_mcap(tmp_path / "x.mcap", definitions(), good, record(opcode, bytes(length % 22), length), good)
    frames, problems = read(path)
    assert 1 <= len(frames) <= 2
    if opcode == Opcode.MESSAGE or length > 21:
        assert problems
    recover(path, tmp_path / "y.mcap")


@pytest.mark.parametrize("cdr", [cdr_frame, cdr_fd_frame])
def test_frame_messages_of_any_length_and_any_told_length_of_the_data(tmp_path, cdr):
    """Each shorter than a frame is counted as damaged; no frame has more data than its type holds."""
    whole = cdr(1)
    kind = FRAME_TYPE if cdr is cdr_frame else FD_FRAME_TYPE
    cut = [message(whole[:size]) for size in range(len(whole))]
    told = [message(cdr(1, size)) for size in (0, 8, 9, 64, 65, 255)]
    path = write_mcap(tmp_path / "x.mcap", definitions(kind), chunk(b"".join(cut + told)))
    frames, problems = read(path)
    most = 8 if cdr is cdr_frame else 64
    assert frames.length.tolist() == [min(size, most) for size in (0, 8, 9, 64, 65, 255)]
    assert f"{len(whole)} frame messages are damaged and left out" in problems[0]


@pytest.mark.parametrize("name", [0, 1, 9, 100, 0x7FFF_FFFF, 0xFFFF_FFF0, 0xFFFF_FFFF])
def test_a_frame_name_that_lies_about_its_length(tmp_path, name):
    path = write_mcap(tmp_path / "x.mcap", definitions(), chunk(message(cdr_frame(1, name=name))))
    frames, problems = read(path)
    assert len(frames) + len(problems) == 1


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
@pytest.mark.parametrize("size", [0, 1, 100_000, 1 << 40, BIG, (1 << 64) - 1])
def test_a_chunk_that_lies_about_its_unpacked_size_is_read_or_told(tmp_path, compression, size):
    good = chunk(message(cdr_frame(1)))
    path = write_mcap(
        tmp_path / "x.mcap", definitions(), good, chunk(message(cdr_frame(2)), compression, size), good
    )
    frames, problems = read(path)
    assert len(frames) == 3 or problems
    assert len(frames) >= 2


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_chunk_that_unpacks_to_too_much_is_told(tmp_path, compression, monkeypatch):
    monkeypatch.setattr("dctorque_can.logs.mcap_file._LARGEST_CHUNK", 1 << 20)
    good = chunk(message(cdr_frame(1)))
    for size in (None, 1000):
        path = write_mcap(tmp_path / "x.mcap", definitions(), good, chunk(bytes(2 << 20), compression, size), good)
        frames, problems = read(path)
        assert len(frames) == 2
        assert len(problems) == 1
        assert "a chunk unpacks to more than 1 MiB" in problems[0]


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
