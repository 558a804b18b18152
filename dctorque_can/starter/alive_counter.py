"""The alive counter of a message: what steps by one from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.words import Word

_STEPS, _UNNAMED_STEPS = 0.9, 0.98  # of the steps between frames that must be one: a log may lack frames


@dataclass(frozen=True)
class Counter:
    """An alive counter.

    Attributes:
        signals: that with the lower bits first.
        modulus: it runs 0..modulus-1.
        values: of each payload, int64 ``[n]``.
        share: of the steps that are one.
    """

    signals: tuple[Entry, ...]
    modulus: int
    values: NDArray[np.int64]
    share: float


def find_counter(entries: Sequence[Entry], data: NDArray[np.uint8]) -> Counter | None:
    """Return the alive counter: called so first, and then the shortest one that steps by one."""
    single = [(e,) for e in entries if 2 <= e.layout.bits <= 16 and not e.layout.is_float]
    parts = [e for e in entries if Word.COUNTER in e.own and {Word.LOW_PART, Word.HIGH_PART} & e.own]
    low = [e for e in parts if Word.LOW_PART in e.own]
    high = [e for e in parts if Word.HIGH_PART in e.own]
    pairs = [(low[0], high[0])] if len(low) == len(high) == 1 else []
    found = [c for signals in (*pairs, *single) if (c := _stepping(signals, data)) is not None]
    found = [c for c in found if any(Word.COUNTER in e.own for e in c.signals) or c.share > _UNNAMED_STEPS]
    return min(
        found,
        key=lambda c: (
            not any(Word.COUNTER in e.own for e in c.signals),
            -len(c.signals),
            len(c.signals[0].signal.name),
        ),
        default=None,
    )


def _stepping(signals: tuple[Entry, ...], data: NDArray[np.uint8]) -> Counter | None:
    values = np.zeros(len(data), np.int64)
    shift = 0
    for each in signals:
        values |= each.layout.read_raw(data).astype(np.int64) << shift
        shift += each.layout.bits
    top = int(values.max(initial=0)) + 1
    if top < 3 or len(np.unique(values)) < 3:
        return None
    full = 1 << shift
    shares = {
        modulus: float(((np.diff(values) % modulus) == 1).mean())
        for modulus in dict.fromkeys((full, top))
        if modulus == full or len(data) > 2 * modulus
    }
    modulus = max(shares, key=lambda each: shares[each])
    return Counter(signals, modulus, values, shares[modulus]) if shares[modulus] >= _STEPS else None
