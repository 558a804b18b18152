"""Lines for the journal of systemd: each says how serious it is, by the prefix of sd-daemon(3)."""

from __future__ import annotations

import os
from enum import IntEnum
from functools import cache

STDERR = 2


class Priority(IntEnum):
    """Of syslog."""

    ERROR = 3
    WARNING = 4
    INFO = 6


@cache
def is_journal(descriptor: int = STDERR) -> bool:
    """Return whether what is written to a file goes to the journal, as ``JOURNAL_STREAM`` says."""
    told = os.environ.get("JOURNAL_STREAM")
    if not told:
        return False
    try:
        status = os.fstat(descriptor)
    except OSError:
        return False
    return told == f"{status.st_dev}:{status.st_ino}"


def line(priority: Priority, text: str) -> str:
    """Return a text as it goes to standard error: for the journal with a prefix before each of its lines."""
    if not is_journal():
        return text
    return "\n".join(f"<{priority:d}>{each}" for each in text.split("\n"))
