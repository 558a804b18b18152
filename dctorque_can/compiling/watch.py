"""Who is told that something has to be compiled, and what was compiled so far in this process."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol


@dataclass
class Compiled:
    """What this process compiled instead of finding it.

    Attributes:
        functions: finished.
        cpu_s: processor time that took, s.
        folders: where they are kept now.
    """

    functions: int = 0
    cpu_s: float = 0.0
    folders: set[Path] = field(default_factory=set)


class Listener(Protocol):
    """Somebody who tells people."""

    def begins(self) -> None:
        """Be told that a function has to be compiled, and with it all that it calls."""

    def ends(self) -> None:
        """Be told that this is over."""

    def problem(self, text: str) -> None:
        """Be told why compiled code cannot be kept or used, once for each reason."""


so_far = Compiled()
_listener: Listener | None = None
_told: set[str] = set()
_depth = 0
_began_s = 0.0


@contextmanager
def telling(listener: Listener) -> Iterator[None]:
    """Tell ``listener``; without one, problems are Python warnings and nothing else is told."""
    global _listener
    before, _listener = _listener, listener
    try:
        yield
    finally:
        _listener = before


def begins() -> None:
    """Note that a function is going to be compiled; it may be within another."""
    global _depth, _began_s
    _depth += 1
    if _depth == 1:
        _began_s = time.process_time()
        if _listener is not None:
            _listener.begins()


def ends(failed: bool) -> None:
    """Note that a function was compiled, or failed to be."""
    global _depth
    _depth -= 1
    so_far.functions += not failed
    if _depth == 0:
        so_far.cpu_s += time.process_time() - _began_s
        if _listener is not None:
            _listener.ends()


def problem(text: str) -> None:
    """Tell why compiled code cannot be kept or used, unless that was told before."""
    if text in _told:
        return
    _told.add(text)
    if _listener is not None:
        _listener.problem(text)
    else:
        warnings.warn(text, RuntimeWarning, stacklevel=2)
