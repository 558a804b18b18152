"""Frames and tables out of an MCAP file."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import can
import numpy as np
from numpy.typing import NDArray

from dctorque_can.logs.columns import FrameColumns
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap.compression import DamagedRecordError
from dctorque_can.logs.mcap.file import McapFile
from dctorque_can.logs.mcap.foreign import (
    CAN_FRAME,
    OUR_FD_FRAME,
    Decoder,
    big_endian_frame,
    decoder_of,
    messages,
    plain_type,
)
from dctorque_can.logs.mcap.layout import (
    DIRECTION_FLAGS,
    MESSAGE_ENCODING,
    RECORD_ENCODINGS,
    direction_of_topic,
)
from dctorque_can.logs.mcap.records import (
    CLASSIC,
    FD,
    FrameTopics,
    Stamps,
    count_frames,
    count_messages,
    gather,
    read_frames,
)
from dctorque_can.logs.mcap.spans import message_spans
from dctorque_can.logs.mcap.table import Table, unpack_stamp
from dctorque_can.logs.messages import ChannelNumbers, frames_from_messages
from dctorque_can.pipeline.frames import Frames

_CHANNELS = 1 << 16
_BATCH = 10_000
_KINDS = {CAN_FRAME: CLASSIC, OUR_FD_FRAME: FD}


class McapFrames:
    """The frames of an MCAP file, in file order: of type ``can_msgs/msg/Frame``, our CAN FD type, and of others.

    Attributes:
        documents: attachments by name.
        metadata: named sets of words.
        problems: what could not be read, one line each.
    """

    def __init__(self, path: Path) -> None:
        self.file = McapFile(path)
        self.documents = {attachment.name: attachment.data for attachment in self.file.attachments}
        self.metadata = self.file.metadata
        self.start_us: int | None = None
        self._numbers = ChannelNumbers()
        self._topics = FrameTopics(*(np.zeros(_CHANNELS, np.uint8) for _ in range(3)))
        self._known: set[int] = set()
        self._damaged = 0
        self._decoders: dict[int, Decoder] = {}
        self._buses: dict[int, str] = {}

    @property
    def problems(self) -> list[str]:
        """What could not be read, one line each; complete when the frames have been read."""
        lines = [f"{self.file.path}: {lost}" for lost in self.file.lost]
        if self._damaged:
            lines.append(f"{self.file.path}: {self._damaged} frame messages are damaged and left out")
        return lines

    @property
    def unread(self) -> list[str]:
        """Topics of no frames with their types, complete when the frames have been read."""
        definitions = self.file.definitions
        return [
            f"{channel.topic} ({definitions.type_of(channel)[0] or channel.message_encoding or 'no schema'})"
            for number, channel in sorted(definitions.channels.items(), key=lambda item: item[1].topic)
            if not self._topics.kind[number] and number not in self._decoders
        ]

    @property
    def fraction(self) -> float:
        """Share of the file that has been read."""
        return self.file.position / self.file.size

    def frames(self) -> Iterator[Frames]:
        """Yield the frames chunk by chunk."""
        for records in self.file.runs():
            for start, end in message_spans(self.file, records):
                self._learn_channels()
                span = records[start:end]
                others = self._others(span) if self._decoders else Frames.empty()
                n, longest = count_frames(span, self._topics)
                if n == 0:
                    if len(others):
                        yield others
                    continue
                frames = Frames.empty(int(n), 8 if longest <= 8 else 64)
                stamps = np.empty(int(n), [("sec", "<i4"), ("nanosec", "<u4")])
                times = np.empty(int(n), np.uint64)
                stamped = Stamps(stamps["sec"], stamps["nanosec"], times)
                good = int(read_frames(span, self._topics, stamped, FrameColumns.of(frames)))
                frames.t_us[:good] = unpack_stamp(stamps[:good], times[:good])
                if good < n:  # damaged, or in the other byte order
                    swapped = self._swapped(span)
                    self._damaged += int(n) - good - len(swapped)
                    others = Frames.concatenate([others, swapped])
                if len(others):
                    yield Frames.concatenate([frames[:good], others]).sorted_by_time()
                elif good:
                    yield frames[:good]

    def close(self) -> None:
        """Forget the file."""
        self.file.close()

    def _others(self, span: NDArray[np.uint8]) -> Frames:
        """Return the frames of messages of other recorders."""
        return self._decoded(span, self._decoders, self._count_damaged)

    def _swapped(self, span: NDArray[np.uint8]) -> Frames:
        """Return the frames of our usual type in big-endian CDR."""
        usual = np.flatnonzero(self._topics.kind == CLASSIC).tolist()
        return self._decoded(span, dict.fromkeys(usual, big_endian_frame), lambda: None)

    def _count_damaged(self) -> None:
        self._damaged += 1

    def _decoded(
        self, span: NDArray[np.uint8], decoders: Mapping[int, Decoder], damaged: Callable[[], None]
    ) -> Frames:
        parts: list[Frames] = []
        found: list[can.Message] = []
        for message in messages(span.tobytes()):
            decoder = decoders.get(message.channel)
            if decoder is None:
                continue
            try:
                frame = decoder(message)
            except (DamagedRecordError, ValueError, TypeError, OverflowError, struct.error):
                damaged()
                continue
            topic = self._buses[message.channel]
            frame.channel = topic if frame.channel is None else f"{topic}/{frame.channel}"
            found.append(frame)
            if len(found) == _BATCH:
                parts.append(frames_from_messages(found, self._numbers))
                found = []
        return Frames.concatenate([*parts, frames_from_messages(found, self._numbers)])

    def _learn_channels(self) -> None:
        definitions = self.file.definitions
        for number in definitions.channels.keys() - self._known:
            self._known.add(number)
            channel = definitions.channels[number]
            self._buses[number] = bus_of_topic(channel.topic)
            type_name, encoding = definitions.type_of(channel)
            decoder = decoder_of(channel, definitions.schemas.get(channel.schema_id))
            if decoder is not None:
                self._decoders[number] = decoder
                continue
            if encoding not in RECORD_ENCODINGS or channel.message_encoding != MESSAGE_ENCODING:
                continue
            self._topics.kind[number] = _KINDS.get(plain_type(type_name), 0)
            if self._topics.kind[number]:
                self._topics.number[number] = self._numbers[self._buses[number]]
                self._topics.flags[number] = DIRECTION_FLAGS[direction_of_topic(channel.topic)]


def bus_of_topic(topic: str) -> str:
    """Return the topic of frames without who sent them and of which kind they are."""
    return topic.removesuffix("/sent").removesuffix("/tx").removesuffix("/fd")


def read_table(path: Path | str, table: Table | str) -> NDArray[np.void]:
    """Return all rows of a table of an MCAP file, in file order.

    Args:
        path: the log.
        table: the table, or its topic; then the dtype follows from the schema in the file.

    Raises:
        LogReadError: no such file, no such topic, or messages of another kind under that topic.
    """
    path = Path(path)
    file = McapFile(path)
    topic = table if isinstance(table, str) else table.topic
    found: Table | None = None
    parts: list[NDArray[np.void]] = []
    wanted = np.zeros(_CHANNELS, np.bool_)
    for records in file.runs():
        for start, end in message_spans(file, records):
            for number, channel in file.definitions.channels.items():
                if channel.topic == topic and not wanted[number]:
                    schema = file.definitions.schemas.get(channel.schema_id)
                    text = schema.data.decode("utf-8", "replace") if schema else ""
                    stored = Table.from_schema(topic, schema.name if schema else "", text)
                    found = _same_layout(path, stored, table)
                    wanted[number] = True
            if found is None:
                continue
            span = records[start:end]
            count = int(count_messages(span, wanted, found.payload.itemsize))
            payload = np.empty((count, found.payload.itemsize), np.uint8)
            times = np.empty(count, np.uint64)
            gather(span, wanted, payload, times)
            parts.append(found.unpack(payload.view(found.payload)[:, 0], times))
    if found is not None:
        return np.concatenate(parts)
    topics = sorted(channel.topic for channel in file.definitions.channels.values())
    if isinstance(table, Table) and topic in topics:
        return np.zeros(0, table.dtype)
    raise LogReadError(f"{path}: has no topic {topic}; it has {', '.join(topics) or 'none'}")


def _same_layout(path: Path, stored: Table, wanted: Table | str) -> Table:
    if isinstance(wanted, str):
        return stored
    if stored.schema_text != wanted.schema_text:
        raise LogReadError(
            f"{path}: the messages of {wanted.topic} have other fields than {wanted.type_name} has today; "
            "read the topic by its name"
        )
    return wanted
