"""CAN frames that others write to MCAP, each message laid out by hand after its definition."""

import base64
import json
import struct

import pytest
from mcap.opcode import Opcode

from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

from ..frames_strategy import assert_same_frames, frame, frames_of
from ..reading import read
from .crafted import cdr_frame, chunk, definitions, message, record, string, write_mcap

T = 1_700_000_000_000_000
PATH = "x.mcap"


def channel(name, encoding, message_encoding, text="x", topic="/can0", number=7):
    schema = struct.pack("<H", number) + string(name) + string(encoding) + string(text)
    body = struct.pack("<HH", number, number) + string(topic) + string(message_encoding) + struct.pack("<I", 0)
    return record(Opcode.SCHEMA, schema) + record(Opcode.CHANNEL, body)


def header(order, frame_id):
    """Encapsulation and std_msgs/Header, as far as the four bytes behind it are aligned."""
    name = frame_id.encode() + b"\0"
    head = bytes([0, order == "<", 0, 0]) + struct.pack(f"{order}iII", 1_700_000_000, 250_000_000, len(name))
    return head + name + bytes(-len(name) % 4)


def big_endian(can_id, remote=0, extended=0, error=0, data=b"12345678", dlc=8, frame_id="can"):
    return header(">", frame_id) + struct.pack(">I4B", can_id, remote, extended, error, dlc) + data


def socketcan_fd(order, can_id, extended, data, frame_id="can"):
    return (
        header(order, frame_id) + struct.pack(f"{order}IBBBxI", can_id, extended, 0, len(data), len(data)) + data
    )


def ros1(can_id, remote=0, extended=0, data=b"12345678", frame_id="can"):
    head = struct.pack("<4I", 3, 1_700_000_000, 250_000_000, len(frame_id)) + frame_id.encode()
    return head + struct.pack("<I4B", can_id, remote, extended, 0, 8) + data


