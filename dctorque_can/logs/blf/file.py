"""Vector BLF logs: zlib containers of objects, read by a compiled loop over the objects.

The layout is that of ``can.io.blf``, which is the oracle of the tests.
"""

from __future__ import annotations

import zlib
from collections.abc import Generator, Iterator
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

from dctorque_can.logs.blf.objects import END_OF_DATA, SMALLEST_FRAME, TOO_NARROW, read_objects
from dctorque_can.logs.columns import FrameColumns
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.limits import LARGEST_CONTAINER, Unpacked, file_too_large, too_large
from dctorque_can.pipeline.frames import Frames

_SIGNATURE = b"LOBJ"
_BASE_SIZE = OBJ_HEADER_BASE_STRUCT.size
_CONTAINERS_AT_ONCE = 16
_ROWS_AT_ONCE = 1 << 16
_BARE_AT_ONCE = 1 << 20
_ENOUGH = 8 << 20  # bytes of containers that are read together at most
_MOST_PLACES = 20  # damaged places that are told one by one


class BlfFrames:
    """The frames of a BLF file.

    Attributes:
        fraction: share of the file that has been read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.documents: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.unread: list[str] = []
        self.start_us: int | None = None
        self.fraction = 0.0
        self._size = path.stat().st_size
        self._unpacked = Unpacked(self._size)
        self._places: list[str] = []
        self._more_places = 0
        self._objects_left_out = 0
        self._object_bytes_lost = 0
        self._cut = False  # the last container was, which has been told
        with path.open("rb") as file:
            head = file.read(FILE_HEADER_STRUCT.size)
        if len(head) < FILE_HEADER_STRUCT.size or head[:4] != b"LOGG":
            raise LogReadError(f"{path}: is no BLF file: its header is cut off")
        header = FILE_HEADER_STRUCT.unpack(head)
        self._start = int(header[1])
        self._start_s = float(systemtime_to_timestamp(cast(TSystemTime, header[14:22])))

    @property
    def problems(self) -> list[str]:
        """What could not be read, one line each; complete when the frames have been read."""
        lines = [f"{self.path}: {place}" for place in self._places]
        if self._more_places:
            lines.append(f"{self.path}: {self._more_places} more damaged places")
        if self._objects_left_out:
            lines.append(
                f"{self.path}: {self._objects_left_out} damaged objects in containers are left out "
                f"({self._object_bytes_lost} bytes lost)"
            )
        return lines

    def _note(self, position: int, problem: str) -> None:
        if len(self._places) < _MOST_PLACES:
            self._places.append(f"byte {position}: {problem}")
        else:
            self._more_places += 1

    def close(self) -> None:
        """Nothing stays open."""

    def frames(self) -> Iterator[Frames]:
        """Yield the frames of some containers at a time; an object may go on in the next container."""
        rest = b""
        waiting: list[bytes] = []
        size = 0
        with self.path.open("rb") as file:
            for data, follows in self._containers(file):
                if not follows:  # what the damaged place cut off can not be continued
                    yield from self._parse(b"".join([rest, *waiting]), last=True)
                    rest, waiting, size = b"", [], 0
                waiting.append(data)
                size += len(data)
                # An object that is not complete yet is not copied again for every few bytes.
                if (len(waiting) >= _CONTAINERS_AT_ONCE or size > _ENOUGH) and size >= len(rest):
                    self.fraction = file.tell() / self._size
                    rest = yield from self._parse(b"".join([rest, *waiting]), last=False)
                    waiting, size = [], 0
        rest = yield from self._parse(b"".join([rest, *waiting]), last=True)
        if len(rest) >= _BASE_SIZE and not self._cut:
            self._objects_left_out += 1
            self._object_bytes_lost += len(rest)
        self.fraction = 1.0

    def _containers(self, file: BinaryIO) -> Iterator[tuple[bytes, bool]]:
        """Yield the data of each container, and whether it directly follows the one before."""
        position = self._start
        follows = True
        while position + _BASE_SIZE <= self._size:
            if self._unpacked.left <= 0:
                self._note(position, f"the file {file_too_large()}")
                return
            file.seek(position)
            signature, _, _, size, kind = OBJ_HEADER_BASE_STRUCT.unpack(file.read(_BASE_SIZE))
            if signature != _SIGNATURE or not _BASE_SIZE <= size <= LARGEST_CONTAINER:
                follows = False
                following = self._next_container(file, position)
                self._note(position, f"no container begins here ({following - position} bytes lost)")
                position = following
                continue
            following = position + size + size % 4
            if kind == LOG_CONTAINER:
                body = file.read(size - _BASE_SIZE)
                self._cut = len(body) < size - _BASE_SIZE
                data = self._inflate(body, position)
                if data is not None:
                    yield data, follows
                follows = data is not None and not self._cut
                if self._cut:  # or its size is wrong, and others follow
                    following = self._next_container(file, position)
            else:  # objects outside of containers, up to the next container
                following = self._next_container(file, position)
                yield from self._bare(file, position, following)
                follows = False
            position = following
        if position > self._size + 3 and position == self._start:
            self._note(0, f"the header says that the first container begins at byte {position}")
        elif self._size - position > 3:
            self._note(position, "the file ends inside a container")

    def _bare(self, file: BinaryIO, start: int, end: int) -> Iterator[tuple[bytes, bool]]:
        """Yield what stands outside of containers, piece by piece."""
        file.seek(start)
        follows = False
        while start < end and (data := file.read(min(end - start, _BARE_AT_ONCE))):
            start += len(data)
            yield data, follows
            follows = True

    def _next_container(self, file: BinaryIO, position: int) -> int:
        """Return where the next container after ``position`` begins, or the size of the file."""
        file.seek(position + 1)
        passed = position + 1
        wanted = _SIGNATURE + b"\x10\0\1\0"
        tail = b""
        while part := file.read(1 << 16):
            found = (tail + part).find(wanted)
            if found >= 0:
                return passed - len(tail) + found
            passed += len(part)
            tail = (tail + part)[-len(wanted) + 1 :]
        return self._size

    def _inflate(self, body: bytes, position: int) -> bytes | None:
        if len(body) < LOG_CONTAINER_STRUCT.size:
            self._note(position, "a container is too small or cut off")
            return None
        method, size = LOG_CONTAINER_STRUCT.unpack_from(body)
        packed = body[LOG_CONTAINER_STRUCT.size :]
        most = self._unpacked.most(len(packed), LARGEST_CONTAINER)
        if method == NO_COMPRESSION:
            data = packed
        elif method == ZLIB_DEFLATE:
            try:
                data = zlib.decompressobj().decompress(packed, most + 1)
            except zlib.error as error:
                self._note(position, f"a damaged container is left out: {error}")
                return None
        else:
            self._note(position, f"a container is compressed in an unknown way ({method})")
            return None
        if len(data) > most:
            self._unpacked.refuse(most)
            self._note(position, f"left out: {too_large('a container', len(packed), most)}")
            return None
        if method != NO_COMPRESSION:
            self._unpacked.take(len(data))
        if self._cut or len(data) < size:
            self._note(position, f"a container is cut off: {len(data)} of {size} bytes are there")
        return data

    def _parse(self, data: bytes, last: bool) -> Generator[Frames, None, bytes]:
        """Yield the frames of whole objects; return the bytes of the last object, which is not complete."""
        array = np.frombuffer(data, np.uint8)
        position, width, ended = 0, 8, TOO_NARROW
        while ended != END_OF_DATA:
            frames = Frames.empty(min((len(data) - position) // SMALLEST_FRAME + 1, _ROWS_AT_ONCE), width)
            row, position, ended, left_out, lost = read_objects(
                array, position, last, self._start_s, FrameColumns.of(frames)
            )
            if ended == TOO_NARROW:
                width = 64
            self._objects_left_out += left_out
            self._object_bytes_lost += lost
            if row:  # of few frames a copy, so that the room for many does not stay
                yield frames[:row] if 2 * row > len(frames) else frames[:row].copy()
        return data[position:]
