"""The engine torque against what engine and car do with it: sign, scale, offset, mass and inertia.

One equation holds while one clutch alone has the engine's torque, locked or slipping, and while none has:

    η^±1 T_en = k_J η^±1 (J_e + J_d) dω_e/dt + k_m ((m r² + J_w)/R + η^±1 J_c R) dω_b/dt + T_v/R

With k_J = k_m = 1 the file fits. All terms are smoothed alike, and what lasts is taken off (road load, offsets).
So a regression over traffic gives both factors: the engine's own accelerations in launches and shifts tell k_J,
those of the car k_m. Both off by the same: the torque. k_m alone: the mass. k_J alone: the inertia.
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators.inputs import STANDSTILL, wheel_speeds
from dctorque_can.plausibility.clutches import called_closed, called_open
from dctorque_can.plausibility.findings import CLUTCHES, Finding
from dctorque_can.plausibility.signals import faded, is_in, measures_axle, rolls_free, together
from dctorque_can.plausibility.speeds import fits
from dctorque_can.plausibility.thresholds import (
    APART_S,
    BOTH_HIGH,
    BOTH_LOW,
    CERTAIN,
    CORRELATED_S,
    DECIDE_EVERY,
    EQUATION_S,
    FACTOR_HIGH,
    FACTOR_LOW,
    GRADE,
    GRADE_M,
    GRADE_SHARE,
    GRADE_STRONG,
    IDLES_RAD_S,
    INERTIA_HIGH,
    INERTIA_LOW,
    KNOWN_SHARE,
    LASTING_S,
    MEMORY_S,
    MOST_NEGATIVE,
    OFFSET_NM,
    OFFSET_S,
    OFFSET_STRONG_NM,
    PRIOR_ERROR,
    REGRESSION_S,
    SAME_FACTOR,
    SLIPPING_HIGH,
    SLIPPING_LOW,
    STANDS_ON,
    STEADY_RAD_S2,
    STEADY_US,
    STRONG_HIGH,
    STRONG_LOW,
    TWICE,
)
from dctorque_can.plausibility.verdict import decide

_SIGN, _SCALE = int(Finding.ENGINE_TORQUE_SIGN), int(Finding.ENGINE_TORQUE_SCALE)
_SCALE_OR_MASS, _MASS = int(Finding.ENGINE_TORQUE_OR_MASS), int(Finding.MASS)
_INERTIA, _OFFSET = int(Finding.ENGINE_INERTIA), int(Finding.ENGINE_TORQUE_OFFSET)
_ROAD_LOAD = int(Finding.ROAD_LOAD)
_NONE, _UNKNOWN = 2, -1


@compiled_without_allocation
def carrier_of(m: Any, car: Any, inputs: Any) -> int:
    """Return the clutch that has the engine's torque, by speeds or as it is called; `_NONE`; or `_UNKNOWN`."""
    _, w_d, _, _, _ = wheel_speeds(inputs)
    first, second = together(m, 0), together(m, 1)
    if first != second:
        i = 0 if first else 1
        return i if fits(inputs, car, i, w_d) else _UNKNOWN
    if first or m.findings & CLUTCHES:
        return _UNKNOWN
    open_1 = called_open(inputs, 0) or (m.gear[0] == 0 and bool(inputs.gear_known[0]))
    open_2 = called_open(inputs, 1) or (m.gear[1] == 0 and bool(inputs.gear_known[1]))
    if open_1 and open_2:
        return _NONE
    if open_2 and called_closed(inputs, 0) and is_in(m, 0):
        return 0 if m.w_b < STANDSTILL or fits(inputs, car, 0, w_d) else _UNKNOWN
    if open_1 and called_closed(inputs, 1) and is_in(m, 1):
        return 1 if m.w_b < STANDSTILL or fits(inputs, car, 1, w_d) else _UNKNOWN
    return _UNKNOWN


