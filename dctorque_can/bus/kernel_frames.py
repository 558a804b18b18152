"""What ``recvmmsg`` of a SocketCAN socket writes into memory, as columns of frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

CAN_BYTES, CAN_FD_BYTES = 16, 72  # struct can_frame, struct canfd_frame
CONTROL_BYTES = 64  # a time stamp takes 32, the count of dropped frames 24

# struct mmsghdr and struct iovec in words of 64 bits
HEADER_WORDS, VECTOR_WORDS = 8, 2
VECTOR, VECTORS, CONTROL, CONTROL_LENGTH, MESSAGE_FLAGS, MESSAGE_LENGTH = 2, 3, 4, 5, 6, 7

SO_TIMESTAMPNS, SO_RXQ_OVFL = 35, 40
NO_FRAME, NO_TIME = -1, -2  # instead of the number of dropped frames

_LOW = 0xFFFF_FFFF
_CONTROL_HEADER, _SOL_SOCKET = 16, 1
_MSG_DONTROUTE = 4  # of a frame that was sent from this computer
_REMOTE_BIT, _ERROR_BIT, _MASK, _STANDARD_MASK = 0x4000_0000, 0x2000_0000, 0x1FFF_FFFF, 0x7FF
_BRS, _ESI = 1, 2
_EXTENDED = int(EXTENDED_ID)
_FD, _SWITCH, _STATE = int(FrameFlag.FD), int(FrameFlag.BITRATE_SWITCH), int(FrameFlag.ERROR_STATE)
_REMOTE, _ERROR, _TRANSMITTED = int(FrameFlag.REMOTE), int(FrameFlag.ERROR), int(FrameFlag.TRANSMITTED)


@compiled_without_allocation
def _whole_length(length: np.int64, most: int) -> Any:
    """Return the shortest length of CAN FD that is not below ``length``, and no more than ``most``."""
    if length > 48:
        length = np.int64(64)
    elif length > 32:
        length = np.int64(48)
    elif length > 24:
        length = np.int64(32)
    elif length > 8:
        length = (length + 3) // 4 * 4
    return min(length, most)


@compiled_without_allocation
def _read_control(control: NDArray[np.int64], i: int, size: int, dropped: int) -> tuple[int, int]:
    """Return the time of message ``i`` in µs, -1 without one, and the number of frames dropped before it.

    Bounds: nothing is read beyond ``size``, which is held to the width of ``control``.
    """
    t_us = -1
    at = 0
    size = min(size, 8 * control.shape[1])
    while at + _CONTROL_HEADER + 8 <= size:
        length, kind = control[i, at // 8], control[i, at // 8 + 1]
        if length < _CONTROL_HEADER:
            break
        first = at // 8 + 2
        if kind & _LOW == _SOL_SOCKET and kind >> 32 == SO_TIMESTAMPNS and at + 32 <= size:
            t_us = control[i, first] * 1_000_000 + (control[i, first + 1] + 500) // 1000
        elif kind & _LOW == _SOL_SOCKET and kind >> 32 == SO_RXQ_OVFL:
            dropped = control[i, first] & _LOW
        at += (length + 7) // 8 * 8
    return t_us, dropped


@compiled_without_allocation
def read_kernel_frames(
    n: int,
    dropped: int,
    headers: NDArray[np.int64],
    raw: NDArray[np.uint8],
    control: NDArray[np.int64],
    t_us: NDArray[np.int64],
    can_id: NDArray[np.uint32],
    length: NDArray[np.uint8],
    flags: NDArray[np.uint8],
    narrow: NDArray[np.uint8],
    wide: NDArray[np.uint8],
) -> int:
    """Write ``n`` messages as columns of `Frames`, and make the headers ready for the next call of ``recvmmsg``.

    The meaning is that of python-can's ``capture_message``, to which the tests hold it; only the time is an
    integer from the beginning.

    Args:
        n: messages.
        dropped: frames that the socket has dropped before them.
        headers: struct mmsghdr ``[m, HEADER_WORDS]``.
        raw: what they received ``[m, CAN_FD_BYTES]``.
        control: their control messages ``[m, CONTROL_BYTES / 8]``.
        t_us, can_id, length, flags: columns ``[m]``.
        narrow, wide: data ``[m, 8]`` and ``[m, 64]``.

    Returns:
        the frames that the socket has dropped up to the last message, `NO_FRAME` when a message is none, or
        `NO_TIME` when it has no time stamp.

    Bounds: the caller gives arrays of ``m`` rows, and an ``n`` that is not larger. Lengths are held to 8 or 64.
    """
    fault = 0
    for i in range(n):
        stamp_us, dropped = _read_control(control, i, headers[i, CONTROL_LENGTH], dropped)
        headers[i, CONTROL_LENGTH] = CONTROL_BYTES
        size = headers[i, MESSAGE_LENGTH] & _LOW
        if stamp_us < 0:
            fault = NO_TIME
        if size not in (CAN_BYTES, CAN_FD_BYTES):
            fault = NO_FRAME
        identifier = (
            np.int64(raw[i, 0]) | np.int64(raw[i, 1]) << 8 | np.int64(raw[i, 2]) << 16 | np.int64(raw[i, 3]) << 24
        )
        flag, count = 0, _whole_length(np.int64(raw[i, 4]), 8)
        if size == CAN_FD_BYTES:
            count = _whole_length(np.int64(raw[i, 4]), 64)
            flag |= _FD
            flag |= _SWITCH if raw[i, 5] & _BRS else 0
            flag |= _STATE if raw[i, 5] & _ESI else 0
        flag |= _ERROR if identifier & _ERROR_BIT else 0
        flag |= _TRANSMITTED if headers[i, MESSAGE_FLAGS] & _MSG_DONTROUTE else 0
        asked = count
        if identifier & _REMOTE_BIT:
            flag |= _REMOTE
            if size == CAN_BYTES and raw[i, 4] == 8 and 8 < raw[i, 7] <= 15:
                asked = np.int64(raw[i, 7])  # a DLC above 8 bytes
            count = 0
        if identifier & _EXTENDED:
            can_id[i] = identifier & _MASK | _EXTENDED
        else:
            can_id[i] = identifier & _STANDARD_MASK
        t_us[i], length[i], flags[i] = stamp_us, asked, flag
        for k in range(64):
            wide[i, k] = raw[i, 8 + k] if k < count else 0
        for k in range(8):
            narrow[i, k] = wide[i, k]
    return fault if fault < 0 else dropped
