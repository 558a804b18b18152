"""The objects of BLF containers to columns: compiled loops after the layouts in ``can.io.blf``."""

from __future__ import annotations

import numpy as np
from can.io.blf import CAN_ERROR_EXT, CAN_FD_MESSAGE, CAN_FD_MESSAGE_64, CAN_MESSAGE, CAN_MESSAGE2
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.logs.little_endian import little_endian
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

OBJECT_BASE = 16  # signature, header size and version, object size, kind
_LOBJ = int.from_bytes(b"LOBJ", "little")
_FD_LENGTHS = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64], np.uint8)
_EXTENDED = int(EXTENDED_ID)
_FD = int(FrameFlag.FD)
_SWITCH = int(FrameFlag.BITRATE_SWITCH)
_STATE = int(FrameFlag.ERROR_STATE)
_REMOTE = int(FrameFlag.REMOTE)
_ERROR = int(FrameFlag.ERROR)
_TRANSMITTED = int(FrameFlag.TRANSMITTED)
_TEN_MICROSECONDS = 1
_EXACT = 1 << 53


@compiled
def _next_object(data: NDArray[np.uint8], position: int) -> int:
    """Return where the next object begins, at most 4 bytes of padding away; -1 if there is none."""
    for padding in range(5):
        if position + padding + 4 <= len(data) and little_endian(data, position + padding, 4) == _LOBJ:
            return position + padding
    return -1


@compiled
def has_fd(data: NDArray[np.uint8], position: int) -> bool:
    """Return whether a CAN FD object is among the sound ones from ``position`` on."""
    while True:
        position = _next_object(data, position)
        if position < 0 or position + OBJECT_BASE > len(data):
            return False
        size = little_endian(data, position + 8, 4)
        kind = little_endian(data, position + 12, 4)
        if kind in (CAN_FD_MESSAGE, CAN_FD_MESSAGE_64):
            return True
        if size < OBJECT_BASE:
            return False
        position += size


@compiled
def _microseconds(ticks: int, ten_microseconds: bool, start_s: float) -> int:
    """Return µs in the arithmetic of python-can: the float of the exact seconds, plus the start, rounded once."""
    seconds = ticks / 1e5 if ten_microseconds else ticks / 1e9
    return int(np.rint((seconds + start_s) * 1e6))


@compiled
def read_objects(
    data: NDArray[np.uint8],
    position: int,
    start_s: float,
    t_us: NDArray[np.int64],
    can_id: NDArray[np.uint32],
    length: NDArray[np.uint8],
    flags: NDArray[np.uint8],
    channel: NDArray[np.uint8],
    payload: NDArray[np.uint8],
) -> tuple[int, int, bool]:
    """Fill the columns; return the number of frames, where reading ended, and whether all is well there."""
    row = 0
    while True:
        start = _next_object(data, position)
        if start < 0:
            return row, position, position + 8 > len(data)
        if start + OBJECT_BASE > len(data):
            return row, start, True
        header_size = little_endian(data, start + 4, 2)
        version = little_endian(data, start + 6, 2)
        size = little_endian(data, start + 8, 4)
        kind = little_endian(data, start + 12, 4)
        if size < OBJECT_BASE:
            return row, start, False
        if start + size > len(data):
            return row, start, True
        position = start + size
        at = start + (32 if version == 1 else 40)
        if version != 1 and version != 2:
            continue
        fixed = 0
        if kind in (CAN_MESSAGE, CAN_MESSAGE2):
            fixed = 16
        elif kind == CAN_ERROR_EXT:
            fixed = 32
        elif kind == CAN_FD_MESSAGE:
            fixed = 84
        elif kind == CAN_FD_MESSAGE_64:
            fixed = 40
        if fixed == 0:
            continue
        if at + fixed > len(data):
            return row, start, False
        ticks = little_endian(data, start + 24, 8)
        if ticks < 0 or ticks >= _EXACT:
            return row, start, False

        if kind == CAN_FD_MESSAGE_64:
            number = int(data[at])
            flag, count, first, there, identifier = _fd_64(data, at, header_size, size)
        else:
            number = little_endian(data, at, 2)
            flag, count, first, identifier = _object(data, at, kind)
            there = count
        if flag & _REMOTE:
            there = 0
        t_us[row] = _microseconds(ticks, little_endian(data, start + 16, 4) == _TEN_MICROSECONDS, start_s)
        can_id[row] = (identifier & 0x1FFFFFFF) | (_EXTENDED if identifier & _EXTENDED else 0)
        length[row] = count
        flags[row] = flag
        channel[row] = min(max(number - 1, 0), 255)
        for i in range(min(there, 64)):
            payload[row, i] = data[first + i]
        row += 1


@compiled
def _fd_length(code: int) -> int:
    return int(_FD_LENGTHS[code]) if code < 16 else 64


@compiled
def _object(data: NDArray[np.uint8], at: int, kind: int) -> tuple[int, int, int, int]:
    """Return flags, length, position of the data, and identifier of any object but the CAN FD 64 one."""
    if kind == CAN_ERROR_EXT:
        return _ERROR, min(int(data[at + 10]), 8), at + 24, little_endian(data, at + 16, 4)
    flag = 0
    bits = int(data[at + 2])
    code = int(data[at + 3])
    if bits & 0x80:
        flag |= _REMOTE
    if bits & 1:
        flag |= _TRANSMITTED
    identifier = little_endian(data, at + 4, 4)
    if kind != CAN_FD_MESSAGE:
        count = min(code, 64 if flag & _REMOTE else 8)
        return flag, count, at + 8, identifier
    fd_bits = int(data[at + 13])
    if fd_bits & 1:
        flag |= _FD
    if fd_bits & 2:
        flag |= _SWITCH
    if fd_bits & 4:
        flag |= _STATE
    count = _fd_length(code) if flag & _REMOTE else min(int(data[at + 14]), 64)
    return flag, count, at + 20, identifier


@compiled
def _fd_64(data: NDArray[np.uint8], at: int, header_size: int, size: int) -> tuple[int, int, int, int, int]:
    """Return flags, length, position of the data, bytes that are really there, and identifier."""
    flag = 0
    bits = little_endian(data, at + 12, 4)
    if bits & 0x0010:
        flag |= _REMOTE
    if bits & 0x1000:
        flag |= _FD
    if bits & 0x2000:
        flag |= _SWITCH
    if bits & 0x4000:
        flag |= _STATE
    if data[at + 34] != 0:
        flag |= _TRANSMITTED
    told = int(data[at + 2])
    offset = int(data[at + 35])
    there = min(told, (offset if offset else size) - header_size - 40)
    there = max(min(there, len(data) - at - 40), 0)
    count = _fd_length(int(data[at + 1])) if flag & _REMOTE else min(told, 64)
    return flag, count, at + 40, min(there, count), little_endian(data, at + 4, 4)
