"""Counts, sizes and names that lie: no compiled loop reads or writes where nothing is.

A fault of this kind ends the process or damages it, so the worst files are read by a process of their own.
`NUMBA_BOUNDSCHECK=1` makes an IndexError of every one of them; `tools/check` runs these tests so, too.
"""

import struct

import can
import pytest

from dctorque_can.pipeline.frames import FrameFlag

from ..reading import read, read_apart
from .crafted import blf_object, can_message, container, write_blf


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
    frames, log = read(write_blf(tmp_path / "x.blf", container(can_message(1) + small + can_message(2))))
    assert frames.can_id.tolist() == [1, 2]
    assert len(log.problems) == 1
    assert "1 damaged objects in containers are left out" in log.problems[0]


@pytest.mark.parametrize("size", [0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, 5000])
def test_a_blf_object_that_claims_what_follows_it_hides_nothing(tmp_path, size):
    objects = can_message(1) + can_message(2, size=size) + can_message(3)
    frames, log = read(write_blf(tmp_path / "x.blf", container(objects), container(can_message(4))))
    assert frames.can_id.tolist() == [1, 3, 4]
    assert len(log.problems) == 1
    assert "1 damaged objects" in log.problems[0]


def test_the_last_blf_object_is_told_when_it_is_not_whole(tmp_path):
    frames, log = read(write_blf(tmp_path / "x.blf", container(can_message(1) + can_message(2)[:-3])))
    assert frames.can_id.tolist() == [1]
    assert "1 damaged objects in containers are left out (45 bytes lost)" in log.problems[0]


def test_many_damaged_blf_objects_cost_no_more_than_their_bytes(tmp_path):
    """Each by itself looked through all that follow."""
    objects = can_message(1, ticks=1 << 60) * 100_000 + can_message(2)
    count, problems = read_apart(write_blf(tmp_path / "x.blf", container(objects)))
    assert count == 1
    assert "100000 damaged objects in containers are left out (4800000 bytes lost)" in problems[0]


@pytest.mark.parametrize("told", [0, 1, 0xFFFF_FFFF])
@pytest.mark.parametrize("method", [0, 2])
def test_a_blf_container_may_lie_about_its_unpacked_size(tmp_path, told, method):
    frames, log = read(
        write_blf(
            tmp_path / "x.blf", container(can_message(1), told=told, method=method), container(can_message(2))
        )
    )
    assert frames.can_id.tolist() == [1, 2]
    assert ["a container is cut off" in problem for problem in log.problems] == [True] * (told > 48)


@pytest.mark.parametrize("size", [0, 15, 16, 31, 100_000, 0x7FFF_FFFF, 0xFFFF_FFFF])
def test_a_blf_container_with_a_wrong_size_costs_itself(tmp_path, size):
    bad = container(can_message(2), size=size)
    frames, log = read(write_blf(tmp_path / "x.blf", container(can_message(1)), bad, container(can_message(3))))
    assert [number for number in frames.can_id.tolist() if number != 2] == [1, 3]
    assert log.problems


def test_a_blf_container_that_unpacks_to_too_much_is_left_out(tmp_path):
    path = write_blf(tmp_path / "x.blf", container(bytes(65 << 20)), container(can_message(2)))
    frames, log = read(path)
    assert frames.can_id.tolist() == [2]
    assert "unpacks to more than 64 MiB" in log.problems[0]


def test_damaged_places_of_a_blf_are_counted_when_they_are_many(tmp_path):
    frames, log = read(write_blf(tmp_path / "x.blf", *[container(b"", size=16)] * 1000, container(can_message(2))))
    assert frames.can_id.tolist() == [2]
    assert len(log.problems) == 21
    assert "980 more damaged places" in log.problems[-1]


@pytest.mark.parametrize("start", [0, 143, 100_000, 0xFFFF_FFFF])
def test_a_blf_header_that_lies_about_its_size_is_told(tmp_path, start):
    frames, log = read(write_blf(tmp_path / "x.blf", container(can_message(1)), start=start))
    assert len(frames) == (start < 144)
    assert len(log.problems) == 1


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
    frames, log = read(write_blf(tmp_path / "x.blf", container(objects)))
    assert log.problems == []
    assert frames.can_id.tolist() == [1] * 1000 + [7] + [2] * 1000
    assert frames.length[1000] == 64
    assert bytes(frames.data[1000]) == data
    assert (frames.flags[1000] & FrameFlag.FD) != 0


def test_more_blf_frames_than_rows_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr("dctorque_can.logs.blf.file._ROWS_AT_ONCE", 3)
    frames, log = read(write_blf(tmp_path / "x.blf", container(b"".join(map(can_message, range(10))))))
    assert log.problems == []
    assert frames.can_id.tolist() == list(range(10))


def test_a_length_lies_within_the_row_also_where_less_data_are_there(tmp_path):
    """Found by tools/fuzz: a CAN FD 64 object told 64 bytes, had 4, and came out with length 64 in a row of 8."""
    head = struct.pack("<BBBBLLLLLLLHBBL", 1, 15, 64, 0, 7, 0, 0x1000, *[0] * 8)
    frames, _ = read(write_blf(tmp_path / "x.blf", container(blf_object(101, head + b"abcd"))))
    assert frames.length.tolist() == [64]
    assert frames.data.shape == (1, 64)
    assert bytes(frames.data[0]) == b"abcd" + bytes(60)
