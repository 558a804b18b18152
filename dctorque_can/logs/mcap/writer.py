"""The MCAP log: frames, tables and events that Foxglove, PlotJuggler and rosbag2 open without a plug-in."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from dctorque_can import __version__
from dctorque_can.logs.mcap.chunks import ChunkedFile, Compression
from dctorque_can.logs.mcap.layout import (
    EVENT_SCHEMA,
    EVENT_TOPIC,
    EVENT_TYPE,
    FD_FRAME,
    FD_FRAME_SCHEMA,
    FD_FRAME_TYPE,
    FD_ONLY,
    FRAME,
    FRAME_SCHEMA,
    FRAME_TYPE,
    MESSAGE_HEAD,
    Direction,
    EventLevel,
    frame_topic,
    message_record,
)
from dctorque_can.logs.mcap.table import CDR_LITTLE_ENDIAN, Table, log_times, pack_stamp
from dctorque_can.pipeline.frames import EXTENDED_ID, ID_MASK, FrameFlag, Frames

_FRAME_RECORD = message_record(FRAME)
_FD_FRAME_RECORD = message_record(FD_FRAME)
_FRAME_IDS = np.array([f"can{channel}" for channel in range(256)], "S8")
_FRAME_ID_SIZES = np.array([len(f"can{channel}") + 1 for channel in range(256)], np.uint32)
_UNKNOWN = 0  # no channel has the id 0
_MEDIA_TYPES = {
    ".yaml": "application/yaml",
    ".yml": "application/yaml",
    ".json": "application/json",
    ".state": "application/octet-stream",
}


class McapLog:
    """A new MCAP log.

    Args:
        path: file to be created.
        documents: configuration and databases, attached under their names.
        metadata: named sets of words, at the head of the file in their order (`head` reads the first);
            versions and the SHA-256 of every document are added as ``dctorque``.
        compression: "lz4" (fast), "zstd" (smaller) or "" (none).
        chunk_size: bytes of messages after which a chunk is written by itself.
        overwrite: replace an existing file; otherwise that is an error.
        held: as `ChunkedFile` says: locked, and never through a symbolic link.

    Raises:
        LogWriteError: here and in every method: the file can not be written; all that was flushed stays readable.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        documents: Mapping[str, bytes] | None = None,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
        compression: Compression = "lz4",
        chunk_size: int = 1 << 20,
        overwrite: bool = True,
        held: bool = False,
    ) -> None:
        self.path = Path(path)
        self._file = ChunkedFile(
            self.path, compression=compression, chunk_size=chunk_size, overwrite=overwrite, held=held
        )
        self._schemas: dict[tuple[str, str], int] = {}
        self._tables: dict[Table, int] = {}
        self._events = _UNKNOWN
        self._frame_channels = np.zeros(_frame_key(255, True, Direction.TRANSMITTED) + 1, np.uint16)
        self._sequences = np.zeros(1 << 16, np.uint32)
        described = {name: dict(values) for name, values in (metadata or {}).items()}
        ours = described.pop("dctorque", {}) | {"dctorque_can": __version__}
        for name, values in described.items():
            self._file.add_metadata(name, values)
        for name, content in (documents or {}).items():
            self._file.add_attachment(name, _MEDIA_TYPES.get(Path(name).suffix, "text/plain"), content)
            ours[f"sha256 {name}"] = hashlib.sha256(content).hexdigest()
        self._file.add_metadata("dctorque", ours)

    @property
    def size(self) -> int:
        """Bytes written and waiting (uncompressed): what a rotation by size looks at."""
        return self._file.size + self._file.waiting

    @property
    def written(self) -> int:
        """Bytes that were handed to the operating system."""
        return self._file.size

    def fileno(self) -> int:
        """Return the number by which the operating system knows the file."""
        return self._file.fileno()

    def write_frames(self, frames: Frames) -> None:
        """Append frames in their order: topic ``/can<channel>``, with ``/fd``, ``/sent``, ``/tx`` as they are."""
        step = -(-self._file.chunk_size // _FRAME_RECORD.itemsize)
        for start in range(0, len(frames), step):
            self._write_frames(frames[start : start + step])

    def _write_frames(self, frames: Frames) -> None:
        wide = ((frames.flags & FD_ONLY) != 0) | (frames.length > 8)
        sent = (frames.flags & FrameFlag.SENT) != 0
        marked = (frames.flags & FrameFlag.TRANSMITTED) != 0
        direction = np.where(sent, Direction.SENT, np.where(marked, Direction.TRANSMITTED, 0))
        channels = self._channels_of(frames.channel + 256 * wide + 512 * direction)
        sequences = self._sequence(channels)
        times = log_times(frames.t_us)
        sizes = np.where(wide, _FD_FRAME_RECORD.itemsize, _FRAME_RECORD.itemsize).astype(np.uint64)
        offsets = np.cumsum(sizes) - sizes
        if not wide.any():
            records = _frame_records(frames, channels, sequences, times)
            block = records.tobytes()
        else:
            out = np.empty(int(sizes.sum()), np.uint8)
            for rows, record in ((~wide, _frame_records), (wide, _fd_frame_records)):
                records = record(frames[rows], channels[rows], sequences[rows], times[rows])
                places = offsets[rows].astype(np.int64)[:, None] + np.arange(records.itemsize)
                out[places] = records.view(np.uint8).reshape(len(records), records.itemsize)
            block = out.tobytes()
        self._file.append(block, channels, times, offsets)

    def _channels_of(self, keys: NDArray[np.int64]) -> NDArray[np.uint16]:
        channels = self._frame_channels[keys]
        if not channels.all():
            for key in np.unique(keys[channels == _UNKNOWN]).tolist():
                channel, fd, direction = key & 255, bool(key & 256), Direction(key >> 9)
                schema = (
                    self._schema(FD_FRAME_TYPE, FD_FRAME_SCHEMA) if fd else self._schema(FRAME_TYPE, FRAME_SCHEMA)
                )
                self._frame_channels[key] = self._channel(frame_topic(channel, fd, direction), schema)
            channels = self._frame_channels[keys]
        return channels

    def write_table(self, table: Table, rows: NDArray[np.void]) -> None:
        """Append ``rows`` (``table.dtype`` ``[n]``) to the topic of ``table``."""
        if rows.dtype.names != table.dtype.names:
            raise ValueError(f"{table.topic}: rows have the fields {rows.dtype.names}, not {table.dtype.names}")
        channel = self._tables.get(table)
        if channel is None:
            schema = self._schema(table.type_name, table.schema_text)
            channel = self._tables[table] = self._channel(table.topic, schema)
        record = message_record(table.payload)
        step = -(-self._file.chunk_size // record.itemsize)
        records = np.zeros(min(step, len(rows)), record)
        for start in range(0, len(rows), step):
            part = rows[start : start + step]
            out = records[: len(part)]
            channels = np.full(len(part), channel, np.uint16)
            times = log_times(part["t_us"])
            _message_heads(out, channels, self._sequence(channels), times)
            table.pack(part, out["payload"])
            offsets = np.arange(len(part), dtype=np.uint64) * np.uint64(record.itemsize)
            self._file.append(out.tobytes(), channels, times, offsets)

    def write_event(self, t_us: int, level: EventLevel, name: str, text: str) -> None:
        """Append a line for people: ``name`` says which part speaks. Opens as a log message in Foxglove."""
        if self._events == _UNKNOWN:
            self._events = self._channel(EVENT_TOPIC, self._schema(EVENT_TYPE, EVENT_SCHEMA))
        channels = np.array([self._events], np.uint16)
        times = log_times(np.array([t_us], np.int64))
        stamp = np.zeros(1, [("sec", "<i4"), ("nanosec", "<u4")])
        pack_stamp(np.array([t_us], np.int64), stamp)
        body = bytearray(stamp.tobytes())
        body.append(level)
        for string in (text, name, ""):
            encoded = string.encode("utf-8", "replace").replace(b"\0", b" ") + b"\0"
            body += bytes(-len(body) % 4) + struct.pack("<I", len(encoded)) + encoded
        body += bytes(-len(body) % 4) + struct.pack("<I", 0)
        payload = bytes(CDR_LITTLE_ENDIAN) + bytes(body)
        head = struct.pack(
            "<BQHIQQ",
            Opcode.MESSAGE,
            MESSAGE_HEAD + len(payload),
            self._events,
            int(self._sequence(channels)[0]),
            int(times[0]),
            int(times[0]),
        )
        self._file.append(head + payload, channels, times, np.zeros(1, np.uint64))

    def sync(self) -> None:
        """Wait until the disk has what was flushed: that survives a power cut too."""
        self._file.sync()

    def flush(self) -> None:
        """Hand everything to the operating system: what is written up to here survives a killed process."""
        self._file.flush()

    def close(self) -> None:
        """Write the rest and the index, and close the file; a failed write has closed it already."""
        self._file.finish()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _schema(self, name: str, text: str) -> int:
        key = (name, text)
        if key not in self._schemas:
            self._schemas[key] = self._file.add_schema(name, text.encode())
        return self._schemas[key]

    def _channel(self, topic: str, schema: int) -> int:
        return self._file.add_channel(topic, schema, metadata={"offered_qos_profiles": ""})

    def _sequence(self, channels: NDArray[np.uint16]) -> NDArray[np.uint32]:
        numbers = np.empty(len(channels), np.uint32)
        for channel in np.unique(channels).tolist():
            rows = channels == channel
            count = int(rows.sum())
            first = int(self._sequences[channel])
            numbers[rows] = np.arange(first, first + count).astype(np.uint32)
            self._sequences[channel] = (first + count) & 0xFFFF_FFFF
        return numbers


def _frame_key(channel: int, fd: bool, direction: Direction) -> int:
    return channel + 256 * fd + 512 * direction


def _frame_records(
    frames: Frames,
    channels: NDArray[np.uint16],
    sequences: NDArray[np.uint32],
    times: NDArray[np.uint64],
) -> NDArray[np.void]:
    records = np.empty(len(frames), _FRAME_RECORD)
    _message_heads(records, channels, sequences, times)
    payload = records["payload"]
    _frame_heads(payload, frames)
    payload["dlc"] = frames.length
    payload["data"] = frames.data[:, :8]
    return records


def _fd_frame_records(
    frames: Frames,
    channels: NDArray[np.uint16],
    sequences: NDArray[np.uint32],
    times: NDArray[np.uint64],
) -> NDArray[np.void]:
    records = np.zeros(len(frames), _FD_FRAME_RECORD)
    _message_heads(records, channels, sequences, times)
    payload = records["payload"]
    _frame_heads(payload, frames)
    payload["is_fd"] = (frames.flags & FrameFlag.FD) != 0
    payload["bitrate_switch"] = (frames.flags & FrameFlag.BITRATE_SWITCH) != 0
    payload["error_state_indicator"] = (frames.flags & FrameFlag.ERROR_STATE) != 0
    payload["length"] = frames.length
    payload["data"][:, : frames.data.shape[1]] = frames.data
    return records


def _message_heads(
    records: NDArray[np.void],
    channels: NDArray[np.uint16],
    sequences: NDArray[np.uint32],
    times: NDArray[np.uint64],
) -> None:
    records["opcode"] = Opcode.MESSAGE
    records["length"] = records.itemsize - 9
    records["channel"] = channels
    records["sequence"] = sequences
    records["log_time"] = times
    records["publish_time"] = times


def _frame_heads(payload: NDArray[np.void], frames: Frames) -> None:
    payload["encapsulation"] = CDR_LITTLE_ENDIAN
    pack_stamp(frames.t_us, payload)
    payload["frame_id_size"] = _FRAME_ID_SIZES[frames.channel]
    payload["frame_id"] = _FRAME_IDS[frames.channel]
    payload["id"] = frames.can_id & ID_MASK
    payload["is_extended"] = (frames.can_id & EXTENDED_ID) != 0
    payload["is_rtr"] = (frames.flags & FrameFlag.REMOTE) != 0
    payload["is_error"] = (frames.flags & FrameFlag.ERROR) != 0
