"""CAN frames that others wrote to an MCAP, message by message.

ros2_socketcan's FD frames, ``can_msgs/Frame`` of ROS 1 or in big-endian CDR, and JSON with identifier and data.
"""

from __future__ import annotations

import base64
import binascii
import json
import re
import struct
from collections.abc import Callable, Iterator
from datetime import datetime
from functools import partial
from typing import Any, NamedTuple

import can
from mcap.records import Channel, Schema

from dctorque_can.logs.mcap.compression import DamagedRecordError
from dctorque_can.logs.mcap.layout import MESSAGE_HEAD, RECORD_HEAD
from dctorque_can.pipeline.frames import ID_MASK

CAN_FRAME = "can_msgs/Frame"
OUR_FD_FRAME = "dctorque_msgs/FdFrame"
SOCKETCAN_FD_FRAME = "ros2_socketcan_msgs/FdFrame"
_ROLES = {
    "id": ("id", "can_id", "canid", "arbitration_id", "arbitrationid", "identifier", "address", "addr"),
    "data": ("data", "payload", "bytes"),
    "time": ("timestamp", "time", "stamp", "t"),
    "length": ("dlc", "length", "len"),
    "extended": ("is_extended", "extended", "ext", "ide", "is_extended_id", "isextended"),
    "remote": ("is_rtr", "rtr", "remote", "is_remote", "is_remote_frame"),
    "error": ("is_error", "error", "is_error_frame"),
    "fd": ("is_fd", "fd", "canfd"),
    "bus": ("bus", "channel", "interface"),
}


class Message(NamedTuple):
    """One message of an MCAP.

    Attributes:
        channel: its number.
        log_ns: when it was logged.
        data: its bytes.
    """

    channel: int
    log_ns: int
    data: bytes


Decoder = Callable[[Message], can.Message]
"""Gives the frame of a message; raises `DamagedRecordError`, ValueError and their kind when it holds none."""


def messages(records: bytes) -> Iterator[Message]:
    """Yield the messages of whole message records that stand in a row."""
    position = 0
    while position < len(records):
        _, size, channel, _, log_ns, _ = struct.unpack_from("<BQHIQQ", records, position)
        end = position + RECORD_HEAD + size
        yield Message(channel, log_ns, records[position + RECORD_HEAD + MESSAGE_HEAD : end])
        position = end


def plain_type(name: str) -> str:
    """Return a type of ROS in one spelling, such as ``can_msgs/Frame``."""
    words = re.split(r"/|::", name)
    return "/".join(word.removesuffix("_") for word in words if word not in ("msg", "dds_"))


def decoder_of(channel: Channel, schema: Schema | None) -> Decoder | None:
    """Return what reads the frames of a channel; None when it is not known to hold frames."""
    name = plain_type(schema.name) if schema else ""
    if channel.message_encoding == "cdr" and name == SOCKETCAN_FD_FRAME:
        return _socketcan_fd
    if channel.message_encoding == "ros1" and name == CAN_FRAME:
        return _ros1_frame
    if channel.message_encoding == "json":
        fields = _fields(schema.data) if schema else None
        if fields is not None:
            return partial(_json_frame, fields.get("data", ""))
    return None


def big_endian_frame(message: Message) -> can.Message:
    """Return the frame of a ``can_msgs/msg/Frame`` in big-endian CDR."""
    data = message.data
    if data[:2] != b"\0\0":
        raise DamagedRecordError("no big-endian CDR")
    seconds, at = _header(data, ">")
    number, remote, extended, error, dlc = struct.unpack_from(">I3?B", data, at)
    payload = data[at + 8 : at + 16]
    if len(payload) < 8:
        raise DamagedRecordError("a frame is cut off")
    return _frame(seconds, number, payload[: min(dlc, 8)], extended, remote, error, length=dlc)


def _header(data: bytes, order: str) -> tuple[float, int]:
    """Return the time of a ROS 2 header, s, and where the first number of four bytes behind it stands."""
    sec, nanosec, size = struct.unpack_from(f"{order}iII", data, 4)
    return sec + nanosec / 1e9, 4 + ((12 + size + 3) & ~3)


def _socketcan_fd(message: Message) -> can.Message:
    data = message.data
    order = "<" if data[1:2] == b"\1" else ">"
    seconds, at = _header(data, order)
    number, extended, error, length = struct.unpack_from(f"{order}I2?B", data, at)
    (count,) = struct.unpack_from(f"{order}I", data, at + 8)
    payload = data[at + 12 : at + 12 + count]
    if count > 64 or len(payload) < count:
        raise DamagedRecordError("a frame is cut off")
    return _frame(seconds, number, payload[: min(length, count)], extended, False, error, fd=True)


