"""Raw bits of signals out of payloads, compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation


@compiled_without_allocation
def read_bits(data: NDArray[np.uint8], i: int, field: Any) -> np.uint64:
    """Return the raw bits of a signal.

    Bounds: `layout_problem` holds every field to its message; of a frame that is shorter than its message, the
    caller has asked `lies_within` whether the field is there.
    """
    byte = field.lsb_byte
    bits = np.uint64(data[i, byte]) >> field.shift
    position = np.uint64(8) - field.shift
    for _ in range(field.n_bytes - 1):
        byte += field.step
        bits |= np.uint64(data[i, byte]) << position
        position += np.uint64(8)
    return bits & field.mask  # type: ignore[no-any-return]


@compiled_without_allocation
def read_parts(
    data: NDArray[np.uint8], i: int, low: int, high: int, low_bits: np.uint64, fields: NDArray[Any]
) -> np.uint64:
    """Return a number in two signals: ``low_bits`` of it in ``low``, those above in ``high``, -1 for none."""
    bits = read_bits(data, i, fields[low])
    if high >= 0:
        bits |= read_bits(data, i, fields[high]) << low_bits
    return bits


@compiled_without_allocation
def lies_within(field: Any, there: int) -> bool:
    """Return whether all bytes of a signal are among the first ``there`` ones."""
    first = field.lsb_byte
    return max(first, first + field.step * (field.n_bytes - 1)) < there  # type: ignore[no-any-return]
