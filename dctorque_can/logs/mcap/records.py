"""Compiled loops over the records of whole chunks.

`messages_end` finds the messages that stand in a row; all the others trust it, and go over such a row only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.logs.columns import FrameColumns
from dctorque_can.logs.little_endian import little_endian
from dctorque_can.logs.mcap.layout import MESSAGE_HEAD, RECORD_HEAD
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

_HEAD = RECORD_HEAD + MESSAGE_HEAD
_SCHEMA, _CHANNEL, _MESSAGE = int(Opcode.SCHEMA), int(Opcode.CHANNEL), int(Opcode.MESSAGE)
CLASSIC, FD = 1, 2
_EXTENDED = int(EXTENDED_ID)
_FLAG_FD = int(FrameFlag.FD)
_FLAG_SWITCH = int(FrameFlag.BITRATE_SWITCH)
_FLAG_STATE = int(FrameFlag.ERROR_STATE)
_FLAG_REMOTE = int(FrameFlag.REMOTE)
_FLAG_ERROR = int(FrameFlag.ERROR)


class FrameTopics(NamedTuple):
    """What is known of each MCAP channel, by its number: uint8 ``[65536]`` each.

    ``kind`` is `CLASSIC`, `FD`, or 0 for no frames; ``number`` the bus; ``flags`` say who sent the frames.
    """

    kind: NDArray[np.uint8]
    number: NDArray[np.uint8]
    flags: NDArray[np.uint8]


class Stamps(NamedTuple):
    """Times of ``n`` messages: of their own header, and the log time in ns."""

    sec: NDArray[np.int32]
    nanosec: NDArray[np.uint32]
    log_time: NDArray[np.uint64]


@compiled
def record_end(data: NDArray[np.uint8], position: int) -> int:
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
def messages_end(data: NDArray[np.uint8], position: int) -> int:
    """Return where the row of whole message records that begins at ``position`` ends.

    What lies between is safe to read for the loops below: each record is as long as it says, a message head at
    least, and the last one ends with the row.
    """
    while position < len(data) and data[position] == _MESSAGE:
        end = record_end(data, position)
        if end < 0:
            break
        position = end
    return position


@compiled
def skip_unknown(data: NDArray[np.uint8], position: int) -> int:
    """Return where the first whole record from ``position`` on is a message, defines something, or is damaged."""
    while position < len(data) and data[position] not in (_MESSAGE, _SCHEMA, _CHANNEL):
        end = record_end(data, position)
        if end < 0:
            break
        position = end
    return position


@compiled
def count_messages(data: NDArray[np.uint8], wanted: NDArray[np.bool_], size: int) -> int:
    """Return the number of messages of the wanted channels that have payloads of ``size`` bytes.

    Bounds: ``data`` are whole messages (`messages_end`); ``wanted`` has a place for every channel number.
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
def gather(
    data: NDArray[np.uint8],
    wanted: NDArray[np.bool_],
    payload: NDArray[np.uint8],
    times: NDArray[np.uint64],
) -> None:
    """Copy the payloads (uint8 ``[n, size]``) and log times of the wanted channels.

    Bounds: as `count_messages`; a payload has exactly ``size`` bytes, and no row is written beyond the ``n``-th.
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
def count_frames(data: NDArray[np.uint8], topics: FrameTopics) -> tuple[int, int]:
    """Return the number of frame messages, and 64 if there is a CAN FD one among them, else 8.

    Bounds: as `count_messages`.
    """
    kind, _, _ = topics
    count = 0
    longest = 8
    position = 0
    while position < len(data):
        found = kind[little_endian(data, position + RECORD_HEAD, 2)]
        if found != 0:
            count += 1
        if found == FD:
            longest = 64
        position += RECORD_HEAD + little_endian(data, position + 1, 8)
    return count, longest


@compiled
def read_frames(data: NDArray[np.uint8], topics: FrameTopics, stamps: Stamps, columns: FrameColumns) -> int:
    """Fill stamps and columns, but for ``t_us``, from all sound frame messages, and return how many are.

    Bounds: as `count_messages`; every byte of a payload is read only after its place was found to lie before the
    end of its record; no row is written beyond the last one, no byte beyond the width of the payload.
    """
    kind, number, direction = topics
    sec, nanosec, times = stamps
    _, can_id, length, flags, channel, payload = columns
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
            if at + (16 if found == CLASSIC else 75) <= end:
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
                if found == FD:
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


@compiled
def renumber(
    data: NDArray[np.uint8],
    numbers: NDArray[np.uint16],
    channels: NDArray[np.uint16],
    times: NDArray[np.uint64],
    offsets: NDArray[np.uint64],
) -> tuple[int, int, int]:
    """Give the records their new channel ids in place, closing the gaps of those that have none.

    Returns the number of messages kept, of those left out, and of bytes kept.

    Bounds: ``data`` are whole messages (`messages_end`), ``numbers`` has a place for every channel number, and
    the bytes kept never overtake those read. No row is written beyond the last one: each has a whole head.
    """
    row = 0
    unknown = 0
    position = 0
    kept = 0
    while position < len(data) and row < len(times):
        size = RECORD_HEAD + little_endian(data, position + 1, 8)
        channel = numbers[little_endian(data, position + RECORD_HEAD, 2)]
        if channel == 0:
            unknown += 1
        else:
            for i in range(size):
                data[kept + i] = data[position + i]
            data[kept + RECORD_HEAD] = channel & 255
            data[kept + RECORD_HEAD + 1] = channel >> 8
            channels[row] = channel
            times[row] = little_endian(data, kept + RECORD_HEAD + 6, 8)
            offsets[row] = kept
            row += 1
            kept += size
        position += size
    return row, unknown, kept