@pytest.mark.parametrize("frame_id", ["", "a", "can0", "a longer name"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_fd_frames_of_ros2_socketcan(tmp_path, frame_id, order):
    payloads = [
        socketcan_fd(order, 0x123, 0, bytes(range(12)), frame_id),
        socketcan_fd(order, 0x18FEF100, 1, bytes(64), frame_id),
        socketcan_fd(order, 0x124, 0, b"", frame_id),
    ]
    known = channel("ros2_socketcan_msgs/msg/FdFrame", "ros2msg", "cdr")
    frames, log = read(write_mcap(tmp_path / PATH, known, chunk(b"".join(map(message, payloads)))))
    assert log.problems == []
    assert log.unread == []
    t, fd = T + 250_000, FrameFlag.FD
    expected = [(0x123, bytes(range(12))), (0x18FEF100 | EXTENDED_ID, bytes(64)), (0x124, b"")]
    assert_same_frames(frames, frames_of([frame(t, can_id, data, fd) for can_id, data in expected]))


@pytest.mark.parametrize("frame_id", ["", "a", "can0", "a longer name"])
def test_big_endian_frames_among_others(tmp_path, frame_id):
    payloads = [
        big_endian(0x123, frame_id=frame_id),
        big_endian(0x18FEF100, extended=1, dlc=2, data=b"ab345678", frame_id=frame_id),
        big_endian(0x124, remote=1, frame_id=frame_id),
    ]
    frames, log = read(write_mcap(tmp_path / PATH, definitions(), chunk(b"".join(map(message, payloads)))))
    assert log.problems == []
    t = T + 250_000
    expected = [
        frame(t, 0x123, b"12345678"),
        frame(t, 0x18FEF100 | EXTENDED_ID, b"ab"),
        frame(t, 0x124, b"", FrameFlag.REMOTE, length=8),
    ]
    assert_same_frames(frames, frames_of(expected))
    damaged = message(cdr_frame(1)) + message(payloads[0]) + message(payloads[0][:-1]) + message(b"\0\0")
    frames, log = read(write_mcap(tmp_path / PATH, definitions(), chunk(damaged)))
    assert sorted(frames.can_id.tolist()) == [1, 0x123]
    assert log.problems == [f"{tmp_path / PATH}: 2 frame messages are damaged and left out"]


@pytest.mark.parametrize("name", ["can_msgs/Frame", "can_msgs/msg/Frame"])
def test_frames_of_ros_1(tmp_path, name):
    payloads = [ros1(0x123), ros1(0x18FEF100, extended=1, frame_id=""), ros1(0x124, remote=1), ros1(1)[:-1]]
    known = channel(name, "ros1msg", "ros1")
    frames, log = read(write_mcap(tmp_path / PATH, known, chunk(b"".join(map(message, payloads)))))
    t = T + 250_000
    expected = [
        frame(t, 0x123, b"12345678"),
        frame(t, 0x18FEF100 | EXTENDED_ID, b"12345678"),
        frame(t, 0x124, b"", FrameFlag.REMOTE, length=8),
    ]
    assert_same_frames(frames, frames_of(expected))
    assert log.problems == [f"{tmp_path / PATH}: 1 frame messages are damaged and left out"]


@pytest.mark.parametrize("name", ["can_msgs/msg/Frame", "can_msgs::msg::Frame", "can_msgs::msg::dds_::Frame_"])
def test_frames_defined_in_idl(tmp_path, name):
    known = channel(name, "ros2idl", "cdr", "module can_msgs {};")
    frames, log = read(write_mcap(tmp_path / PATH, known, chunk(message(cdr_frame(0x123)))))
    assert frames.can_id.tolist() == [0x123]
    assert log.problems == []


SCHEMA = {"type": "object", "properties": {"timestamp": {}, "id": {"type": "integer"}, "data": {"type": "string"}}}
BASE64 = SCHEMA | {"properties": SCHEMA["properties"] | {"data": {"type": "string", "contentEncoding": "base64"}}}
NOW = {"sec": 1_700_000_000, "nsec": 250_000_000}


@pytest.mark.parametrize(
    ("schema", "fields"),
    [
        (BASE64, {"timestamp": NOW, "data": base64.b64encode(b"\0" * 6).decode()}),
        (SCHEMA, {"timestamp": {"secs": 1_700_000_000, "nanosec": 250_000_000}, "data": "000000000000"}),
        (SCHEMA, {"timestamp": 1_700_000_000.25, "data": "00 00 00 00 00 00"}),
        (SCHEMA, {"timestamp": 1_700_000_000_250, "data": "0x000000000000"}),
        (SCHEMA, {"timestamp": "2023-11-14T22:13:20.250+00:00", "data": [0, 0, 0, 0, 0, 0]}),
        (SCHEMA, {"timestamp": NOW, "data": base64.b64encode(b"\0" * 6).decode(), "dlc": 6}),
    ],
)
def test_json_in_its_spellings(tmp_path, schema, fields):
    payload = json.dumps({"id": 0x123, **fields}).encode()
    known = channel("Raw", "jsonschema", "json", json.dumps(schema))
    frames, log = read(write_mcap(tmp_path / PATH, known, chunk(message(payload))))
    assert log.problems == []
    assert_same_frames(frames, frames_of([frame(T + 250_000, 0x123, bytes(6))]))


def test_json_with_flags_and_buses(tmp_path):
    base = {"timestamp": NOW, "data": "01"}
    rows = [
        base | {"arbitration_id": "0x18FEF100", "bus": 0},
        base | {"arbitration_id": 5, "is_extended": True, "bus": 1},
        base | {"arbitration_id": 6, "is_rtr": True, "dlc": 4, "data": "", "bus": 1},
        base | {"arbitration_id": 7, "data": "00" * 12, "bus": 1},
        {"arbitration_id": 8},
        [1],
        base | {"arbitration_id": -1},
    ]
    schema = {"properties": {"arbitration_id": {}, "Data": {}}}
    known = channel("Raw", "jsonschema", "json", json.dumps(schema))
    payloads = b"".join(message(json.dumps(row).encode()) for row in rows) + message(b"{")
    frames, log = read(write_mcap(tmp_path / PATH, known, chunk(payloads)))
    t = T + 250_000
    expected = [
        frame(t, 0x18FEF100 | EXTENDED_ID, b"\1"),
        frame(t, 5 | EXTENDED_ID, b"\1", channel=1),
        frame(t, 6, b"", FrameFlag.REMOTE, 1, length=4),
        frame(t, 7, bytes(12), FrameFlag.FD, 1),
    ]
    assert_same_frames(frames, frames_of(expected))
    assert log.problems == [f"{tmp_path / PATH}: 4 frame messages are damaged and left out"]


def test_what_is_no_frame_is_named_and_left_alone(tmp_path):
    other = channel("Pose", "jsonschema", "json", json.dumps({"properties": {"x": {}}}), "/pose", 1)
    proto = channel("foo.RawCan", "protobuf", "protobuf", "", "/raw", 2)
    imu = channel("sensor_msgs/msg/Imu", "ros2msg", "cdr", "x", "/imu", 3)
    rows = message(b'{"x": 1}', 1) + message(b"abc", 2) + message(b"abc", 3)
    frames, log = read(write_mcap(tmp_path / PATH, other + proto + imu, chunk(rows)))
    assert len(frames) == 0
    assert log.problems == []
    assert log.unread == ["/imu (sensor_msgs/msg/Imu)", "/pose (Pose)", "/raw (foo.RawCan)"]
