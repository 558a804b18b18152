"""The bytes of our MCAP messages: record headers, frame payloads, schema texts, topics.

MCAP: https://mcap.dev/spec; `can_msgs/msg/Frame`: https://github.com/ros-industrial/ros_canopen;
`foxglove_msgs/msg/Log`: https://docs.foxglove.dev/docs/visualization/message-schemas/log
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from dctorque_can.logs.mcap.table import SCHEMA_RULE, TIME_SCHEMA
from dctorque_can.pipeline.frames import FrameFlag

RECORD_HEAD = 9  # opcode u8, length u64
MESSAGE_HEAD = 22  # channel u16, sequence u32, log time u64, publish time u64
RECORD_ENCODING = "ros2msg"
RECORD_ENCODINGS = (RECORD_ENCODING, "ros2idl")  # of others
MESSAGE_ENCODING = "cdr"

FRAME_TYPE = "can_msgs/msg/Frame"
FD_FRAME_TYPE = "dctorque_msgs/msg/FdFrame"
EVENT_TYPE = "foxglove_msgs/msg/Log"
EVENT_TOPIC = "/dctorque/events"

FD_ONLY = int(FrameFlag.FD | FrameFlag.BITRATE_SWITCH | FrameFlag.ERROR_STATE)

_HEADER_SCHEMA = (
    SCHEMA_RULE
    + "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    + SCHEMA_RULE
    + TIME_SCHEMA
)
FRAME_SCHEMA = (
    "std_msgs/Header header\n"
    "uint32 id\n"
    "bool is_rtr\n"
    "bool is_extended\n"
    "bool is_error\n"
    "uint8 dlc\n"
    "uint8[8] data\n" + _HEADER_SCHEMA
)
FD_FRAME_SCHEMA = (
    "std_msgs/Header header\n"
    "uint32 id\n"
    "bool is_rtr\n"
    "bool is_extended\n"
    "bool is_error\n"
    "bool is_fd\n"
    "bool bitrate_switch\n"
    "bool error_state_indicator\n"
    "uint8 length\n"
    "uint8[64] data\n" + _HEADER_SCHEMA
)
EVENT_SCHEMA = (
    "uint8 UNKNOWN=0\nuint8 DEBUG=1\nuint8 INFO=2\nuint8 WARNING=3\nuint8 ERROR=4\nuint8 FATAL=5\n"
    "builtin_interfaces/Time timestamp\n"
    "uint8 level\n"
    "string message\n"
    "string name\n"
    "string file\n"
    "uint32 line\n" + SCHEMA_RULE + TIME_SCHEMA
)


class EventLevel(IntEnum):
    """``level`` of an event, as Foxglove counts."""

    DEBUG = 1
    INFO = 2
    WARNING = 3
    ERROR = 4
    FATAL = 5


# The frame id is "can0".."can255": with its terminating zero 5 to 7 bytes, padded to 8 by the alignment of `id`.
_FRAME_HEAD = [
    ("encapsulation", "u1", (4,)),
    ("sec", "<i4"),
    ("nanosec", "<u4"),
    ("frame_id_size", "<u4"),
    ("frame_id", "S8"),
    ("id", "<u4"),
    ("is_rtr", "u1"),
    ("is_extended", "u1"),
    ("is_error", "u1"),
]
FRAME = np.dtype([*_FRAME_HEAD, ("dlc", "u1"), ("data", "u1", (8,))])
FD_FRAME = np.dtype(
    [
        *_FRAME_HEAD,
        ("is_fd", "u1"),
        ("bitrate_switch", "u1"),
        ("error_state_indicator", "u1"),
        ("length", "u1"),
        ("data", "u1", (64,)),
    ]
)


def message_record(payload: np.dtype[np.void]) -> np.dtype[np.void]:
    """Return the layout of a whole message record with ``payload``."""
    return np.dtype(
        [
            ("opcode", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("sequence", "<u4"),
            ("log_time", "<u8"),
            ("publish_time", "<u8"),
            ("payload", payload),
        ]
    )


class Direction(IntEnum):
    """Who sent a frame: the last word of its topic."""

    RECEIVED = 0
    SENT = 1  # by us: not an input
    TRANSMITTED = 2  # by whatever recorded the log: an input


_DIRECTION_WORDS = {Direction.RECEIVED: "", Direction.SENT: "/sent", Direction.TRANSMITTED: "/tx"}
DIRECTION_FLAGS = {
    Direction.RECEIVED: FrameFlag(0),
    Direction.SENT: FrameFlag.SENT,
    Direction.TRANSMITTED: FrameFlag.TRANSMITTED,
}


def frame_topic(channel: int, fd: bool, direction: Direction) -> str:
    """Return the topic of frames of bus ``channel``, e.g. ``/can0``, ``/can0/fd/sent``."""
    return f"/can{channel}{'/fd' if fd else ''}{_DIRECTION_WORDS[direction]}"


def direction_of_topic(topic: str) -> Direction:
    """Return the direction that `frame_topic` wrote."""
    for direction, word in _DIRECTION_WORDS.items():
        if word and topic.endswith(word):
            return direction
    return Direction.RECEIVED
