"""What all readers of logs in lines have: the frames' source as `logs.reader` wants it, and lines that are bad."""

from __future__ import annotations

from pathlib import Path


class LineSource:
    """A log in lines; bad ones are counted and left out.

    Attributes:
        path: the file.
        start_us: µs since 1970 at which its times count from 0; None where they do not, or nobody says.
        fraction: share of the file that has been read.
    """

    def __init__(self, path: Path, start_us: int | None = None) -> None:
        self.path = path
        self.documents: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.unread: list[str] = []
        self.start_us = start_us
        self.fraction = 0.0
        self._bad_lines = 0
        self._first_bad_line = ""
        self._problems: list[str] = []

    @property
    def problems(self) -> list[str]:
        """What could not be read, one line each; complete when the frames have been read."""
        if not self._bad_lines:
            return self._problems
        told = f"{self.path}: {self._bad_lines} lines can not be read, the first is {self._first_bad_line}"
        return [told, *self._problems]

    def close(self) -> None:
        """Nothing stays open."""

    def _count_bad_lines(self, count: int, number: int, first: str) -> None:
        if not self._bad_lines:
            self._first_bad_line = f"line {number}: {first.strip()[:60]!r}"
        self._bad_lines += count

    def _note_share(self, share: float) -> None:
        self.fraction = share

    def _note_problem(self, problem: str) -> None:
        self._problems.append(f"{self.path}: {problem}")
