"""The readers of python-can, as columns: every format that has no faster reader here, and their oracle."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import can

from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.messages import ChannelNumbers, frames_from_messages
from dctorque_can.pipeline.frames import Frames

_BATCH = 10_000


class PythonCanFrames:
    """The frames of a file that `can.LogReader` reads.

    Attributes:
        problems: why reading stopped early, one line each.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.documents: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.problems: list[str] = []
        self.fraction = 0.0
        self._size = path.stat().st_size
        self._numbers = ChannelNumbers()
        try:
            self._reader = can.LogReader(path)
        except NotImplementedError as error:
            raise LogReadError(
                f"{path}: reading MF4 needs asammdf; install it with: pip install 'dctorque-can[mf4]'"
            ) from error
        except Exception as error:
            raise LogReadError(f"{path}: can not be read as {path.suffix}: {_words(error)}") from error

    def frames(self) -> Iterator[Frames]:
        """Yield the frames in batches; stops with a problem line where python-can gives up."""
        count = 0
        with self._reader as reader:
            messages = iter(reader)
            while True:
                batch: list[can.Message] = []
                failure: Exception | None = None
                try:  # what was read before the failure stays in the list
                    batch.extend(itertools.islice(messages, _BATCH))
                except Exception as error:  # noqa: BLE001 - they raise whatever a bad byte leads to
                    failure = error
                count += len(batch)
                if batch:
                    yield frames_from_messages(batch, self._numbers)
                if failure is not None:
                    self.problems.append(f"{self.path}: reading stopped after {count} frames: {_words(failure)}")
                if failure is not None or len(batch) < _BATCH:
                    break
        self.fraction = 1.0

    def close(self) -> None:
        """Close the file."""
        self._reader.stop()


def _words(error: Exception) -> str:
    return f"{error or type(error).__name__}"
