"""What the clutches are called against what the speeds say of them."""

from __future__ import annotations

from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators.inputs import STANDSTILL, wheel_speeds
from dctorque_can.plausibility.findings import Finding
from dctorque_can.plausibility.signals import faded, is_in, rolls_free, together
from dctorque_can.plausibility.speeds import fits
from dctorque_can.plausibility.thresholds import (
    APART_RAD_S,
    CLOSED_SLIDES_S,
    IDLES_RAD_S,
    LAUNCH_M_S2,
    LAUNCH_NM,
    LAUNCH_PART,
    LAUNCH_S,
    MEMORY_S,
    REST_S,
    RIDES_PART,
    RIDES_RAD_S,
    SLIDES_PART,
)
from dctorque_can.plausibility.verdict import decide

_NOTHING, _OPEN, _CLOSED = -1, 0, 1  # of `contract.INPUTS`
_RIDE_MEMORY = 1000.0  # rad/s of way, in which evidence of rides fades
_EXCHANGED, _DIRECTION = int(Finding.CLUTCHES_EXCHANGED), int(Finding.CLUTCH_DIRECTION)
_CALLED_OPEN, _CALLED_CLOSED = int(Finding.CLUTCH1_CALLED_OPEN), int(Finding.CLUTCH1_CALLED_CLOSED)
_OF_ONE_CLUTCH = _CALLED_OPEN | _CALLED_OPEN << 1 | _CALLED_CLOSED | _CALLED_CLOSED << 1
_LAUNCH_CALLED_OPEN = int(Finding.LAUNCH_CALLED_OPEN)


@compiled_without_allocation
def called_open(inputs: Any, i: int) -> bool:
    """Return whether the bus says that a clutch is open."""
    return bool(inputs.called[i] == _OPEN)


@compiled_without_allocation
def called_closed(inputs: Any, i: int) -> bool:
    """Return whether the bus says that a clutch is closed, whether it slips or not."""
    return bool(inputs.called[i] == _CLOSED)


@compiled_without_allocation
def compare_phases(m: Any, car: Any, inputs: Any, dt: float) -> None:
    """Add what engine and shafts say of the clutches."""
    known, w_d, _, _, _ = wheel_speeds(inputs)
    way = abs(m.w_e - m.last_w_e)
    m.last_w_e = m.w_e
    runs = m.w_e > IDLES_RAD_S
    fade = faded(way, _RIDE_MEMORY)
    holds_1 = runs and together(m, 0) and fits(inputs, car, 0, w_d)
    holds_2 = runs and together(m, 1) and fits(inputs, car, 1, w_d)
    for i in range(2):
        holds, other_holds = (holds_1, holds_2) if i == 0 else (holds_2, holds_1)
        if holds and not other_holds and inputs.called[i] != _NOTHING:
            m.ride[i] = m.ride[i] * fade + way
            m.ride_open[i] *= fade
            m.ride_crossed[i] *= fade
            if called_open(inputs, i):
                m.ride_open[i] += way
                if called_closed(inputs, 1 - i):
                    m.ride_crossed[i] += way
        slides = is_in(m, i) and abs(m.slip[i]) > APART_RAD_S and other_holds and inputs.called[i] != _NOTHING
        closed = slides and called_closed(inputs, i)
        m.closed_slides_s[i] = m.closed_slides_s[i] + dt if closed else 0.0
        if slides:
            fade_s = faded(dt, MEMORY_S)
            m.slide_s[i] = m.slide_s[i] * fade_s + dt
            m.slide_closed_s[i] = m.slide_closed_s[i] * fade_s + (dt if closed else 0.0)
    if known and abs(m.w_b) < STANDSTILL and runs:
        if called_open(inputs, 0) and called_open(inputs, 1):
            m.rest_open_s += dt
        elif called_closed(inputs, 0) and called_closed(inputs, 1):
            m.rest_closed_s += dt
        if m.rest_open_s + m.rest_closed_s > MEMORY_S:
            m.rest_open_s *= 0.5
            m.rest_closed_s *= 0.5
    gives = m.torque - car.engine_inertia * m.dw_e > LAUNCH_NM
    if runs and gives and m.dw_b * car.radius > LAUNCH_M_S2 and rolls_free(m, inputs):
        in_one = is_in(m, 0) or is_in(m, 1)
        told = inputs.called[0] != _NOTHING and inputs.called[1] != _NOTHING
        if in_one and not holds_1 and not holds_2 and told:
            m.launch_s = m.launch_s * faded(dt, MEMORY_S) + dt
            m.launch_open_s *= faded(dt, MEMORY_S)
            if called_open(inputs, 0) and called_open(inputs, 1):
                m.launch_open_s += dt


@compiled_without_allocation
def judge_phases(m: Any) -> None:
    """Say which clutch is called what it is not."""
    crossed, most = False, 0.0
    for i in range(2):
        crossed |= m.ride_crossed[i] >= RIDES_RAD_S and m.ride_crossed[i] > 0.5 * m.ride_open[i]
        most = max(most, m.ride_crossed[i])
    rest = m.rest_open_s + m.rest_closed_s
    exchanged = crossed and m.rest_open_s >= REST_S and m.rest_open_s > 0.8 * rest
    direction = crossed and m.rest_closed_s >= REST_S and m.rest_closed_s > 0.8 * rest
    decide(m, _EXCHANGED, most, exchanged, exchanged, exchanged)
    decide(m, _DIRECTION, most, direction, direction, direction)
    for i in range(2):
        part = m.ride_open[i] / max(m.ride[i], 1e-9)
        told = m.ride_open[i] >= RIDES_RAD_S and part > RIDES_PART and not exchanged and not direction
        stays = m.ride_open[i] >= 0.5 * RIDES_RAD_S and part > 0.5 * RIDES_PART and not exchanged and not direction
        decide(m, _CALLED_OPEN << i, m.ride_open[i], told, stays, told)
        told = m.closed_slides_s[i] >= CLOSED_SLIDES_S and not exchanged and not direction
        stays = m.slide_closed_s[i] > SLIDES_PART * m.slide_s[i] and not exchanged and not direction
        decide(m, _CALLED_CLOSED << i, m.slide_closed_s[i], told, stays, told)
    if exchanged or direction:  # by now it is known why
        m.ever &= ~_OF_ONE_CLUTCH
    told = m.launch_open_s >= LAUNCH_S and m.launch_open_s > LAUNCH_PART * m.launch_s
    stays = m.launch_open_s > 0.5 * LAUNCH_PART * m.launch_s
    decide(m, _LAUNCH_CALLED_OPEN, m.launch_open_s, told, stays, told)
