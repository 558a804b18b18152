"""What a chunk unpacks to, whatever it says of its size, within a limit."""

from __future__ import annotations

from typing import cast

import lz4.frame
import zstandard
from mcap.records import Chunk

_LARGEST_CHUNK = 256 << 20  # unpacked; recorders write 1 to 10 MiB
_PIECE = 4096  # of packed data: 4 bytes can stand for 128 kB


class DamagedRecordError(Exception):
    """The bytes of a record do not say what such a record must say."""


def decompress(chunk: Chunk) -> bytes:
    """Return the records of a chunk, at most `_LARGEST_CHUNK` bytes, whatever the chunk says of its size."""
    if chunk.compression == "":
        return chunk.data
    if chunk.compression == "lz4":
        told = min(chunk.uncompressed_size, _LARGEST_CHUNK)
        for most in (told, _LARGEST_CHUNK):  # few chunks are larger than they say
            unpacking = lz4.frame.LZ4FrameDecompressor()
            data: bytes = unpacking.decompress(chunk.data, most + 1)
            if unpacking.eof and len(data) <= most:
                return data
            if len(data) <= most:
                raise DamagedRecordError("a chunk can not be decompressed")
    elif chunk.compression == "zstd":
        told = zstandard.frame_content_size(chunk.data)
        if told <= _LARGEST_CHUNK:  # -1: the frame does not say; then no more is unpacked than the chunk says
            return zstandard.ZstdDecompressor().decompress(
                chunk.data, max_output_size=min(chunk.uncompressed_size, _LARGEST_CHUNK)
            )
    else:
        raise DamagedRecordError(f"a chunk is compressed as {chunk.compression!r}; lz4, zstd and none are known")
    raise DamagedRecordError(f"a chunk unpacks to more than {_LARGEST_CHUNK >> 20} MiB")


def decompress_cut(compression: str, packed: bytes) -> bytes:
    """Return what can be had of data that are cut off."""
    if compression == "lz4":
        return cast(bytes, lz4.frame.LZ4FrameDecompressor().decompress(packed, _LARGEST_CHUNK))
    if compression == "zstd":
        unpacking = zstandard.ZstdDecompressor().decompressobj()
        data = bytearray()
        for start in range(0, len(packed), _PIECE):
            data += unpacking.decompress(packed[start : start + _PIECE])
            if len(data) > _LARGEST_CHUNK or unpacking.eof:
                break
        return bytes(data)
    return packed if compression == "" else b""
