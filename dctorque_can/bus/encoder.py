"""Physical values to payloads of one DBC message, whole columns at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from cantools.database.can import Message, Signal
from numpy.typing import ArrayLike, NDArray

from dctorque_can.bus.layout import Coding, SignalLayout, layout_problem, selector_problem, selectors
from dctorque_can.bus.problems import InputError, nearest, protection_problems
from dctorque_can.bus.protection import Checksum
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.samples import Protection

_NOT_AVAILABLE_WORDS = {"not available", "signal not available", "sna", "n/a", "na"}
_LIMIT_TOLERANCE = 1e-6  # of one raw step: a limit written in decimals may miss its raw value by rounding


class MessageEncoder:
    """Encoder of one message; counts and signs its payloads from call to call.

    A value beyond what the signal may hold is saturated to the nearest one that it may: the DBC's minimum and
    maximum, else the range of the raw value without those raw values that mean "not available". NaN becomes the
    raw value that the value table of the DBC calls "not available" (or "SNA"). A signal that is not given has its
    start value of the DBC, else raw 0. Multiplexed signals are written where their multiplexer selects them.

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
        self._message = message
        self._signals = [_SignalEncoder(message, signal) for signal in message.signals]
        self._checksum = Checksum.of(message, protection) if protection else None
        self._crc_signal = protection.crc_signal if protection else ""
        self._counter_signal = protection.counter_signal if protection else ""
        self._modulus = protection.counter_modulus if protection else 1
        self._counter = 0
        own = {self._crc_signal, self._counter_signal}
        self._names = {signal.name for signal in self._signals} - own

    def encode(self, columns: Mapping[str, ArrayLike]) -> NDArray[np.uint8]:
        """Return payloads uint8 ``[n, length]``.

        Args:
            columns: by signal name, physical values in the DBC's unit, float ``[n]`` or one for all rows.

        Raises:
            DctorqueError: a name is no signal of the message or is filled in by the protection, columns differ in
                length, or a value is NaN where the DBC has no "not available".
        """
        for name in columns:
            if name not in self._names:
                raise DctorqueError(self._unknown(name))
        values = {name: np.atleast_1d(np.asarray(given, np.float64)) for name, given in columns.items()}
        try:
            (n,) = np.broadcast_shapes(*(column.shape for column in values.values()), (1,))
        except ValueError as error:
            shapes = ", ".join(f"{name} {column.shape}" for name, column in values.items())
            raise DctorqueError(f"{self._message.name}: columns must be of one length: {shapes}") from error
        counters = (self._counter + np.arange(n)) % self._modulus
        raws: dict[str, NDArray[np.uint64]] = {}
        for signal in self._signals:
            if signal.name == self._counter_signal:
                raws[signal.name] = counters.astype(np.uint64)
            elif signal.name == self._crc_signal:
                raws[signal.name] = np.zeros(n, np.uint64)
            elif signal.name in values:
                raws[signal.name] = np.broadcast_to(signal.raw(values[signal.name]), n)
            else:
                raws[signal.name] = np.full(n, signal.start_raw, np.uint64)
        data = np.zeros((n, self._message.length), np.uint8)
        for signal in self._signals:
            signal.layout.write_raw(data, np.where(signal.selected(raws), raws[signal.name], np.uint64(0)))
        if self._checksum is not None:
            data[:, self._checksum.crc_byte] = self._checksum.column(data, counters)
        self._counter = (self._counter + n) % self._modulus
        return data

    def _unknown(self, name: str) -> str:
        if name in (self._crc_signal, self._counter_signal):
            return f"{self._message.name}.{name} is filled in by the protection and cannot be given"
        suggestions = nearest(name, self._names)
        hint = f"; did you mean {' or '.join(suggestions)}?" if suggestions else ""
        return f"{name} is not a signal of {self._message.name}{hint}"


