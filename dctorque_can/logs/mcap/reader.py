"""Frames and tables out of an MCAP file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dctorque_can.logs.columns import FrameColumns
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap.compression import DamagedRecordError
from dctorque_can.logs.mcap.file import Lost, McapFile
from dctorque_can.logs.mcap.layout import (
    DIRECTION_FLAGS,
    FD_FRAME_TYPE,
    FRAME_TYPE,
    MESSAGE_ENCODING,
    RECORD_ENCODING,
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
    messages_end,
    read_frames,
    record_end,
    skip_unknown,
)
from dctorque_can.logs.mcap.table import Table, unpack_stamp
from dctorque_can.logs.messages import ChannelNumbers
from dctorque_can.pipeline.frames import Frames

_CHANNELS = 1 << 16


class McapFrames:
    """The frames of an MCAP file, of all topics of type ``can_msgs/msg/Frame`` or our CAN FD type, in file order.

    Attributes:
        documents: attachments by name.
        metadata: named sets of words.
        problems: what could not be read, one line each.
    """

    def __init__(self, path: Path) -> None:
        self.file = McapFile(path)
        self.documents = {attachment.name: attachment.data for attachment in self.file.attachments}
        self.metadata = self.file.metadata
        self._numbers = ChannelNumbers()
        self._topics = FrameTopics(*(np.zeros(_CHANNELS, np.uint8) for _ in range(3)))
        self._known: set[int] = set()
        self._damaged = 0

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
            if not self._topics.kind[number]
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
                n, longest = count_frames(span, self._topics)
                if n == 0:
                    continue
                frames = Frames.empty(int(n), 8 if longest <= 8 else 64)
                stamps = np.empty(int(n), [("sec", "<i4"), ("nanosec", "<u4")])
                times = np.empty(int(n), np.uint64)
                stamped = Stamps(stamps["sec"], stamps["nanosec"], times)
                good = int(read_frames(span, self._topics, stamped, FrameColumns.of(frames)))
                frames.t_us[:good] = unpack_stamp(stamps[:good], times[:good])
                self._damaged += int(n) - good
                if good:
                    yield frames[:good]

    def close(self) -> None:
        """Forget the file."""
        self.file.close()

    def _learn_channels(self) -> None:
        definitions = self.file.definitions
        for number in definitions.channels.keys() - self._known:
            self._known.add(number)
            channel = definitions.channels[number]
            type_name, encoding = definitions.type_of(channel)
            if encoding != RECORD_ENCODING or channel.message_encoding != MESSAGE_ENCODING:
                continue
            self._topics.kind[number] = {FRAME_TYPE: CLASSIC, FD_FRAME_TYPE: FD}.get(type_name, 0)
            if self._topics.kind[number]:
                direction = direction_of_topic(channel.topic)
                bus = channel.topic.removesuffix("/sent").removesuffix("/tx").removesuffix("/fd")
                self._topics.number[number] = self._numbers[bus]
                self._topics.flags[number] = DIRECTION_FLAGS[direction]


def message_spans(file: McapFile, records: NDArray[np.uint8], cut: bool = False) -> Iterator[tuple[int, int]]:
    """Yield where in ``records`` messages stand in a row; definitions between them go to ``file``.

    A record that can not be whole ends them, and what is lost is noted, unless they are known to be ``cut`` off.
    """
    position = 0
    while position < len(records):
        end = int(messages_end(records, position))
        if end > position:
            yield position, end
        position = int(skip_unknown(records, end))
        if position > end or position == len(records):
            continue
        after = int(record_end(records, position))
        if after < 0:
            if not cut:
                lost = len(records) - position
                file.lost.append(Lost(file.position, lost, "in the chunk before it a record is damaged"))
            break
        try:
            file.definitions.learn(records[position:after].tobytes())
        except DamagedRecordError as error:
            file.lost.append(Lost(file.position, 0, f"in the chunk before it: {error}"))
        position = after


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
