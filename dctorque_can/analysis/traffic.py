"""What the frames of a recording are: how many of each identifier, and of the mapped ones how many are whole."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

_NO_DATA = int(FrameFlag.REMOTE | FrameFlag.ERROR | FrameFlag.SENT)
_STANDARD_IDS = 1 << 11
_MOST_IDENTIFIERS = 1000


@dataclass(frozen=True, slots=True)
class MappedMessage:
    """A message that inputs come from.

    Attributes:
        name: of the DBC.
        length: its bytes by the DBC.
        needed: its first bytes, in which all mapped signals and what protects them lie.
    """

    name: str
    length: int
    needed: int


@dataclass(slots=True)
class MessageTraffic:
    """What came of one mapped message.

    Attributes:
        frames: data frames.
        short: of these, with fewer bytes than the DBC says.
        shortest: bytes of the shortest of them; those of the DBC while there is none.
        channels: on which they came.
    """

    frames: int
    short: int
    shortest: int
    channels: set[int]


class Traffic:
    """Counts the frames of a recording.

    Args:
        mapped: messages that inputs come from by their identifier, with `EXTENDED_ID` set for 29-bit ones.
        channels: the one channel on which a message counts, by its identifier; any where there is none.

    Attributes:
        frames: all of them.
        messages: what came of each mapped message, by its identifier.
    """

    def __init__(self, mapped: Mapping[int, MappedMessage], channels: Mapping[int, int] | None = None) -> None:
        self.frames = 0
        self.mapped = dict(mapped)
        self._channels = dict(channels or {})
        self.messages = {can_id: MessageTraffic(0, 0, message.length, set()) for can_id, message in mapped.items()}
        self._standard = np.zeros(_STANDARD_IDS, np.int64)
        self._others: Counter[int] = Counter()

    @property
    def mapped_frames(self) -> int:
        """Data frames of mapped messages."""
        return sum(message.frames for message in self.messages.values())

    def take(self, frames: Frames) -> None:
        """Count a batch."""
        self.frames += len(frames)
        standard = frames.can_id < _STANDARD_IDS
        all_standard = bool(standard.all())
        ids = frames.can_id if all_standard else frames.can_id[standard]
        counts = np.bincount(ids, minlength=_STANDARD_IDS)
        self._standard += counts
        if not all_standard:
            found, numbers = np.unique(frames.can_id[~standard], return_counts=True)
            self._others.update(dict(zip(found.tolist(), numbers.tolist(), strict=True)))
        for can_id in self.messages:
            if can_id < _STANDARD_IDS and not counts[can_id]:
                continue
            self._take_message(can_id, frames, np.flatnonzero(frames.can_id == can_id))

    def _take_message(self, can_id: int, frames: Frames, rows: NDArray[np.intp]) -> None:
        message = self.messages[can_id]
        rows = rows[frames.flags[rows] & _NO_DATA == 0]
        if can_id in self._channels:
            rows = rows[frames.channel[rows] == self._channels[can_id]]
        if not len(rows):
            return
        message.frames += len(rows)
        length = frames.length[rows]
        message.short += int(np.count_nonzero(length < self.mapped[can_id].length))
        message.shortest = min(message.shortest, int(length.min()))
        message.channels.update(np.flatnonzero(np.bincount(frames.channel[rows])).tolist())

    def as_json(self) -> dict[str, Any]:
        """Return the counts for scripts."""
        return {
            "mapped_frames": self.mapped_frames,
            "identifiers": {identifier_text(can_id): count for can_id, count in self.most_seen(_MOST_IDENTIFIERS)},
            "short_frames": {
                self.mapped[can_id].name: {"frames": m.short, "shortest": m.shortest}
                for can_id, m in self.messages.items()
                if m.short
            },
        }

    def most_seen(self, most: int) -> list[tuple[int, int]]:
        """Return the identifiers that came most often with how often, at most so many of them."""
        counts = Counter({int(i): int(self._standard[i]) for i in np.flatnonzero(self._standard)})
        return (counts + self._others).most_common(most)


def identifier_text(can_id: int) -> str:
    """Return an identifier as ASC has it: hexadecimal, 29-bit ones with an x behind."""
    return f"{can_id & ~EXTENDED_ID:X}x" if can_id & EXTENDED_ID else f"{can_id:X}"


def on_their_channels(frames: Frames, channels: Mapping[int, int]) -> Frames:
    """Return the frames without those of ``channels`` that are on another channel than the one named there."""
    if not channels:
        return frames
    elsewhere = np.zeros(len(frames), np.bool_)
    for can_id, channel in channels.items():
        elsewhere |= (frames.can_id == can_id) & (frames.channel != channel)
    return frames[~elsewhere] if elsewhere.any() else frames
