"""candump logs (``candump -L``, ``.log``): ``(1700000000.000000) can0 123#DEADBEEF R``; and candump's screen."""

from __future__ import annotations

import io
import re
from itertools import groupby

import can
import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.logs.columns import FrameColumns
from dctorque_can.logs.text.blocks import LastLine
from dctorque_can.logs.text.candump_screen import COLOUR, Screen, is_screen, whole
from dctorque_can.logs.text.lines import Lines, each_message
from dctorque_can.logs.text.scan import (
    END_OF_BLOCK,
    HEX,
    IRREGULAR,
    LONGEST_NAME,
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
_SPACE, _HASH = 32, 35
_RAW_DLC = re.compile(r"_[0-9A-Fa-f](?=\s*$|\s+[RT]\s*$)")  # of candump -8, behind the data


class Candump:
    """The lines of a candump log, whose text begins with ``head``."""

    def __init__(self, head: bytes = b"") -> None:
        self.warnings: list[str] = []
        self.start_us: int | None = None
        self._screen = Screen(COLOUR.sub("", head.decode("utf-8", "replace")))

    def plain(self, block: bytes) -> bytes:
        """See `LineFormat.plain`."""
        return block

    def parse(
        self,
        data: NDArray[np.uint8],
        position: int,
        row: int,
        columns: FrameColumns,
        names: NDArray[np.uint8],
        numbers: NDArray[np.uint8],
    ) -> tuple[int, int, int]:
        """See `LineFormat.parse`."""
        return _parse(data, position, row, columns, names, numbers)

    def channel(self, line: bytes) -> tuple[bytes, int | str]:
        """See `LineFormat.channel`."""
        name = line.split()[1]
        return name, int(name) if name.isdigit() else name.decode("ascii")

    def messages(self, text: str) -> tuple[list[can.Message], list[str]]:
        """See `LineFormat.messages`."""
        messages: list[can.Message] = []
        bad: list[str] = []
        plain = [COLOUR.sub("", line) for line in io.StringIO(text, newline=None)]
        for on_screen, group in groupby(plain, is_screen):
            if on_screen:
                for line in group:
                    try:
                        messages.append(self._screen.message(line))
                    except ValueError:
                        bad.append(line)
                continue
            lines = Lines(_RAW_DLC.sub("", line) for line in group)
            messages += each_message(lines, can.CanutilsLogReader, "", lambda lines: bad.append(lines.last))
        return messages, bad

    def last_line(self, line: str) -> LastLine:
        """See `LineFormat.last_line`: the number of bytes stands nowhere."""
        if is_screen(line):
            return LastLine.WHOLE if whole(line) else LastLine.PART
        if _RAW_DLC.search(line):
            return LastLine.WHOLE
        words = line.split()
        if len(words) == 4:  # the direction stands behind the data
            return LastLine.WHOLE
        _, _, data = words[-1].partition("#")
        if len(words) != 3 or data[:1].upper() == "R":
            return LastLine.UNSURE
        flexible = data.startswith("#")
        if len(data[2:] if flexible else data) % 2:
            return LastLine.PART
        return LastLine.WHOLE if len(data) == 16 and not flexible else LastLine.UNSURE


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
        while end < size and data[end] != 10:
            end += 1
        following = min(end + 1, size)
        if end > line and data[end - 1] == 13:
            end -= 1
        if end == line:
            position = following
            continue
        if data[line] != 40:
            return line, row, IRREGULAR
        time, at = parse_time(data, line + 1, end)
        if at < 0 or at + 2 >= end or data[at] != 41 or data[at + 1] != _SPACE:
            return line, row, IRREGULAR
        name = at + 2
        at = name
        while at < end and 32 < data[at] < 127:
            at += 1
        if at == name or at - name > LONGEST_NAME or at >= end or data[at] != _SPACE:
            return line, row, IRREGULAR
        known = find_channel(data, name, at, names)

        at += 1
        number = 0
        digits = 0
        while at < end and HEX[data[at]] != 255 and digits < 9:
            number = 16 * number + int(HEX[data[at]])
            digits += 1
            at += 1
        if (digits != 3 and digits != 8) or number > 0x1FFFFFFF or at >= end or data[at] != _HASH:
            return line, row, IRREGULAR
        at += 1
        flag = 0
        most = 8
        if at + 1 < end and data[at] == _HASH:
            if not 48 <= data[at + 1] <= 57:
                return line, row, IRREGULAR
            bits = int(data[at + 1]) - 48
            flag = _FD | (_SWITCH if bits & 1 else 0) | (_STATE if bits & 2 else 0)
            at += 2
            most = 64
        if most > payload.shape[1]:
            return line, row, IRREGULAR
        count, at = parse_hex_bytes(data, at, end, 0, payload[row], most)
        sound = at == end
        if at + 2 == end and data[at] == _SPACE:
            sound = data[at + 1] == 82 or data[at + 1] == 84
            if data[at + 1] == 84:
                flag |= _TRANSMITTED
        if not sound or known < 0:
            payload[row] = 0
            return line, row, NEW_CHANNEL if sound else IRREGULAR
        t_us[row] = time
        can_id[row] = number | (_EXTENDED if digits == 8 else 0)
        length[row] = count
        flags[row] = flag
        channel[row] = numbers[known]
        row += 1
        position = following
    return position, row, END_OF_BLOCK
