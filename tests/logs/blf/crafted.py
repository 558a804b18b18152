"""BLF files put together by hand, so that every size in them can lie."""

import struct
import zlib

import can


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
