"""Vector ASC logs: ``0.010000 1  123  Rx   d 8 01 02 03 04 05 06 07 08``, and ``CANFD`` lines.

Times are those that stand in the lines, from the start of the measurement, as python-can gives them. Relative
ones are summed; `Asc.start_us` is the date of the start.
"""

from __future__ import annotations

import io
import re
from itertools import groupby

import can
import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.logs.columns import FrameColumns
from dctorque_can.logs.text.asc_times import TimeRewriter, is_negative, start_of
from dctorque_can.logs.text.blocks import LastLine
from dctorque_can.logs.text.lines import Lines, each_message, warnings_of
from dctorque_can.logs.text.scan import (
    END_OF_BLOCK,
    HEX,
    IRREGULAR,
    NEW_CHANNEL,
    NO_ROOM,
    find_channel,
    parse_hex_bytes,
    parse_time,
)
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

_EXTENDED = int(EXTENDED_ID)
_FD = int(FrameFlag.FD)
_SWITCH = int(FrameFlag.BITRATE_SWITCH)
_STATE = int(FrameFlag.ERROR_STATE)
_TRANSMITTED = int(FrameFlag.TRANSMITTED)
_FD_LENGTHS = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64], np.int64)
_END_OF_HEADER = "internal events logged\n"  # without it the reader takes the first line for its header
_HEX_DIGIT = re.compile(r"[0-9a-fA-F]")
_BASE = re.compile(rb"^\s*base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.I | re.M)


class Asc:
    """The lines of an ASC log, whose text begins with ``head``.

    Attributes:
        start_us: µs since 1970 at which the measurement began: of the first ``Begin Triggerblock``, else of the
            header; None when neither has a date that is understood.
    """

    def __init__(self, head: bytes) -> None:
        match = _BASE.search(head)
        self._base = match[1].decode().lower() if match else "hex"
        self.warnings: list[str] = []
        self.start_us = start_of(head)
        self._times = TimeRewriter(head)
        self._negative = 0

    def plain(self, block: bytes) -> bytes:
        """See `LineFormat.plain`: absolute times with a point."""
        return self._times.plain(block)

    def parse(
        self,
        data: NDArray[np.uint8],
        position: int,
        row: int,
        columns: FrameColumns,
        names: NDArray[np.uint8],
        numbers: NDArray[np.uint8],
    ) -> tuple[int, int, int]:
        """See `LineFormat.parse`. Decimal files are left to python-can."""
        if self._base == "dec":
            return position, row, IRREGULAR
        return _parse(data, position, row, columns, names, numbers)

    def channel(self, line: bytes) -> tuple[bytes, int | str]:
        """See `LineFormat.channel`: python-can counts from 0."""
        words = line.split()
        name = words[2] if words[1] == b"CANFD" else words[1]
        return name, int(name) - 1

    def messages(self, text: str) -> tuple[list[can.Message], list[str]]:
        """See `LineFormat.messages`."""
        messages: list[can.Message] = []
        bad: list[str] = []
        for negative, group in groupby(io.StringIO(text, newline=None), is_negative):
            lines = Lines(line.replace("-", "", 1) if negative else line for line in group)
            lines.begin(_END_OF_HEADER)
            found = each_message(
                lines,
                lambda file: can.ASCReader(file, base=self._base),
                _END_OF_HEADER,
                lambda lines: bad.append(lines.last),
            )
            # It warns of lengths that differ, and takes the data that are there.
            with warnings_of("can.io.asc", lambda text: None):
                part = list(found)
            if negative and part:
                for message in part:
                    message.timestamp = -message.timestamp
                self._tell_negative(len(part))
            messages += part
        return messages, bad

    def _tell_negative(self, count: int) -> None:
        self._negative += count
        self.warnings[:] = [
            f"{self._negative} frames have negative times, before the start of the measurement; they are taken so"
        ]

    def last_line(self, line: str) -> LastLine:
        """See `LineFormat.last_line`: the number of bytes stands before the data."""
        if not line[0].isdigit():  # comment, end of a trigger block
            return LastLine.WHOLE
        words = line.split()
        if words[1:2] == ["CANFD"]:
            length_at = 8 if len(words) > 5 and words[5].isdigit() else 9
            size = words[length_at : length_at + 1]
            count = int(size[0]) if size and size[0].isdecimal() and len(size[0]) <= 2 else -1
        else:
            length_at = 5
            size = words[5:6] if words[4:5] == ["d"] else []
            count = int(size[0], 16) if size and _HEX_DIGIT.fullmatch(size[0]) else -1
            count = min(count, 8)
        if count < 0:
            return LastLine.UNSURE
        data = words[length_at + 1 : length_at + 1 + count]
        if len(data) < count:
            return LastLine.PART
        if self._base == "dec":
            return LastLine.UNSURE
        return LastLine.WHOLE if all(len(word) == 2 for word in data) else LastLine.PART


@compiled
def _skip(data: NDArray[np.uint8], position: int, end: int) -> int:
    """Return the first byte after spaces and tabs, at most ``end``."""
    while position < end and (data[position] == 32 or data[position] == 9):
        position += 1
    return position


@compiled
def _word_end(data: NDArray[np.uint8], position: int, end: int) -> int:
    while position < end and 32 < data[position] < 127:
        position += 1
    return position


@compiled
def _identifier(data: NDArray[np.uint8], start: int, end: int) -> int:
    """Return the identifier of a word such as ``1AB`` or ``1ABCDEFx``, or -1."""
    extended = end > start and (data[end - 1] == 120 or data[end - 1] == 88)
    digits_end = end - 1 if extended else end
    if digits_end == start or digits_end - start > 8:
        return -1
    number = 0
    for i in range(start, digits_end):
        if HEX[data[i]] == 255:
            return -1
        number = 16 * number + int(HEX[data[i]])
    if number > 0x1FFFFFFF:
        return -1
    return number | _EXTENDED if extended else number


@compiled
def _bit(data: NDArray[np.uint8], start: int, end: int) -> int:
    """Return the value of the word ``0`` or ``1``, or -1."""
    if end - start != 1 or not 48 <= data[start] <= 49:
        return -1
    return int(data[start]) - 48


@compiled
def _fd_head(data: NDArray[np.uint8], at: int, end: int) -> tuple[int, int, int]:
    """Read ``[name] brs esi dlc length``; return length, flags and the position of the data, or -1."""
    stop = _word_end(data, at, end)
    if stop == at:
        return -1, 0, at
    if not 48 <= data[at] <= 57:
        at = _skip(data, stop, end)
        stop = _word_end(data, at, end)
    switch = _bit(data, at, stop)
    at = _skip(data, stop, end)
    stop = _word_end(data, at, end)
    state = _bit(data, at, stop)
    at = _skip(data, stop, end)
    stop = _word_end(data, at, end)
    if switch < 0 or state < 0 or stop - at != 1 or HEX[data[at]] == 255:
        return -1, 0, at
    size = int(_FD_LENGTHS[HEX[data[at]]])
    at = _skip(data, stop, end)
    stop = _word_end(data, at, end)
    told = 0
    for i in range(at, stop):
        if not 48 <= data[i] <= 57 or i - at > 1:
            return -1, 0, at
        told = 10 * told + (int(data[i]) - 48)
    if told != size or size == 0:
        return -1, 0, at
    flags = _FD | (_SWITCH if switch else 0) | (_STATE if state else 0)
    return size, flags, _skip(data, stop, end)


@compiled
def _parse(
    data: NDArray[np.uint8],
    position: int,
    row: int,
    columns: FrameColumns,
    names: NDArray[np.uint8],
    numbers: NDArray[np.uint8],
) -> tuple[int, int, int]:
    """Parse lines as `LineFormat.parse` says.

    Bounds: a byte is read at a position only after that was found to be below ``end``, the end of the line; a row
    is written only below the number of rows, a byte of the payload only below its width.
    """
    t_us, can_id, length, flags, channel, payload = columns
    size = len(data)
    while position < size:
        line = position
        if row >= len(t_us):
            return line, row, NO_ROOM
        end = line
        odd = False  # a byte that might end a line or be a space for python-can
        while end < size and data[end] != 10:
            odd = odd or data[end] > 126 or (data[end] < 32 and data[end] != 9 and data[end] != 13)
            end += 1
        following = min(end + 1, size)
        if end > line and data[end - 1] == 13:
            end -= 1
        for i in range(line, end):
            odd = odd or data[i] == 13
        if odd:
            return line, row, IRREGULAR
        at = _skip(data, line, end)
        if at + 1 < end and data[at] == 45 and 48 <= data[at + 1] <= 57:  # before the start of the measurement
            return line, row, IRREGULAR
        if at == end or not 48 <= data[at] <= 57:  # empty, header, comment, trigger block
            position = following
            continue
        time, at = parse_time(data, at, end)
        if at < 0 or at >= end or (data[at] != 32 and data[at] != 9):
            return line, row, IRREGULAR
        at = _skip(data, at, end)
        stop = _word_end(data, at, end)
        fd = (
            stop - at == 5
            and data[at] == 67
            and data[at + 1] == 65
            and data[at + 2] == 78
            and data[at + 3] == 70
            and data[at + 4] == 68
        )
        if fd:
            at = _skip(data, stop, end)
            stop = _word_end(data, at, end)
        for i in range(at, stop):
            if not 48 <= data[i] <= 57:
                return line, row, IRREGULAR
        if at == stop or stop - at > 3 or (stop - at > 1 and data[at] == 48):
            return line, row, IRREGULAR
        known = find_channel(data, at, stop, names)
        at = _skip(data, stop, end)

        if fd:
            direction = at
            at = _skip(data, _word_end(data, at, end), end)
            stop = _word_end(data, at, end)
            number = _identifier(data, at, stop)
            at = _skip(data, stop, end)
        else:
            stop = _word_end(data, at, end)
            number = _identifier(data, at, stop)
            direction = _skip(data, stop, end)
            at = _skip(data, _word_end(data, direction, end), end)
        if number < 0 or direction + 2 >= end or data[direction + 1] != 120 or data[direction + 2] > 32:
            return line, row, IRREGULAR
        if data[direction] != 82 and data[direction] != 84:
            return line, row, IRREGULAR

        if fd:
            most, flag, at = _fd_head(data, at, end)
        else:
            flag = 0
            most = -1
            if at + 1 < end and data[at] == 100 and data[at + 1] <= 32:
                at = _skip(data, at + 1, end)
                stop = _word_end(data, at, end)
                if stop - at == 1 and 48 <= data[at] <= 56:
                    most = int(data[at]) - 48
                at = _skip(data, stop, end)
        if most < 0 or most > payload.shape[1]:
            return line, row, IRREGULAR
        count, at = parse_hex_bytes(data, at, end, 1, payload[row], most)
        if count != most or (count > 0 and at < end and data[at] != 32 and data[at] != 9):
            payload[row] = 0
            return line, row, IRREGULAR
        if known < 0:
            payload[row] = 0
            return line, row, NEW_CHANNEL
        if data[direction] == 84:
            flag |= _TRANSMITTED
        t_us[row] = time
        can_id[row] = number
        length[row] = count
        flags[row] = flag
        channel[row] = numbers[known]
        row += 1
        position = following
    return position, row, END_OF_BLOCK
