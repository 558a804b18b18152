"""The `.mcap` suffix for python-can: ``can_player x.mcap``, ``can_logconvert x.blf x.mcap`` and the like."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
from can.io.generic import MessageReader, SizedMessageWriter
from can.typechecking import StringPathLike

from dctorque_can.logs.mcap.reader import McapFrames
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.logs.messages import ChannelNumbers, frames_from_messages, message_from_frame

_WAITING_MESSAGES = 512
_FLUSH_S = 1.0


class McapReader(MessageReader):
    """Iterator over the CAN frames of an MCAP file, in the order of the file.

    Raises:
        LogReadError: there is no such file, or it is no MCAP.
    """

    def __init__(self, file: StringPathLike, **kwargs: Any) -> None:
        self._source = McapFrames(Path(file))

    def __iter__(self) -> Iterator[can.Message]:
        for frames in self._source.frames():
            for i in range(len(frames)):
                yield message_from_frame(frames, i)

    def stop(self) -> None:
        """Close the file."""
        self._source.close()


class McapWriter(SizedMessageWriter):
    """Writes CAN frames to a new MCAP file.

    Messages are flushed to the operating system once per second of their own time.

    Raises:
        LogWriteError: the file can not be written.
        ValueError: asked to append, which an MCAP file does not allow.
    """

    def __init__(self, file: StringPathLike, append: bool = False, **kwargs: Any) -> None:
        if append:
            raise ValueError("an MCAP file can not be appended to; write to a new file")
        self._log = McapLog(Path(file))
        self._numbers = ChannelNumbers()
        self._waiting: list[can.Message] = []
        self._flushed_s = 0.0

    def on_message_received(self, msg: can.Message) -> None:
        """Take one message."""
        self._waiting.append(msg)
        due = abs(msg.timestamp - self._flushed_s) >= _FLUSH_S
        if due or len(self._waiting) >= _WAITING_MESSAGES:
            self._hand_over()
        if due:
            self._flushed_s = msg.timestamp
            self._log.flush()

    def file_size(self) -> int:
        """Return the bytes written so far."""
        return self._log.size

    def stop(self) -> None:
        """Write the rest and the index, and close the file."""
        self._hand_over()
        self._log.close()

    def _hand_over(self) -> None:
        if self._waiting:
            self._log.write_frames(frames_from_messages(self._waiting, self._numbers))
            self._waiting.clear()
