"""The structure of an MCAP file, whole, truncated or damaged: what stands where, and its message records.

The stock reader of the `mcap` package gives 0.1 million messages a second and nothing at all of a truncated file.
Here chunks are found by walking the records, and handed on whole.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, ChunkIndex, Footer, Header, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.limits import LARGEST_CHUNK, Unpacked, file_too_large
from dctorque_can.logs.little_endian import little_endian
from dctorque_can.logs.mcap.compression import DamagedRecordError, TooLargeError, decompress, decompress_cut
from dctorque_can.logs.mcap.layout import RECORD_HEAD

_CHUNK_HEAD = 40  # record head, three u64, crc u32, and the size of the compression's name
_FOOTER_SIZE = RECORD_HEAD + 20
_MESSAGE = int(Opcode.MESSAGE)
_MESSAGE_INDEX = int(Opcode.MESSAGE_INDEX)

R = TypeVar("R", covariant=True)


class _Readable(Protocol[R]):
    @staticmethod
    def read(stream: ReadDataStream) -> R: ...


@dataclass
class Lost:
    """Bytes of a file that could not be read.

    Attributes:
        start: first byte.
        size: bytes.
        reason: in words.
    """

    start: int
    size: int
    reason: str

    def __str__(self) -> str:
        return f"byte {self.start}: {self.reason} ({self.size} bytes lost)"


@dataclass
class Definitions:
    """Schemas and channels met so far, by their ids."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def type_of(self, channel: Channel) -> tuple[str, str]:
        """Return type name and schema encoding, empty when there is no schema."""
        schema = self.schemas.get(channel.schema_id)
        return (schema.name, schema.encoding) if schema else ("", "")

    def learn(self, record: bytes) -> None:
        """Take a schema or channel record (from its opcode on); anything else is left alone."""
        if record[0] == Opcode.SCHEMA:
            schema = _parse(Schema, record)
            self.schemas[schema.id] = schema
        elif record[0] == Opcode.CHANNEL:
            channel = _parse(Channel, record)
            self.channels[channel.id] = channel


