"""Raw CAN frames as columns: the word that bus, logs and daemon share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntFlag
from typing import Self

import numpy as np
from numpy.typing import NDArray

EXTENDED_ID = 0x8000_0000  # set in ``can_id`` for 29-bit identifiers, as SocketCAN does

ID_MASK = 0x1FFF_FFFF  # of a 29-bit identifier
EVERY_BIT = 0xFFFF_FFFF

# An identifier of SAE J1939-21: priority 3 bits, parameter group number 18, source address 8. The last byte of the
# number is a destination in PDU1, and a part of the number in PDU2.
PRIORITY = 0x1C00_0000
DESTINATION = 0x0000_FF00
SOURCE = 0x0000_00FF
_FIRST_PDU2 = 240  # of the byte "PDU format", bits 16 to 23


def group_mask(can_id: int) -> int:
    """Return the bits by which a J1939 identifier is known: its parameter group number, and `EXTENDED_ID`."""
    is_pdu1 = (can_id >> 16) & 0xFF < _FIRST_PDU2
    return EVERY_BIT & ~(PRIORITY | SOURCE | (DESTINATION if is_pdu1 else 0))


class FrameFlag(IntFlag):
    """Bits of ``Frames.flags``."""

    FD = 1
    BITRATE_SWITCH = 2
    ERROR_STATE = 4
    REMOTE = 8
    ERROR = 16
    SENT = 32  # transmitted by us
    TRANSMITTED = 64  # marked Tx by whatever recorded the log: an input like any other


@dataclass(frozen=True, slots=True)
class Address:
    """Which frames are one message.

    Attributes:
        can_id: its identifier, with `EXTENDED_ID` set for a 29-bit one.
        mask: the bits of the identifier by which it is known; all of them, but for J1939.
        channel: on which it counts; None: on any.
    """

    can_id: int
    mask: int = EVERY_BIT
    channel: int | None = None

    def has(self, can_id: int, channel: int) -> bool:
        """Return whether a frame is this message."""
        return (can_id ^ self.can_id) & self.mask == 0 and self.channel in (None, channel)

    def meets(self, other: Address) -> bool:
        """Return whether one frame could be both."""
        known = (self.can_id ^ other.can_id) & self.mask & other.mask == 0
        return known and (None in (self.channel, other.channel) or self.channel == other.channel)

    def rows(self, frames: Frames) -> NDArray[np.bool_]:
        """Return which frames are this message, bool ``[n]``."""
        known: NDArray[np.bool_] = (frames.can_id & np.uint32(self.mask)) == np.uint32(self.can_id & self.mask)
        return known if self.channel is None else known & (frames.channel == self.channel)


@dataclass(frozen=True, slots=True)
class Frames:
    """``n`` frames in order of arrival.

    Attributes:
        t_us: int64 ``[n]``, microseconds since the epoch of the log (Unix time on a live bus).
        can_id: uint32 ``[n]``, with bit 31 (`EXTENDED_ID`) set for 29-bit identifiers.
        length: uint8 ``[n]``, payload bytes 0..64 (not the DLC code).
        flags: uint8 ``[n]``, bits of `FrameFlag`.
        channel: uint8 ``[n]``, index of the bus the frame was seen on.
        data: uint8 ``[n, 64]`` or ``[n, 8]`` when no frame is longer; zero beyond ``length``.
    """

    t_us: NDArray[np.int64]
    can_id: NDArray[np.uint32]
    length: NDArray[np.uint8]
    flags: NDArray[np.uint8]
    channel: NDArray[np.uint8]
    data: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.t_us)

    def __getitem__(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Self:
        return type(self)(
            self.t_us[rows],
            self.can_id[rows],
            self.length[rows],
            self.flags[rows],
            self.channel[rows],
            self.data[rows],
        )

    def copy(self) -> Self:
        """Return the frames in memory of their own."""
        return type(self)(
            self.t_us.copy(),
            self.can_id.copy(),
            self.length.copy(),
            self.flags.copy(),
            self.channel.copy(),
            self.data.copy(),
        )

    @classmethod
    def empty(cls, n: int = 0, width: int = 8) -> Self:
        """Return ``n`` zeroed frames of ``width`` data bytes."""
        return cls(
            np.zeros(n, np.int64),
            np.zeros(n, np.uint32),
            np.zeros(n, np.uint8),
            np.zeros(n, np.uint8),
            np.zeros(n, np.uint8),
            np.zeros((n, width), np.uint8),
        )

    @classmethod
    def concatenate(cls, parts: Iterable[Frames]) -> Self:
        """Join batches in the given order."""
        batches = list(parts)
        if not batches:
            return cls.empty()
        width = max(batch.data.shape[1] for batch in batches)
        padded = [np.pad(batch.data, ((0, 0), (0, width - batch.data.shape[1]))) for batch in batches]
        return cls(
            np.concatenate([b.t_us for b in batches]),
            np.concatenate([b.can_id for b in batches]),
            np.concatenate([b.length for b in batches]),
            np.concatenate([b.flags for b in batches]),
            np.concatenate([b.channel for b in batches]),
            np.concatenate(padded),
        )

    def sorted_by_time(self) -> Self:
        """Return the frames ordered by time; frames of equal time keep their order."""
        return self[np.argsort(self.t_us, kind="stable")]
