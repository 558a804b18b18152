"""An MCAP file written chunk by chunk from whole blocks of message records.

The stock writer of the `mcap` package takes one message at a time (0.1 million a second); this one takes blocks
that numpy has laid out, and leaves all other records to the classes of the package.
"""

from __future__ import annotations

import fcntl
import os
import stat
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from io import FileIO
from pathlib import Path
from typing import Literal

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from dctorque_can import __version__
from dctorque_can.logs.errors import LogWriteError
from dctorque_can.logs.mcap.layout import MESSAGE_ENCODING, RECORD_ENCODING

Compression = Literal["lz4", "zstd", ""]


class ChunkedFile:
    """Writes records to a new file; every record reaches the operating system whole, in one go.

    A file that is ``held`` is never opened through a symbolic link, and locked (flock) until it is closed: so one
    sees that somebody still writes it.

    Attributes:
        size: bytes written so far, without the chunk in memory.
        waiting: bytes in the chunk in memory.
    """

    def __init__(
        self,
        path: Path,
        *,
        compression: Compression = "lz4",
        chunk_size: int = 1 << 20,
        overwrite: bool = True,
        profile: str = "ros2",
        held: bool = False,
    ) -> None:
        self.path = path
        self.size = 0
        self.waiting = 0
        self.chunk_size = chunk_size
        self._compression = compression
        self._blocks: list[tuple[bytes, NDArray[np.uint16], NDArray[np.uint64], NDArray[np.uint64]]] = []
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._index: list[bytes] = []  # of each chunk, ready to be written: nothing is left to be done at the end
        self._first_ns: int | None = None
        self._last_ns = 0
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = defaultdict(int)
        self._failed = False
        try:
            self._file = FileIO(path, "wb" if overwrite else "xb", opener=_held if held else None)
        except FileExistsError as error:
            raise LogWriteError(f"{path}: exists already; give another name, it is not overwritten") from error
        except OSError as error:
            raise LogWriteError(f"{path}: can not be created: {error.strerror}") from error
        self._write(MCAP0_MAGIC)
        self._write_record(Header(profile, f"dctorque_can {__version__}"))

    def add_schema(self, name: str, text: bytes, encoding: str = RECORD_ENCODING) -> int:
        """Write a schema and return its id."""
        number = len(self._schemas) + 1
        self._schemas[number] = Schema(id=number, data=text, encoding=encoding, name=name)
        self._write_record(self._schemas[number])
        return number

    def add_channel(
        self,
        topic: str,
        schema: int,
        encoding: str = MESSAGE_ENCODING,
        metadata: Mapping[str, str] | None = None,
    ) -> int:
        """Write a channel and return its id; outside of the chunks, so that these hold nothing but messages."""
        number = len(self._channels) + 1
        channel = Channel(
            id=number,
            topic=topic,
            message_encoding=encoding,
            schema_id=schema,
            metadata=dict(metadata or {}),
        )
        self._channels[number] = channel
        self._write_record(channel)
        return number

    def add_attachment(self, name: str, media_type: str, data: bytes, t_ns: int = 0) -> None:
        """Write a file that travels with the log."""
        offset = self.size
        record = Attachment(create_time=t_ns, log_time=t_ns, name=name, media_type=media_type, data=data)
        length = self._write_record(record)
        self._attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                log_time=t_ns,
                create_time=t_ns,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a named set of words."""
        offset = self.size
        length = self._write_record(Metadata(name=name, metadata=dict(values)))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def append(
        self,
        records: bytes,
        channels: NDArray[np.uint16],
        log_times: NDArray[np.uint64],
        offsets: NDArray[np.uint64],
    ) -> None:
        """Append a block of whole message records to the chunk; a full chunk is written.

        Args:
            records: the bytes of the block.
            channels: uint16 ``[n]``, channel of each record.
            log_times: uint64 ``[n]``, ns.
            offsets: uint64 ``[n]``, where in the block each record starts.
        """
        self._check()
        if len(log_times) == 0:
            return
        self._blocks.append((records, channels, log_times, offsets + np.uint64(self.waiting)))
        self.waiting += len(records)
        if self.waiting >= self.chunk_size:
            self.flush()

    def sync(self) -> None:
        """Wait until the disk has all that was handed to the operating system; a device or a pipe has no disk."""
        self._check()
        if not self.path.is_file():
            return
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise self._failure(error) from error

    def fileno(self) -> int:
        """Return the number by which the operating system knows the file."""
        return self._file.fileno()

    def flush(self) -> None:
        """End the chunk and hand it to the operating system: a killed process loses nothing of it."""
        self._check()
        if not self._blocks:
            return
        data = b"".join([block[0] for block in self._blocks])
        channels = np.concatenate([block[1] for block in self._blocks])
        log_times = np.concatenate([block[2] for block in self._blocks])
        offsets = np.concatenate([block[3] for block in self._blocks])
        self._blocks.clear()
        self.waiting = 0
        if self._compression == "lz4":
            packed: bytes = lz4.frame.compress(data)
        elif self._compression == "zstd":
            packed = zstandard.compress(data, 1)
        else:
            packed = data
        chunk = Chunk(
            compression=self._compression,
            data=packed,
            message_start_time=int(log_times.min()),
            message_end_time=int(log_times.max()),
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        start = self.size
        chunk_length = self._write_record(chunk)
        index_offsets = self._write_message_index(channels, log_times, offsets)
        index = ChunkIndex(
            message_start_time=chunk.message_start_time,
            message_end_time=chunk.message_end_time,
            chunk_start_offset=start,
            chunk_length=chunk_length,
            message_index_offsets=index_offsets,
            message_index_length=self.size - start - chunk_length,
            compression=self._compression,
            compressed_size=len(packed),
            uncompressed_size=len(data),
        )
        self._index.append(_encoded([index]))
        first_ns, self._last_ns = chunk.message_start_time, max(self._last_ns, chunk.message_end_time)
        self._first_ns = first_ns if self._first_ns is None else min(self._first_ns, first_ns)

    def _write_message_index(
        self, channels: NDArray[np.uint16], log_times: NDArray[np.uint64], offsets: NDArray[np.uint64]
    ) -> dict[int, int]:
        entries = np.empty((len(log_times), 2), "<u8")
        entries[:, 0] = log_times
        entries[:, 1] = offsets
        starts: dict[int, int] = {}
        blocks: list[bytes] = []
        end = self.size
        for channel in np.unique(channels).tolist():
            chosen = entries[channels == channel].tobytes()
            self._counts[channel] += len(chosen) // 16
            starts[channel] = end
            head = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(chosen), channel, len(chosen))
            blocks += [head, chosen]
            end += len(head) + len(chosen)
        self._write(b"".join(blocks))
        return starts

    def finish(self) -> None:
        """Write the last chunk and the index of the file, and close it; a failed write has closed it already."""
        if self._file.closed:
            return
        self.flush()
        self._write_record(DataEnd(0))
        self._write_summary()
        self._file.close()

    def _write_summary(self) -> None:
        groups = [
            (Opcode.SCHEMA, _encoded(self._schemas.values())),
            (Opcode.CHANNEL, _encoded(self._channels.values())),
            (Opcode.STATISTICS, _encoded([self._statistics()])),
            (Opcode.CHUNK_INDEX, b"".join(self._index)),
            (Opcode.ATTACHMENT_INDEX, _encoded(self._attachments)),
            (Opcode.METADATA_INDEX, _encoded(self._metadata)),
        ]
        start = end = self.size
        blocks: list[bytes] = []
        offsets: list[McapRecord] = []
        for opcode, block in groups:
            if block:
                offsets.append(SummaryOffset(group_opcode=opcode, group_start=end, group_length=len(block)))
            blocks.append(block)
            end += len(block)
        footer = Footer(summary_start=start, summary_offset_start=end, summary_crc=0)
        covered = b"".join(blocks) + _encoded(offsets) + _encoded([footer])[:-4]
        self._write(covered + zlib.crc32(covered).to_bytes(4, "little") + MCAP0_MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._index),
            message_count=sum(self._counts.values()),
            message_start_time=self._first_ns or 0,
            message_end_time=self._last_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _write_record(self, record: McapRecord) -> int:
        data = _encoded([record])
        self._write(data)
        return len(data)

    def _write(self, data: bytes) -> None:
        self._check()
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            raise self._failure(error) from error
        self.size += len(data)

    def _failure(self, error: OSError) -> LogWriteError:
        self._failed = True
        self._file.close()
        return LogWriteError(
            f"{self.path}: writing failed after {self.size} bytes: {error.strerror}; "
            "what was written before can be read"
        )

    def _check(self) -> None:
        if self._failed:
            raise LogWriteError(f"{self.path}: an earlier write failed, nothing more is written")
        if self._file.closed:
            raise LogWriteError(f"{self.path}: is closed, nothing more is written")


def _held(path: str, flags: int) -> int:
    """Open a file that nobody else writes; what is in it goes only then. A device is shared."""
    number = os.open(path, (flags & ~os.O_TRUNC) | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    try:
        if stat.S_ISREG(os.fstat(number).st_mode):
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.ftruncate(number, 0)
    except OSError:
        os.close(number)
        raise
    return number


def _encoded(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
