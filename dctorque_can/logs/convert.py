"""Frames to a new log of any format."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import can

from dctorque_can.logs.errors import LogWriteError
from dctorque_can.logs.formats import FORMATS
from dctorque_can.logs.late_asammdf import give_asammdf
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.pipeline.frames import Frames


def write_frames(path: Path | str, frames: Frames | Iterable[Frames]) -> None:
    """Write ``frames`` to ``path`` in the format of its suffix; only MCAP keeps everything.

    What the writers of python-can do not keep:
        .asc: the date (times are from the first frame on; earlier ones come out wrong), data of error frames;
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
        with can.Logger(path) as writer:
            for batch in batches:
                for i in range(len(batch)):
                    writer.on_message_received(message_from_frame(batch, i))
    except NotImplementedError as error:
        raise LogWriteError(
            f"{path}: writing MF4 needs asammdf; install it with: pip install 'dctorque-can[mf4]'"
        ) from error
    except OSError as error:
        raise LogWriteError(f"{path}: can not be written: {error.strerror}") from error
