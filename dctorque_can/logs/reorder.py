"""Frames that a logger merged out of order, put in order of time within a window."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from dctorque_can.pipeline.frames import Frames

_AT_ONCE = 4096  # frames; each step of the clock costs as much as they do


class Reorder:
    """Sorts frames by time as they come; frames of one time keep their order.

    A frame that is older than the window allows is a step of the clock: what came before is given first. The
    result does not depend on how the frames are cut into batches.

    Args:
        window_us: how much later than its place a frame may stand.

    Attributes:
        moved: frames that stood behind one of a later time.
        furthest_us: by how much at most.
    """

    def __init__(self, window_us: int) -> None:
        self.moved = 0
        self.furthest_us = 0
        self._window_us = window_us
        self._waiting = Frames.empty()
        self._latest_us: int | None = None

    def sorted(self, batches: Iterable[Frames]) -> Iterator[Frames]:
        """Yield the frames in their new order; as they are without a window."""
        if not self._window_us:
            yield from batches
            return
        for frames in batches:
            if np.all(frames.t_us[1:] >= frames.t_us[:-1]):
                yield from self._take(frames)
                continue
            for start in range(0, len(frames), _AT_ONCE):
                yield from self._take(frames[start : start + _AT_ONCE])
        if len(self._waiting):
            yield self._waiting.sorted_by_time()
            self._waiting = Frames.empty()

    def _take(self, frames: Frames) -> Iterator[Frames]:
        while len(frames):
            before = frames.t_us[0] if self._latest_us is None else self._latest_us
            latest = np.maximum(np.maximum.accumulate(frames.t_us), before)
            behind = latest - frames.t_us
            steps = np.flatnonzero(behind > self._window_us)
            end = int(steps[0]) if len(steps) else len(frames)
            if end:
                late = behind[:end]
                self.moved += int(np.count_nonzero(late))
                self.furthest_us = max(self.furthest_us, int(late.max()))
                self._latest_us = int(latest[end - 1])
                yield from self._give(frames[:end], self._latest_us - self._window_us)
            frames = frames[end:]
            if len(frames):  # the clock went back
                yield from self._give(Frames.empty(), None)
                self._latest_us = int(frames.t_us[0])

    def _give(self, frames: Frames, until_us: int | None) -> Iterator[Frames]:
        """Yield what no frame can come before any more; all of it with None."""
        together = Frames.concatenate([self._waiting, frames]).sorted_by_time()
        count = len(together)
        if until_us is not None:
            count = int(np.searchsorted(together.t_us, until_us, side="right"))
        self._waiting = together[count:]
        if count:
            yield together[:count]
