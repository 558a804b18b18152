"""Gathers what the service sees into batches for the log writer."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dctorque_can.daemon.log.counts import State, no_state
from dctorque_can.daemon.log.process import LogProcess
from dctorque_can.daemon.log.protocol import (
    Kind,
    estimates_message,
    frames_message,
    health_message,
    json_message,
    table_message,
)
from dctorque_can.logs.mcap.layout import EventLevel
from dctorque_can.logs.mcap.table import Table
from dctorque_can.pipeline.estimates import Estimates
from dctorque_can.pipeline.frames import Frames

BATCH_FRAMES = 512
BATCH_S = 0.05
NOTHING = Frames.empty()


class FrameBuffer:
    """Columns that fill up frame by frame without any allocation."""

    def __init__(self, capacity: int) -> None:
        self._narrow = Frames.empty(capacity, 8)
        self._wide = replace(self._narrow, data=np.zeros((capacity, 64), np.uint8))
        self._columns = self._narrow
        self._capacity = capacity
        self.count = 0

    def add(self, frames: Frames) -> Frames:
        """Take as many frames as fit and return the rest."""
        n = len(frames)
        taken = min(n, self._capacity - self.count)
        if taken < n:
            self._copy(frames[:taken])
            return frames[taken:]
        self._copy(frames)
        return NOTHING

    def _copy(self, frames: Frames) -> None:
        end = self.count + len(frames)
        rows, width = slice(self.count, end), frames.data.shape[1]
        if width > 8 and self._columns is self._narrow:
            self._columns = self._wide
            self._wide.data[: self.count, :8] = self._narrow.data[: self.count]
            self._wide.data[: self.count, 8:] = 0
        columns = self._columns
        columns.t_us[rows] = frames.t_us
        columns.can_id[rows] = frames.can_id
        columns.length[rows] = frames.length
        columns.flags[rows] = frames.flags
        columns.channel[rows] = frames.channel
        if columns is self._narrow:
            columns.data[rows] = frames.data
        else:
            columns.data[rows, :width] = frames.data
            columns.data[rows, width:] = 0
        self.count = end

    @property
    def full(self) -> bool:
        """Whether nothing more fits."""
        return self.count == self._capacity

    def take(self) -> Frames:
        """Return everything and start anew; the columns are only valid until the next `add`."""
        frames = self._columns[: self.count]
        self.count, self._columns = 0, self._narrow
        return frames


class Recorder:
    """What goes to the log, in batches.

    Args:
        log: the log writer.
        frames: whether frames (and with them decoded signals) go there.
        estimates: whether estimates and health go there.
        flush_s: time from receiving to the hands of the operating system, at most.
        state: copies the state of the estimator, after the last frame that was given.
    """

    def __init__(
        self, log: LogProcess, frames: bool, estimates: bool, flush_s: float, state: Callable[[], State]
    ) -> None:
        self._log = log
        self._state_of_now = state
        self._flush_s = 0.0
        self._received_s: float | None = None  # the oldest that has not been flushed
        self._set(frames, estimates, flush_s)
        self._rows: list[NDArray[np.void]] = []
        self._health: list[NDArray[np.void]] = []
        self._due_s = 0.0

    def _set(self, frames: bool, estimates: bool, flush_s: float) -> None:
        self._state = self._state_of_now if frames else lambda: no_state  # without frames nothing can be replayed
        self._flush_every_s = flush_s / 2  # the other half is for what lies between
        self._batch_s = min(BATCH_S, flush_s / 4)
        self._frames = FrameBuffer(BATCH_FRAMES) if frames else None
        self._with_estimates = estimates

    def change(self, frames: bool, estimates: bool, flush_s: float) -> None:
        """Finish the log, and begin one that gets what it is told; see the class."""
        self._hand_over()
        self._set(frames, estimates, flush_s)
        self.rotate()

    def frames(self, frames: Frames) -> None:
        """Add frames, received or sent."""
        if self._frames is None:
            return
        if self._received_s is None:
            self._received_s = time.monotonic()
        while len(frames):
            frames = self._frames.add(frames)
            if self._frames.full:
                self._hand_over_frames()

    def estimates(self, estimates: Estimates) -> None:
        """Add estimates and health."""
        if self._with_estimates:
            if len(estimates.rows):
                self._rows.append(estimates.rows)
            if len(estimates.health):
                self._health.append(estimates.health)

    def event(self, t_us: int, level: EventLevel, text: str) -> None:
        """Add a line for people."""
        event = {"t_us": t_us, "level": int(level), "name": "dctorque", "text": text}
        self._log.hand_over(json_message(Kind.EVENT, event))

    def table(self, table: Table, rows: NDArray[np.void]) -> None:
        """Add rows of any table, e.g. the truth of a simulation."""
        step = max((1 << 20) // table.dtype.itemsize, 1)
        for start in range(0, len(rows), step):
            self._log.hand_over(table_message(table, rows[start : start + step]))

    def pause_s(self, now_s: float) -> float:
        """Return after which time `keep_time` must be called again, though nothing comes."""
        return math.inf if self._received_s is None else max(min(self._due_s, self._flush_s) - now_s, 0.0)

    def keep_time(self, now_s: float) -> None:
        """Hand the batch over when it is time; to be called after every receive, and after `pause_s`."""
        if now_s < min(self._due_s, self._flush_s):
            return
        self._due_s = now_s + self._batch_s
        self._hand_over()
        if self._log.wants_new(now_s):
            self.rotate()
        elif now_s >= self._flush_s:
            self._flush_s = now_s + self._flush_every_s
            if self._received_s is not None and self._log.flush(self._state(), self._received_s):
                self._received_s = None
        self._log.pump()

    def rotate(self) -> None:
        """Finish the log and begin the next one, with the state of now."""
        self._hand_over()
        self._received_s = None
        self._log.rotate(self._state())

    def close(self) -> None:
        """Hand over the rest and close the log."""
        self._hand_over()
        self._log.close()

    def wait_for_room(self, most_bytes: int) -> None:
        """Let the log writer catch up: for those who make frames faster than any bus."""
        while self._log.waiting_bytes > most_bytes:
            self._log.pump()
            time.sleep(0.001)

    def _hand_over_frames(self) -> None:
        if self._frames is not None and self._frames.count:
            count = self._frames.count
            self._log.hand_over(frames_message(self._frames.take()), count)

    def _hand_over(self) -> None:
        self._hand_over_frames()
        if self._rows:
            self._log.hand_over(estimates_message(self._rows))
            self._rows.clear()
        if self._health:
            self._log.hand_over(health_message(self._health))
            self._health.clear()
