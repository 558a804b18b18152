"""The words of a line of text, for the compiled parsers: times, names of channels, bytes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled

LONGEST_NAME = 16

# What a compiled parser stopped for.
END_OF_BLOCK, IRREGULAR, NEW_CHANNEL, NO_ROOM = 0, 1, 2, 3

HEX = np.full(256, 255, np.uint8)
HEX[np.frombuffer(b"0123456789", np.uint8)] = np.arange(10)
HEX[np.frombuffer(b"abcdef", np.uint8)] = np.arange(10, 16)
HEX[np.frombuffer(b"ABCDEF", np.uint8)] = np.arange(10, 16)
_POWERS = 10.0 ** np.arange(23)  # exact


@compiled
def lines_end(data: NDArray[np.uint8], position: int, count: int) -> int:
    """Return where ``count`` lines from ``position`` on end, at most the end of the data."""
    while position < len(data):
        if data[position] == 10:
            count -= 1
            if count == 0:
                return position + 1
        position += 1
    return position


@compiled
def parse_time(data: NDArray[np.uint8], position: int, end: int) -> tuple[int, int]:
    """Return µs of the decimal seconds at ``position``, and where they end; -1 unless in the plain form.

    Digits, a point, digits, together less than 2^53, so that the division gives exactly the float of the text:
    the same number that python-can gives, rounded to µs in the same way. Bounds: reads below ``end``; at most 17
    characters, so that the number does not overflow and 10^k stands in the table.
    """
    mantissa = 0
    first = position
    while position < end and 48 <= data[position] <= 57 and position - first < 17:
        mantissa = mantissa * 10 + (int(data[position]) - 48)
        position += 1
    if position == first or position >= end or data[position] != 46:
        return 0, -1
    position += 1
    point = position
    while position < end and 48 <= data[position] <= 57 and position - first < 18:
        mantissa = mantissa * 10 + (int(data[position]) - 48)
        position += 1
    if position == point or mantissa >= 9007199254740992:
        return 0, -1
    return int(np.rint(mantissa / _POWERS[position - point] * 1e6)), position


@compiled
def find_channel(data: NDArray[np.uint8], start: int, end: int, names: NDArray[np.uint8]) -> int:
    """Return which of ``names`` stands at ``start`` to ``end``, or -1. A longer name than these can be is none."""
    size = end - start
    for k in range(len(names)):
        same = size <= names.shape[1] and (size == names.shape[1] or names[k, size] == 0)
        i = 0
        while same and i < size:
            same = names[k, i] == data[start + i]
            i += 1
        if same:
            return k
    return -1


@compiled
def parse_hex_bytes(
    data: NDArray[np.uint8], position: int, end: int, gap: int, out: NDArray[np.uint8], most: int
) -> tuple[int, int]:
    """Read pairs of hexadecimal digits, ``gap`` spaces between them; return how many and where they end.

    Bounds: reads below ``end``, writes at most ``most`` bytes, and no more than ``out`` has room for.
    """
    count = 0
    most = min(most, len(out))
    while count < most and position + 1 < end:
        high, low = HEX[data[position]], HEX[data[position + 1]]
        if high == 255 or low == 255:
            break
        out[count] = 16 * high + low
        count += 1
        position += 2
        if count < most and gap == 1:
            if position < end and data[position] == 32:
                position += 1
            else:
                break
    return count, position
