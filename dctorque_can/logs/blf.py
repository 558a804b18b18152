"""Vector BLF logs: zlib containers of objects, read by a compiled loop over the objects.

The layout is that of ``can.io.blf``, which is the oracle of the tests.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from can.io.blf import (
    FILE_HEADER_STRUCT,
    LOG_CONTAINER,
    LOG_CONTAINER_STRUCT,
    NO_COMPRESSION,
    OBJ_HEADER_BASE_STRUCT,
    ZLIB_DEFLATE,
    TSystemTime,
    systemtime_to_timestamp,
)

from dctorque_can.logs.blf_objects import has_fd, read_objects
from dctorque_can.logs.errors import LogReadError
from dctorque_can.pipeline.frames import Frames

_SIGNATURE = b"LOBJ"
_BASE_SIZE = OBJ_HEADER_BASE_STRUCT.size
_SMALLEST_OBJECT = 32  # with a header of version 1
_CONTAINERS_AT_ONCE = 16


class BlfFrames:
    """The frames of a BLF file.

    Attributes:
        problems: what could not be read, one line each.
        fraction: share of the file that has been read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.documents: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.problems: list[str] = []
        self.fraction = 0.0
        self._size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(FILE_HEADER_STRUCT.size)
        if len(head) < FILE_HEADER_STRUCT.size or head[:4] != b"LOGG":
            raise LogReadError(f"{path}: is no BLF file: its header is cut off")
        header = FILE_HEADER_STRUCT.unpack(head)
        self._start = int(header[1])
        self._start_s = float(systemtime_to_timestamp(cast(TSystemTime, header[14:22])))

    def close(self) -> None:
        """Nothing stays open."""

    def frames(self) -> Iterator[Frames]:
        """Yield the frames of some containers at a time; an object may go on in the next container."""
        rest = b""
        waiting: list[bytes] = []
        with self.path.open("rb") as file:
            for data, follows in self._containers(file):
                if not follows:  # what the damaged place cut off can not be continued
                    yield from self._parse(b"".join([rest, *waiting]))[0]
                    rest, waiting = b"", []
                waiting.append(data)
                if len(waiting) == _CONTAINERS_AT_ONCE:
                    frames, rest = self._parse(b"".join([rest, *waiting]))
                    waiting = []
                    self.fraction = file.tell() / self._size
                    yield from frames
        yield from self._parse(b"".join([rest, *waiting]))[0]
        self.fraction = 1.0

    def _containers(self, file: BinaryIO) -> Iterator[tuple[bytes, bool]]:
        """Yield the data of each container, and whether it directly follows the one before."""
        position = self._start
        follows = True
        while position + _BASE_SIZE <= self._size:
            file.seek(position)
            signature, _, _, size, kind = OBJ_HEADER_BASE_STRUCT.unpack(file.read(_BASE_SIZE))
            if signature != _SIGNATURE or size < _BASE_SIZE:
                follows = False
                position = self._next_container(file, position)
                continue
            body = file.read(size - _BASE_SIZE)
            if kind == LOG_CONTAINER:
                cut = len(body) < size - _BASE_SIZE
                data = self._inflate(body, position, cut)
                if data is None:
                    follows = False
                else:
                    yield data, follows
                    follows = not cut
            position += size + size % 4
        if self._size - position > 3:
            self.problems.append(f"{self.path}: byte {position}: the file ends inside a container")

    def _next_container(self, file: BinaryIO, position: int) -> int:
        """Note a damaged place, and return where the next container begins."""
        file.seek(position + 1)
        passed = position + 1
        wanted = _SIGNATURE + b"\x10\0\1\0"
        tail = b""
        while part := file.read(1 << 20):
            found = (tail + part).find(wanted)
            if found >= 0:
                start = passed - len(tail) + found
                self.problems.append(
                    f"{self.path}: byte {position}: no container begins here ({start - position} bytes lost)"
                )
                return start
            passed += len(part)
            tail = (tail + part)[-len(wanted) + 1 :]
        self.problems.append(
            f"{self.path}: byte {position}: no container begins here ({self._size - position} bytes lost)"
        )
        return self._size

    def _inflate(self, body: bytes, position: int, cut: bool) -> bytes | None:
        if len(body) < LOG_CONTAINER_STRUCT.size:
            self.problems.append(f"{self.path}: byte {position}: the file ends inside a container")
            return None
        method, size = LOG_CONTAINER_STRUCT.unpack_from(body)
        packed = body[LOG_CONTAINER_STRUCT.size :]
        if method == NO_COMPRESSION:
            data = packed
        elif method == ZLIB_DEFLATE:
            try:
                data = zlib.decompressobj().decompress(packed)
            except zlib.error as error:
                self.problems.append(f"{self.path}: byte {position}: a damaged container is left out: {error}")
                return None
        else:
            self.problems.append(
                f"{self.path}: byte {position}: a container is compressed in an unknown way ({method})"
            )
            return None
        if cut or len(data) < size:
            self.problems.append(
                f"{self.path}: byte {position}: a container is cut off: {len(data)} of {size} bytes are there"
            )
        return data

    def _parse(self, data: bytes) -> tuple[list[Frames], bytes]:
        """Return the frames of whole objects, and the bytes of the last object, which is not complete."""
        parts: list[Frames] = []
        array = np.frombuffer(data, np.uint8)
        position = 0
        while position < len(data):
            capacity = (len(data) - position) // _SMALLEST_OBJECT + 1
            wide = has_fd(array, position)
            frames = Frames.empty(capacity, 64 if wide else 8)
            row, end, sound = read_objects(
                array,
                position,
                self._start_s,
                frames.t_us,
                frames.can_id,
                frames.length,
                frames.flags,
                frames.channel,
                frames.data,
            )
            parts.append(frames[:row])
            if sound:
                return parts, data[end:]
            position = data.find(_SIGNATURE, end + 1)
            position = len(data) if position < 0 else position
            self.problems.append(
                f"{self.path}: a damaged object in a container is left out ({position - end} bytes lost)"
            )
        return parts, b""
