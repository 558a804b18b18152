"""Gears that one gear signal for the whole gearbox lets one expect, in the filter: they change under load.

A gear that a shaft's own signal tells changes while its clutch is open. One that is only expected turns out to be
another one at any time: then the clutch may carry anything between nothing and all.
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import MAX_GEAR
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.kalman import gearbox
from dctorque_can.estimators.kalman.filter import forget, measure
from dctorque_can.estimators.kalman.model import R_1, T_C1, TH_T1, W_C1, W_O, N
from dctorque_can.pipeline.samples import Quantity

_OPEN, _SLIPPING = int(ClutchPhase.OPEN), int(ClutchPhase.SLIPPING)
_TARGET_GEAR = int(Quantity.TARGET_GEAR)
_SHARE, _LITTLE = 0.25, 5.0  # of what both clutches carry, and N·m, that one may which need not
_EXPECTED_S = 0.1  # for how long that lasts
_AT_LEAST = 30.0  # N·m of either clutch that nobody knows of
_SOON, _SOON_US = 2.0, 600_000  # by which a synchroniser is surer to pull, for so long after a gear is told
_LEAST_TWIST = 1e-3  # rad
_LEAST_SPEED = 1.0  # (rad/s)², of a shaft in gear against its wheels


@compiled_without_allocation
def change_gears(f: Any, tuning: Any, inputs: Any) -> None:
    """Take new gears."""
    for i in range(2):
        if inputs.gear[i] == f.gear[i]:
            continue
        if inputs.gear[i] == 0 or (f.gear[i] == 0 and not inputs.closed[i]):
            gearbox.change_gear(f, tuning, i, inputs.gear[i])
            if inputs.gear[i] == 0:
                continue
        else:
            gearbox.engage(f, tuning, i, inputs.gear[i])
            share_torque(f, tuning, i, bool(inputs.closed[i]))
        if inputs.mapped[_TARGET_GEAR]:
            f.expected_us[i] = f.t_us
        turn_with_car(f, float(tuning.ratio[i, f.gear[i] + 1]), i)


@compiled_without_allocation
def expect_open(f: Any, seconds: float) -> None:
    """Expect that a clutch carries little of which nothing is told, while the other one drives.

    A torque that it always had could not be told from one of the road. Said weakly, so that it may take over.
    """
    for i in range(2):
        if f.idle[i] and f.gear[i] != 0 and seconds > 0.0:
            sigma = _SHARE * abs(f.x[T_C1] + f.x[T_C1 + 1]) + _LITTLE
            measure(f, T_C1 + i, 0.0, sigma * sigma * max(_EXPECTED_S / seconds, 1.0))


@compiled_without_allocation
def share_torque(f: Any, tuning: Any, i: int, carries: bool) -> None:
    """Let clutch i carry any part of what both do, if it may carry something; both together are what they were."""
    T, other = T_C1 + i, T_C1 + 1 - i
    total = f.x[T_C1] + f.x[T_C1 + 1]
    sigma = 0.5 * abs(total) + _AT_LEAST if carries else tuning.open_torque
    mine = 0.5 * total if carries else 0.0
    rest = total - mine
    forget(f, T, mine, sigma * sigma)
    forget(f, R_1 + i, 0.0, tuning.sliding_rate**2 if carries else tuning.rate[0] ** 2)
    if f.gear[1 - i] != 0:
        f.x[other] = rest
        f.P[other, other] += sigma * sigma
        f.P[T, other] = f.P[other, T] = -sigma * sigma
    ratio = abs(tuning.ratio[i, f.gear[i] + 1])
    twist = math.hypot(_LEAST_TWIST, tuning.transfer_twist[i, f.gear[i] + 1] * ratio * sigma)
    forget(f, TH_T1 + i, 0.0, twist * twist)


@compiled_without_allocation
def turn_with_car(f: Any, ratio: float, i: int) -> None:
    """Let an input shaft turn as its gear makes it: a stiff gear would make torque of any other speed."""
    shaft = W_C1 + i
    forget(f, shaft, ratio * f.x[W_O], 0.0)
    for k in range(N):
        if k != shaft:
            f.P[shaft, k] = f.P[k, shaft] = ratio * f.P[W_O, k]
    f.P[shaft, shaft] = ratio * ratio * f.P[W_O, W_O] + _LEAST_SPEED


@compiled_without_allocation
def largest_ratio(f: Any, tuning: Any, i: int) -> float:
    """Return the largest ratio that shaft i may be synchronised to: of its gear, or next to the other shaft's."""
    other = f.gear[1 - i]
    lower = abs(tuning.ratio[i, other]) if other > 0 else 0.0
    higher = abs(tuning.ratio[i, other + 2]) if 0 <= other < MAX_GEAR else 0.0
    return float(max(abs(tuning.ratio[i, f.gear[i] + 1]), lower, higher))


@compiled_without_allocation
def admit_synchronisers(f: Any, tuning: Any, inputs: Any, phase_1: int, phase_2: int) -> None:
    """Let what is published be as uncertain as a synchroniser makes it that may begin to pull at any moment.

    It pulls within milliseconds, a locked clutch on the other shaft and the output shaft carry it at once, and no
    signal says when. The speeds show it 10 to 20 ms later; until then the estimate is off by that torque.
    """
    for i in range(2):
        if f.gear[i] != 0 and not inputs.synchronises[i]:
            continue
        ratio = tuning.synchroniser_ratio[i]
        if inputs.synchronises[i]:
            ratio = max(ratio, largest_ratio(f, tuning, i))
            soon = f.t_us - f.expected_us[i] < _SOON_US or (phase_2 if i == 0 else phase_1) == _SLIPPING
            ratio *= _SOON if soon else 1.0
        at_wheel = tuning.synchroniser_torque * ratio
        f.sigma_o = math.hypot(f.sigma_o, at_wheel)
        gear = f.gear[1 - i]
        phase = phase_2 if i == 0 else phase_1
        if gear != 0 and phase != _OPEN:
            ratio = abs(tuning.ratio[1 - i, gear + 1])
            if f.gear[i] != 0 and (phase_1 if i == 0 else phase_2) != _OPEN:  # taken for a shift of the load
                ratio = abs(ratio - abs(tuning.ratio[i, f.gear[i] + 1]))
                f.sigma_1 = math.hypot(f.sigma_1, at_wheel / ratio)
                f.sigma_2 = math.hypot(f.sigma_2, at_wheel / ratio)
                continue
            jump = at_wheel / ratio
            if i == 0:
                f.sigma_2 = math.hypot(f.sigma_2, jump)
            else:
                f.sigma_1 = math.hypot(f.sigma_1, jump)
