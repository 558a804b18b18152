"""Notices that frames come of which none is mapped: another car, another channel, another DBC."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from dctorque_can.analysis.origins import NO_DATA
from dctorque_can.analysis.traffic import MappedMessage, Traffic
from dctorque_can.analysis.unmapped import unmapped_lines
from dctorque_can.pipeline.frames import Frames

PATIENCE_S = 2.0  # from the first frame: told
_MOST_KNOWN = 4096  # identifiers; a bus full of nonsense does not fill the memory


class TrafficWatch:
    """Counts the data frames of all buses until one is mapped; from then on it costs nothing.

    Args:
        messages: that inputs come from.
        tell: is told once that none is mapped, and that the first one has come: ``tell(is_error, text)``.

    Attributes:
        mapped: whether a mapped frame has come.
        told: whether it was told that frames come and none is mapped.
    """

    def __init__(self, messages: Iterable[MappedMessage], tell: Callable[[bool, str], None]) -> None:
        self.mapped = False
        self.told = False
        self._traffic = Traffic(messages)
        self._tell = tell
        self._since_s: float | None = None

    def take(self, frames: Frames, now_s: float) -> None:
        """Look at a batch."""
        if self.mapped:
            return
        data = (frames.flags & NO_DATA) == 0
        if not data.all():
            frames = frames[np.flatnonzero(data)]
        if not len(frames):
            return
        if self._since_s is None:
            self._since_s = now_s
        if self._traffic.extended_identifiers > _MOST_KNOWN:
            self._traffic = Traffic([each.mapped for each in self._traffic.messages])
        self._traffic.take(frames)
        self.mapped = self._traffic.mapped_frames > 0
        if self.mapped and self.told:
            self._tell(False, "the first mapped frame has come")

    def keep_time(self, now_s: float) -> None:
        """Tell, when it is time."""
        if self.mapped or self.told or self._since_s is None or now_s - self._since_s < PATIENCE_S:
            return
        self.told = True
        for line in self.lines():
            self._tell(True, line)

    def lines(self) -> list[str]:
        """Return that no frame was mapped, and which came most; nothing if one was, or none came."""
        if self.mapped or not self._traffic.frames:
            return []
        return unmapped_lines(self._traffic, "most seen are")
