"""What the filter takes from the wheel speeds of an axle."""

from __future__ import annotations

from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import DrivenAxle
from dctorque_can.estimators.inputs import WHEEL, usable, wheel_speeds
from dctorque_can.estimators.kalman import faults
from dctorque_can.estimators.kalman.faults import SensorFault
from dctorque_can.estimators.kalman.filter import measure
from dctorque_can.estimators.kalman.learning import noise_factor
from dctorque_can.estimators.kalman.model import W_B, W_W
from dctorque_can.estimators.kalman.thresholds import (
    FASTEST_WHEEL,
    ROLLS,
    ROLLS_SHARE,
    SAME_TIME_US,
    SLIP_VARIANCE,
    SPINS,
)

_FIRST = 3  # place of the first wheel among the signals
_REAR_WHEEL = WHEEL + 2
_APART, _APART_TIME = 0.1, 0.05  # rad/s by which driven wheels leave the body at least, and s for which they do
_SPIKE, _STUCK, _MISSING = int(SensorFault.SPIKE), int(SensorFault.STUCK), int(SensorFault.MISSING)


@compiled_without_allocation
def stand_in_for_undriven(inputs: Any, f: Any) -> None:
    """Let the driven wheels tell of the body, within their slip, when no wheel is there that rolls with it.

    Not while they spin, for as long as it is known that they do.
    """
    undriven = WHEEL if inputs.driven_axle == DrivenAxle.REAR else _REAR_WHEEL
    rolls = usable(inputs, undriven) or usable(inputs, undriven + 1)
    if rolls and inputs.driven_axle != DrivenAxle.ALL:
        return
    _, _, _, speed, fresh = wheel_speeds(inputs)
    if fresh and not f.spins:
        measure(f, W_B, speed, SLIP_VARIANCE)


@compiled_without_allocation
def measure_either_way(f: Any, i: int, z: float, ratio: float, body: float, seconds: float) -> None:
    """Take a magnitude z while nobody knows which way the car goes: it turns as the body does.

    It may be faster or slower by what the magnitudes differ, either way round, and that lasts.

    Args:
        f: `filter.FILTER`.
        i: state, of the driven wheels or of a shaft in gear.
        z: speed, rad/s, with the sign that is taken for granted.
        ratio: by which it turns faster than the wheels.
        body: speed of the body at the wheel, rad/s.
        seconds: since the last frame.
    """
    apart = 2.0 * (abs(z) - abs(ratio * body))
    measure(f, i, z, (apart * apart + (_APART * ratio) ** 2) * max(2.0 * _APART_TIME / max(seconds, 1e-3), 1.0))


@compiled_without_allocation
def near_in_time(inputs: Any, left: int) -> bool:
    """Return whether the wheels of an axle, in messages of their own, have been seen at nearly the same time."""
    both = usable(inputs, left) and usable(inputs, left + 1)
    return both and abs(inputs.seen_us[left] - inputs.seen_us[left + 1]) <= SAME_TIME_US


@compiled_without_allocation
def measure_axle(inputs: Any, f: Any, tuning: Any, left: int, driven: bool, sensor: int) -> None:
    """Take the new wheel speeds of an axle: their mean, or one corrected for its usual distance from the other."""
    state, axle = W_W if driven else W_B, (left - WHEEL) // 2
    there_l, there_r = bool(inputs.fresh[left]), bool(inputs.fresh[left + 1])
    if not there_l and not there_r:
        if inputs.stale[left] or inputs.stale[left + 1]:
            faults.leave_out(f, sensor, _MISSING)
        return
    w_l, w_r, fault = inputs.value[left], inputs.value[left + 1], 0
    signal = _FIRST + left - WHEEL
    factor = noise_factor(f, tuning, sensor)
    variance_l, variance_r = factor * tuning.speed_variance[signal], factor * tuning.speed_variance[signal + 1]
    if there_l and faults.is_stuck(f, tuning, signal, state, w_l, variance_l):
        there_l, fault = False, _STUCK
    if there_r and faults.is_stuck(f, tuning, signal + 1, state, w_r, variance_r):
        there_r, fault = False, _STUCK
    together = (there_l and there_r) or near_in_time(inputs, left)
    slips = driven and (spins_alone(f, w_l, w_r) or f.spin_rate > SPINS)
    if slips:
        f.spread_known[axle] = False  # what they differ by now is their slip, and ends with it
    if fault == 0 and together and not slips:
        odd = faults.odd_wheel(f, tuning, axle, state, w_l, w_r, variance_l + variance_r)
        there_l, there_r = there_l and odd != 1, there_r and odd != 2
        if odd != 0:
            fault = _SPIKE
    if fault == 0 and (inputs.stale[left] or inputs.stale[left + 1]):
        fault = _MISSING
    usual = 0.5 * f.spread[axle] if f.spread_known[axle] else 0.0
    if not there_l and not there_r:
        f.rejected[sensor] = 0  # of the mean
        f.beyond[sensor] += 1
    else:
        if there_l and there_r:
            z, variance = 0.5 * (w_l + w_r), 0.25 * (variance_l + variance_r)
        elif there_l:
            z, variance = alone(w_l, -usual), variance_l
        else:
            z, variance = alone(w_r, usual), variance_r
        faults.measure_gated(f, tuning, sensor, state, z, variance, FASTEST_WHEEL)
    if fault != 0:
        faults.blame(f, sensor, fault)


@compiled_without_allocation
def spins_alone(f: Any, left: float, right: float) -> bool:
    """Return whether one driven wheel spins while the other rolls; the output shaft has their mean."""
    body = abs(f.x[W_B])
    slow, fast = min(abs(left), abs(right)), max(abs(left), abs(right))
    usual = ROLLS_SHARE * body + ROLLS
    return bool(fast > body + usual and abs(slow - body) <= usual)


@compiled_without_allocation
def alone(speed: float, correction: float) -> float:
    """Return an axle's speed by one wheel, corrected for its usual distance from the mean unless it stands."""
    return speed + correction if abs(speed) > faults.TOLD_AS_ZERO else 0.0
