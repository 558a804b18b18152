"""What the frames of a recording are: how many of each identifier, and of the mapped ones how many are whole."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.origins import NO_DATA, Origins, identifier_text
from dctorque_can.pipeline.frames import EXTENDED_ID, Address, Frames, group_mask

_STANDARD_IDS = 1 << 11
_MOST_IDENTIFIERS = 1000


@dataclass(frozen=True, slots=True)
class MappedMessage:
    """A message that inputs come from.

    Attributes:
        name: of the DBC.
        address: by what its frames are known.
        length: its bytes by the DBC.
        needed: its first bytes, in which all mapped signals and what protects them lie.
    """

    name: str
    address: Address
    length: int
    needed: int


@dataclass(slots=True)
class MessageTraffic:
    """What came of one mapped message.

    Attributes:
        mapped: the message.
        frames: data frames.
        short: of these, with fewer bytes than the DBC says.
        shortest: bytes of the shortest of them; those of the DBC while there is none.
        origins: where they came from.
    """

    mapped: MappedMessage
    frames: int
    short: int
    shortest: int
    origins: Origins


class Traffic:
    """Counts the frames of a recording.

    Args:
        mapped: messages that inputs come from.

    Attributes:
        frames: all of them.
        messages: what came of each mapped message.
    """

    def __init__(self, mapped: Iterable[MappedMessage]) -> None:
        self.frames = 0
        self.messages = [
            MessageTraffic(each, 0, 0, each.length, Origins(each.name, each.address)) for each in mapped
        ]
        self._standard = np.zeros(_STANDARD_IDS, np.int64)
        self._others: Counter[int] = Counter()

    @property
    def mapped_frames(self) -> int:
        """Data frames of mapped messages."""
        return sum(message.frames for message in self.messages)

    @property
    def extended_identifiers(self) -> int:
        """How many identifiers of 29 bits came; each takes memory."""
        return len(self._others)

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
        for message in self.messages:
            can_id = message.mapped.address.can_id
            if all_standard if can_id >= _STANDARD_IDS else not counts[can_id]:
                continue
            rows = np.flatnonzero(message.mapped.address.rows(frames))
            _count(message, frames, rows[frames.flags[rows] & NO_DATA == 0])

    def same_group(self, message: MessageTraffic) -> list[tuple[int, int]]:
        """Return identifiers of the J1939 number of a message of 29 bits, and how often each came."""
        can_id = message.mapped.address.can_id
        if not can_id & EXTENDED_ID:
            return []
        group = Address(can_id, group_mask(can_id))
        return [(other, count) for other, count in self._others.most_common() if group.has(other, 0)]

    def as_json(self) -> dict[str, Any]:
        """Return the counts for scripts."""
        return {
            "mapped_frames": self.mapped_frames,
            "identifiers": {identifier_text(can_id): count for can_id, count in self.most_seen(_MOST_IDENTIFIERS)},
            "short_frames": {
                m.mapped.name: {"frames": m.short, "shortest": m.shortest} for m in self.messages if m.short
            },
        }

    def most_seen(self, most: int) -> list[tuple[int, int]]:
        """Return the identifiers that came most often with how often, at most so many of them."""
        counts = Counter({int(i): int(self._standard[i]) for i in np.flatnonzero(self._standard)})
        return (counts + self._others).most_common(most)


def _count(message: MessageTraffic, frames: Frames, rows: NDArray[np.intp]) -> None:
    """Count data frames of one message."""
    if not len(rows):
        return
    message.frames += len(rows)
    length = frames.length[rows]
    message.short += int(np.count_nonzero(length < message.mapped.length))
    message.shortest = min(message.shortest, int(length.min()))
    message.origins.take(frames, rows)
