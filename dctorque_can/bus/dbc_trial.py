"""What cantools says of a piece of a DBC."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from decimal import InvalidOperation

import cantools
from cantools.database.can import Database

from dctorque_can.bus.dbc_text import Statement

MOST_TRIALS = 4_000
"""Of one file; one takes about a millisecond."""

LARGEST_MESSAGE = 4095
"""Bytes: what ISO-TP can carry, more than J1939's 1785. cantools takes memory and time for every bit of it."""

MOST_SELECTORS = 4096  # of one signal; for each of them cantools makes a way to read the message

_SIZES = re.compile(
    r"\bBO_\s+\d+\s+\w+\s*:\s*(?P<bytes>\d+)"
    r"|\bSG_\s+\w+\s*\w*\s*:\s*(?P<start>\d+)\s*\|\s*(?P<length>\d+)"
    r"|\bSG_MUL_VAL_\s+\d+\s+\w+\s+\w+\s(?P<ranges>[\s\d,-]+)"
)
_LOG = logging.getLogger("cantools.database.can.database")
_AT_LINE = re.compile(r"\bat line (\d+), column (\d+)")


def _nothing(record: logging.LogRecord) -> bool:
    """Keep a record of cantools from being shown: messages that are there twice are told with their line."""
    return False


_LOG.addFilter(_nothing)


def parse(text: str, strict: bool) -> tuple[Database | None, str]:
    """Return the database of a DBC's text, or None and why there is none."""
    too_large = _too_large(text)
    if too_large:
        return None, too_large
    try:
        database = cantools.database.load_string(text, "dbc", strict=strict)
    except cantools.Error as error:
        # cantools wraps whatever its loader raised; a missing definition is a bare KeyError
        cause = getattr(error, "e_dbc", None) or error
        if isinstance(cause, KeyError):
            return None, f"{cause} is used but not defined"
        if isinstance(cause, InvalidOperation):
            return None, "a number is expected where there is none"
        return None, " ".join(str(cause).split()).rstrip(".") or type(cause).__name__
    except RecursionError:
        return None, "nested too deeply"
    assert isinstance(database, Database)
    return database, ""


def _too_large(text: str) -> str:
    """Return which number is larger than cantools should see, or ""."""
    for size in _SIZES.finditer(text):
        for what, most, unit in (("bytes", LARGEST_MESSAGE, "bytes"), ("length", 8 * LARGEST_MESSAGE, "bits")):
            if _number(size[what]) > most:
                return f"{size[what]} {unit} are more than {most}, the most {_place(text, size.start(what))}"
        if _number(size["start"]) >= 8 * LARGEST_MESSAGE:
            return f"bit {size['start']} is beyond the largest message {_place(text, size.start('start'))}"
        ranges = re.findall(r"(\d+)\s*-\s*(\d+)", size["ranges"] or "")
        values = sum(_number(last) - _number(first) + 1 for first, last in ranges)
        if values > MOST_SELECTORS:
            return (
                f"{values} multiplexer values are more than {MOST_SELECTORS} {_place(text, size.start('ranges'))}"
            )
    return ""


def _number(digits: str | None) -> int:
    """Return a number, of which more digits than any that is right has are not looked at."""
    return int((digits or "0").lstrip("0")[:20] or "0")


def _place(text: str, position: int) -> str:
    """Return where something stands in the words of cantools."""
    return f"at line {text.count(chr(10), 0, position) + 1}, column {position - text.rfind(chr(10), 0, position)}"


class TooManyFaultsError(Exception):
    """A file has more faults than can be told apart in reasonable time."""


class Trials:
    """Tries pieces of one DBC, a limited number of them."""

    def __init__(self) -> None:
        self._left = MOST_TRIALS

    def reason(self, text: str, strict: bool = False) -> str:
        """Return why a piece cannot be read; "" when it can."""
        if self._left == 0:
            raise TooManyFaultsError
        self._left -= 1
        reason = parse(text, strict)[1]
        return "" if reason.startswith(("unused VAL_", "unused SIG_VALTYPE_")) else reason

    def faulty(self, context: str, candidates: Sequence[Statement]) -> list[tuple[Statement, str]]:
        """Return the statements that cannot be read after ``context``, each with the reason."""
        if not candidates:
            return []
        reason = self.reason(context + "".join(each.text for each in candidates))
        if not reason:
            return []
        if len(candidates) == 1:
            return [(candidates[0], without_line(reason))]
        half = len(candidates) // 2
        return self.faulty(context, candidates[:half]) + self.faulty(context, candidates[half:])


def stated_line(reason: str) -> int:
    """Return the line, from 1, that cantools says; 0 when it says none."""
    stated = _AT_LINE.search(reason)
    return int(stated.group(1)) if stated else 0


def without_line(reason: str) -> str:
    """Return a reason without the number of the line, which is that of a piece."""
    return _AT_LINE.sub(r"in column \2", reason)


def lines_of(reason: str, text: str) -> list[int]:
    """Return the lines that cantools' reason points at."""
    entries = re.findall(r"VAL_ (\d+) (\w+)", reason)
    if reason.startswith("unused VAL_") and entries:
        found = (re.search(rf"^\s*VAL_\s+{number}\s+{name}\b", text, re.MULTILINE) for number, name in entries)
        return [text.count("\n", 0, each.end()) + 1 for each in found if each]
    line = line_of(reason, text)
    return [line] if line else []


def line_of(reason: str, text: str) -> int:
    """Return the line that cantools' reason points at, 0 when it tells nothing that can be found."""
    stated = stated_line(reason)
    if stated:
        return stated
    message = re.search(r"in message (\w+)", reason)
    signal = re.search(r"[Tt]he signals? (\w+)", reason)
    undefined = re.match(r"'([^']+)' is used but not defined", reason)
    start = 0
    if message:
        found = re.search(rf"^\s*BO_\s+\d+\s+{message.group(1)}\s*:", text, re.MULTILINE)
        start = found.start() if found else 0
    if signal:
        pattern = rf"^\s*SG_\s+{signal.group(1)}\s"
    elif message:
        pattern = rf"^\s*BO_\s+\d+\s+{message.group(1)}\s*:"
    elif undefined:
        pattern = rf"^.*\b{re.escape(undefined.group(1))}\b"
    else:
        return 0
    place = re.compile(pattern, re.MULTILINE).search(text, start)
    if place is None:
        return 0
    return text.count("\n", 0, place.end()) + 1
