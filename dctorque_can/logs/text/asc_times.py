"""The times of an ASC log: the date of its start, decimal commas, and times that count from the line before."""

from __future__ import annotations

import re
from datetime import datetime

_ENGLISH = "jan feb mar apr may jun jul aug sep oct nov dec"
_MONTHS = {name: number for number, name in enumerate(_ENGLISH.split(), 1)} | {
    **{"mär": 3, "maer": 3, "mrz": 3, "mai": 5, "okt": 10, "dez": 12, "fév": 2, "avr": 4, "aoû": 8, "déc": 12}
}
_DATE = re.compile(
    r"(?P<month>[^\W\d]{3,4})\.?\s+(?P<day>\d{1,2})\s+(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2})"
    r"(?:[.,](?P<fraction>\d{1,9}))?\s+(?:(?P<half>[ap]m)\s+)?(?P<year>\d{4})",
    re.I,
)
_BLOCK = re.compile(rb"^\s*begin\s+trigger\s?block\s+(.+)$", re.I | re.M)
_HEADER = re.compile(rb"^\s*date\s+(.+)$", re.I | re.M)
_RELATIVE = re.compile(rb"^\s*base\s+(?:hex|dec)\s+timestamps\s+relative", re.I | re.M)
_COMMA = re.compile(rb"^(\s*-?\d+),(\d+)(?=\s)", re.M)
_TIME = re.compile(rb"^([ \t]*)(-?)(\d{1,12})\.(\d{1,12})(?=[ \t])", re.M)
_NEGATIVE = re.compile(r"\s*-\d")


def start_of(head: bytes) -> int | None:
    """Return when the measurement began, µs since 1970, by the first lines of an ASC log; None: they do not say.

    A date has no time zone: it is taken as one of this machine, as the tools write it.
    """
    for pattern in (_BLOCK, _HEADER):
        match = pattern.search(head)
        if match is not None:
            moment = _moment(match.group(1))
            if moment is not None:
                return moment
    return None


def _moment(text: bytes) -> int | None:
    try:
        words = text.decode("utf-8")
    except UnicodeDecodeError:
        words = text.decode("cp1252", "replace")
    match = _DATE.search(words)
    month = _MONTHS.get(match["month"].lower(), _MONTHS.get(match["month"].lower()[:3])) if match else None
    if match is None or month is None:
        return None
    hour = int(match["hour"])
    if match["half"] and hour <= 12:
        hour = hour % 12 + (12 if match["half"].lower() == "pm" else 0)
    try:
        year, day, minute, second = (int(match[name]) for name in ("year", "day", "minute", "second"))
        whole = round(datetime(year, month, day, hour, minute, second).timestamp())
    except (ValueError, OverflowError, OSError):
        return None
    return whole * 1_000_000 + int((match["fraction"] or "0").ljust(6, "0")[:6])


def is_negative(line: str) -> bool:
    """Return whether a line begins with a negative time."""
    return _NEGATIVE.match(line) is not None


class TimeRewriter:
    """Makes times of an ASC log plain: with a point, and from the start of the measurement.

    Args:
        head: the beginning of its text, which says what has to be done.
    """

    def __init__(self, head: bytes) -> None:
        self.relative = _RELATIVE.search(head) is not None
        self.comma = _COMMA.search(head) is not None
        self._passed_ns = 0

    def plain(self, block: bytes) -> bytes:
        """Return whole lines with plain times; the same bytes where they are plain already."""
        if self.comma:
            block = _COMMA.sub(rb"\1.\2", block)
        return _TIME.sub(self._summed, block) if self.relative else block

    def _summed(self, match: re.Match[bytes]) -> bytes:
        """Return the time of a line that counts from the line before, counted from the start."""
        step = int(match[3]) * 1_000_000_000 + int(match[4].ljust(9, b"0")[:9])
        self._passed_ns += -step if match[2] else step
        sign = b"-" if self._passed_ns < 0 else b""
        seconds, rest = divmod(abs(self._passed_ns), 1_000_000_000)
        return b"%s%s%d.%09d" % (match[1], sign, seconds, rest)
