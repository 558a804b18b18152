"""For which share of all estimates each torque was valid, and something was wrong: counted as they come."""

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
_FEW = 64  # estimates, as they come live: to sort them takes longer than to count them


class StatusShares:
    """Counts how often each status was given. Every estimate counts the same, however long it stood."""

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()

    def count(self, status: NDArray[np.uint32]) -> None:
        """Count the status ``[n]`` of some estimates."""
        if len(status) <= _FEW:
            self._counts.update(status.tolist())
            return
        values, counts = np.unique(status, return_counts=True)
        self._counts.update(dict(zip(values.tolist(), counts.tolist(), strict=True)))

    @property
    def estimates(self) -> int:
        """How many were counted."""
        return self._counts.total()

    def having(self, bits: int) -> int:
        """Return how many estimates have all of the bits."""
        return sum(n for value, n in self._counts.items() if value & bits == bits)

    def share(self, bit: Status) -> float:
        """Return the share of estimates with a bit, 0…1; 0 without any estimate."""
        return self.having(bit) / self.estimates if self._counts else 0.0

    def as_json(self) -> dict[str, float]:
        """Return all shares by `key_of` their bits."""
        return {key_of(bit): round(self.share(bit), 6) for bit in (*VALID.values(), *FAULTS)}


def key_of(bit: Status) -> str:
    """Return the name of a bit in JSON."""
    return str(bit.name).lower()
