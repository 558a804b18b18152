"""Frames to a new log of any format."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import can
import numpy as np

from dctorque_can.logs.errors import LogWriteError
from dctorque_can.logs.formats import FORMATS
from dctorque_can.logs.late_asammdf import give_asammdf
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.pipeline.frames import FrameFlag, Frames

_NOT_KEPT: dict[str, dict[str, int]] = {
    ".asc": {"data of error frames": FrameFlag.ERROR},
    ".log": {"all but the time of error frames": FrameFlag.ERROR, "the length of remote frames": FrameFlag.REMOTE},
    ".csv": {"that they are CAN FD": FrameFlag.FD},
    ".mf4": {"the length of remote frames": FrameFlag.REMOTE},
}
_FORWARD_ONLY = (".asc", ".log")  # python-can's writers never let the time go back
_LEFT_OUT = {".trc": FrameFlag.FD | FrameFlag.REMOTE | FrameFlag.ERROR}


class Kept:
    """What of frames a format can keep.

    Args:
        suffix: of the format.

    Attributes:
        frames: so many can be written.
    """

    def __init__(self, suffix: str) -> None:
        self.frames = 0
        self._suffix = suffix.lower()
        self._left_out = 0
        self._behind = 0
        self._latest_us: int | None = None
        self._changed = dict.fromkeys(_NOT_KEPT.get(self._suffix, {}), 0)

    def of(self, frames: Frames) -> Frames:
        """Return those of the frames that can be written, and count the others."""
        left_out = frames.flags & int(_LEFT_OUT.get(self._suffix, 0)) != 0
        self._left_out += int(np.count_nonzero(left_out))
        for what, flag in _NOT_KEPT.get(self._suffix, {}).items():
            self._changed[what] += int(np.count_nonzero(frames.flags & int(flag)))
        kept = frames[~left_out] if left_out.any() else frames
        self.frames += len(kept)
        if self._suffix in _FORWARD_ONLY and len(kept):
            before = kept.t_us[0] if self._latest_us is None else self._latest_us
            latest = np.maximum(np.maximum.accumulate(kept.t_us), before)
            self._behind += int(np.count_nonzero(kept.t_us < latest))
            self._latest_us = int(latest[-1])
        return kept

    @property
    def lost(self) -> list[str]:
        """What is not kept, one line each."""
        name = self._suffix.removeprefix(".").upper()
        lines = [f"{count} frames: {name} does not keep {what}" for what, count in self._changed.items() if count]
        if self._behind:
            lines.append(f"{self._behind} frames stand behind frames of a later time: {name} gives them that time")
        if self._left_out:
            lines.append(f"{self._left_out} CAN FD, remote or error frames are left out: {name} cannot hold them")
        return lines


class _AscWriter(can.ASCWriter):
    """python-can's writer writes 5 ms as ".5", which is read as half a second."""

    FORMAT_DATE = "%a %b %d %H:%M:%S.{:03d} %Y"


def write_frames(path: Path | str, frames: Frames | Iterable[Frames]) -> None:
    """Write ``frames`` to ``path`` in the format of its suffix; only MCAP keeps everything.

    What the writers of python-can do not keep (times that go back neither in .asc nor in .log):
        .asc: the date to better than 1 ms (times are from the first frame on; earlier ones come out wrong), data
            of error frames;
        .blf: times before 1990 (they come out from the first frame on), direction of error frames;
        .log: length of remote frames, everything but the time of error frames;
        .csv: channel, direction, CAN FD;
        .trc: remote, error and CAN FD frames; the date to better than 1 µs;
        .mf4: length of remote frames, the absolute time to better than 1 µs.

    Raises:
        LogWriteError: unknown suffix, or the file can not be written.
    """
    path = Path(path)
    batches = [frames] if isinstance(frames, Frames) else frames
    if path.suffix.lower() not in FORMATS:
        raise LogWriteError(f"{path}: the suffix says no known log format; known are {', '.join(FORMATS)}")
    if path.suffix.lower() == ".mcap":
        with McapLog(path) as log:
            for batch in batches:
                log.write_frames(batch)
        return
    if path.suffix.lower() == ".mf4":
        give_asammdf()
    try:
        with _AscWriter(path) if path.suffix.lower() == ".asc" else can.Logger(path) as writer:
            for batch in batches:
                for i in range(len(batch)):
                    writer.on_message_received(message_from_frame(batch, i))
    except NotImplementedError as error:
        raise LogWriteError(
            f"{path}: writing MF4 needs asammdf; install it with: pip install 'dctorque-can[mf4]'"
        ) from error
    except OSError as error:
        raise LogWriteError(f"{path}: can not be written: {error.strerror}") from error
