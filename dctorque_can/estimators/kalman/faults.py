"""Which speeds are believed: a spike, a stuck or a biased sensor is told from a driveline that surprises.

A shaft has inertia: it neither jumps nor stands still while its neighbours turn faster. Speeds in rad/s.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.kalman.filter import forget, measure, told, told_variance
from dctorque_can.estimators.kalman.learning import learn_noise
from dctorque_can.estimators.kalman.model import DT_E, GAIN, LAG_1, LAG_2, T_C1
from dctorque_can.estimators.kalman.thresholds import CHANCE, LARGEST_JUMP, LARGEST_SPREAD, MOTION, MOVED, TOO_MANY


class SensorFault(IntEnum):
    """Why the measurements of a sensor are not taken."""

    NONE = 0
    SPIKE = 1  # too far from the prediction to be a motion
    STUCK = 2  # the very same value again while the shaft has turned faster or slower
    BIASED = 3  # follows the prediction at a distance
    MISSING = 4  # no value for longer than its timeout


_SPIKE, _BIASED = int(SensorFault.SPIKE), int(SensorFault.BIASED)
_SLIPPING = int(ClutchPhase.SLIPPING)
_ENGINE = 0
SOONEST = 0.005  # s, in which a speed that is not believed may have come about
_TURNS = 1.0  # rad/s; slower speeds are told as zero
TOLD_AS_ZERO = 1e-6  # … which the scale and offset of a DBC may leave not quite that; it has no noise
_LEAST_SHARE = 0.2
_RISING, _FALLING = 0.1, 0.005  # per change: what was learned at a constant speed is kept through faster ones
_LONGEST_RUN = 50  # longer ones teach nothing
_SPREAD_PER_US = 1e-6 / 0.5  # that difference is learned within half a second
_FIRST_WHEEL = 3
_TELLING_REPEATS = 3
_NOISE_OF_CHANGE = 9.0  # three standard deviations, squared, of a difference of innovations


@compiled_without_allocation
def measure_gated(f: Any, tuning: Any, sensor: int, i: int, z: float, variance: float, fastest: float) -> None:
    """Take a speed z of x_i unless its sensor is at fault.

    Beyond the gate it is, or further from the last one that was taken than the shaft can get, unless the last ones
    move smoothly (something moves the shaft that the model does not know of), others are beyond it too, or it has
    lasted for the patience of the gate: then the state is opened to them. A speed that is told as zero teaches no
    noise, and does not count among the innovations.

    Args:
        f: `filter.FILTER`.
        tuning: `tuning.TUNING`.
        sensor: 0 engine, 1 and 2 input shafts, 3 driven and 4 undriven wheels.
        i: state.
        z: measurement, rad/s.
        variance: of its noise, (rad/s)².
        fastest: acceleration that the shaft can have, rad/s²; infinite while a synchroniser may do anything to it.
    """
    e = z - told(f, i)
    known = told_variance(f, i)
    noise, late = variance, (tuning.timing_error * f.rate[i]) ** 2
    variance = noise + late
    S = known + variance
    beyond = not e * e <= tuning.gate * S  # also when it is no number
    if beyond and math.isinf(fastest):
        f.P[i, i] += e * e
        take(f, sensor, i, z, variance)
        return
    reach = fastest * (f.t_us - f.accepted_us[sensor]) * 1e-6 + math.sqrt(2.0 * tuning.gate * variance)
    if not beyond and not abs(z - f.accepted[sensor]) > reach:  # before the first there is none to compare with
        noisy = abs(z) > TOLD_AS_ZERO
        if noisy:
            f.taken[sensor] += 1
            f.squares[sensor] += e * e / S
        if noisy and not math.isinf(fastest):
            learn_noise(f, tuning, sensor, e, known + late, noise)
        take(f, sensor, i, z, variance)
        return
    f.rejected[sensor] += 1
    f.beyond[sensor] += 1
    d, last_d = e - f.last_e[sensor, 0], f.last_e[sensor, 0] - f.last_e[sensor, 1]
    f.last_e[sensor, 1], f.last_e[sensor, 0] = f.last_e[sensor, 0], e
    parallel = f.rejected[sensor] > 1 and d * d < _NOISE_OF_CHANGE * 2.0 * S
    smooth = (d - last_d) ** 2 < _NOISE_OF_CHANGE * 6.0 * S
    if f.fault[sensor] == 0 or f.rejected[sensor] == 1:
        f.fault_us[sensor] = f.t_us
    if f.t_us - f.fault_us[sensor] < tuning.patience_us and at_fault(f) < TOO_MANY:
        if parallel:
            blame(f, sensor, _BIASED)
            return
        if f.rejected[sensor] < MOTION or not smooth:
            blame(f, sensor, _SPIKE)
            return
    surprise(f, tuning, sensor, i, e)
    take(f, sensor, i, z, variance)


@compiled_without_allocation
def take(f: Any, sensor: int, i: int, z: float, variance: float) -> None:
    """Take a measurement that is believed."""
    f.fault[sensor] = f.rejected[sensor] = 0
    f.accepted[sensor], f.accepted_us[sensor] = z, f.t_us
    measure(f, i, z, variance)


@compiled_without_allocation
def is_stuck(f: Any, tuning: Any, signal: int, i: int, z: float, variance: float) -> bool:
    """Return whether a value is repeated although the shaft turns faster or slower, or far too often.

    Either only while other signals change: where all are constant, it is they that are made so.
    How often a sound sensor repeats itself while it turns, by its resolution or as its message is the faster, is
    learned; that many repetitions in a row must be less likely than `CHANCE`.

    Signals are the engine, both shafts, and the wheels FL, FR, RL, RR.
    """
    if z != f.last[signal]:
        if abs(z) > _TURNS and f.repeats[signal] < _LONGEST_RUN:
            change = f.repeats[signal] / (f.repeats[signal] + 1.0) - f.repeat_share[signal]
            f.repeat_share[signal] += (_RISING if change > 0.0 else _FALLING) * change
        f.last[signal], f.repeats[signal] = z, 0
        return False
    f.repeats[signal] += 1
    if f.repeats[signal] == 1:
        f.repeat_from[signal] = told(f, i)
    if abs(z) <= _TURNS:
        return False
    moved = told(f, i) - f.repeat_from[signal]
    S = told_variance(f, i) + variance + (tuning.timing_error * f.rate[i]) ** 2
    likely = max(f.repeat_share[signal], _LEAST_SHARE) ** f.repeats[signal]
    return (moved * moved > MOVED * MOVED * S or likely < CHANCE) and others_change(f, signal)


@compiled_without_allocation
def others_change(f: Any, signal: int) -> bool:
    """Return whether at least two other signals have repeated themselves far less: not all is constant."""
    count = 0
    for other in range(len(f.repeats)):
        if not math.isnan(f.last[other]) and 2 * f.repeats[other] < f.repeats[signal]:
            count += 1
    return count >= 2


@compiled_without_allocation
def odd_wheel(f: Any, tuning: Any, axle: int, i: int, left: float, right: float, variance: float) -> int:
    """Return which wheel of an axle has left the other: 0 none, 1 left, 2 right.

    The wheels differ in bends and by their tyres, and that changes slowly. When it jumps, or a wheel falls behind,
    the odd one is the one that repeats itself, else the one further from the prediction; but what lasts for the
    patience of the gate, and can be on a road, is how the wheels differ now.
    The variance is of both noises together.
    """
    usual, wheel = f.spread[axle], _FIRST_WHEEL + 2 * axle
    change = (left - right) - usual
    fast, slow = max(abs(left), abs(right)), min(abs(left), abs(right))
    possible = fast - slow <= LARGEST_SPREAD * fast + _TURNS
    lasting = not f.spread_known[axle] or f.t_us - f.spread_us[axle] > tuning.patience_us
    if lasting and possible:
        f.spread[axle], f.spread_known[axle], f.spread_us[axle] = left - right, True, f.t_us
        return 0
    if not possible and slow <= _TURNS:  # dead, or its signal is
        return 1 if abs(left) < abs(right) else 2
    if abs(change) <= LARGEST_JUMP + math.sqrt(tuning.gate * variance):
        f.spread[axle] += min((f.t_us - f.spread_us[axle]) * _SPREAD_PER_US, 1.0) * change
        f.spread_us[axle] = f.t_us
        return 0
    repeats = f.repeats[wheel] - f.repeats[wheel + 1]
    if abs(repeats) >= _TELLING_REPEATS:
        return 1 if repeats > 0 else 2
    return 1 if abs(left - 0.5 * usual - told(f, i)) > abs(right + 0.5 * usual - told(f, i)) else 2


@compiled_without_allocation
def blame(f: Any, sensor: int, fault: int) -> None:
    """Remember what is wrong with a sensor, and since when."""
    if f.fault[sensor] == 0:
        f.fault_us[sensor] = f.t_us
    f.fault[sensor] = fault


@compiled_without_allocation
def leave_out(f: Any, sensor: int, fault: int) -> None:
    """Blame a sensor whose measurement is not even held against the prediction."""
    blame(f, sensor, fault)
    f.rejected[sensor] = 0


@compiled_without_allocation
def at_fault(f: Any) -> int:
    """Return how many sensors are beyond the gate now; so many at once are not at fault, but the model."""
    count = 0
    for rejected in f.rejected:
        if rejected > 0:
            count += 1
    return count


@compiled_without_allocation
def surprise(f: Any, tuning: Any, sensor: int, i: int, e: float) -> None:
    """Open the state to a motion that the model did not expect: of the speed, and of the torques behind it."""
    f.P[i, i] += e * e
    f.torque_rate[0] = f.torque_rate[1] = tuning.rate[_SLIPPING]
    if 0 < sensor < _FIRST_WHEEL and f.gear[sensor - 1] != 0:
        torque = tuning.J_e * e / max((f.t_us - f.accepted_us[sensor]) * 1e-6, SOONEST)
        for c in range(2):
            f.P[T_C1 + c, T_C1 + c] += torque * torque
    if sensor == _ENGINE:  # then the nominal torque is not what the engine gives
        lasting = max((f.t_us - f.fault_us[sensor]) * 1e-6, 0.01)
        f.P[DT_E, DT_E] += (tuning.J_e * e / lasting) ** 2


@compiled_without_allocation
def forget_lasting_errors(f: Any, tuning: Any) -> None:
    """Forget gain and lag of the nominal torque: what it was lately is no torque that they would explain."""
    forget(f, GAIN, 0.0, tuning.gain_error**2)
    forget(f, LAG_1, 0.0, tuning.lag_error**2)
    forget(f, LAG_2, 0.0, tuning.lag_error**2)
