"""What is handed over to the log-writer process, and what became of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

State = Callable[[], bytes]
"""Gives the bytes of a state that was copied when this was made."""


def no_state() -> bytes:
    """Return the state before the first frame."""
    return b""


@dataclass
class LogCounts:
    """What became of the frames that were handed over.

    Attributes:
        written: frames that are in a log and handed to the operating system.
        dropped: frames that are (or may be) in no log.
        restarts: times the process had to be started anew.
        deleted: old logs that went for the quota or the free space.
        slowest_flush_ms: longest time from receiving to the hands of the operating system.
        late_flushes: times that this was longer than `logging.flush_ms`.
        paths: logs that were opened, in order.
        sizes: of each, bytes that the operating system has.
        finalised: torn logs that were closed afterwards, in order.
        failures: why a log could not be written, in order; not again while a new one is tried in vain.
    """

    written: int = 0
    dropped: int = 0
    restarts: int = 0
    deleted: int = 0
    slowest_flush_ms: float = 0.0
    late_flushes: int = 0
    paths: list[Path] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)
    finalised: list[Path] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


class Message(NamedTuple):
    """What is handed over.

    Attributes:
        content: bytes.
        frames: that it holds.
        number: of the point that it is, 0 for none.
        state: at that point.
        again: whether the next process gets it too, if this one dies.
    """

    content: bytes
    frames: int = 0
    number: int = 0
    state: State = no_state
    again: bool = True
