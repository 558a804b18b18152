"""The compiled loop from physical values to payloads."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.layout import Coding
from dctorque_can.bus.loop import SCRATCH, find_raw
from dctorque_can.bus.protection import CHECKSUM, payload_checksum, write_constants
from dctorque_can.bus.tables import CONDITION, FIELD, RAW
from dctorque_can.compiled import compiled, compiled_without_allocation

VALUE, COUNTER, COUNTER_HIGH, CRC = range(4)  # what a signal carries

SIGNAL = np.dtype(
    [
        *((name, FIELD[name]) for name in FIELD.names or ()),
        ("role", "i8"),
        ("coding", "i8"),
        ("scale", "f8"),
        ("offset", "f8"),
        ("low", "f8"),  # limits of the number before scale and offset
        ("high", "f8"),
        ("has_not_available", "b1"),
        ("not_available", "u8"),  # bits sent for NaN
        ("start", "u8"),  # bits sent when no value is given
        ("first_condition", "i8"),
        ("n_conditions", "i8"),
    ],
    align=True,
)
"""How one signal is written."""

MESSAGE = np.dtype(
    [
        *CHECKSUM,
        ("modulus", "i8"),
        ("counter_low_bits", "u8"),  # of a counter in two parts, bits of the lower one
        ("crc_signal", "i8"),  # row of the signals, -1: none
        ("crc_high_signal", "i8"),
    ],
    align=True,
)
"""How one message is counted and signed."""

FLOAT32, FLOAT64 = int(Coding.FLOAT32), int(Coding.FLOAT64)


@compiled_without_allocation
def _bits_of(value: float, signal: Any, scratch: Any) -> np.uint64:
    """Return the saturated bits of a physical value that is not NaN."""
    number = (value - signal.offset) / signal.scale
    if signal.coding == FLOAT32 or signal.coding == FLOAT64:
        number = min(max(number, signal.low), signal.high)
        scratch.bits = np.uint64(0)
        if signal.coding == FLOAT32:
            scratch.as_f32 = np.float32(number)
        else:
            scratch.as_f64 = number
        return scratch.bits  # type: ignore[no-any-return]
    number = min(max(np.rint(number), signal.low), signal.high)
    if number < 0.0:
        return np.uint64(np.int64(number)) & signal.mask  # type: ignore[no-any-return]
    return np.uint64(number)


@compiled_without_allocation
def _write_bits(data: NDArray[np.uint8], i: int, signal: Any, bits: np.uint64) -> None:
    """Set the bits of a signal, which `layout_problem` holds to its message, the width of ``data``."""
    byte = signal.lsb_byte
    data[i, byte] |= np.uint8((bits << signal.shift) & np.uint64(0xFF))
    position = np.uint64(8) - signal.shift
    for _ in range(signal.n_bytes - 1):
        byte += signal.step
        data[i, byte] |= np.uint8((bits >> position) & np.uint64(0xFF))
        position += np.uint64(8)


@compiled_without_allocation
def encode_rows(
    values: NDArray[np.float64],
    columns: NDArray[np.int64],
    counter: int,
    signals: NDArray[Any],
    conditions: NDArray[Any],
    raws: NDArray[Any],
    message: NDArray[Any],
    row_bits: NDArray[np.uint64],
    scratch: NDArray[Any],
    data: NDArray[np.uint8],
) -> int:
    """Write payloads into ``data``, which is zero; return -1, or the index of a signal that has no code for NaN.

    Args:
        values: physical values ``[n, m]``.
        columns: ``[signals]``, column of ``values``, -1 where the start value is sent.
        counter: alive counter of the first payload.
        signals: `SIGNAL`.
        conditions: `CONDITION`; its ``field`` is the index of the multiplexer in ``signals``.
        raws: `RAW`.
        message: `MESSAGE` of one row.
        row_bits: room for the bits of one payload's signals.
        scratch: room of one row.
        data: uint8 ``[n, length]``.

    Bounds: `MessageEncoder` makes every argument; ``columns`` and ``row_bits`` have a row for each signal, columns
    are those of ``values``, conditions point into ``signals`` and ``raws``.
    """
    rule = message[0]
    for i in range(len(values)):
        count = (counter + i) % rule.modulus
        for k in range(len(signals)):
            signal = signals[k]
            if signal.role == COUNTER:
                row_bits[k] = np.uint64(count) & signal.mask
            elif signal.role == COUNTER_HIGH:
                row_bits[k] = np.uint64(count) >> rule.counter_low_bits
            elif signal.role == CRC:
                row_bits[k] = np.uint64(0)
            elif columns[k] < 0:
                row_bits[k] = signal.start
            elif not np.isnan(values[i, columns[k]]):
                row_bits[k] = _bits_of(values[i, columns[k]], signal, scratch[0])
            elif signal.has_not_available:
                row_bits[k] = signal.not_available
            else:
                return k
        for k in range(len(signals)):
            signal = signals[k]
            selected = True
            for c in range(signal.first_condition, signal.first_condition + signal.n_conditions):
                condition = conditions[c]
                bits = row_bits[condition.field]
                selected &= find_raw(raws, condition.first_raw, condition.n_raws, bits) >= 0
            if selected:
                _write_bits(data, i, signal, row_bits[k])
        if rule.crc_bits > 0:
            write_constants(data, i, rule, raws)
            checksum = payload_checksum(data, i, rule, count, raws)
            _write_bits(data, i, signals[rule.crc_signal], checksum & signals[rule.crc_signal].mask)
            if rule.crc_high_signal >= 0:
                _write_bits(data, i, signals[rule.crc_high_signal], checksum >> rule.crc_low_bits)
    return -1


@compiled
def encode_batch(
    values: NDArray[np.float64],
    columns: NDArray[np.int64],
    counter: int,
    memory: NDArray[np.int64],
    data: NDArray[np.uint8],
) -> int:
    """Write payloads as `encode_rows` does, with the tables that `packed` put into ``memory``."""
    return encode_rows(
        values,
        columns,
        counter,
        memory[memory[0] : memory[1]].view(SIGNAL),
        memory[memory[1] : memory[2]].view(CONDITION),
        memory[memory[2] : memory[3]].view(RAW),
        memory[memory[3] : memory[4]].view(MESSAGE),
        memory[memory[4] : memory[5]].view(np.uint64),
        memory[memory[5] : memory[6]].view(SCRATCH),
        data,
    )
