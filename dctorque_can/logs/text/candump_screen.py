"""What candump shows on the screen: `` (1700000000.000000)  can0  123   [8]  01 02 …``, with any of its options.

Options: ``-ta`` ``-tA`` ``-tz`` ``-td`` (times), ``-x`` (direction and CAN FD flags), ``-8`` (raw DLC in braces),
``-S`` (bytes in reverse order), ``-i`` (binary), ``-a`` (characters behind), ``-c`` (colours).
"""

from __future__ import annotations

import re
from datetime import datetime
from itertools import pairwise

import can

COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_LINE = re.compile(
    r"\s*\((?P<time>[-: .0-9]+)\)\s+(?P<channel>\S+)\s+(?:(?P<direction>[TR]X)\s+(?P<brs>[-B])\s(?P<esi>[-E])\s+)?"
    r"(?P<id>[0-9A-Fa-f]{8}|[0-9A-Fa-f]{3})\s+(?:\[(?P<length>\d{1,2})\]|\{(?P<dlc>[0-9A-Fa-f])\})\s*(?P<rest>.*)$"
)


def is_screen(line: str) -> bool:
    """Return whether a line is of candump's screen."""
    return _LINE.match(line) is not None


class Screen:
    """Reads lines of one recording of candump's screen.

    Args:
        head: its first lines; they tell whether times count from the frame before (``-td``).
    """

    def __init__(self, head: str = "") -> None:
        times = [match["time"].strip() for line in head.splitlines()[:-1] if (match := _LINE.match(line))]
        seconds = [float(time) for time in times if re.fullmatch(r"\d+\.\d+", time)]
        small = bool(seconds) and seconds[0] == 0.0
        self.from_the_frame_before = small and any(b < a for a, b in pairwise(seconds))
        self._passed = 0.0

    def message(self, line: str) -> can.Message:
        """Return the frame of a line.

        Raises:
            ValueError: bytes are missing, or it is no such line.
        """
        match = _LINE.match(line)
        if match is None:
            raise ValueError("no line of candump's screen")
        time = self._seconds(match["time"].strip())
        channel = int(match["channel"]) if match["channel"].isdigit() else match["channel"]
        rest = match["rest"]
        if rest.rstrip().endswith("ERRORFRAME"):
            return can.Message(timestamp=time, is_error_frame=True, channel=channel)
        length = min(int(match["length"]), 64) if match["length"] else 8
        remote = rest.startswith("remote request")
        data = b"" if remote else _data(rest, length)
        return can.Message(
            timestamp=time,
            channel=channel,
            arbitration_id=int(match["id"], 16) & 0x1FFF_FFFF,
            is_extended_id=len(match["id"]) == 8,
            is_remote_frame=remote,
            is_rx=match["direction"] != "TX",
            is_fd=len(match["length"] or "") == 2,
            bitrate_switch=match["brs"] == "B",
            error_state_indicator=match["esi"] == "E",
            dlc=length,
            data=None if remote else data,
        )

    def _seconds(self, text: str) -> float:
        if "-" in text.lstrip("-"):
            return datetime.fromisoformat(text).timestamp()  # of this machine's time zone: candump tells none
        seconds = float(text)
        if self.from_the_frame_before:
            self._passed += seconds
            return self._passed
        return seconds


def whole(line: str) -> bool:
    """Return whether a last line of candump's screen has all its bytes."""
    try:
        Screen().message(line)
    except ValueError:
        return False
    return True


def _data(text: str, length: int) -> bytes:
    swapped = "`" in text
    words = re.split(r"[\s`]+", text.strip())[:length]
    if length == 0:
        return b""
    if len(words) < length or not all(re.fullmatch(r"[0-9A-Fa-f]{2}|[01]{8}", word) for word in words):
        raise ValueError("bytes are missing")
    data = bytes(int(word, 2 if len(word) == 8 else 16) for word in words)
    return data[::-1] if swapped else data
