"""How far the estimate of the clutch that drives is from what the transmission itself believes of it."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.pipeline.estimates import Status


class TransmissionFigures:
    """Adds up the differences, estimate minus told, where just one clutch drives and its torque is valid."""

    def __init__(self) -> None:
        self._estimates = self._n = 0
        self._sum = self._squares = self._told_squares = 0.0

    def count(self, rows: NDArray[np.void]) -> None:
        """Take the next `ESTIMATE` rows."""
        self._estimates += len(rows)
        known = rows[rows["status"] & Status.TRANSMISSION_TORQUE_KNOWN != 0]
        if not len(known):
            return
        first = (known["phase1"] != ClutchPhase.OPEN) & (known["gear1"] != 0)
        valid = known["status"] & np.where(first, Status.CLUTCH1_VALID, Status.CLUTCH2_VALID) != 0
        told = known["transmission_torque_nm"][valid]
        torque = np.where(first, known["clutch1_torque_nm"], known["clutch2_torque_nm"])[valid]
        self._n += len(told)
        self._sum += float(np.sum(torque - told))
        self._squares += float(np.sum((torque - told) ** 2))
        self._told_squares += float(np.sum(told**2))

    def as_json(self) -> dict[str, float] | None:
        """Return RMS and mean of the differences, N·m, the RMS of what is told, and the share of all estimates."""
        if not self._n:
            return None
        return {
            "rms_nm": sqrt(self._squares / self._n),
            "bias_nm": self._sum / self._n,
            "told_rms_nm": sqrt(self._told_squares / self._n),
            "share": self._n / self._estimates,
        }
