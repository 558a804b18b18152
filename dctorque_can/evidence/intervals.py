"""How often the messages of a recording come."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.origins import NO_DATA
from dctorque_can.pipeline.frames import Address, Frames

_LONGEST_MS = 10_000
_STEP_MS = 0.1


@dataclass(frozen=True, slots=True)
class Interval:
    """Times between frames of one message, of which there are two at least.

    Attributes:
        frames: number of them.
        median_ms: half of the times are less.
        longest_usual_ms: 99 of 100 are less.
    """

    frames: int
    median_ms: float
    longest_usual_ms: float


class Intervals:
    """Measures the times between frames of some messages, to a tenth of a millisecond and up to 10 s.

    Args:
        addresses: by what the messages are known.
    """

    def __init__(self, addresses: Iterable[Address]) -> None:
        bins = int(_LONGEST_MS / _STEP_MS) + 1
        self._counts: dict[Address, NDArray[np.int64]] = {each: np.zeros(bins, np.int64) for each in addresses}
        self._last_us: dict[Address, int] = {}

    def take(self, frames: Frames) -> None:
        """Count a batch; a step of the clock back counts for nothing."""
        for address, counts in self._counts.items():
            t_us = frames.t_us[address.rows(frames) & (frames.flags & NO_DATA == 0)]
            if not len(t_us):
                continue
            before = self._last_us.get(address)
            steps = np.diff(t_us) if before is None else np.diff(t_us, prepend=before)
            self._last_us[address] = int(t_us[-1])
            steps_ms = np.minimum(steps[steps >= 0] / 1000, _LONGEST_MS)
            counts += np.bincount(np.round(steps_ms / _STEP_MS).astype(np.int64), minlength=len(counts))

    def of(self, address: Address) -> Interval | None:
        """Return what was measured of a message; None of one that did not come twice."""
        total = np.cumsum(self._counts[address])
        if not total[-1]:
            return None
        median, usual = (
            float(_STEP_MS * np.searchsorted(total, share * total[-1], side="left")) for share in (0.5, 0.99)
        )
        return Interval(int(total[-1]) + 1, round(median, 1), round(usual, 1))
