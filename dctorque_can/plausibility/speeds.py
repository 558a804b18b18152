"""Speeds against each other: ratios of gears, scales of wheels, exchanged shafts, the driven axle."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import GEARS, MAX_GEAR, STANDARD_GRAVITY
from dctorque_can.estimators.inputs import SPEED_1, wheel_speeds
from dctorque_can.plausibility.findings import Finding
from dctorque_can.plausibility.signals import faded, is_in, measures_axle, rolls_free
from dctorque_can.plausibility.thresholds import (
    AXLE_S,
    AXLE_SLOPE,
    CERTAIN,
    CORRELATED_S,
    FITS_SHARE,
    LATE_S,
    LATE_SIGMA,
    LITTLE_PULL,
    MEMORY_S,
    MISREAD_PART,
    MISREAD_S,
    OTHER_SHARE,
    RATIO_RATE,
    RATIO_S,
    RATIO_SHARE,
    RATIO_SHARE_STRONG,
    ROLLS_RAD_S,
    SAME_SHARE,
    SLIP_ROLLS_RAD_S,
    STANDS_ON,
)
from dctorque_can.plausibility.verdict import decide

_GEAR_RATIO, _WHEEL_SPEEDS = int(Finding.GEAR_RATIO), int(Finding.WHEEL_SPEEDS)
_AXLE_SPEEDS, _DRIVEN_AXLE = int(Finding.AXLE_SPEEDS), int(Finding.DRIVEN_AXLE)
_WHEELS_LATE = int(Finding.WHEELS_LATE)
_SHAFTS_EXCHANGED, _GEAR_SIGNAL = int(Finding.SHAFTS_EXCHANGED), int(Finding.GEAR_SIGNAL)


@compiled_without_allocation
def deviation(speed: float, expected: float) -> float:
    """Return by which share a speed is beyond the expected one."""
    return abs(speed / expected - 1.0)


@compiled_without_allocation
def fits(inputs: Any, car: Any, i: int, w_d: float) -> bool:
    """Return whether the speed of a shaft is about that of its gear."""
    gear = inputs.gear[i]
    if not inputs.mapped[SPEED_1 + i]:
        return True
    return bool(deviation(inputs.value[SPEED_1 + i], car.ratio[gear + 1] * w_d) < FITS_SHARE)


@compiled_without_allocation
def pulls_little(m: Any, car: Any) -> bool:
    """Return whether the tyres of the driven axle hardly slip, by the torque that is told."""
    force = 0.0
    for i in range(2):
        force = max(force, abs(m.torque * car.ratio[m.gear[i] + 1]) / car.radius)
    return bool(force < LITTLE_PULL * STANDARD_GRAVITY * car.inertia / (car.radius * car.radius))


@compiled_without_allocation
def compare_ratios(m: Any, car: Any, inputs: Any, dt: float) -> None:
    """Add what shafts and wheels say of the gears that are in."""
    _, w_d, _, _, _ = wheel_speeds(inputs)
    if w_d < ROLLS_RAD_S or abs(m.dw_b) > RATIO_RATE * w_d:
        return
    if not (measures_axle(inputs, True) or pulls_little(m, car)):
        return
    fade = faded(dt, MEMORY_S)
    for i in range(2):
        if not inputs.mapped[SPEED_1 + i] or not is_in(m, i):
            continue
        gear = m.gear[i]
        expected, speed = car.ratio[gear + 1] * w_d, inputs.value[SPEED_1 + i]
        other = inputs.value[SPEED_1 + 1 - i]
        own = deviation(speed, expected)
        m.in_gear_s = m.in_gear_s * fade + dt
        m.crossed_s *= fade
        m.misread_s *= fade
        crossed = False
        if own > FITS_SHARE and inputs.mapped[SPEED_1 + 1 - i] and is_in(m, 1 - i):
            others = car.ratio[m.gear[1 - i] + 1] * w_d
            crossed = deviation(other, expected) < OTHER_SHARE and deviation(speed, others) < OTHER_SHARE
        if crossed:
            m.crossed_s += dt
        elif own > FITS_SHARE:
            for number in range(1, MAX_GEAR + 1):
                ratio = car.ratio[number + 1]
                there = number != gear and ratio != 0.0 and car.shaft[number + 1] == i + 1
                if there and deviation(speed, ratio * w_d) < OTHER_SHARE:
                    m.misread_s += dt
                    m.misread_gear = number
        m.ratio_xx[gear + 1] = m.ratio_xx[gear + 1] * fade + expected * expected * dt
        m.ratio_xy[gear + 1] = m.ratio_xy[gear + 1] * fade + expected * (speed - expected) * dt
        m.ratio_s[gear + 1] = m.ratio_s[gear + 1] * fade + dt


@compiled_without_allocation
def compare_axles(m: Any, car: Any, inputs: Any) -> None:
    """Add how much faster the driven wheels turn at an acceleration; called with every equation."""
    driven_known, w_d, undriven_known, w_u, _ = wheel_speeds(inputs)
    apart = driven_known and undriven_known and w_d != w_u
    if not car.one_axle or not apart or m.w_b < SLIP_ROLLS_RAD_S or not rolls_free(m, inputs):
        return
    dt = 0.1
    fade = faded(dt, MEMORY_S)
    x, y = m.dw_b * car.radius, m.axle_slip
    for k in range(6):
        m.axle[k] *= fade
    m.axle[0] += 1.0
    m.axle[1] += x
    m.axle[2] += y
    m.axle[3] += x * x
    m.axle[4] += x * y
    m.axle[5] += y * y
    m.axle_s = m.axle_s * fade + dt


@compiled_without_allocation
def judge_ratios(m: Any) -> None:
    """Say whether one gear, or all of them, or the shafts do not fit the wheels."""
    enough = m.in_gear_s * MISREAD_PART
    crossed = m.crossed_s >= MISREAD_S and m.crossed_s > enough
    decide(m, _SHAFTS_EXCHANGED, m.crossed_s / max(m.in_gear_s, 1e-9), crossed, crossed, crossed)
    misread = m.misread_s >= MISREAD_S and m.misread_s > enough and not crossed
    if misread:
        m.finding_gear = m.misread_gear
    decide(m, _GEAR_SIGNAL, m.misread_s / max(m.in_gear_s, 1e-9), misread, misread, misread)
    if crossed or misread:
        decide(m, _GEAR_RATIO, 0.0, False, False, False)
        decide(m, _WHEEL_SPEEDS, 0.0, False, False, False)
        m.ever &= ~(_GEAR_RATIO | _WHEEL_SPEEDS)  # by now it is known why
        return
    # what most gears agree on: the deviation that the most others are near to, at a tie the smallest
    common, votes = 0.0, -1
    for a in range(GEARS):
        if m.ratio_s[a] >= RATIO_S:
            mine, near = m.ratio_xy[a] / m.ratio_xx[a], 0
            for b in range(GEARS):
                if m.ratio_s[b] >= RATIO_S and abs(m.ratio_xy[b] / m.ratio_xx[b] - mine) < SAME_SHARE:
                    near += 1
            if near > votes or (near == votes and abs(mine) < abs(common)):
                common, votes = mine, near
    all_alike = votes >= 2
    size = abs(common) if all_alike else 0.0
    decide(
        m,
        _WHEEL_SPEEDS,
        common,
        size > RATIO_SHARE,
        size > 0.8 * RATIO_SHARE,
        size > RATIO_SHARE_STRONG,
    )
    worst, gear = 0.0, 0
    for a in range(GEARS):
        if m.ratio_s[a] >= RATIO_S and votes >= 1:
            own = m.ratio_xy[a] / m.ratio_xx[a] - (common if all_alike else 0.0)
            if abs(own) > abs(worst):
                worst, gear = own, a - 1
    size = abs(worst)
    if size > RATIO_SHARE:
        m.finding_gear = gear
    decide(
        m,
        _GEAR_RATIO,
        worst,
        size > RATIO_SHARE,
        size > 0.8 * RATIO_SHARE,
        size > RATIO_SHARE_STRONG,
    )


@compiled_without_allocation
def judge_axles(m: Any) -> None:
    """Say whether the other axle is driven, or the axles have different scales."""
    n = m.axle[0]
    if m.axle_s < AXLE_S:
        return
    mean_x, mean_y = m.axle[1] / n, m.axle[2] / n
    xx = m.axle[3] - n * mean_x * mean_x
    xy = m.axle[4] - n * mean_x * mean_y
    yy = m.axle[5] - n * mean_y * mean_y
    if xx <= 0.0:
        return
    slope = xy / xx
    rest = max(yy - slope * xy, 0.0) / n
    error = math.sqrt(rest / xx * CORRELATED_S / 0.1)
    wrong = slope + CERTAIN * error < -AXLE_SLOPE
    stays = slope < -0.8 * AXLE_SLOPE
    decide(m, _DRIVEN_AXLE, slope, wrong, stays, wrong)
    at_rest = mean_y - slope * mean_x
    size = abs(at_rest)
    decide(m, _AXLE_SPEEDS, at_rest, size > RATIO_SHARE, size > 0.8 * RATIO_SHARE, size > RATIO_SHARE_STRONG)


@compiled_without_allocation
def judge_delay(m: Any, answer: Any) -> None:
    """Say whether wheels come later, or sooner, than an estimator can make up for that learns by how much."""
    late, sigma = abs(answer.wheels_late), answer.wheels_late_sigma
    known = 0.0 < sigma < LATE_SIGMA * late
    wrong = known and late > LATE_S
    decide(m, _WHEELS_LATE, answer.wheels_late, wrong, known and late > STANDS_ON * LATE_S, wrong)
