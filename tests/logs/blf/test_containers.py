"""BLF of python-can and of other writers, whole, cut and damaged."""

import tempfile
from pathlib import Path

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.logs.messages import message_from_frame
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

from ..frames_strategy import assert_same_frames, frame, frames_of
from ..reading import START, by_python_can, read


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