def _ros1_frame(message: Message) -> can.Message:
    data = message.data
    _, sec, nanosec, size = struct.unpack_from("<4I", data, 0)
    number, remote, extended, error, dlc = struct.unpack_from("<I3?B", data, 16 + size)
    payload = data[24 + size : 32 + size]
    if len(payload) < 8:
        raise DamagedRecordError("a frame is cut off")
    return _frame(sec + nanosec / 1e9, number, payload[: min(dlc, 8)], extended, remote, error, length=dlc)


def _frame(
    seconds: float,
    number: int,
    data: bytes,
    extended: bool,
    remote: bool = False,
    error: bool = False,
    *,
    fd: bool = False,
    length: int = 0,
    bus: str | int | None = None,
) -> can.Message:
    return can.Message(
        timestamp=seconds,
        arbitration_id=number & ID_MASK,
        is_extended_id=extended,
        is_remote_frame=remote,
        is_error_frame=error,
        is_fd=fd,
        dlc=min(length, 8) if remote else len(data),
        data=None if remote else data,
        channel=bus,
    )


def _fields(schema: bytes) -> dict[str, str] | None:
    """Return how a JSON schema says that each role is encoded, or ""; None without identifier and data."""
    try:
        properties = json.loads(schema or b"{}").get("properties", {})
    except (ValueError, AttributeError, RecursionError):
        return None
    if not isinstance(properties, dict):
        return None
    named = {str(name).lower(): what for name, what in properties.items()}
    found: dict[str, str] = {}
    for role, names in _ROLES.items():
        for name in names:
            if name in named and role not in found:
                what = named[name]
                found[role] = str(what.get("contentEncoding", "")) if isinstance(what, dict) else ""
    return found if {"id", "data"} <= set(found) else None


def _json_frame(encoding: str, message: Message) -> can.Message:
    try:
        found = json.loads(message.data)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    if not isinstance(found, dict):
        raise ValueError("no object")
    fields = {str(name).lower(): value for name, value in found.items()}

    def role(name: str) -> Any:
        return next((fields[key] for key in _ROLES[name] if key in fields), None)

    number = role("id")
    number = int(number, 0) if isinstance(number, str) else number
    if not isinstance(number, int) or isinstance(number, bool) or number < 0:
        raise ValueError("no identifier")
    length = role("length")
    length = length if isinstance(length, int) and not isinstance(length, bool) else -1
    remote = bool(role("remote"))
    data = b"" if remote and role("data") is None else _bytes(role("data"), length, encoding)
    if len(data) > 64:
        raise ValueError("more than 64 bytes")
    if length >= 0:
        data = data[:length]
    extended = role("extended")
    is_extended = number > 0x7FF if extended is None else bool(extended)
    bus = role("bus")
    return _frame(
        _seconds(role("time"), message.log_ns),
        number,
        data,
        is_extended,
        remote,
        bool(role("error")),
        fd=bool(role("fd")) or len(data) > 8,
        length=max(length, 0),
        bus=bus if isinstance(bus, str | int) else None,
    )


def _bytes(value: Any, length: int, encoding: str) -> bytes:
    """Return bytes that are written as a list of numbers, hexadecimal, or base64."""
    if isinstance(value, list):
        return bytes(value)
    if not isinstance(value, str):
        raise ValueError("no data")
    text = value.strip()
    digits = re.sub(r"0x|[\s:,-]", "", text, flags=re.I)
    is_hex = encoding != "base64" and re.fullmatch(r"(?:[0-9A-Fa-f]{2})*", digits) is not None
    spaced = digits != text  # base64 has no blanks, and no prefix
    if is_hex and (spaced or length < 0 or len(digits) == 2 * length) and not _is_base64_of(text, length):
        return bytes.fromhex(digits)
    try:
        return base64.b64decode(text, validate=True)
    except binascii.Error as error:
        raise ValueError(f"data are neither hexadecimal nor base64: {error}") from error


def _is_base64_of(text: str, length: int) -> bool:
    """Return whether a text can be base64 of so many bytes and cannot be hexadecimal of them."""
    return length >= 0 and len(text) == 4 * ((length + 2) // 3) and len(text) != 2 * length


def _seconds(value: Any, log_ns: int) -> float:
    """Return the time of a field: seconds and nanoseconds, one number, or a date; without one that of the log."""
    if isinstance(value, dict):
        fields = {str(name).lower(): part for name, part in value.items()}
        sec = next((fields[name] for name in ("sec", "secs", "seconds", "s") if name in fields), 0)
        names = ("nsec", "nanosec", "nsecs", "nanos", "nanoseconds", "ns")
        nanosec = next((fields[name] for name in names if name in fields), 0)
        return float(int(sec) + int(nanosec) / 1e9)
    if isinstance(value, str):
        return datetime.fromisoformat(value).timestamp()
    if isinstance(value, int | float) and not isinstance(value, bool):
        scales = ((1e11, 1.0), (1e14, 1e-3), (1e17, 1e-6))
        return float(value) * next((scale for most, scale in scales if abs(value) < most), 1e-9)
    return log_ns / 1e9
