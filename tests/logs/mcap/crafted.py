"""MCAP files put together by hand, so that every length in them can lie."""

import struct

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from dctorque_can.logs.mcap.layout import FRAME_TYPE


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
