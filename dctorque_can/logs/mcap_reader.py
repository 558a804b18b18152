"""Frames and tables out of an MCAP file, by compiled loops over the records of whole chunks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.little_endian import little_endian
from dctorque_can.logs.mcap_file import DamagedRecordError, Lost, McapFile
from dctorque_can.logs.mcap_layout import (
    DIRECTION_FLAGS,
    FD_FRAME_TYPE,
    FRAME_TYPE,
    MESSAGE_ENCODING,
    MESSAGE_HEAD,
    RECORD_ENCODING,
    RECORD_HEAD,
    direction_of_topic,
)
from dctorque_can.logs.messages import ChannelNumbers
from dctorque_can.logs.table import Table, unpack_stamp
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

_HEAD = RECORD_HEAD + MESSAGE_HEAD
_SCHEMA, _CHANNEL, _MESSAGE = int(Opcode.SCHEMA), int(Opcode.CHANNEL), int(Opcode.MESSAGE)
_CLASSIC, _FD = 1, 2
_CHANNELS = 1 << 16
_EXTENDED = int(EXTENDED_ID)
_FLAG_FD = int(FrameFlag.FD)
_FLAG_SWITCH = int(FrameFlag.BITRATE_SWITCH)
_FLAG_STATE = int(FrameFlag.ERROR_STATE)
_FLAG_REMOTE = int(FrameFlag.REMOTE)
_FLAG_ERROR = int(FrameFlag.ERROR)


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
        self._kind = np.zeros(_CHANNELS, np.uint8)
        self._number = np.zeros(_CHANNELS, np.uint8)
        self._flags = np.zeros(_CHANNELS, np.uint8)
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
    def fraction(self) -> float:
        """Share of the file that has been read."""
        return self.file.position / self.file.size

    def frames(self) -> Iterator[Frames]:
        """Yield the frames chunk by chunk."""
        for records in self.file.runs():
            for start, end in message_spans(self.file, records):
                self._learn_channels()
                span = records[start:end]
                n, longest = _count_frames(span, self._kind)
                if n == 0:
                    continue
                frames = Frames.empty(int(n), 8 if longest <= 8 else 64)
                stamps = np.empty(int(n), [("sec", "<i4"), ("nanosec", "<u4")])
                times = np.empty(int(n), np.uint64)
                good = int(
                    _read_frames(
                        span,
                        self._kind,
                        self._number,
                        self._flags,
                        stamps["sec"],
                        stamps["nanosec"],
                        times,
                        frames.can_id,
                        frames.length,
                        frames.flags,
                        frames.channel,
                        frames.data,
                    )
                )
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
            self._kind[number] = {FRAME_TYPE: _CLASSIC, FD_FRAME_TYPE: _FD}.get(type_name, 0)
            if self._kind[number]:
                direction = direction_of_topic(channel.topic)
                bus = channel.topic.removesuffix("/sent").removesuffix("/tx").removesuffix("/fd")
                self._number[number] = self._numbers[bus]
                self._flags[number] = DIRECTION_FLAGS[direction]


def message_spans(file: McapFile, records: NDArray[np.uint8], cut: bool = False) -> Iterator[tuple[int, int]]:
    """Yield where in ``records`` messages stand in a row; definitions between them go to ``file``.

    A record that can not be whole ends them, and what is lost is noted, unless they are known to be ``cut`` off.
    """
    position = 0
    while position < len(records):
        end = int(_messages_end(records, position))
        if end > position:
            yield position, end
        position = int(_skip_unknown(records, end))
        if position > end or position == len(records):
            continue
        after = int(_record_end(records, position))
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
            count = int(_count_messages(span, wanted, found.payload.itemsize))
            payload = np.empty((count, found.payload.itemsize), np.uint8)
            times = np.empty(count, np.uint64)
            _gather(span, wanted, payload, times)
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


@compiled
def _record_end(data: NDArray[np.uint8], position: int) -> int:
    """Return where the record at ``position`` ends; -1 if it is damaged or goes on beyond the data."""
    if position + RECORD_HEAD > len(data) or data[position] == 0:
        return -1
    length = little_endian(data, position + 1, 8)
    if length < 0 or length > len(data) - position - RECORD_HEAD:
        return -1
    if data[position] == _MESSAGE and length < MESSAGE_HEAD:
        return -1
    return position + RECORD_HEAD + length


@compiled
def _messages_end(data: NDArray[np.uint8], position: int) -> int:
    """Return where the row of whole message records that begins at ``position`` ends.

    What lies between is safe to read for the loops below: each record is as long as it says, a message head at
    least, and the last one ends with the row.
    """
    while position < len(data) and data[position] == _MESSAGE:
        end = _record_end(data, position)
        if end < 0:
            break
        position = end
    return position


@compiled
def _skip_unknown(data: NDArray[np.uint8], position: int) -> int:
    """Return where the first whole record from ``position`` on is a message, defines something, or is damaged."""
    while position < len(data) and data[position] not in (_MESSAGE, _SCHEMA, _CHANNEL):
        end = _record_end(data, position)
        if end < 0:
            break
        position = end
    return position


@compiled
def _count_messages(data: NDArray[np.uint8], wanted: NDArray[np.bool_], size: int) -> int:
    """Return the number of messages of the wanted channels that have payloads of ``size`` bytes.

    Bounds: ``data`` are whole messages (`_messages_end`); ``wanted`` has a place for every channel number.
    """
    count = 0
    position = 0
    while position < len(data):
        length = little_endian(data, position + 1, 8)
        if wanted[little_endian(data, position + RECORD_HEAD, 2)] and length == MESSAGE_HEAD + size:
            count += 1
        position += RECORD_HEAD + length
    return count


@compiled
def _gather(
    data: NDArray[np.uint8],
    wanted: NDArray[np.bool_],
    payload: NDArray[np.uint8],
    times: NDArray[np.uint64],
) -> None:
    """Copy the payloads (uint8 ``[n, size]``) and log times of the wanted channels.

    Bounds: as `_count_messages`; a payload has exactly ``size`` bytes, and no row is written beyond the ``n``-th.
    """
    row = 0
    position = 0
    size = payload.shape[1]
    while position < len(data) and row < len(times):
        length = little_endian(data, position + 1, 8)
        if wanted[little_endian(data, position + RECORD_HEAD, 2)] and length == MESSAGE_HEAD + size:
            payload[row] = data[position + _HEAD : position + _HEAD + size]
            times[row] = little_endian(data, position + RECORD_HEAD + 6, 8)
            row += 1
        position += RECORD_HEAD + length


@compiled
def _count_frames(data: NDArray[np.uint8], kind: NDArray[np.uint8]) -> tuple[int, int]:
    """Return the number of frame messages, and 64 if there is a CAN FD one among them, else 8.

    Bounds: as `_count_messages`.
    """
    count = 0
    longest = 8
    position = 0
    while position < len(data):
        found = kind[little_endian(data, position + RECORD_HEAD, 2)]
        if found != 0:
            count += 1
        if found == _FD:
            longest = 64
        position += RECORD_HEAD + little_endian(data, position + 1, 8)
    return count, longest


@compiled
def _read_frames(
    data: NDArray[np.uint8],
    kind: NDArray[np.uint8],
    number: NDArray[np.uint8],
    direction: NDArray[np.uint8],
    sec: NDArray[np.int32],
    nanosec: NDArray[np.uint32],
    times: NDArray[np.uint64],
    can_id: NDArray[np.uint32],
    length: NDArray[np.uint8],
    flags: NDArray[np.uint8],
    channel: NDArray[np.uint8],
    payload: NDArray[np.uint8],
) -> int:
    """Fill the columns from all frame messages that are sound, and return how many are.

    Bounds: as `_count_messages`; every byte of a payload is read only after its place was found to lie before the
    end of its record; no row is written beyond the last one, no byte beyond the width of the payload.
    """
    row = 0
    position = 0
    while position < len(data) and row < len(times):
        end = position + RECORD_HEAD + little_endian(data, position + 1, 8)
        mcap_channel = little_endian(data, position + RECORD_HEAD, 2)
        start = position + _HEAD + 4  # after the encapsulation header, from where CDR aligns
        found = kind[mcap_channel]
        if found != 0 and end >= start + 12 and data[position + _HEAD + 1] == 1:
            text = little_endian(data, start + 8, 4)
            at = start + ((12 + text + 3) & ~3)
            if at + (16 if found == _CLASSIC else 75) <= end:
                times[row] = little_endian(data, position + RECORD_HEAD + 6, 8)
                sec[row] = np.int32(little_endian(data, start, 4))
                nanosec[row] = little_endian(data, start + 4, 4)
                channel[row] = number[mcap_channel]
                can_id[row] = little_endian(data, at, 4) & 0x1FFFFFFF
                if data[at + 5] != 0:
                    can_id[row] |= np.uint32(_EXTENDED)
                flag = direction[mcap_channel]
                if data[at + 4] != 0:
                    flag |= _FLAG_REMOTE
                if data[at + 6] != 0:
                    flag |= _FLAG_ERROR
                size = data[at + 7]
                longest = 8
                first = at + 8
                if found == _FD:
                    longest = 64
                    first = at + 11
                    size = data[at + 10]
                    if data[at + 7] != 0:
                        flag |= _FLAG_FD
                    if data[at + 8] != 0:
                        flag |= _FLAG_SWITCH
                    if data[at + 9] != 0:
                        flag |= _FLAG_STATE
                length[row] = min(size, longest, payload.shape[1])
                flags[row] = flag
                if flag & _FLAG_REMOTE == 0:
                    for i in range(length[row]):
                        payload[row, i] = data[first + i]
                row += 1
        position = end
    return row
