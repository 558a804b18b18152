"""A clean, indexed MCAP file out of one that was cut off or damaged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dctorque_can.logs.errors import LogWriteError
from dctorque_can.logs.mcap.chunks import ChunkedFile
from dctorque_can.logs.mcap.file import McapFile
from dctorque_can.logs.mcap.layout import MESSAGE_HEAD, RECORD_HEAD
from dctorque_can.logs.mcap.records import renumber
from dctorque_can.logs.mcap.spans import message_spans

_SMALLEST = RECORD_HEAD + MESSAGE_HEAD


@dataclass(frozen=True, slots=True)
class Recovery:
    """What a recovery saved and what it could not.

    Attributes:
        messages: saved, of all channels.
        messages_of_broken_chunk: of these, saved out of the chunk that the end of the file cuts off.
        unknown_messages: not saved: the definition of their channel is lost.
        attachments: saved.
        lost: one line for each damaged place; empty if the file was whole.
        bytes_lost: size of the damaged places.
        only_cut: nothing is damaged but the end of the file.
    """

    messages: int
    messages_of_broken_chunk: int
    unknown_messages: int
    attachments: int
    lost: tuple[str, ...]
    bytes_lost: int
    only_cut: bool


def recover(path: Path | str, out: Path | str, progress: Callable[[float], None] | None = None) -> Recovery:
    """Write everything whole of the MCAP file ``path`` to a new file ``out``.

    Schemas, channels, attachments and metadata are kept; ids are given anew, the order stays.

    Args:
        path: an MCAP file, of whatever program.
        out: must not exist.
        progress: told the share that is done, 0 to 1.

    Raises:
        LogReadError: ``path`` is missing or no MCAP file at all.
        LogWriteError: ``out`` exists or can not be written.
    """
    path, out = Path(path), Path(out)
    source = McapFile(path)
    if out.exists():
        raise LogWriteError(f"{out}: exists already; give another name, it is not overwritten")
    target = ChunkedFile(out, overwrite=False, profile=source.profile)
    try:
        for name, values in source.metadata.items():  # first of all: by the first of them a log is known
            target.add_metadata(name, values)
        for attachment in source.attachments:
            target.add_attachment(attachment.name, attachment.media_type, attachment.data, attachment.log_time)
        copy = _Copy(source, target)
        for records in source.runs():
            copy.take(records)
            if progress:
                progress(source.position / source.size)
        if progress:
            progress(1.0)
        before = copy.messages
        tail = source.broken_tail()
        if tail is not None:
            copy.take(tail, cut=True)
        target.add_metadata(
            "recovered", {"from": path.name} | {str(i): str(lost) for i, lost in enumerate(source.lost)}
        )
    finally:
        target.finish()
    return Recovery(
        messages=copy.messages,
        messages_of_broken_chunk=copy.messages - before,
        unknown_messages=copy.unknown,
        attachments=len(source.attachments),
        lost=tuple(str(lost) for lost in source.lost),
        bytes_lost=sum(lost.size for lost in source.lost),
        only_cut=all(lost.start + lost.size == source.size for lost in source.lost),
    )


class _Copy:
    """Message records on their way from one file to another, with the channel ids of the new one."""

    def __init__(self, source: McapFile, target: ChunkedFile) -> None:
        self.messages = 0
        self.unknown = 0
        self._source = source
        self._target = target
        self._channels = np.zeros(1 << 16, np.uint16)
        self._schemas: dict[int, int] = {0: 0}

    def take(self, records: NDArray[np.uint8], cut: bool = False) -> None:
        for start, end in message_spans(self._source, records, cut):
            self._define()
            span = records[start:end].copy()
            size = len(span) // _SMALLEST
            channels, times = np.empty(size, np.uint16), np.empty(size, np.uint64)
            offsets = np.empty(size, np.uint64)
            n, unknown, used = renumber(span, self._channels, channels, times, offsets)
            self._target.append(span[:used].tobytes(), channels[:n], times[:n], offsets[:n])
            self.messages += int(n)
            self.unknown += int(unknown)

    def _define(self) -> None:
        definitions = self._source.definitions
        for number, channel in definitions.channels.items():
            if self._channels[number]:
                continue
            schema = definitions.schemas.get(channel.schema_id)
            if schema and schema.id not in self._schemas:
                added = self._target.add_schema(schema.name, schema.data, schema.encoding)
                self._schemas[schema.id] = added
            self._channels[number] = self._target.add_channel(
                channel.topic,
                self._schemas[schema.id] if schema else 0,
                channel.message_encoding,
                channel.metadata,
            )
