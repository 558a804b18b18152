"""What stands for a clutch's temperature: the one that the vehicle file's thermal data give, or the heat stored.

Without thermal data the friction work is kept with a time constant in which an ordinary clutch cools. A
coefficient for it is learned from the clutch itself, so that its unit does not matter.
"""

from __future__ import annotations

import math

HEAT_UNIT_J, HEAT_UNIT_K = 100e3, 100.0  # of ϑ = 1
COOLING_S = 90.0  # time constant of what is stored


class Warmth:
    """ϑ of one clutch: how much warmer it is than the coolant, in units of 100 K, or what stands for that.

    Attributes:
        stored_j: heat stored at ``key``.
        heat_j: friction work at ``key``, as the rows count it.
        key: time of the last look, µs, or None.
    """

    def __init__(self) -> None:
        self.stored_j = self.heat_j = 0.0
        self.key: int | None = None

    def at(self, key: int, heat_j: float, above_coolant_k: float) -> float:
        """Return ϑ at a time that does not fall.

        Args:
            key: µs.
            heat_j: all friction work since the start; that of an estimator begun anew is smaller.
            above_coolant_k: temperature above the coolant's; NaN where it is not known.
        """
        if self.key is not None:
            self.stored_j *= math.exp(-(key - self.key) * 1e-6 / COOLING_S)
            self.stored_j += max(heat_j - self.heat_j, 0.0)
        self.key, self.heat_j = key, heat_j
        return self.now(key, above_coolant_k)

    def now(self, key: int, above_coolant_k: float) -> float:
        """Return ϑ without learning of new heat."""
        if not math.isnan(above_coolant_k):
            return above_coolant_k / HEAT_UNIT_K
        if self.key is None:
            return 0.0
        return self.stored_j * math.exp(-max(key - self.key, 0) * 1e-6 / COOLING_S) / HEAT_UNIT_J
