"""From which channels and J1939 source addresses each mapped message comes, and whether that is more than one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dctorque_can.pipeline.frames import EXTENDED_ID, SOURCE, Address, FrameFlag, Frames

MOST_NAMES = 12
NO_DATA = int(FrameFlag.REMOTE | FrameFlag.ERROR | FrameFlag.SENT)
"""Flags of frames that are never an input."""
_MOST_KNOWN = 4096  # identifiers; a bus full of nonsense does not fill the memory


@dataclass(slots=True)
class Origins:
    """Where the frames of one message came from.

    Attributes:
        name: of the DBC.
        address: by what its frames are known.
        channels: on which they came.
        sources: J1939 source addresses; empty of a message that is known by one alone, or by its identifier.
    """

    name: str
    address: Address
    channels: set[int] = field(default_factory=set)
    sources: set[int] = field(default_factory=set)

    def __str__(self) -> str:
        return f"{identifier_text(self.address.can_id)} {self.name}"

    def take(self, frames: Frames, rows: NDArray[np.intp]) -> None:
        """Note where some frames of this message came from."""
        self.channels.update(np.flatnonzero(np.bincount(frames.channel[rows])).tolist())
        if self.address.mask & SOURCE != SOURCE:
            self.sources.update(np.flatnonzero(np.bincount(frames.can_id[rows] & SOURCE)).tolist())


class OriginWatch:
    """Notices on a live bus that a message comes from more than one place; some microseconds a batch.

    Args:
        messages: that inputs come from, each with the address by which it is known.
    """

    def __init__(self, messages: Iterable[tuple[str, Address]]) -> None:
        self._origins = [Origins(name, address) for name, address in messages]
        self._known: set[tuple[int, int, bool]] = set()
        self._told: set[str] = set()

    def take(self, frames: Frames) -> bool:
        """Look at a batch; return whether it held anything new."""
        data = frames.flags & NO_DATA == 0
        kinds = set(zip(frames.can_id.tolist(), frames.channel.tolist(), data.tolist(), strict=True))
        if kinds <= self._known or len(self._known) > _MOST_KNOWN:
            return False
        for each in self._origins:
            rows = np.flatnonzero(each.address.rows(frames) & data)
            if len(rows):
                each.take(frames, rows)
        self._known |= kinds
        return True

    def news(self) -> list[str]:
        """Return what `shared_lines` says that it did not say before."""
        lines = [line for line in shared_lines(self._origins) if line not in self._told]
        self._told.update(lines)
        return lines


def shared_lines(origins: Sequence[Origins]) -> list[str]:
    """Return which messages come from several channels, or from several source addresses, in sentences."""
    lines = []
    several = [each for each in origins if len(each.channels) > 1]
    if several:
        channels = sorted(set().union(*(each.channels for each in several)))
        names = [str(each) for each in sorted(several, key=lambda each: each.address.can_id)]
        lines.append(
            f"channels {' and '.join(map(str, channels))} both carry mapped identifiers: "
            f"{listed(names, MOST_NAMES)}; frames of all of them are taken, unless `channel:` of the database "
            "names one"
        )
    for each in origins:
        if len(each.sources) > 1:
            sources = " and ".join(f"0x{source:02X}" for source in sorted(each.sources))
            lines.append(
                f"source addresses {sources} both send {each}; frames of all of them are taken, unless "
                "`source_addresses:` of the database names one"
            )
    return lines


def listed(items: Sequence[str], most: int) -> str:
    """Return items with commas, and how many more there are."""
    more = f" and {len(items) - most} more" if len(items) > most else ""
    return ", ".join(items[:most]) + more


def identifier_text(can_id: int) -> str:
    """Return an identifier as ASC has it: hexadecimal, 29-bit ones with an x behind."""
    return f"{can_id & ~EXTENDED_ID:X}x" if can_id & EXTENDED_ID else f"{can_id:X}"