class McapFile:
    """An MCAP file opened for reading.

    Attributes:
        profile: e.g. "ros2".
        definitions: schemas and channels that stand outside of the chunks; the others must be learnt from `runs`.
        attachments: in the order of the file.
        metadata: by name.
        lost: what could not be read; complete after `runs` is exhausted.
        complete: the file was closed properly: stock readers open it.
        position: bytes up to the end of what `runs` has given.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.profile = ""
        self.definitions = Definitions()
        self.attachments: list[Attachment] = []
        self.metadata: dict[str, dict[str, str]] = {}
        self.lost: list[Lost] = []
        self.position = 0
        self._pieces: list[tuple[int, int, bool]] = []
        self._tail: tuple[int, int] | None = None
        if not path.is_file():
            raise LogReadError(f"{path}: there is no such file")
        with path.open("rb") as file:
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise LogReadError(f"{path}: is no MCAP file: it does not begin with the MCAP magic bytes")
            self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self.size = len(self._map)
        self._unpacked = Unpacked(self.size)
        self._bytes: NDArray[np.uint8] = np.frombuffer(self._map, np.uint8)
        self.complete = self.size > 2 * len(MCAP0_MAGIC) and self._map[-len(MCAP0_MAGIC) :] == MCAP0_MAGIC
        self._scan()

    def _scan(self) -> None:
        position = len(MCAP0_MAGIC)
        while position < self.size:
            after = int(_skip_messages(self._bytes, position))
            if after > position:
                self._pieces.append((position, after, False))
                position = after
            end, problem = self._record_end(position)
            if problem:
                position = self._lose(position, problem)
            elif end > position:
                try:
                    self._take(position, end)
                except DamagedRecordError as error:
                    self.lost.append(Lost(position, end - position, str(error)))
                if self._map[position] == Opcode.FOOTER:
                    break
                position = end
        if not self.complete and not self.lost:
            self.lost.append(Lost(self.size, 0, "the file was not closed: its end is missing"))

    def _record_end(self, position: int) -> tuple[int, str]:
        if position >= self.size:
            return position, ""
        if position + RECORD_HEAD > self.size:
            return position, "the file ends inside a record"
        end = position + RECORD_HEAD + _u64(self._map, position + 1)
        if end > self.size:
            return position, "the file ends inside a record, or the record is damaged"
        if self._map[position] == 0:
            return position, "no record begins here"
        if self._map[position] == Opcode.FOOTER and self.size - end > len(MCAP0_MAGIC):
            return position, "the record that ends a file stands within it"
        return end, ""

    def _lose(self, position: int, reason: str) -> int:
        """Note what is lost from ``position`` on, and return where the next chunk is known to begin."""
        following = next((start for start in self._indexed_chunks() if start > position), self.size)
        self.lost.append(Lost(position, following - position, reason))
        if following == self.size:
            self._tail = (position, self.size)
        return following

    def _indexed_chunks(self) -> list[int]:
        """Return where chunks begin by the index at the end of the file, if that is there."""
        footer_start = self.size - len(MCAP0_MAGIC) - _FOOTER_SIZE
        if not self.complete or footer_start < 0 or self._map[footer_start] != Opcode.FOOTER:
            return []
        footer = _parse(Footer, self._map[footer_start : footer_start + _FOOTER_SIZE])
        position, starts = footer.summary_start, []
        while 0 < position < footer_start:
            end, problem = self._record_end(position)
            if problem:
                break
            if self._map[position] == Opcode.CHUNK_INDEX:
                starts.append(self._chunk_start(position, end))
            position = end
        return sorted(start for start in starts if 0 < start < footer_start)

    def _chunk_start(self, start: int, end: int) -> int:
        """Return where the chunk of an index record begins, 0 if the record is damaged."""
        try:
            index: ChunkIndex = _parse(ChunkIndex, self._map[start:end])
        except DamagedRecordError:
            return 0
        return int(index.chunk_start_offset)

    def _take(self, start: int, end: int) -> None:
        opcode = self._map[start]
        if opcode == Opcode.CHUNK:
            self._pieces.append((start, end, True))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self.definitions.learn(self._map[start:end])
        elif opcode == Opcode.ATTACHMENT:
            body = self._map[start + RECORD_HEAD : end]
            if body[-4:] not in (b"\0\0\0\0", zlib.crc32(body[:-4]).to_bytes(4, "little")):
                self.lost.append(Lost(start, end - start, "an attachment has a wrong checksum"))
            else:
                self.attachments.append(_parse(Attachment, self._map[start:end]))
        elif opcode == Opcode.METADATA:
            record = _parse(Metadata, self._map[start:end])
            self.metadata[record.name] = record.metadata
        elif opcode == Opcode.HEADER:
            self.profile = _parse(Header, self._map[start:end]).profile

    def runs(self) -> Iterator[NDArray[np.uint8]]:
        """Yield the records of every whole chunk, and runs of messages outside of chunks, in the file's order."""
        for start, end, is_chunk in self._pieces:
            self.position = end
            if self._unpacked.left <= 0:
                self.lost.append(Lost(start, self.size - start, f"the file {file_too_large()}"))
                break
            if is_chunk:
                records = self._chunk(start, end)
                if records is not None:
                    yield records
            else:
                yield self._bytes[start:end]
        self.position = self.size

    def _chunk(self, start: int, end: int) -> NDArray[np.uint8] | None:
        try:
            chunk = _parse(Chunk, self._map[start:end])
            most = self._unpacked.most(len(chunk.data), LARGEST_CHUNK)
            data = decompress(chunk, most)
        except TooLargeError as error:
            self._unpacked.refuse(most)
            self.lost.append(Lost(start, end - start, str(error)))
            return None
        except DamagedRecordError as error:
            self.lost.append(Lost(start, end - start, str(error)))
            return None
        except (RuntimeError, zstandard.ZstdError, ValueError, MemoryError):
            self.lost.append(Lost(start, end - start, "a chunk can not be decompressed"))
            return None
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            self.lost.append(Lost(start, end - start, "a chunk has a wrong checksum"))
            return None
        if chunk.compression:
            self._unpacked.take(len(data))
        return np.frombuffer(data, np.uint8)

    def broken_tail(self) -> NDArray[np.uint8] | None:
        """Return what can be decompressed of a chunk that the end of the file cuts off; its last record is cut."""
        if self._tail is None or self._tail[0] + _CHUNK_HEAD > self.size:
            return None
        start, end = self._tail
        if self._map[start] != Opcode.CHUNK:
            return None
        name_end = start + RECORD_HEAD + 28 + 4 + int.from_bytes(self._map[start + 37 : start + 41], "little")
        compression = self._map[start + 41 : name_end].decode("ascii", "replace")
        packed = self._map[name_end + 8 : end]
        try:
            data = decompress_cut(compression, packed, self._unpacked.most(len(packed), LARGEST_CHUNK))
        except (RuntimeError, zstandard.ZstdError, MemoryError):
            return None
        return np.frombuffer(data, np.uint8)

    def close(self) -> None:
        """Forget the file; the system releases it with the last array that looks at it."""
        self._pieces.clear()


def _parse(kind: type[_Readable[R]], record: bytes) -> R:
    try:
        return kind.read(ReadDataStream(BytesIO(record[RECORD_HEAD:])))
    except (McapError, ValueError, OverflowError, struct.error) as error:
        raise DamagedRecordError(f"a damaged record: {error}") from error


def _u64(data: mmap.mmap, position: int) -> int:
    return int.from_bytes(data[position : position + 8], "little")


@compiled
def _skip_messages(data: NDArray[np.uint8], position: int) -> int:
    """Return where the first whole record that is neither message nor message index begins, or ends whole.

    Bounds: a head is read only where it is whole; the position never passes the end of the data.
    """
    while position + RECORD_HEAD <= len(data):
        if data[position] != _MESSAGE and data[position] != _MESSAGE_INDEX:
            break
        length = little_endian(data, position + 1, 8)
        if length < 0 or length > len(data) - position - RECORD_HEAD:
            break
        position += RECORD_HEAD + length
    return position