@compiled_without_allocation
def compare_torque(m: Any, car: Any, inputs: Any, dt: float) -> None:
    """Add the equation of this moment."""
    carrier = carrier_of(m, car, inputs)
    gear = m.gear[carrier] if 0 <= carrier < _NONE else 0
    begins = carrier != m.carrier or gear != m.carrier_gear
    if begins:
        # a launch goes on from where nothing was carried: smoothed terms fit at once
        if not (m.carrier == _NONE and 0 <= carrier < _NONE):
            m.wait_us = m.t_us + STEADY_US
        m.carrier, m.carrier_gear = carrier, gear
    if carrier == _UNKNOWN or m.t_us < m.wait_us or m.w_e < IDLES_RAD_S:
        m.mean[0] = math.nan
        return
    if carrier != _NONE and not rolls_free(m, inputs):
        m.mean[0] = math.nan
        return
    m.knows_body = measures_axle(inputs, False)
    y, x_1, x_2 = m.torque, car.engine_inertia * m.dw_e, 0.0
    if carrier != _NONE:
        ratio = car.ratio[gear + 1]
        loss = car.efficiency if y > x_1 else 1.0 / car.efficiency
        y, x_1 = y * loss, x_1 * loss  # not x_2: it would jump as the power turns, and the load with it
        x_2 = (car.inertia / ratio + car.shaft_inertia[carrier] * ratio * loss) * m.dw_b
        add_grade(m, car, (y - x_1 - x_2) * ratio, dt)
    if begins or math.isnan(m.mean[0]):
        m.mean[0], m.mean[1], m.mean[2] = y, x_1, x_2
    share = -math.expm1(-dt / LASTING_S)
    m.mean[0] += share * (y - m.mean[0])
    m.mean[1] += share * (x_1 - m.mean[1])
    m.mean[2] += share * (x_2 - m.mean[2])
    if m.looks % DECIDE_EVERY != 0:
        return
    y, x_1, x_2 = y - m.mean[0], x_1 - m.mean[1], x_2 - m.mean[2]
    seconds = EQUATION_S
    fade = faded(seconds, MEMORY_S)
    m.sum_xx[0] = m.sum_xx[0] * fade + x_1 * x_1
    m.sum_xx[1] = m.sum_xx[1] * fade + x_1 * x_2
    m.sum_xx[2] = m.sum_xx[2] * fade + x_2 * x_2
    m.sum_xy[0] = m.sum_xy[0] * fade + x_1 * y
    m.sum_xy[1] = m.sum_xy[1] * fade + x_2 * y
    m.sum_yy = m.sum_yy * fade + y * y
    m.sum_s = m.sum_s * fade + seconds
    apart = carrier == _NONE or not together(m, carrier)
    m.apart_s = m.apart_s * fade + (seconds if apart else 0.0)


@compiled_without_allocation
def add_grade(m: Any, car: Any, load: float, dt: float) -> None:
    """Add the grade that a load at the wheel means, N·m, weighed by the way."""
    way = abs(m.w_b) * car.radius * dt
    resistance = car.rolling + car.air * m.w_b * m.w_b
    grade = (load - math.copysign(resistance, m.w_b)) / car.weight
    fade = faded(way, GRADE_M)
    m.grade_m = m.grade_m * fade + way
    m.climb_m = m.climb_m * fade + grade * way


@compiled_without_allocation
def judge_grade(m: Any) -> None:
    """Say whether the road load means a grade that no road has for so long."""
    grade = m.climb_m / m.grade_m if m.grade_m >= GRADE_SHARE * GRADE_M else 0.0
    steep = abs(grade)
    decide(m, _ROAD_LOAD, grade, steep > GRADE, steep > STANDS_ON * GRADE, steep > GRADE_STRONG)


@compiled_without_allocation
def compare_idle(m: Any, car: Any, inputs: Any, dt: float) -> None:
    """Add the engine torque while nothing takes it: both clutches are called open, the car stands or brakes."""
    both_open = called_open(inputs, 0) and called_open(inputs, 1)
    free = both_open and not together(m, 0) and not together(m, 1)
    rests = abs(m.w_b) < STANDSTILL or not rolls_free(m, inputs)
    if free and rests and m.w_e > IDLES_RAD_S and abs(m.dw_e) < STEADY_RAD_S2:
        fade = faded(dt, MEMORY_S)
        m.idle_s = m.idle_s * fade + dt
        m.idle_nms = m.idle_nms * fade + (m.torque - car.engine_inertia * m.dw_e) * dt


@compiled_without_allocation
def judge_idle(m: Any) -> None:
    """Say whether the engine torque has an offset; what was taken for idle with wrong clutches is forgotten."""
    if m.findings & CLUTCHES:
        m.idle_s = m.idle_nms = 0.0
    offset = m.idle_nms / m.idle_s if m.idle_s >= OFFSET_S else 0.0
    size = abs(offset)
    decide(m, _OFFSET, offset, size > OFFSET_NM, size > 0.8 * OFFSET_NM, size > OFFSET_STRONG_NM)


