"""Where the shifts of a drive are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.phases import ClutchPhase


@dataclass(frozen=True, slots=True)
class Shift:
    """One change of the clutch that drives.

    Attributes:
        start: first row in which the off-going clutch no longer is the only closed one.
        end: first row in which the on-coming clutch is locked.
        from_gear: of the off-going clutch.
        to_gear: of the on-coming clutch.
    """

    start: int
    end: int
    from_gear: int
    to_gear: int

    @property
    def is_up(self) -> bool:
        """Whether it is an up-shift."""
        return self.to_gear > self.from_gear


def find_shifts(rows: NDArray[np.void]) -> list[Shift]:
    """Return the shifts of a drive in order of time.

    Args:
        rows: with ``phase1``, ``phase2``, ``gear1`` and ``gear2`` (estimates or the truth), in order of time.
    """
    locked = [rows[f"phase{i}"] == ClutchPhase.LOCKED for i in (1, 2)]
    alone = [locked[0] & (rows["phase2"] == ClutchPhase.OPEN), locked[1] & (rows["phase1"] == ClutchPhase.OPEN)]
    driving = np.where(locked[0], 1, np.where(locked[1], 2, 0))
    shifts: list[Shift] = []
    last = 0  # clutch that was locked last
    for k in np.flatnonzero(np.diff(driving, prepend=0)):
        now = int(driving[k])
        if now == 0:
            continue
        if last not in (0, now):
            before = np.flatnonzero(alone[last - 1][:k])
            start = int(before[-1]) + 1 if len(before) else 0
            gears = int(rows[f"gear{last}"][start]), int(rows[f"gear{now}"][k])
            if 0 not in gears:  # else it was a stop: the next start is a launch
                shifts.append(Shift(start, int(k), *gears))
        last = now
    return shifts
