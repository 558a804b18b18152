"""Whose the one input shaft speed is that some transmissions tell: that of the shaft whose clutch drives.

It is given to a shaft only while that is beyond doubt: for a while its clutch alone can have carried a torque, and
the speed has fitted its gear and the driven wheels. In a shift, and for a moment after it, neither shaft has a
speed. A shaft in gear turns with the wheels, so nothing that fits can be far off.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.inputs import SPEED_1, phase_of, wheel_speeds
from dctorque_can.pipeline.samples import Quantity, Signs

DRIVING_SHAFT = np.dtype(
    [
        ("shaft", "i8"),  # 0 or 1 that drives alone; -1: neither, or both may
        ("since_us", "i8"),
    ],
    align=True,
)
"""Which shaft drives."""

_SPEED = int(Quantity.DRIVING_SHAFT_SPEED)
_OPEN = int(ClutchPhase.OPEN)
_SIGNED, _UNTOLD = int(Signs.SIGNED), int(Signs.UNTOLD)
_SETTLED_US = 300_000  # for which it must be so
_APART, _APART_SHARE = 3.0, 0.03  # rad/s and share by which it may leave the wheels: half a step of two gears
_NEGATIVE = -5.0  # rad/s, beyond what noise makes of zero


def first_driving_shaft(state: NDArray[np.void]) -> None:
    """Make ``state``, a `DRIVING_SHAFT` of zeros, what it is before the first frame."""
    state["shaft"], state["since_us"] = -1, NEVER


@compiled_without_allocation
def give_speed(d: Any, inputs: Any, rules: Any) -> None:
    """Give a new speed to the shaft that drives, as if it had been told of that one."""
    if not inputs.mapped[_SPEED]:
        return
    shaft = driving(inputs)
    if shaft != d.shaft:
        d.shaft, d.since_us = shaft, inputs.t_us
    if not inputs.fresh[_SPEED]:
        return
    if inputs.signs[_SPEED] == _UNTOLD and inputs.value[_SPEED] < _NEGATIVE:
        inputs.signs[_SPEED] = _SIGNED
    if shaft < 0:
        return
    known, w_d, _, _, _ = wheel_speeds(inputs)
    ratio, speed = rules.ratio[inputs.gear[shaft] + 1], abs(inputs.value[_SPEED])
    if not known or abs(speed - abs(ratio * w_d)) > _APART + _APART_SHARE * speed:
        d.since_us = inputs.t_us  # the other shaft, in neutral, may pass by
    if inputs.t_us - d.since_us < _SETTLED_US:
        return
    if inputs.signs[_SPEED] == _SIGNED:
        speed = inputs.value[_SPEED]
    else:
        speed = math.copysign(speed, inputs.heading * ratio)
    inputs.signs[SPEED_1 + shaft] = inputs.signs[_SPEED]
    inputs.value[SPEED_1 + shaft] = inputs.w_c[shaft] = speed
    inputs.fresh[SPEED_1 + shaft] = True


@compiled_without_allocation
def driving(inputs: Any) -> int:
    """Return the shaft whose clutch alone can carry a torque, and whose gear is certain; -1 for none."""
    shaft = -1
    for i in range(2):
        if phase_of(inputs, i) != _OPEN and not inputs.idle[i]:
            if shaft >= 0:
                return -1
            shaft = i
    certain = shaft >= 0 and bool(inputs.gear_known[shaft]) and not inputs.gear_unsure[shaft]
    return shaft if certain and inputs.closed_known[1 - shaft] else -1
