"""What a gearbox tells that has one gear signal for both shafts: the gear that drives, and the one that will."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.simulation.truth import TRUTH_PERIOD_US

Integers = NDArray[np.int64]
GearChange = Literal["middle", "end"]

_CARRIES_NM = 2.0  # capacity from which a clutch counts as closed
_AT_WORK = 80.0  # rad/s of the shaft, from which a clutch that drives and slips does so for a shift, not a launch
_BEFORE_US, _AFTER_US = 150_000, 50_000  # by which a shift is told before a clutch moves and after it is locked


class OneGear(NamedTuple):
    """Columns ``[n]`` beside the truth.

    Attributes:
        actual: gear that drives; −1 reverse, 0 neutral. It stays while no clutch is closed.
        target: gear asked for on the other shaft, else ``actual``.
        shifting: 1 while a shift is in progress.
        state: of the clutches together: 0 open, 1 slipping, 2 closed.
    """

    actual: Integers
    target: Integers
    shifting: Integers
    state: Integers


def one_gear(truth: NDArray[np.void], changes: GearChange) -> OneGear:
    """Return what such a gearbox tells.

    Args:
        truth: `TRUTH` ``[n]``.
        changes: when the actual gear changes: ``middle``, as soon as the new clutch has the greater capacity, or
            ``end``, when the old one is open.
    """
    n = len(truth)
    gear = np.stack([truth["gear1"], truth["gear2"]]).astype(np.int64)
    command = np.stack([truth["gear1_command"], truth["gear2_command"]]).astype(np.int64)
    capacity = np.stack([truth["clutch1_capacity_nm"], truth["clutch2_capacity_nm"]])
    carries = capacity > _CARRIES_NM
    takes_over = carries & (capacity > capacity[::-1])
    if changes == "end":
        takes_over &= ~carries[::-1]
    drives = np.zeros(n, np.int64)  # index of the shaft that does
    actual, target = np.zeros(n, np.int64), np.zeros(n, np.int64)
    shaft, last = _first_shaft(gear[:, 0]), 0
    for k in range(n):
        for i in range(2):
            if takes_over[i, k] and gear[i, k] != 0:
                shaft = i
        if not carries[:, k].any():
            shaft = _shaft_at_rest(gear[:, k], command[:, k], shaft)
        last = int(gear[shaft, k]) or last
        drives[k], actual[k] = shaft, last
        target[k] = command[1 - shaft, k] or last
    rows = np.arange(n)
    phase = np.stack([truth["phase1"], truth["phase2"]])[drives, rows]
    speed = np.abs(np.stack([truth["shaft1_speed_rad_s"], truth["shaft2_speed_rad_s"]])[drives, rows])
    slips = carries[drives, rows] & (phase == ClutchPhase.SLIPPING)
    shifting = _wider(carries.all(axis=0) | (slips & (speed > _AT_WORK)))
    state = np.where(carries.any(axis=0), np.where(slips | carries.all(axis=0), 1, 2), 0)
    return OneGear(actual, target, shifting.astype(np.int64), state.astype(np.int64))


def _first_shaft(gear: Integers) -> int:
    return 1 if gear[0] == 0 and gear[1] != 0 else 0


def _shaft_at_rest(gear: Integers, command: Integers, shaft: int) -> int:
    """Return which shaft counts as driving while no clutch is closed: that of the lowest gear, or of reverse."""
    if -1 in command:
        return int(np.flatnonzero(command == -1)[0])
    if gear[shaft] != 0 and (gear[1 - shaft] == 0 or gear[shaft] < gear[1 - shaft]):
        return shaft
    return 1 - shaft if gear[1 - shaft] > 0 else shaft


def _wider(flag: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a flag that begins sooner and ends later."""
    edges = np.diff(flag.astype(np.int64), prepend=0, append=0)
    wide = np.zeros(len(flag), np.bool_)
    before, after = _BEFORE_US // TRUTH_PERIOD_US, _AFTER_US // TRUTH_PERIOD_US
    for first, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        wide[max(first - before, 0) : end + after] = True
    return wide
