"""Where the bits of a DBC signal lie and what number they code: the one reading of the DBC's conventions."""

from __future__ import annotations

import math
import struct
from collections.abc import Collection
from dataclasses import dataclass
from enum import IntEnum
from typing import Self

import numpy as np
from cantools.database.can import Message, Signal
from numpy.typing import NDArray

from dctorque_can.pipeline.samples import Protection

MAX_BITS = 64
MAX_BYTES = 64  # of a CAN FD payload


class Coding(IntEnum):
    """How raw bits become a number, before scale and offset."""

    UNSIGNED = 0
    SIGNED = 1  # two's complement
    FLOAT32 = 2  # IEEE 754
    FLOAT64 = 3


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """Position and coding of one signal of at most 64 bits.

    The signal's bytes are visited from the least significant one at ``lsb_byte`` in direction ``step``: +1 for
    little endian (Intel), -1 for big endian (Motorola). The lowest bit is bit ``shift`` of the first byte.

    Attributes:
        lsb_byte: index of the byte with the least significant bit.
        shift: position of that bit in its byte, 0..7.
        step: +1 or -1.
        n_bytes: how many bytes the signal touches, 1..9.
        bits: length in bits, 1..64.
        coding: integer or float.
        scale: physical value = number * scale + offset.
        offset: in the signal's DBC unit.
    """

    lsb_byte: int
    shift: int
    step: int
    n_bytes: int
    bits: int
    coding: Coding
    scale: float
    offset: float

    @classmethod
    def of(cls, signal: Signal) -> Self:
        """Return the layout of a signal that has no `layout_problem`."""
        start, bits = int(signal.start), int(signal.length)
        if signal.byte_order == "big_endian":
            lsb = 8 * (start // 8) + 7 - start % 8 + bits - 1  # counted from the top bit of byte 0
            lsb_byte, shift, step = lsb // 8, 7 - lsb % 8, -1
        else:
            lsb_byte, shift, step = start // 8, start % 8, 1
        if signal.is_float:
            coding = Coding.FLOAT32 if bits == 32 else Coding.FLOAT64
        else:
            coding = Coding.SIGNED if signal.is_signed else Coding.UNSIGNED
        scale, offset = float(signal.scale), float(signal.offset)
        return cls(lsb_byte, shift, step, (shift + bits + 7) // 8, bits, coding, scale, offset)

    @property
    def is_float(self) -> bool:
        """Whether the bits are an IEEE 754 number."""
        return self.coding in (Coding.FLOAT32, Coding.FLOAT64)

    @property
    def mask(self) -> int:
        """The bits of a raw value."""
        return (1 << self.bits) - 1

    @property
    def byte_indices(self) -> range:
        """The bytes touched, least significant first."""
        return range(self.lsb_byte, self.lsb_byte + self.step * self.n_bytes, self.step)

    @property
    def raw_range(self) -> tuple[int, int]:
        """Smallest and largest integer the bits can code."""
        if self.coding is Coding.SIGNED:
            return -(1 << (self.bits - 1)), (1 << (self.bits - 1)) - 1
        return 0, self.mask

    def bits_of(self, raw: int) -> int | None:
        """Return the bit pattern of a raw value, None when the signal cannot hold it.

        A signed signal's value may be given as a negative number or as its bit pattern.
        """
        if self.coding is Coding.FLOAT32:
            return int.from_bytes(struct.pack("<f", raw), "little") if abs(raw) < 2**127 else None
        if self.coding is Coding.FLOAT64:
            return int.from_bytes(struct.pack("<d", raw), "little") if abs(raw) < 2**1023 else None
        return raw & self.mask if self.raw_range[0] <= raw <= self.mask else None

    def read_raw(self, data: NDArray[np.uint8]) -> NDArray[np.uint64]:
        """Return the bit patterns, uint64 ``[n]``, of payloads uint8 ``[n, width]``."""
        raw = np.zeros(len(data), np.uint64)
        for k, byte in enumerate(self.byte_indices):
            part = data[:, byte].astype(np.uint64)
            raw |= part >> np.uint64(self.shift) if k == 0 else part << np.uint64(8 * k - self.shift)
        return raw & np.uint64(self.mask)

    def read(self, data: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return the physical values, float64 ``[n]``, of payloads uint8 ``[n, width]``."""
        raw = self.read_raw(data)
        if self.coding is Coding.FLOAT32:
            with np.errstate(invalid="ignore"):  # a signalling NaN becomes a quiet one
                number = raw.astype(np.uint32).view(np.float32).astype(np.float64)
        elif self.coding is Coding.FLOAT64:
            number = raw.view(np.float64)
        elif self.coding is Coding.SIGNED:
            unused = 64 - self.bits
            number = ((raw << np.uint64(unused)).view(np.int64) >> np.int64(unused)).astype(np.float64)
        else:
            number = raw.astype(np.float64)
        with np.errstate(over="ignore", invalid="ignore"):  # a float signal may hold anything
            return number * self.scale + self.offset

    def write_raw(self, data: NDArray[np.uint8], raw: NDArray[np.uint64]) -> None:
        """Set the signal's bits, which must be zero, in payloads uint8 ``[n, width]``."""
        for k, byte in enumerate(self.byte_indices):
            part = raw << np.uint64(self.shift) if k == 0 else raw >> np.uint64(8 * k - self.shift)
            data[:, byte] |= (part & np.uint64(0xFF)).astype(np.uint8)


def layout_problem(signal: Signal, message_length: int) -> str:
    """Return why a signal cannot be read, or "" when it can."""
    if not 1 <= signal.length <= MAX_BITS:
        return f"has {signal.length} bits; at most {MAX_BITS} can be read"
    if signal.is_float and signal.length not in (32, 64):
        return f"is a float of {signal.length} bits; floats of 32 and 64 bits can be read"
    layout = SignalLayout.of(signal)
    if min(layout.byte_indices) < 0 or max(layout.byte_indices) >= min(message_length, MAX_BYTES):
        return f"does not fit in the {message_length} bytes of its message"
    if not (math.isfinite(layout.scale) and math.isfinite(layout.offset)) or layout.scale == 0.0:
        return f"has the scale {signal.scale} and offset {signal.offset}; they must be finite and the scale not 0"
    return ""


def selectors(message: Message, signal: Signal) -> list[tuple[Signal, tuple[int, ...]]]:
    """Return the multiplexers on the way to a signal, innermost first, each with the ids that select it.

    The chain ends early at a multiplexer that is missing or selects itself; `selector_problem` tells.
    """
    chain: list[tuple[Signal, tuple[int, ...]]] = []
    seen = {signal.name}
    while signal.multiplexer_ids:
        ids = tuple(signal.multiplexer_ids)
        found = next((each for each in message.signals if each.name == signal.multiplexer_signal), None)
        if found is None or found.name in seen:
            break
        seen.add(found.name)
        chain.append((found, ids))
        signal = found
    return chain


def selector_problem(message: Message, signal: Signal) -> str:
    """Return why the multiplexers of a signal cannot be followed, or "" when they can."""
    chain = selectors(message, signal)
    innermost = chain[-1][0] if chain else signal
    if innermost.multiplexer_ids:
        return f"is multiplexed by {innermost.multiplexer_signal!r}, which does not select it; correct the DBC"
    for selector, _ in chain:
        unreadable = layout_problem(selector, message.length)
        if unreadable or selector.is_float:
            return f"is multiplexed by {selector.name}, which {unreadable or 'is a float'}"
    return ""


def bytes_needed(message: Message, signals: Collection[str], protection: Protection | None) -> int:
    """Return how many first bytes of a message hold some signals, their multiplexers and the protection."""
    if protection is not None and protection.crc != "none":
        return int(message.length)  # a CRC covers all of them
    counter = protection.counter_signals if protection is not None else ()
    wanted = [signal for signal in message.signals if signal.name in signals or signal.name in counter]
    chains = [selector for signal in wanted for selector, _ in selectors(message, signal)]
    return max((max(SignalLayout.of(each).byte_indices) + 1 for each in (*wanted, *chains)), default=0)
