"""Physical values to payloads of one DBC message, whole columns at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from cantools.database.can import Message, Signal
from numpy.typing import ArrayLike, NDArray

from dctorque_can.bus.layout import Coding, SignalLayout, layout_problem, selector_problem, selectors
from dctorque_can.bus.loop import SCRATCH, find_raw
from dctorque_can.bus.problems import InputError, nearest, protection_problems
from dctorque_can.bus.protection import CHECKSUM, checksum_rule, payload_crc
from dctorque_can.bus.tables import CONDITION, FIELD, RAW
from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.samples import Protection

_NOT_AVAILABLE_WORDS = {"not available", "signal not available", "sna", "n/a", "na"}
_LIMIT_TOLERANCE = 1e-6  # of one raw step: a limit written in decimals may miss its raw value by rounding

_NAN_BITS = {Coding.FLOAT32: 0x7FC0_0000, Coding.FLOAT64: 0x7FF8_0000_0000_0000}

VALUE, COUNTER, CRC = 0, 1, 2  # what a signal carries

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

MESSAGE = np.dtype([*CHECKSUM, ("modulus", "i8")], align=True)
"""How one message is counted and signed."""

FLOAT32, FLOAT64 = int(Coding.FLOAT32), int(Coding.FLOAT64)


class MessageEncoder:
    """Encoder of one message; counts and signs its payloads from call to call.

    A value beyond what the signal may hold is saturated to the nearest one that it may: the DBC's minimum and
    maximum, else the range of the raw value without those raw values that mean "not available". NaN becomes the
    raw value that the value table of the DBC calls "not available" (or "SNA"), and stays NaN in a float signal
    without one. A signal that is not given has its start value of the DBC, else raw 0. Multiplexed signals are
    written where their multiplexer selects them.

    Args:
        message: of a cantools database.
        protection: counter and CRC to fill in, None for neither. The counter starts at 0.

    Raises:
        InputError: the protection does not fit the message.
        DctorqueError: a signal of the message cannot be written.
    """

    def __init__(self, message: Message, protection: Protection | None = None) -> None:
        if protection is not None and (problems := list(protection_problems(message, protection))):
            raise InputError(problems)
        rule = protection or Protection(message.name)
        self._message = message
        self._counter = 0
        self._modulus = rule.counter_modulus
        self._own = {rule.crc_signal, rule.counter_signal} - {""}
        self._index = {signal.name: k for k, signal in enumerate(message.signals)}
        conditions: list[tuple[int, int, int]] = []
        raws = [(each, 0.0) for each in rule.data_ids]
        signals = []
        for signal in message.signals:
            first = len(conditions)
            for selector, ids in selectors(message, signal):
                conditions.append((self._index[selector.name], len(raws), len(ids)))
                raws += [(each, 0.0) for each in ids]
            role = CRC if signal.name == rule.crc_signal else VALUE
            role = COUNTER if signal.name == rule.counter_signal else role
            signals.append((*_coding(message, signal, role), first, len(conditions) - first))
        self._tables = (
            np.array(signals, SIGNAL),
            np.array(conditions, CONDITION),
            np.array(raws, RAW),
            np.array([(*checksum_rule(message, rule, 0), rule.counter_modulus)], MESSAGE),
            np.zeros(len(signals), np.uint64),
            np.zeros(1, SCRATCH),
        )

    def encode(self, columns: Mapping[str, ArrayLike]) -> NDArray[np.uint8]:
        """Return payloads uint8 ``[n, length]``.

        Args:
            columns: by signal name, physical values in the DBC's unit, float ``[n]`` or one for all rows.

        Raises:
            DctorqueError: a name is no signal of the message or is filled in by the protection, columns differ in
                length, or a value is NaN where the DBC has no "not available".
        """
        arrays = {name: np.asarray(column) for name, column in columns.items()}
        n = max((len(column) for column in arrays.values() if column.ndim), default=1)
        values = np.empty((n, len(self._index)))
        given = np.zeros(len(self._index), np.bool_)
        for name, column in arrays.items():
            if name not in self._index or name in self._own:
                raise DctorqueError(self._unknown(name))
            if column.ndim and column.shape != (n,):
                shapes = ", ".join(f"{each} {column.shape}" for each, column in arrays.items())
                raise DctorqueError(f"{self._message.name}: columns must be of one length: {shapes}")
            values[:, self._index[name]] = column
            given[self._index[name]] = True
        data = np.zeros((n, self._message.length), np.uint8)
        fault = encode_rows(values, given, self._counter, *self._tables, data)
        if fault >= 0:
            where = f"{self._message.name}.{self._message.signals[fault].name}"
            raise DctorqueError(f"{where}: a value is NaN, and the DBC has no raw value for not available")
        self._counter = (self._counter + n) % self._modulus
        return data

    def _unknown(self, name: str) -> str:
        if name in self._own:
            return f"{self._message.name}.{name} is filled in by the protection and cannot be given"
        suggestions = nearest(name, set(self._index) - self._own)
        hint = f"; did you mean {' or '.join(suggestions)}?" if suggestions else ""
        return f"{name} is not a signal of {self._message.name}{hint}"


def _coding(message: Message, signal: Signal, role: int) -> tuple[object, ...]:
    unwritable = layout_problem(signal, message.length) or selector_problem(message, signal)
    if unwritable:
        raise DctorqueError(f"{message.name}.{signal.name} {unwritable}")
    layout = SignalLayout.of(signal)
    missing = _not_available_raws(signal)
    not_available = layout.bits_of(missing[-1]) if missing else _NAN_BITS.get(layout.coding)
    start = 0 if signal.raw_initial is None or signal.is_float else int(signal.raw_initial)
    return (
        *(layout.lsb_byte, layout.step, layout.n_bytes, layout.shift, layout.mask),
        *(role, int(layout.coding), layout.scale, layout.offset),
        *_limits(signal, layout, missing),
        *(not_available is not None, not_available or 0),
        layout.bits_of(start) or 0,
    )


def _limits(signal: Signal, layout: SignalLayout, missing: tuple[int, ...]) -> tuple[float, float]:
    """Return the smallest and largest number, before scale and offset, that may be sent."""
    minimum = -math.inf if signal.minimum is None else float(signal.minimum)
    maximum = math.inf if signal.maximum is None else float(signal.maximum)
    low, high = sorted((bound - layout.offset) / layout.scale for bound in (minimum, maximum))
    if layout.is_float:
        largest = float(np.finfo(np.float32 if layout.bits == 32 else np.float64).max)
        return max(low, -largest), min(high, largest)
    first, last = layout.raw_range
    while last in missing and last > first:
        last -= 1
    while first in missing and last > first:
        first += 1
    wanted_first = max(first, math.ceil(low - _LIMIT_TOLERANCE)) if math.isfinite(low) else first
    wanted_last = min(last, math.floor(high + _LIMIT_TOLERANCE)) if math.isfinite(high) else last
    if wanted_first > wanted_last:  # limits that exclude every raw value say nothing
        wanted_first, wanted_last = first, last
    return _float_at_least(wanted_first), _float_at_most(wanted_last)


def _float_at_most(number: int) -> float:
    nearby = float(number)  # may round up beyond 2**53
    return nearby if int(nearby) <= number else math.nextafter(nearby, -math.inf)


def _float_at_least(number: int) -> float:
    nearby = float(number)
    return nearby if int(nearby) >= number else math.nextafter(nearby, math.inf)


def _not_available_raws(signal: Signal) -> tuple[int, ...]:
    words = {int(raw): str(word).casefold().replace("_", " ") for raw, word in (signal.choices or {}).items()}
    return tuple(sorted(raw for raw, word in words.items() if word in _NOT_AVAILABLE_WORDS))


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
    given: NDArray[np.bool_],
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
        values: physical values ``[n, signals]``.
        given: ``[signals]``, false where the start value is sent.
        counter: alive counter of the first payload.
        signals: `SIGNAL`.
        conditions: `CONDITION`; its ``field`` is the index of the multiplexer in ``signals``.
        raws: `RAW`.
        message: `MESSAGE` of one row.
        row_bits: room for the bits of one payload's signals.
        scratch: room of one row.
        data: uint8 ``[n, length]``.

    Bounds: `MessageEncoder` makes every argument; signals have the columns of ``values`` and the rows of
    ``row_bits``, conditions point into ``signals`` and ``raws``.
    """
    rule = message[0]
    for i in range(len(values)):
        count = (counter + i) % rule.modulus
        for k in range(len(signals)):
            signal = signals[k]
            if signal.role == COUNTER:
                row_bits[k] = np.uint64(count)
            elif signal.role == CRC:
                row_bits[k] = np.uint64(0)
            elif not given[k]:
                row_bits[k] = signal.start
            elif not np.isnan(values[i, k]):
                row_bits[k] = _bits_of(values[i, k], signal, scratch[0])
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
        if rule.crc_table >= 0:
            data[i, rule.crc_byte] = payload_crc(data, i, rule, count, raws)
    return -1
