"""The frames of CSV files whose columns have names. Row by row: these are exports of small size."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import TextIO

import can

from dctorque_can.logs.messages import ChannelNumbers, frames_from_messages
from dctorque_can.logs.text.csv_dialect import CsvDialect
from dctorque_can.logs.text.line_source import LineSource
from dctorque_can.logs.text.unzip import text_of
from dctorque_can.pipeline.frames import Frames

_BATCH = 10_000
_LONGEST_LINE = 1 << 16
_TRUE = ("true", "1", "x", "yes", "ext", "extended", "xtd")
_NOT_HEX = re.compile(r"0x|[\s:|.\-]", re.I)
_NO_FRAME_TYPES = ("ST", "EC", "EV", "HW")  # of PEAK: status, error counters, events
_FD_TYPES = ("FD", "FB", "FE", "BI")
_SCALES = ((1e11, 1.0), (1e14, 1e-3), (1e17, 1e-6))  # numbers below are times since 1970 in s, ms, µs


class CsvFrames(LineSource):
    """The frames of a CSV; bad lines are counted and left out.

    Attributes:
        fraction: share of the file that has been read.
    """

    def __init__(self, path: Path, dialect: CsvDialect) -> None:
        super().__init__(path)
        self._dialect = dialect
        self._numbers = ChannelNumbers()

    def frames(self) -> Iterator[Frames]:
        """Yield the frames in batches."""
        with text_of(self.path, self._note_share, self._note_problem) as text:
            batch: list[can.Message] = []
            for message in self._messages(text):
                batch.append(message)
                if len(batch) == _BATCH:
                    yield frames_from_messages(batch, self._numbers)
                    batch = []
            if batch:
                yield frames_from_messages(batch, self._numbers)
        self.fraction = 1.0

    def _messages(self, text: TextIO) -> Iterator[can.Message]:
        number = 0
        while True:
            line = text.readline(_LONGEST_LINE)
            if not line:
                return
            number += 1
            if number <= self._dialect.header_line or not line.strip() or line.lstrip()[0] in ";#":
                continue
            try:
                message = self._message(line)
            except (ValueError, IndexError, OverflowError):
                self._count_bad_lines(1, number, line)
                continue
            if message is not None:
                yield message

    def _message(self, line: str) -> can.Message | None:
        cells = [cell.strip().strip('"').strip() for cell in line.rstrip("\r\n").split(self._dialect.delimiter)]
        kind = self._cell(cells, "type")
        if kind in _NO_FRAME_TYPES:
            return None
        remote = self._is(cells, "remote") or kind in ("RR", "Remote", "remote")
        error = self._is(cells, "error") or kind in ("ER", "Error", "error")
        identifier, extended = self._identifier(cells)
        told = self._cell(cells, "length")
        length = int(told) if told.isdecimal() else -1
        data = b"" if remote else self._data(cells, length)
        if not remote and length > len(data):
            raise ValueError("bytes are missing")
        if not (data or remote or error or length <= 0):
            raise ValueError("no data")
        bus = self._cell(cells, "bus")
        return can.Message(
            timestamp=self._seconds(cells[self._dialect.columns["time"]]),
            arbitration_id=identifier,
            is_extended_id=extended,
            is_remote_frame=remote,
            is_error_frame=error,
            is_fd=kind in _FD_TYPES or len(data) > 8,
            bitrate_switch=kind in ("FB", "BI"),
            error_state_indicator=kind in ("FE", "BI"),
            is_rx=not self._cell(cells, "direction").lower().startswith("t"),
            channel=int(bus) if bus.isdecimal() else bus or None,
            dlc=max(length, 0) if remote else len(data),
            data=None if remote else data,
        )

    def _cell(self, cells: list[str], role: str) -> str:
        column = self._dialect.columns.get(role, -1)
        return cells[column] if 0 <= column < len(cells) else ""

    def _is(self, cells: list[str], role: str) -> bool:
        return self._cell(cells, role).lower() in _TRUE

    def _identifier(self, cells: list[str]) -> tuple[int, bool]:
        text = cells[self._dialect.columns["id"]]
        marked = text[-1:] in "xX" and bool(text)
        text = text.rstrip("xX") if marked else text.rstrip("hH")
        number = int(text, 16 if text[:2].lower() == "0x" else self._dialect.base)
        if not 0 <= number <= 0x1FFF_FFFF:
            raise ValueError("no identifier")
        extended = marked or number > 0x7FF or (self._dialect.long_is_extended and len(text) == 8)
        return number, extended or self._is(cells, "extended")

    def _data(self, cells: list[str], length: int) -> bytes:
        dialect = self._dialect
        if dialect.bytes_from < 0:
            digits = _NOT_HEX.sub("", cells[dialect.columns["data"]])
            return bytes.fromhex(digits)[: 64 if length < 0 else length]
        last = dialect.bytes_from + (length if 0 <= length <= 64 else 64)
        parts = [part for part in cells[dialect.bytes_from : last] if part]
        return bytes(int(part, 16) for part in parts)

    def _seconds(self, text: str) -> float:
        if self._dialect.decimal_comma:
            text = text.replace(",", ".")
        try:
            number = float(text)
        except ValueError:
            return datetime.fromisoformat(text.replace("/", "-").replace("_", " ")).timestamp()
        scale = self._dialect.scale
        if scale == 1e-6 and "." in text:  # SavvyCAN's integers are µs, its decimals seconds
            scale = 1.0
        if not scale:
            scale = next((scale for most, scale in _SCALES if number < most), 1e-9)
        return number * scale + self._dialect.start_us / 1e6
