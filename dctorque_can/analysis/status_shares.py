"""For which share of all estimates, and of the time, each torque was valid and something was wrong."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.errors import VALID
from dctorque_can.pipeline.estimates import Status

FAULTS = (
    *(Status.INPUT_STALE, Status.SPEED_IMPLAUSIBLE, Status.LIMITED),
    *(Status.ENGINE_SPEED_FAULT, Status.SHAFT1_SPEED_FAULT, Status.SHAFT2_SPEED_FAULT),
    *(Status.DRIVEN_WHEELS_FAULT, Status.UNDRIVEN_WHEELS_FAULT, Status.ENGINE_TORQUE_FAULT),
    Status.VEHICLE_FILE_IMPLAUSIBLE,
)
"""Bits of the status that say that something is wrong."""
BOTH_CLUTCHES = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID
LONGEST_US = 100_000
"""For so long an estimate stands at most."""
_FEW = 64  # estimates, as they come live: to sort them takes longer than to count them


class StatusShares:
    """Counts how often each status was given, and how long it stood: until the next estimate came.

    Estimates come in bursts, one a frame, so shares of them are no shares of time. What stood for longer than
    `LONGEST_US` counts for that: nobody knows what the car did in a gap.
    """

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()
        self._stood_us: Counter[int] = Counter()
        self._last: tuple[int, int] | None = None  # time and status of the last estimate

    def count(self, t_us: NDArray[np.int64], status: NDArray[np.uint32]) -> None:
        """Count times and statuses ``[n]`` of the next estimates."""
        if len(status) <= _FEW:
            for now_us, value in zip(t_us.tolist(), status.tolist(), strict=True):
                self._counts[value] += 1
                if self._last is not None:
                    self._stood_us[self._last[1]] += min(max(now_us - self._last[0], 0), LONGEST_US)
                self._last = now_us, value
            return
        first_us, first = self._last or (int(t_us[0]), int(status[0]))
        stood_us = np.clip(np.diff(t_us, prepend=first_us), 0, LONGEST_US)
        before = np.concatenate([np.array([first], status.dtype), status[:-1]])
        self._counts.update(_sums(status, np.ones(len(status), np.int64)))
        self._stood_us.update(_sums(before, stood_us))
        self._last = int(t_us[-1]), int(status[-1])

    @property
    def estimates(self) -> int:
        """How many were counted."""
        return self._counts.total()

    def having(self, bits: int) -> int:
        """Return how many estimates have all of the bits."""
        bits = int(bits)  # a flag would make a flag of each value
        return sum(n for value, n in self._counts.items() if value & bits == bits)

    def share(self, bit: Status) -> float:
        """Return the share of estimates with a bit, 0…1; 0 without any estimate."""
        return self.having(bit) / self.estimates if self._counts else 0.0

    def time_share(self, bit: Status) -> float:
        """Return the share of the time with a bit, 0…1; 0 without two estimates."""
        total_us, bits = self._stood_us.total(), int(bit)
        return sum(us for value, us in self._stood_us.items() if value & bits) / total_us if total_us else 0.0

    def as_json(self) -> dict[str, float]:
        """Return all shares of the estimates by `key_of` their bits."""
        return {key_of(bit): round(self.share(bit), 6) for bit in (*VALID.values(), *FAULTS)}

    def time_as_json(self) -> dict[str, float]:
        """Return all shares of the time by `key_of` their bits."""
        return {key_of(bit): round(self.time_share(bit), 6) for bit in (*VALID.values(), *FAULTS)}


def _sums(values: NDArray[np.uint32], weights: NDArray[np.int64]) -> dict[int, int]:
    """Return the sum of the weights of each value."""
    found, places = np.unique(values, return_inverse=True)
    sums = np.zeros(len(found), np.int64)
    np.add.at(sums, places, weights)
    return dict(zip(found.tolist(), sums.tolist(), strict=True))


def key_of(bit: Status) -> str:
    """Return the name of a bit in JSON."""
    return str(bit.name).lower()