@compiled_without_allocation
def factors(m: Any) -> tuple[float, float, float, float, float]:
    """Return k_J, its standard error, k_m, its standard error, and the most that k_m may be.

    A driver who holds the speed on a hill makes torque without acceleration, and a hill alone makes acceleration
    without torque: the regression on accelerations finds too little. That of accelerations on torque finds too
    much, if anything. The truth is between both.
    """
    n = max(m.sum_s / EQUATION_S, 1.0)
    variance = m.sum_yy / n + 1.0  # first guess, N²·m²: nothing is explained
    k_J = k_m = error_J = error_m = 0.0
    correlated = CORRELATED_S / EQUATION_S
    for _ in range(2):
        weak = variance * correlated / (PRIOR_ERROR * PRIOR_ERROR)
        a, b, c = m.sum_xx[0] + weak, m.sum_xx[1], m.sum_xx[2] + weak
        r, s = m.sum_xy[0] + weak, m.sum_xy[1] + weak
        determinant = a * c - b * b
        k_J, k_m = (c * r - b * s) / determinant, (a * s - b * r) / determinant
        rest = m.sum_yy - 2.0 * (k_J * m.sum_xy[0] + k_m * m.sum_xy[1])
        rest += k_J * k_J * m.sum_xx[0] + 2.0 * k_J * k_m * m.sum_xx[1] + k_m * k_m * m.sum_xx[2]
        variance = max(rest, 0.0) / n + 0.25
        error_J = math.sqrt(variance * correlated * c / determinant)
        error_m = math.sqrt(variance * correlated * a / determinant)
    yy = m.sum_yy - 2.0 * k_J * m.sum_xy[0] + k_J * k_J * m.sum_xx[0]
    xy = m.sum_xy[1] - k_J * m.sum_xx[1]
    most = yy / xy if abs(xy) > 1e-3 * yy else math.copysign(1e3, k_m)
    return k_J, error_J, k_m, error_m, most


@compiled_without_allocation
def judge_factors(m: Any) -> None:
    """Say whether torque, mass or inertia are off."""
    if m.findings & CLUTCHES or m.sum_s < REGRESSION_S:
        for bit in (_SIGN, _SCALE, _SCALE_OR_MASS, _MASS, _INERTIA):
            decide(m, bit, 0.0, False, False, False)
        return
    k_J, error_J, k_m, error_m, most = factors(m)
    margin = CERTAIN * error_m
    negative = k_m + margin < 0.0 and most > MOST_NEGATIVE
    lowest, highest = (FACTOR_LOW, FACTOR_HIGH) if m.knows_body else (SLIPPING_LOW, SLIPPING_HIGH)
    low = not negative and most > 0.0 and most * (1.0 + margin / max(abs(k_m), 1e-9)) < lowest
    middle = math.sqrt(max(k_m * most, 1e-6))
    # what engine and car say alike needs less of a deviation
    known = error_J < KNOWN_SHARE * abs(k_J) and m.apart_s >= APART_S
    both = max(k_J + TWICE * error_J, middle) < BOTH_LOW or min(k_J - TWICE * error_J, middle) > BOTH_HIGH
    alike = known and k_J > 0.0 and max(k_J / middle, middle / k_J) < SAME_FACTOR
    off = low or k_m - margin > highest or (both and alike and m.knows_body and not negative)
    if m.findings & (_SCALE | _SCALE_OR_MASS | _MASS) and not negative:
        off |= middle < lowest / STANDS_ON or middle > highest * STANDS_ON
    sound = known and FACTOR_LOW < k_J < FACTOR_HIGH
    decide(m, _SIGN, -1.0, negative, negative, negative)
    scale = off and alike and not sound
    mass = off and sound and not alike
    either = off and not scale and not mass
    decide(m, _SCALE, 1.0 / middle, scale, scale, scale)
    far = middle < STRONG_LOW or middle > STRONG_HIGH
    decide(m, _MASS, middle, mass, mass, mass and far)
    decide(m, _SCALE_OR_MASS, 1.0 / middle, either, either, either and far)
    if scale or mass:  # by now it is known which
        m.ever &= ~_SCALE_OR_MASS
    inertia = k_J + CERTAIN * error_J < INERTIA_LOW or k_J - CERTAIN * error_J > INERTIA_HIGH
    inertia &= not negative and not off and m.apart_s >= APART_S
    decide(m, _INERTIA, k_J, inertia, inertia, inertia)
