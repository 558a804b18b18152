"""python-can messages to frame columns and back; the one place where float seconds become integer µs."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace

import can
import numpy as np
from can.typechecking import Channel
from can.util import channel2int

from dctorque_can.pipeline.frames import EXTENDED_ID, ID_MASK, FrameFlag, Frames

_PACKS = {width: struct.Struct(f"=qIBBBx{width}s").pack for width in (8, 64)}
_PACK_DATA = {width: struct.Struct(f"={width}s").pack_into for width in (8, 64)}
_ROW_NAMES = ("t_us", "can_id", "length", "flags", "channel", "data")
_ROWS = {
    width: np.dtype(
        {
            "names": _ROW_NAMES,
            "formats": ["i8", "u4", "u1", "u1", "u1", ("u1", width)],
            "offsets": [0, 8, 12, 13, 14, 16],
            "itemsize": 16 + width,
        }
    )
    for width in (8, 64)
}
_LONGEST_NAME = 255
_MAX_S = 9e12
_MAX_T_US = 9_000_000_000_000_000_000
_EXTENDED = int(EXTENDED_ID)
_FD = int(FrameFlag.FD)
_SWITCH = int(FrameFlag.BITRATE_SWITCH)
_STATE = int(FrameFlag.ERROR_STATE)
_REMOTE = int(FrameFlag.REMOTE)
_ERROR = int(FrameFlag.ERROR)
_SENT = int(FrameFlag.SENT)
_TRANSMITTED = int(FrameFlag.TRANSMITTED)


class ChannelNumbers:
    """Numbers the channels of one log: ``can1`` and ``1`` become 1, other names the lowest free number.

    Attributes:
        names: channel as the log calls it, to its index in ``Frames.channel``.
    """

    def __init__(self) -> None:
        self.names: dict[Channel | None, int] = {}
        self._taken: set[int] = set()

    def __getitem__(self, channel: Channel | None) -> int:
        """Return the index of ``channel``; 0 for None. Two names never share an index (up to 255)."""
        known = self.names.get(channel)
        if known is not None:
            return known
        is_name = isinstance(channel, str)
        if channel is None:
            wanted: int | None = 0
        else:  # of a longer name the number at its end may have more digits than Python converts
            wanted = None if isinstance(channel, str) and len(channel) > _LONGEST_NAME else channel2int(channel)
        if wanted is None or (is_name and wanted in self._taken):
            wanted = next((number for number in range(255) if number not in self._taken), 255)
        self.names[channel] = min(max(wanted, 0), 255)
        self._taken.add(self.names[channel])
        return self.names[channel]


def frames_from_messages(messages: Sequence[can.Message], channel: int | ChannelNumbers = 0) -> Frames:
    """Return ``messages`` as columns, in their order.

    Args:
        messages: as a bus or a log reader of python-can gives them; seconds are rounded to µs here.
        channel: index of the bus they were seen on, or the numbering of a log with several buses.

    The length of a remote frame is the one asked for, of any other frame the bytes that are there.
    Of data longer than 64 bytes the first 64 count.
    """
    is_index = isinstance(channel, int)
    width = _width(messages)
    pack = _PACKS[width]
    # one row of bytes per message, since packing one costs less than writing its numbers into six arrays
    rows = np.frombuffer(
        b"".join(
            [
                pack(*_numbers(m), channel if is_index else channel[m.channel], _data(m))  # type: ignore[index]
                for m in messages
            ]
        ),
        _ROWS[width],
    )
    return Frames(*[rows[name].copy() for name in _ROW_NAMES])


class MessageRoom:
    """Columns for messages of a live bus, written again and again: cheaper than to make new ones.

    Args:
        most: how many messages there is room for.
    """

    def __init__(self, most: int) -> None:
        self._narrow = Frames.empty(most, 8)
        self._wide = replace(self._narrow, data=np.zeros((most, 64), np.uint8))
        columns = self._narrow
        # memoryviews, which take a single number sooner than an array does
        self._numbers = columns.t_us.data, columns.can_id.data, columns.length.data, columns.flags.data
        self._views: dict[tuple[int, int], Frames] = {}

    def frames(self, messages: Sequence[can.Message]) -> Frames:
        """Return what `frames_from_messages` does, of no more messages than there is room for.

        The columns are only valid until the next call.
        """
        width = _width(messages)
        columns = self._narrow if width == 8 else self._wide
        t_us, can_id, length, flags = self._numbers
        data, pack = columns.data.data, _PACK_DATA[width]
        for i, m in enumerate(messages):
            t_us[i], can_id[i], length[i], flags[i] = _numbers(m)
            pack(data, width * i, _data(m))
        n = len(messages)
        view = self._views.get((n, width))
        if view is None:
            view = self._views[n, width] = columns[:n]
        return view


def message_from_frame(frames: Frames, i: int) -> can.Message:
    """Return frame ``i`` for python-can, its channel as a number; exact to the µs until the year 2041."""
    flags = int(frames.flags[i])
    can_id = int(frames.can_id[i])
    length = int(frames.length[i])
    remote = bool(flags & _REMOTE)
    return can.Message(
        timestamp=int(frames.t_us[i]) / 1e6,
        arbitration_id=can_id & ID_MASK,
        is_extended_id=bool(can_id & _EXTENDED),
        is_remote_frame=remote,
        is_error_frame=bool(flags & _ERROR),
        channel=int(frames.channel[i]),
        dlc=length,
        data=None if remote else frames.data[i, :length].tobytes(),
        is_fd=bool(flags & _FD),
        is_rx=not flags & (_SENT | _TRANSMITTED),
        bitrate_switch=bool(flags & _SWITCH),
        error_state_indicator=bool(flags & _STATE),
    )


def _width(messages: Sequence[can.Message]) -> int:
    """Return how many bytes the data of each message take in columns."""
    for m in messages:
        if len(m.data) > 8:
            return 64
    return 8


def _numbers(m: can.Message) -> tuple[int, int, int, int]:
    """Return time, identifier, length and flags as `Frames` has them."""
    return (
        _microseconds(m.timestamp),
        (m.arbitration_id & ID_MASK) | _EXTENDED if m.is_extended_id else m.arbitration_id & ID_MASK,
        min(len(m.data), 64) if not m.is_remote_frame else min(max(m.dlc, 0), 64),
        _flags(m),
    )


def _data(m: can.Message) -> bytes | bytearray:
    return m.data if not m.is_remote_frame else b""


def _microseconds(seconds: float) -> int:
    if abs(seconds) < _MAX_S:
        return round(seconds * 1e6)
    if seconds != seconds:
        return 0
    return _MAX_T_US if seconds > 0 else -_MAX_T_US


def _flags(message: can.Message) -> int:
    flags = 0
    if message.is_fd:
        flags |= _FD
    if message.bitrate_switch:
        flags |= _SWITCH
    if message.error_state_indicator:
        flags |= _STATE
    if message.is_remote_frame:
        flags |= _REMOTE
    if message.is_error_frame:
        flags |= _ERROR
    if not message.is_rx:
        flags |= _TRANSMITTED
    return flags
