"""What the service tells its log-writer process over a pipe, and the answers that come back.

A message is a kind byte, the length of its body and the body. Columns travel as their bytes; both ends are always
of one version and one machine.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Iterator
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.logs.mcap.table import Table
from dctorque_can.pipeline.estimates import ESTIMATE, HEALTH
from dctorque_can.pipeline.frames import Frames

HEADER = struct.Struct("<BI")
_SHAPE = struct.Struct("<II")
_NUMBER = struct.Struct("<Q")
_FLUSH = struct.Struct("<Qd")


class Kind(IntEnum):
    """What a message carries."""

    SETUP = 0  # JSON, first of all
    DOCUMENT = 1  # name, NUL, content
    FRAMES = 2
    ESTIMATES = 3
    HEALTH = 4
    EVENT = 5  # JSON
    ROTATE = 6  # number; the state that the next log begins with
    TABLE = 7  # topic, type, schema text as JSON, NUL, rows
    FLUSH = 8  # number; when the oldest of what was handed over since the last one was received
    END = 9  # number


def message(kind: Kind, body: bytes = b"") -> bytes:
    """Return one message."""
    return HEADER.pack(kind, len(body)) + body


def json_message(kind: Kind, content: dict[str, Any]) -> bytes:
    """Return one message with a JSON body."""
    return message(kind, json.dumps(content).encode())


def document_message(name: str, content: bytes) -> bytes:
    """Return one document to be attached to every log."""
    return message(Kind.DOCUMENT, name.encode() + b"\0" + content)


def frames_message(frames: Frames) -> bytes:
    """Return the columns of ``frames`` as one message."""
    columns = (frames.t_us, frames.can_id, frames.length, frames.flags, frames.channel, frames.data)
    body = _SHAPE.pack(len(frames), frames.data.shape[1]) + b"".join(column.tobytes() for column in columns)
    return message(Kind.FRAMES, body)


def read_frames(body: bytes) -> Frames:
    """Return what `frames_message` packed."""
    n, width = _SHAPE.unpack_from(body)
    at = _SHAPE.size

    def column(dtype: str, each: int = 1) -> NDArray[Any]:
        nonlocal at
        values = np.frombuffer(body, dtype, n * each, at)
        at += values.nbytes
        return values

    t_us, can_id = column("i8"), column("u4")
    length, flags, channel = column("u1"), column("u1"), column("u1")
    return Frames(t_us, can_id, length, flags, channel, column("u1", width).reshape(n, width))


def rotate_message(number: int, state: bytes) -> bytes:
    """Return the wish for a new log that begins with a state; empty: with that before the first frame."""
    return message(Kind.ROTATE, _NUMBER.pack(number) + state)


def read_rotate(body: bytes) -> tuple[int, bytes]:
    """Return what `rotate_message` packed."""
    return _NUMBER.unpack_from(body)[0], body[_NUMBER.size :]


def flush_message(number: int, received_s: float) -> bytes:
    """Return the wish that all before it is handed to the operating system, and ``received_s``, monotonic."""
    return message(Kind.FLUSH, _FLUSH.pack(number, received_s))


def read_flush(body: bytes) -> tuple[int, float]:
    """Return what `flush_message` packed."""
    number, received_s = _FLUSH.unpack(body)
    return number, received_s


def end_message(number: int) -> bytes:
    """Return the word that nothing else comes."""
    return message(Kind.END, _NUMBER.pack(number))


def read_end(body: bytes) -> int:
    """Return what `end_message` packed."""
    number: int = _NUMBER.unpack(body)[0]
    return number


def estimates_message(parts: Iterable[NDArray[np.void]]) -> bytes:
    """Return `ESTIMATE` rows as one message."""
    return message(Kind.ESTIMATES, _joined(parts, ESTIMATE))


def health_message(parts: Iterable[NDArray[np.void]]) -> bytes:
    """Return `HEALTH` rows as one message."""
    return message(Kind.HEALTH, _joined(parts, HEALTH))


def _joined(parts: Iterable[NDArray[np.void]], dtype: np.dtype[np.void]) -> bytes:
    """Return rows one behind the other: numpy would compare the fields of each part to those of the others."""
    return b"".join([rows.astype(dtype, copy=False).tobytes() for rows in parts])


def table_message(table: Table, rows: NDArray[np.void]) -> bytes:
    """Return rows of any table whose field names are those of its messages."""
    head = json.dumps([table.topic, table.type_name, table.schema_text]).encode()
    return message(Kind.TABLE, head + b"\0" + rows.astype(table.dtype, copy=False).tobytes())


def read_table_rows(body: bytes) -> tuple[Table, NDArray[np.void]]:
    """Return what `table_message` packed."""
    head, _, rows = body.partition(b"\0")
    table = Table.from_schema(*json.loads(head))
    return table, np.frombuffer(rows, table.dtype)


class MessageSplitter:
    """Cuts a stream of bytes back into messages."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def feed(self, chunk: bytes) -> Iterator[tuple[Kind, bytes]]:
        """Take the next bytes and yield each message that is whole by now."""
        self._rest += chunk
        at = 0
        while len(self._rest) - at >= HEADER.size:
            kind, length = HEADER.unpack_from(self._rest, at)
            end = at + HEADER.size + length
            if end > len(self._rest):
                break
            yield Kind(kind), bytes(self._rest[at + HEADER.size : end])
            at = end
        del self._rest[:at]
