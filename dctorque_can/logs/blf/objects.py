"""The objects of BLF containers to columns: compiled loops after the layouts in ``can.io.blf``."""

from __future__ import annotations

import numpy as np
from can.io.blf import CAN_ERROR_EXT, CAN_FD_MESSAGE, CAN_FD_MESSAGE_64, CAN_MESSAGE, CAN_MESSAGE2
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.logs.columns import FrameColumns
from dctorque_can.logs.little_endian import little_endian
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

OBJECT_BASE = 16  # signature, header size and version, object size, kind
SMALLEST_FRAME = 32 + 8  # header of version 1 and the head of the smallest object that is a frame
LONGEST_OBJECT = 16 << 20  # a larger one is damaged: it would hide all that follows

# Why reading ended.
END_OF_DATA, NO_ROOM, TOO_NARROW = 0, 1, 2

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
_LONGEST = 1 << 59  # ns, 18 years: in µs ten times that is still a number of 63 bits


@compiled
def _next_object(data: NDArray[np.uint8], position: int) -> int:
    """Return where the next object begins, at most 4 bytes of padding away; -1 if there is none."""
    for padding in range(5):
        if position + padding + 4 <= len(data) and little_endian(data, position + padding, 4) == _LOBJ:
            return position + padding
    return -1


@compiled
def _resync(data: NDArray[np.uint8], position: int) -> int:
    """Return where the next signature stands from ``position`` on, or the end of the data."""
    while position + 4 <= len(data):
        if little_endian(data, position, 4) == _LOBJ:
            return position
        position += 1
    return len(data)


@compiled
def _microseconds(ticks: int, ten_microseconds: bool, start_s: float) -> int:
    """Return µs in the arithmetic of python-can: the float of the exact seconds, plus the start, rounded once.

    Ticks that no float holds exactly, of 104 days and more, are divided as whole numbers.
    """
    if ticks >= _EXACT:
        whole = ticks * 10 if ten_microseconds else (ticks + 500) // 1000
        return whole + int(np.rint(start_s * 1e6))
    seconds = ticks / 1e5 if ten_microseconds else ticks / 1e9
    return int(np.rint((seconds + start_s) * 1e6))


@compiled
def _head_size(kind: int) -> int:
    """Return the bytes before the data of an object of this kind, 0 for a kind that is no frame."""
    if kind in (CAN_MESSAGE, CAN_MESSAGE2):
        return 8
    if kind == CAN_ERROR_EXT:
        return 24
    if kind == CAN_FD_MESSAGE:
        return 20
    if kind == CAN_FD_MESSAGE_64:
        return 40
    return 0


@compiled
def read_objects(
    data: NDArray[np.uint8],
    position: int,
    last: bool,
    start_s: float,
    columns: FrameColumns,
) -> tuple[int, int, int, int, int]:
    """Fill the columns with the frames of whole objects from ``position`` on.

    An object that is damaged, too small for what it holds, or longer than any that is written is left out; reading
    goes on at the next signature. With ``last`` nothing follows these data, so that an object which goes on beyond
    them is damaged too, if another one begins after its head.

    Bounds: a row is written only below the number of rows, a byte of the payload only below its width. Only bytes
    before an object's own end are read, which is at most the end of the data; of a CAN FD 64 object, which may
    tell another length, bytes before the end of the data.

    Returns:
        Number of frames, where reading ended, why (`END_OF_DATA`, `NO_ROOM`, `TOO_NARROW`), number of objects left
        out, and their bytes.
    """
    t_us, can_id, length, flags, channel, payload = columns
    row, left_out, lost = 0, 0, 0
    damaged_at = -1
    while row < len(t_us):
        if damaged_at >= 0:
            left_out += 1
            position = _resync(data, damaged_at + 1)
            lost += position - damaged_at
            damaged_at = -1
        start = _next_object(data, position)
        if start < 0:
            if position + 8 > len(data):
                return row, position, END_OF_DATA, left_out, lost
            damaged_at = position
            continue
        if start + OBJECT_BASE > len(data):
            return row, start, END_OF_DATA, left_out, lost
        header_size = little_endian(data, start + 4, 2)
        version = little_endian(data, start + 6, 2)
        size = little_endian(data, start + 8, 4)
        kind = little_endian(data, start + 12, 4)
        if size < OBJECT_BASE or size > LONGEST_OBJECT:
            damaged_at = start
            continue
        if start + size > len(data):
            if not last or _resync(data, start + 1) == len(data):
                return row, start, END_OF_DATA, left_out, lost
            damaged_at = start
            continue
        head = _head_size(kind) if version == 1 or version == 2 else 0
        if head == 0:
            position = start + size
            continue
        at = start + (32 if version == 1 else 40)
        if at + head > start + size:
            damaged_at = start
            continue
        ticks = little_endian(data, start + 24, 8)
        if ticks < 0 or ticks >= _LONGEST:
            damaged_at = start
            continue

        if kind == CAN_FD_MESSAGE_64:
            number = int(data[at])
            flag, count, there, identifier = _fd_64(data, at, header_size, size)
        else:
            number = little_endian(data, at, 2)
            flag, count, identifier = _object(data, at, kind)
            there = 0 if flag & _REMOTE else count
            if at + head + there > start + size:
                damaged_at = start
                continue
        if flag & _REMOTE:
            there = 0
        if not flag & _REMOTE and count > payload.shape[1]:  # also where less is there
            return row, start, TOO_NARROW, left_out, lost
        t_us[row] = _microseconds(ticks, little_endian(data, start + 16, 4) == _TEN_MICROSECONDS, start_s)
        can_id[row] = (identifier & 0x1FFFFFFF) | (_EXTENDED if identifier & _EXTENDED else 0)
        length[row] = count
        flags[row] = flag
        channel[row] = min(max(number - 1, 0), 255)
        for i in range(there):
            payload[row, i] = data[at + head + i]
        row += 1
        position = start + size
    return row, position, NO_ROOM, left_out, lost


@compiled
def _fd_length(code: int) -> int:
    return int(_FD_LENGTHS[code]) if code < len(_FD_LENGTHS) else 64


@compiled
def _object(data: NDArray[np.uint8], at: int, kind: int) -> tuple[int, int, int]:
    """Return flags, length and identifier of any object but the CAN FD 64 one. Reads within its `_head_size`."""
    if kind == CAN_ERROR_EXT:
        return _ERROR, min(int(data[at + 10]), 8), little_endian(data, at + 16, 4)
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
        return flag, count, identifier
    fd_bits = int(data[at + 13])
    if fd_bits & 1:
        flag |= _FD
    if fd_bits & 2:
        flag |= _SWITCH
    if fd_bits & 4:
        flag |= _STATE
    count = _fd_length(code) if flag & _REMOTE else min(int(data[at + 14]), 64)
    return flag, count, identifier


@compiled
def _fd_64(data: NDArray[np.uint8], at: int, header_size: int, size: int) -> tuple[int, int, int, int]:
    """Return flags, length, bytes of data that are there (at most 64), and identifier.

    Reads within the `_head_size`. The data of python-can's reading may reach into the next object.
    """
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
    return flag, count, min(there, count), little_endian(data, at + 4, 4)
