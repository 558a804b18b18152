"""Text logs read in blocks of whole lines: compiled parsers for regular lines, python-can for all others.

A compiled parser knows one strict form of a line. Any other line goes to the reader of python-can, which is
thereby the rule for what a line means, and the oracle of the tests.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Protocol

import can
import numpy as np
from numpy.typing import NDArray

from dctorque_can.logs.columns import FrameColumns
from dctorque_can.logs.formats import BOM
from dctorque_can.logs.messages import ChannelNumbers, frames_from_messages
from dctorque_can.logs.text.line_source import LineSource
from dctorque_can.logs.text.scan import END_OF_BLOCK, LONGEST_NAME, NEW_CHANNEL, NO_ROOM, lines_end
from dctorque_can.logs.text.unzip import pieces
from dctorque_can.pipeline.frames import Frames

_LONGEST_LINE = 1 << 20
_MOST_NAMES = 256  # more channels than `Frames` can tell apart are left to python-can
_MOST_LINES = 4096
_ROWS_AT_ONCE = 1 << 16


class LastLine(Enum):
    """What a last line without a line end is."""

    WHOLE = 1  # nothing of it can be missing
    UNSURE = 2  # it means something as it stands, and might have meant more
    PART = 3  # bytes of its frame are missing


class LineFormat(Protocol):
    """One text format.

    Attributes:
        warnings: what a user should know of this file before he trusts it, one line each; may grow.
        start_us: µs since 1970 at which times count from 0; None where they do not, or the file does not say.
    """

    warnings: list[str]
    start_us: int | None

    def plain(self, block: bytes) -> bytes:
        """Return a block of whole lines as `parse` reads it, line for line."""

    def parse(
        self,
        data: NDArray[np.uint8],
        position: int,
        row: int,
        columns: FrameColumns,
        names: NDArray[np.uint8],
        numbers: NDArray[np.uint8],
    ) -> tuple[int, int, int]:
        """Parse regular lines from ``position`` into ``columns`` from ``row`` on.

        Args:
            data: the block.
            position: where a line begins.
            row: next free row.
            columns: no row is written beyond their end, no byte beyond the width of their data.
            names: uint8 ``[k, LONGEST_NAME]``, known channel names, padded with zeros.
            numbers: uint8 ``[k]``, their indices.

        Returns:
            Position and row reached, and why it stopped (then the position is the beginning of that line).
        """

    def channel(self, line: bytes) -> tuple[bytes, int | str]:
        """Return the channel of a line whose channel is not among the names.

        First its name in the line, at most `LONGEST_NAME` bytes, then the channel as python-can gives it.
        """

    def messages(self, text: str) -> tuple[list[can.Message], list[str]]:
        """Return the messages of python-can for some lines, and the lines that it can not read."""

    def last_line(self, line: str) -> LastLine:
        """Tell whether a last line without a line end was cut off."""


class TextFrames(LineSource):
    """The frames of a text log.

    Attributes:
        problems: what could not be read, one line each.
        fraction: share of the file that has been read.
    """

    def __init__(self, path: Path, line_format: LineFormat) -> None:
        super().__init__(path, line_format.start_us)
        self._format = line_format
        self._channels = ChannelNumbers()
        self._names = np.zeros((0, LONGEST_NAME), np.uint8)
        self._numbers = np.zeros(0, np.uint8)
        self._line = 1

    @property
    def problems(self) -> list[str]:
        """What could not be read, one line each; complete when the frames have been read."""
        return [*super().problems, *(f"{self.path}: {warning}" for warning in self._format.warnings)]

    def frames(self) -> Iterator[Frames]:
        """Yield the frames block by block."""
        for block in self._blocks():
            yield from self._parse(self._format.plain(block))
            self._line += block.count(b"\n")
        self.fraction = 1.0

    def _blocks(self) -> Iterator[bytes]:
        """Yield blocks that end with a line end, but for the last one."""
        rest = b""
        ends_lines = False
        too_long = False  # the line that goes on is, and is left out
        begins = True
        for part in self._bytes():
            if begins and part:
                begins, part = False, part.removeprefix(BOM)
            if too_long:
                start = part.find(b"\n") + 1
                if not start:
                    continue
                too_long, part = False, part[start:]
                self._line += 1
            cut = part.rfind(b"\n") + 1
            if not cut and len(rest) > _LONGEST_LINE:
                cut = part.rfind(b"\r", 0, len(part) - 1) + 1  # the line end of a Macintosh
                if not cut:
                    self._count_bad_lines(1, self._line, rest[:60].decode("utf-8", "replace"))
                    rest, too_long = b"", True
                    continue
            if cut:
                ends_lines = True
                yield rest + part[:cut]
                rest = part[cut:]
            else:
                rest += part
        if rest and not (ends_lines and self._cut_off(rest)):
            yield rest

    def _cut_off(self, line: bytes) -> bool:
        """Note a problem with a last line that has no line end; return whether it must be left out."""
        text = line.decode("utf-8", "replace").strip()
        kind = LastLine.WHOLE if not text or "\r" in text else self._format.last_line(text)
        if kind is LastLine.PART:
            self._problems.append(
                f"{self.path}: the last line is cut off and left out: line {self._line}: {text[:60]!r}"
            )
        elif kind is LastLine.UNSURE:
            self._problems.append(
                f"{self.path}: the last line has no line end: cut off? line {self._line}: {text[:60]!r}"
            )
        return kind is LastLine.PART

    def _bytes(self) -> Iterator[bytes]:
        def read(share: float) -> None:
            self.fraction = share

        return pieces(self.path, read, self._note_problem)

    def _parse(self, block: bytes) -> Iterator[Frames]:
        data = np.frombuffer(block, np.uint8)
        lines = block.count(b"\n") + block.count(b"\r") + 1
        width = self._width(block)
        frames = Frames.empty(min(lines, _ROWS_AT_ONCE), width)
        position, row, region = 0, 0, 1
        while position < len(data):
            start = position
            columns = FrameColumns.of(frames)
            position, row, status = self._format.parse(data, position, row, columns, self._names, self._numbers)
            if status == END_OF_BLOCK:
                break
            if status == NO_ROOM:
                yield frames[:row]
                frames, row = Frames.empty(len(frames), width), 0
                continue
            if status == NEW_CHANNEL and len(self._names) < _MOST_NAMES:
                end = lines_end(data, position, 1)
                self._learn_channel(*self._format.channel(block[position:end]))
                continue
            region = 1 if position > start else min(2 * region, _MOST_LINES)
            end = lines_end(data, position, region)
            part = self._by_python_can(block[position:end], block, position)
            if row + len(part) > len(frames):
                yield frames[:row]
                frames, row = Frames.empty(max(len(frames), len(part)), width), 0
            if part.data.shape[1] > frames.data.shape[1]:
                frames = Frames.concatenate([frames, Frames.empty(0, part.data.shape[1])])
            stop = row + len(part)
            for name in ("t_us", "can_id", "length", "flags", "channel"):
                getattr(frames, name)[row:stop] = getattr(part, name)
            frames.data[row:stop, : part.data.shape[1]] = part.data
            position, row = end, stop
        if row:
            # of few frames a copy, so that the room for many does not stay
            yield frames[:row] if 2 * row > len(frames) else frames[:row].copy()

    @staticmethod
    def _width(block: bytes) -> int:
        return 64 if b"##" in block or b"CANFD" in block else 8

    def _learn_channel(self, name: bytes, channel: int | str) -> None:
        number = self._channels[channel]
        padded = np.frombuffer(name.ljust(LONGEST_NAME, b"\0"), np.uint8)
        self._names = np.concatenate([self._names, padded[None, :]])
        self._numbers = np.append(self._numbers, np.uint8(number))

    def _by_python_can(self, lines: bytes, block: bytes, position: int) -> Frames:
        text = lines.decode("utf-8", "replace")
        messages, bad = self._format.messages(text)
        if bad:
            before = 0 if self._bad_lines else block.count(b"\n", 0, position) + text.split(bad[0])[0].count("\n")
            self._count_bad_lines(len(bad), self._line + before, bad[0])
        return frames_from_messages(messages, self._channels)
