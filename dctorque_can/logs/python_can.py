"""The readers of python-can, as columns: every format that has no faster reader here, and their oracle."""

from __future__ import annotations

import itertools
import traceback
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, nullcontext, suppress
from io import IOBase
from pathlib import Path
from typing import Any

import can

from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.late_asammdf import give_asammdf
from dctorque_can.logs.messages import ChannelNumbers, frames_from_messages
from dctorque_can.logs.mf4_links import check_links
from dctorque_can.logs.text.line_source import LineSource
from dctorque_can.logs.text.lines import Lines, each_message, warnings_of
from dctorque_can.logs.text.unzip import text_of
from dctorque_can.pipeline.frames import Frames

_BATCH = 10_000


class PythonCanFrames:
    """The frames of a binary file that `can.LogReader` reads, which is MF4, by asammdf.

    Attributes:
        problems: what asammdf complains of, and why reading stopped early, one line each.
        fraction: 1 when all has been read; these formats do not say more.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.documents: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.unread: list[str] = []
        self.start_us: int | None = None
        self.problems: list[str] = []
        self.fraction = 0.0
        self._numbers = ChannelNumbers()
        self._closed = False
        give_asammdf()
        try:
            with self._listening():
                check_links(path)
                _check_channels(path)
                self._reader = can.LogReader(path)
        except (ImportError, NotImplementedError) as error:
            raise LogReadError(
                f"{path}: reading MF4 needs asammdf; install it with: pip install 'dctorque-can[mf4]'"
            ) from error
        except Exception as error:
            _release(error)
            raise LogReadError(f"{path}: can not be read as .mf4, damaged or cut off? {_words(error)}") from error

    def frames(self) -> Iterator[Frames]:
        """Yield the frames in batches; stops with a problem line where python-can gives up.

        Raises:
            LogReadError: it gives up before the first frame.
        """
        count = 0
        try:
            for batch in _batches(self.path, self._messages(), self._numbers, self.problems, self._listening):
                count += len(batch)
                yield batch
        finally:
            self.close()
        self.fraction = 1.0
        if self.problems and not count:
            raise LogReadError(f"{self.problems[-1]}; nothing of this MF4 can be read")

    def _messages(self) -> Iterator[can.Message]:
        yield from self._reader

    def _listening(self) -> AbstractContextManager[None]:
        """Turn what asammdf logs into problem lines; its tracebacks into their last line."""

        def note(text: str) -> None:
            head, _, trace = text.partition("Traceback (most recent call last)")
            words = " ".join((head + (trace.strip().rpartition("\n")[2])).split())
            problem = f"{self.path}: {words}"
            if problem not in self.problems:
                self.problems.append(problem)

        return warnings_of("asammdf", note)

    def close(self) -> None:
        """Close the file; again does nothing, which python-can's own reader does not take."""
        if not self._closed:
            self._closed = True
            self._reader.stop()


class PythonCanTextFrames(LineSource):
    """The frames of a TRC or CSV file by the readers of python-can; bad lines are counted and left out.

    Attributes:
        fraction: share of the file that has been read.
    """

    def __init__(self, path: Path, suffix: str) -> None:
        super().__init__(path)
        self._suffix = suffix
        self._numbers = ChannelNumbers()
        self._last_bad_line = 0

    def frames(self) -> Iterator[Frames]:
        """Yield the frames in batches."""
        reader = can.TRCReader if self._suffix == ".trc" else can.CSVReader
        header = "" if self._suffix == ".trc" else "header\n"  # which the CSV reader skips unread
        with text_of(self.path, self._note_share, self._note_problem) as file:
            lines = Lines(file)
            messages = each_message(lines, reader, header, self._count_bad_line)
            with warnings_of("can.io.trc", lambda text: self._count_bad_line(lines)):
                yield from _batches(self.path, messages, self._numbers, self._problems)
        self.fraction = 1.0

    def _count_bad_line(self, lines: Lines) -> None:
        if lines.count == self._last_bad_line:
            return
        self._last_bad_line = lines.count
        self._count_bad_lines(1, lines.count, lines.last)


def _batches(
    path: Path,
    messages: Iterator[can.Message],
    numbers: ChannelNumbers,
    problems: list[str],
    listening: Callable[[], AbstractContextManager[None]] = nullcontext,
) -> Iterator[Frames]:
    count = 0
    while True:
        batch: list[can.Message] = []
        failure: Exception | None = None
        try:  # what was read before the failure stays in the list
            with listening():
                batch.extend(itertools.islice(messages, _BATCH))
        except Exception as error:  # noqa: BLE001 - they raise whatever a bad byte leads to
            failure = error
        count += len(batch)
        if batch:
            yield frames_from_messages(batch, numbers)
        if failure is not None:
            problems.append(f"{path}: reading stopped after {count} frames: {_words(failure)}")
        if failure is not None or len(batch) < _BATCH:
            return


def _check_channels(path: Path) -> None:
    """Check that each channel of an MF4 lies within its records, of which asammdf's machine code reads it unasked.

    That begins while python-can opens the file, so the file is opened apart, without looking into its bus logging.

    Raises:
        ImportError: asammdf is not installed.
        ValueError: one does not, and would be read out of memory that is not the file's.
    """
    from asammdf import MDF

    with closing(MDF(path, process_bus_logging=False)) as file:  # type: ignore[call-arg]
        groups: Any = file.groups
        for number, group in enumerate(groups):
            record = group.channel_group.samples_byte_nr
            for channel in group.channels:
                end = channel.byte_offset + (channel.bit_offset + channel.bit_count + 7) // 8
                if end > record:
                    name = f"{channel.name!r} of group {number}"
                    raise ValueError(f"the channel {name} ends at byte {end} of records of {record} bytes")


def _release(error: Exception) -> None:
    """Close whatever a failed reader of python-can or asammdf left half open, which they do not do themselves.

    A half-made MDF4 would fail once more when it is collected, with a traceback that nobody can catch.
    """
    for frame, _ in traceback.walk_tb(error.__traceback__):
        owner = frame.f_locals.get("self")
        files = [thing for thing in frame.f_locals.values() if isinstance(thing, IOBase)]
        for thing in (owner, getattr(owner, "file", None), *files):
            with suppress(Exception):
                thing.close()  # type: ignore[union-attr]


def _words(error: Exception) -> str:
    return f"{str(error) or type(error).__name__}"
