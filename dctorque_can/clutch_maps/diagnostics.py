"""What a workshop asks of a clutch: energies, temperatures, engagements, residuals, drift of the touch point."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.clutch_maps.rows import ENERGIES_J, RESIDUALS_NM, TEMPERATURES_C
from dctorque_can.clutch_maps.windows import WINDOW_US
from dctorque_can.pipeline.estimates import Status

_LEAST_KM = 5.0  # standard deviation of the distances, for a drift over them
_LEAST_POINTS = 3
_EDGES_NM = np.sqrt(np.array(RESIDUALS_NM[:-1]) * np.array(RESIDUALS_NM[1:]))
_LOWEST_NM = RESIDUALS_NM[0] ** 2 / _EDGES_NM[0]


class Extremes:
    """The first, the least and the most that a value has been.

    Attributes:
        first, least, most: NaN before there was one.
    """

    def __init__(self) -> None:
        self.first = self.least = self.most = math.nan

    def take(self, value: float) -> None:
        """Take the next value; one that is not known changes nothing."""
        if math.isnan(value):
            return
        if math.isnan(self.first):
            self.first = self.least = self.most = value
        self.least, self.most = min(self.least, value), max(self.most, value)


class Diagnostics:
    """Of one clutch.

    Attributes:
        energy_j: all friction work.
        warm_windows: windows in each class of `TEMPERATURES_C`.
        engagements: number in each class of `ENERGIES_J`; that of unknown energy are left out.
        residuals: number, sum and sum of squares of the residuals at each of `RESIDUALS_NM` ``[3, n]``.
        touch, friction: extremes.
        drift: of the touch point over the distance: number, Σ km, Σ km², Σ x, Σ km x.
    """

    def __init__(self) -> None:
        self.energy_j = 0.0
        self.warm_windows = np.zeros(len(TEMPERATURES_C) + 1, np.int64)
        self.engagements = np.zeros(len(ENERGIES_J) + 1, np.int64)
        self.residuals = np.zeros((3, len(RESIDUALS_NM)))
        self.touch, self.friction = Extremes(), Extremes()
        self.drift = np.zeros(5)

    def count(self, clutch: int, rows: NDArray[np.void], ends: NDArray[np.intp]) -> None:
        """Take estimates.

        Args:
            clutch: 0 or 1.
            rows: `ESTIMATE` ``[n]``; the first has been counted before.
            ends: rows with which a window ends.
        """
        number = clutch + 1
        heat = np.diff(rows[f"clutch{number}_heat_j"])
        self.energy_j = float(np.cumsum(np.append(self.energy_j, np.maximum(heat, 0.0)))[-1])
        begun = np.flatnonzero(np.diff(rows[f"clutch{number}_engagements"].astype(np.int64)) > 0)
        known = rows["status"][begun] & (Status.ENERGY1_KNOWN << clutch) != 0
        energies = rows[f"clutch{number}_energy_j"][begun][known]  # of the one before that begins
        classes = np.searchsorted(ENERGIES_J, energies[energies > 0.0], side="right")
        self.engagements += np.bincount(classes, minlength=len(ENERGIES_J) + 1)
        known = rows["status"][ends] & (Status.TEMPERATURE1_KNOWN << clutch) != 0
        degrees = rows[f"clutch{number}_temperature_c"][ends][known]
        classes = np.searchsorted(TEMPERATURES_C, degrees, side="right")
        self.warm_windows += np.bincount(classes, minlength=len(TEMPERATURES_C) + 1)

    def surprise(self, torque_nm: float, residual_nm: float) -> None:
        """Take by how much an observation was above the map."""
        if torque_nm >= _LOWEST_NM:
            self.residuals[:, int(np.searchsorted(_EDGES_NM, torque_nm))] += 1.0, residual_nm, residual_nm**2

    def follow(self, touch_point: float, friction: float, distance_km: float) -> None:
        """Take what is published."""
        self.touch.take(touch_point)
        self.friction.take(friction)
        if not math.isnan(touch_point):
            self.drift += 1.0, distance_km, distance_km**2, touch_point, distance_km * touch_point

    @property
    def touch_per_1000_km(self) -> float:
        """Drift of the touch point by linear regression; NaN: over too short a way."""
        n, k, kk, x, kx = self.drift.tolist()
        if n < _LEAST_POINTS or (spread := kk - k * k / n) < n * _LEAST_KM**2:
            return math.nan
        return 1000.0 * (kx - k * x / n) / spread

    def report(self, row: Any) -> None:
        """Write everything into a `CLUTCH_MAP` row."""
        n = self.residuals[0]
        seen = n > 0
        some = np.where(seen, n, 1.0)
        row["residual_nm"] = np.where(seen, self.residuals[1] / some, np.nan)
        row["residual_rms_nm"] = np.where(seen, np.sqrt(self.residuals[2] / some), np.nan)
        row["temperature_s"] = WINDOW_US * 1e-6 * self.warm_windows
        row["engagements"], row["energy_j"] = self.engagements, self.energy_j
        row["touch_first"], row["touch_least"], row["touch_most"] = (
            self.touch.first,
            self.touch.least,
            self.touch.most,
        )
        row["friction_least"], row["friction_most"] = self.friction.least, self.friction.most
        row["touch_per_1000_km"] = self.touch_per_1000_km