class _SignalEncoder:
    def __init__(self, message: Message, signal: Signal) -> None:
        unwritable = layout_problem(signal, message.length) or selector_problem(message, signal)
        if unwritable:
            raise DctorqueError(f"{message.name}.{signal.name} {unwritable}")
        self.name = signal.name
        self.layout = SignalLayout.of(signal)
        self._where = f"{message.name}.{signal.name}"
        self._not_available = _not_available_raws(signal)
        self._low, self._high = self._limits(signal)
        self._selectors = [
            (selector.name, np.array(ids, np.uint64)) for selector, ids in selectors(message, signal)
        ]
        start = int(signal.raw_initial) if signal.raw_initial is not None and not signal.is_float else 0
        self.start_raw = self.layout.bits_of(start) or 0

    def raw(self, value: NDArray[np.float64]) -> NDArray[np.uint64]:
        """Return the bit patterns of physical values, saturated."""
        missing = np.isnan(value)
        if missing.any() and not self._not_available and not self.layout.is_float:
            raise DctorqueError(f"{self._where}: a value is NaN, and the DBC has no raw value for not available")
        with np.errstate(over="ignore"):
            number = (value - self.layout.offset) / self.layout.scale
        if self.layout.is_float:
            raw = self._float_raw(np.clip(number, self._low, self._high))
        else:
            clipped = np.clip(np.rint(np.where(missing, 0.0, number)), self._low, self._high)
            raw = clipped.astype(np.int64).view(np.uint64) if self._low < 0 else clipped.astype(np.uint64)
            raw &= np.uint64(self.layout.mask)
        if self._not_available:
            raw[missing] = self.layout.bits_of(self._not_available[-1]) or 0
        return raw

    def _float_raw(self, number: NDArray[np.float64]) -> NDArray[np.uint64]:
        if self.layout.coding is Coding.FLOAT32:
            return number.astype(np.float32).view(np.uint32).astype(np.uint64)
        return number.copy().view(np.uint64)

    def selected(self, raws: Mapping[str, NDArray[np.uint64]]) -> NDArray[np.bool_]:
        """Return in which rows every multiplexer on the way to this signal selects it."""
        chosen = np.ones(len(raws[self.name]), np.bool_)
        for selector, ids in self._selectors:
            chosen &= np.isin(raws[selector], ids)
        return chosen

    def _limits(self, signal: Signal) -> tuple[float, float]:
        """Return the smallest and largest number, before scale and offset, that may be sent."""
        bounds = sorted(
            (float(bound) - self.layout.offset) / self.layout.scale
            for bound in (
                -math.inf if signal.minimum is None else signal.minimum,
                math.inf if signal.maximum is None else signal.maximum,
            )
        )
        if self.layout.is_float:
            largest = float(np.finfo(np.float32 if self.layout.bits == 32 else np.float64).max)
            return max(bounds[0], -largest), min(bounds[1], largest)
        low, high = self.layout.raw_range
        while high in self._not_available and high > low:
            high -= 1
        while low in self._not_available and high > low:
            low += 1
        wanted_low = max(low, math.ceil(bounds[0] - _LIMIT_TOLERANCE) if math.isfinite(bounds[0]) else low)
        wanted_high = min(high, math.floor(bounds[1] + _LIMIT_TOLERANCE) if math.isfinite(bounds[1]) else high)
        if wanted_low > wanted_high:  # limits that exclude every raw value say nothing
            wanted_low, wanted_high = low, high
        return _float_at_least(wanted_low), _float_at_most(wanted_high)


def _float_at_most(number: int) -> float:
    nearby = float(number)  # may round up beyond 2**53
    return nearby if int(nearby) <= number else math.nextafter(nearby, -math.inf)


def _float_at_least(number: int) -> float:
    nearby = float(number)
    return nearby if int(nearby) >= number else math.nextafter(nearby, math.inf)


def _not_available_raws(signal: Signal) -> tuple[int, ...]:
    words = {int(raw): str(word).casefold().replace("_", " ") for raw, word in (signal.choices or {}).items()}
    return tuple(sorted(raw for raw, word in words.items() if word in _NOT_AVAILABLE_WORDS))
