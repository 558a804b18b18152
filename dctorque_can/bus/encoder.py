"""Physical values to payloads of one DBC message, whole columns at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from cantools.database.can import Message, Signal
from numpy.typing import ArrayLike, NDArray

from dctorque_can.bus.encoder_loop import (
    COUNTER,
    COUNTER_HIGH,
    CRC,
    MESSAGE,
    SIGNAL,
    VALUE,
    encode_batch,
)
from dctorque_can.bus.layout import Coding, SignalLayout, layout_problem, selector_problem, selectors
from dctorque_can.bus.loop import SCRATCH
from dctorque_can.bus.packing import packed
from dctorque_can.bus.problems import InputError, nearest, protection_problems
from dctorque_can.bus.protection import bits_of, checksum_rule, filled_in
from dctorque_can.bus.tables import CONDITION, RAW
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.samples import Protection

_NOT_AVAILABLE_WORDS = {"not available", "signal not available", "sna", "n/a", "na"}
_LIMIT_TOLERANCE = 1e-6  # of one raw step: a limit written in decimals may miss its raw value by rounding

_NAN_BITS = {Coding.FLOAT32: 0x7FC0_0000, Coding.FLOAT64: 0x7FF8_0000_0000_0000}


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
        roles = {rule.counter_signal: COUNTER, rule.counter_high_signal: COUNTER_HIGH}
        roles |= dict.fromkeys(rule.crc_signals, CRC)
        self._index = {signal.name: k for k, signal in enumerate(message.signals)}
        conditions: list[tuple[int, int, int]] = []
        values, raws = checksum_rule(message, rule, 0)
        signals = []
        for signal in message.signals:
            first = len(conditions)
            for selector, ids in selectors(message, signal):
                conditions.append((self._index[selector.name], len(raws), len(ids)))
                raws += [(each, 0.0) for each in ids]
            role = roles.get(signal.name, VALUE)
            signals.append((*_coding(message, signal, role), first, len(conditions) - first))
        self._own = filled_in(message, rule)
        low_bits = bits_of(message, rule.counter_signal)
        crc_places = [self._index.get(name, -1) for name in (rule.crc_signal, rule.crc_high_signal)]
        self._memory = packed(
            np.array(signals, SIGNAL),
            np.array(conditions, CONDITION),
            np.array(raws, RAW),
            np.array([(*values, rule.counter_modulus, low_bits, *crc_places)], MESSAGE),
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
        places = self.places(list(arrays))
        n = max((len(column) for column in arrays.values() if column.ndim), default=1)
        values = np.empty((n, len(arrays)))
        for k, column in enumerate(arrays.values()):
            if column.ndim and column.shape != (n,):
                shapes = ", ".join(f"{each} {column.shape}" for each, column in arrays.items())
                raise DctorqueError(f"{self._message.name}: columns must be of one length: {shapes}")
            values[:, k] = column
        return self.encode_values(values, places)

    def places(self, names: Sequence[str]) -> NDArray[np.int64]:
        """Return, for each signal of the message, its index in ``names`` or -1, as `encode_values` takes it.

        Raises:
            DctorqueError: a name is no signal of the message or is filled in by the protection.
        """
        result = np.full(len(self._index), -1, np.int64)
        for k, name in enumerate(names):
            if name not in self._index or name in self._own:
                raise DctorqueError(self._unknown(name))
            result[self._index[name]] = k
        return result

    def encode_values(self, values: NDArray[np.float64], places: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Return payloads as `encode` does, for those who encode many times a second.

        Args:
            values: physical values ``[n, m]``.
            places: the signals that its columns are, out of `places`.

        Raises:
            DctorqueError: a value is NaN where the DBC has no "not available".
        """
        n = len(values)
        data = np.zeros((n, self._message.length), np.uint8)
        fault = encode_batch(values, places, self._counter, self._memory, data)
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
