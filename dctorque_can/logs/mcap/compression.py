"""What a chunk unpacks to, whatever it says of its size, within a limit."""

from __future__ import annotations

from typing import cast

import lz4.frame
import zstandard
from mcap.records import Chunk

from dctorque_can.logs.limits import too_large

_PIECE = 4096  # of packed data: 4 bytes can stand for 128 kB


class DamagedRecordError(Exception):
    """The bytes of a record do not say what such a record must say."""


class TooLargeError(DamagedRecordError):
    """A chunk unpacks to more than it may."""


def decompress(chunk: Chunk, most: int) -> bytes:
    """Return the records of a chunk, at most ``most`` bytes, whatever the chunk says of its size."""
    packed = len(chunk.data)
    if chunk.compression == "":
        return chunk.data
    if chunk.compression == "lz4":
        told = min(chunk.uncompressed_size, most)
        for room in (told, most):  # few chunks are larger than they say
            unpacking = lz4.frame.LZ4FrameDecompressor()
            data: bytes = unpacking.decompress(chunk.data, room + 1)
            if unpacking.eof and len(data) <= room:
                return data
            if len(data) <= room:
                raise DamagedRecordError("a chunk can not be decompressed")
    elif chunk.compression == "zstd":
        told = zstandard.frame_content_size(chunk.data)
        if told < 0:  # the frame does not say; then no more is unpacked than the chunk says
            told = chunk.uncompressed_size
        if told <= most:
            return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=told)
    else:
        raise DamagedRecordError(f"a chunk is compressed as {chunk.compression!r}; lz4, zstd and none are known")
    raise TooLargeError(too_large("a chunk", packed, most))


def decompress_cut(compression: str, packed: bytes, most: int) -> bytes:
    """Return what can be had of data that are cut off, at most some ``most`` bytes."""
    if compression == "lz4":
        return cast(bytes, lz4.frame.LZ4FrameDecompressor().decompress(packed, most))
    if compression == "zstd":
        unpacking = zstandard.ZstdDecompressor().decompressobj()
        data = bytearray()
        for start in range(0, len(packed), _PIECE):
            data += unpacking.decompress(packed[start : start + _PIECE])
            if len(data) > most or unpacking.eof:
                break
        return bytes(data)
    return packed if compression == "" else b""
