"""Lines of text handed to the readers of python-can, which stop for good at the first bad one. These go on."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Self, TextIO, cast

import can
from can.io.generic import MessageReader

BAD_LINE_ERRORS = (ValueError, IndexError, KeyError, TypeError, OverflowError, NotImplementedError)


class Lines:
    """What the text readers of python-can use of a file, and where they are in it.

    Attributes:
        last: the line given last.
        count: lines given so far.
    """

    def __init__(self, lines: Iterable[str]) -> None:
        self.last = ""
        self.count = 0
        self._lines = iter(lines)
        self._header = ""

    def begin(self, header: str) -> None:
        """Give ``header`` before the next line, unless it is empty."""
        self._header = header

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> str:
        if self._header:
            header, self._header = self._header, ""
            return header
        self.last = next(self._lines)
        self.count += 1
        return self.last

    def close(self) -> None:
        """Do nothing; whoever opened the file closes it."""


def each_message(
    lines: Lines, reader: Callable[[TextIO], MessageReader], header: str, bad: Callable[[Lines], None]
) -> Iterator[can.Message]:
    """Yield every message that a reader of python-can finds in ``lines``.

    Args:
        lines: the text.
        reader: of the format.
        header: line that the reader must see before it goes on after a bad line, or "".
        bad: told when the last line could not be read.
    """
    messages = reader(cast(TextIO, lines))
    while True:
        count = lines.count
        try:
            yield from messages
        except BAD_LINE_ERRORS:
            bad(lines)
            if lines.count == count:
                return
            lines.begin(header)
        else:
            return


@contextmanager
def warnings_of(logger: str, told: Callable[[str], None]) -> Iterator[None]:
    """Give every warning and error that a library logs to ``logger`` to ``told``, instead of showing it."""

    def listen(record: logging.LogRecord) -> bool:
        if record.levelno < logging.WARNING:
            return True
        told(record.getMessage())
        return False

    logging.getLogger(logger).addFilter(listen)
    try:
        yield
    finally:
        logging.getLogger(logger).removeFilter(listen)
