"""One reader for every log: the suffix says the format, the content must agree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from dctorque_can.logs.formats import BOM, checked_format, is_of_python_can
from dctorque_can.pipeline.frames import Frames


class FrameSource(Protocol):
    """What the reader of one format gives; `problems` grows and `fraction` goes to 1 while frames are read."""

    documents: dict[str, bytes]
    metadata: dict[str, dict[str, str]]
    start_us: int | None

    @property
    def problems(self) -> list[str]:
        """What could not be read, one line each."""

    @property
    def unread(self) -> list[str]:
        """What the file holds beside what was read, such as topics."""

    @property
    def fraction(self) -> float:
        """Share of the file that has been read."""

    def frames(self) -> Iterator[Frames]:
        """Yield the frames in batches of any size."""

    def close(self) -> None:
        """Close the file."""


class LogReader:
    """A log opened for reading, once through. Made by `open_log`.

    Attributes:
        path: the file.
        documents: attachments of an MCAP by name (configuration, databases); else empty.
        metadata: named sets of words of an MCAP; else empty.
        start_us: µs since 1970 at which the times of an ASC count from 0; None where the log says no date.
    """

    def __init__(self, path: Path, source: FrameSource) -> None:
        self.path = path
        self.documents = source.documents
        self.metadata = source.metadata
        self.start_us = source.start_us
        self._source = source

    @property
    def problems(self) -> list[str]:
        """What could not be read (truncated, corrupt places), one line each; complete after `frames`."""
        return self._source.problems

    @property
    def unread(self) -> list[str]:
        """What the file holds beside what was read, such as ``/imu (sensor_msgs/msg/Imu)``; after `frames`."""
        return self._source.unread

    @property
    def fraction(self) -> float:
        """Share of the file that has been read, 0 to 1."""
        return self._source.fraction

    def dated_frames(self, batch: int = 100_000) -> Iterator[Frames]:
        """Yield what `frames` does, with times since 1970 wherever the log says when they begin."""
        for frames in self.frames(batch):
            yield frames if self.start_us is None else replace(frames, t_us=frames.t_us + self.start_us)

    def frames(self, batch: int = 100_000) -> Iterator[Frames]:
        """Yield the frames in the order of the file, ``batch`` at a time (the last time fewer).

        Times are µs: since 1970, or since the start of the log where the format says no more (ASC).
        Everything whole is yielded, whatever surrounds it; what was left out is in `problems`.
        """
        waiting: list[Frames] = []
        count = 0
        for part in self._source.frames():
            waiting.append(part)
            count += len(part)
            if count >= batch:
                joined = Frames.concatenate(waiting)
                whole = count - count % batch
                for start in range(0, whole, batch):
                    yield joined[start : start + batch]
                waiting, count = [joined[whole:]], count - whole
        if count:
            yield Frames.concatenate(waiting)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._source.close()


def open_log(path: Path | str) -> LogReader:
    """Open a log: .asc, .blf, .log (candump), .trc, .csv, .mf4, .mcap, or gzipped text such as .asc.gz.

    Raises:
        LogReadError: no such file, no such format, empty, or its content is not what its suffix says.
    """
    path = Path(path)
    suffix, head = checked_format(path)
    return LogReader(path, _source(path, suffix, head))


def _source(path: Path, suffix: str, head: bytes) -> FrameSource:
    """Return what reads one format; only that is imported."""
    if suffix == ".mcap":
        from dctorque_can.logs.mcap.reader import McapFrames

        return McapFrames(path)
    if suffix == ".blf":
        from dctorque_can.logs.blf.file import BlfFrames

        return BlfFrames(path)
    if suffix in (".log", ".asc"):
        from dctorque_can.logs.text.asc import Asc
        from dctorque_can.logs.text.blocks import TextFrames
        from dctorque_can.logs.text.candump import Candump

        return TextFrames(path, Candump(head) if suffix == ".log" else Asc(head))
    if suffix == ".csv" and not is_of_python_can(head):
        from dctorque_can.logs.text.csv_dialect import dialect_of
        from dctorque_can.logs.text.csv_frames import CsvFrames

        dialect = dialect_of(head.removeprefix(BOM).decode("utf-8", "replace"))
        if dialect is not None:
            return CsvFrames(path, dialect)
    from dctorque_can.logs.python_can import PythonCanFrames, PythonCanTextFrames

    return PythonCanFrames(path) if suffix == ".mf4" else PythonCanTextFrames(path, suffix)
