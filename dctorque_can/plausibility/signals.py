"""The signals as the checks want them: smoothed alike, with what they have been doing since when."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import DrivenAxle
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.estimators.inputs import (
    BRAKE,
    ENGINE_SPEED,
    ENGINE_TORQUE,
    SPEED_1,
    WHEEL,
    braking,
    usable,
    wheel_speeds,
)
from dctorque_can.plausibility.thresholds import (
    BRAKE_US,
    GAP_US,
    ROLLS_RAD_S,
    SMOOTH_S,
    STEADY_US,
    TOGETHER_RAD_S,
    TOGETHER_US,
)


@compiled_without_allocation
def faded(seconds: float, memory: float) -> float:
    """Return by what all earlier evidence is multiplied as ``seconds`` of it are added."""
    return math.exp(-seconds / memory)


@compiled_without_allocation
def shaft_speed(inputs: Any, car: Any, i: int, w_d: float) -> float:
    """Return the speed of an input shaft, rad/s: its signal, or what gear and wheels say where there is none."""
    if inputs.mapped[SPEED_1 + i]:
        return float(inputs.value[SPEED_1 + i])
    return float(car.ratio[inputs.gear[i] + 1] * w_d)


@compiled_without_allocation
def complete(inputs: Any) -> bool:
    """Return whether all that is looked at is there."""
    known, _, _, _, _ = wheel_speeds(inputs)
    there = known and usable(inputs, ENGINE_SPEED) and usable(inputs, ENGINE_TORQUE)
    for i in range(2):
        there &= usable(inputs, SPEED_1 + i) or not inputs.mapped[SPEED_1 + i]
    return bool(there)


@compiled_without_allocation
def measures_axle(inputs: Any, driven: bool) -> bool:
    """Return whether a wheel of the driven axle is measured, or of an undriven one."""
    if inputs.driven_axle == DrivenAxle.ALL:
        return driven
    first = WHEEL + 2 if (inputs.driven_axle == DrivenAxle.REAR) == driven else WHEEL
    return bool(inputs.mapped[first]) or bool(inputs.mapped[first + 1])


@compiled_without_allocation
def follow(m: Any, car: Any, inputs: Any) -> float:
    """Carry the signals on to the present; return the time since the last look, s, 0 if they begin anew."""
    t_us = inputs.t_us
    _, w_d, _, w_b, _ = wheel_speeds(inputs)
    w_e, torque = inputs.value[ENGINE_SPEED], inputs.value[ENGINE_TORQUE]
    anew = m.t_us == NEVER or t_us - m.t_us > GAP_US or t_us <= m.t_us
    dt = 0.0 if anew else (t_us - m.t_us) * 1e-6
    m.t_us = t_us
    share = 1.0 if anew else -math.expm1(-dt / SMOOTH_S)
    # smoothed twice, so that the noise of a speed does not become one of its rate
    m.half_torque += share * (torque - m.half_torque)
    m.torque += share * (m.half_torque - m.torque)
    m.half_w_e += share * (w_e - m.half_w_e)
    m.dw_e = (m.half_w_e - m.w_e) / SMOOTH_S
    m.w_e += share * (m.half_w_e - m.w_e)
    m.half_w_b += share * (w_b - m.half_w_b)
    m.dw_b = (m.half_w_b - m.w_b) / SMOOTH_S
    m.w_b += share * (m.half_w_b - m.w_b)
    slip = w_d / w_b - 1.0 if abs(w_b) > ROLLS_RAD_S else m.axle_slip
    m.axle_slip += share * (slip - m.axle_slip)
    if braking(inputs):
        m.brake_us = t_us
    for i in range(2):
        if anew or inputs.gear[i] != m.gear[i] or not inputs.gear_known[i] or inputs.gear_unsure[i]:
            m.gear[i], m.gear_us[i] = inputs.gear[i], t_us
        difference = w_e - shaft_speed(inputs, car, i, w_d)
        m.slip[i] += (1.0 if anew else -math.expm1(-2.0 * dt / SMOOTH_S)) * (difference - m.slip[i])
        if anew or abs(m.slip[i]) > TOGETHER_RAD_S or not is_in(m, i):
            m.together_us[i] = NEVER
        elif m.together_us[i] == NEVER:
            m.together_us[i] = t_us
    if anew:
        m.last_w_e = m.w_e
        m.carrier = -1
        m.brake_us = t_us  # who knows when it was on
        m.closed_slides_s[0] = m.closed_slides_s[1] = 0.0
    return dt


@compiled_without_allocation
def is_in(m: Any, i: int) -> bool:
    """Return whether a forward gear has been in on a shaft for long enough."""
    return bool(m.gear[i] > 0 and m.t_us - m.gear_us[i] >= STEADY_US)


@compiled_without_allocation
def together(m: Any, i: int) -> bool:
    """Return whether engine and shaft have turned alike for long enough."""
    return bool(m.together_us[i] != NEVER and m.t_us - m.together_us[i] >= TOGETHER_US)


@compiled_without_allocation
def rolls_free(m: Any, inputs: Any) -> bool:
    """Return whether no brake is on: as it is told, else as the car gathers speed."""
    if not inputs.mapped[BRAKE]:
        return bool(m.dw_b > 0.0)
    return usable(inputs, BRAKE) and (m.brake_us == NEVER or m.t_us - m.brake_us >= BRAKE_US)
