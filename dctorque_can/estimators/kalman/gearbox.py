"""What is known of the gearbox, as the filter uses it: phases, gears, and what is published.

Torques in N·m, speeds in rad/s.
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.kalman import ratios
from dctorque_can.estimators.kalman.faults import SOONEST
from dctorque_can.estimators.kalman.filter import forget, measure, measure_open
from dctorque_can.estimators.kalman.model import (
    DT_E,
    OUTPUT,
    R_1,
    T_C1,
    T_C2,
    T_V,
    T_X,
    TH_O,
    TH_T1,
    W_C1,
    W_D,
    W_O,
    Tables,
)
from dctorque_can.estimators.kalman.noise import engine_variance

_OPEN, _SLIPPING, _LOCKED = (int(phase) for phase in ClutchPhase)
_NEUTRAL_TRUST = 100.0  # variances: so weakly that it only keeps a synchroniser's torque from running away
_ROLLING = 4.0  # rad/s/√s at the wheel by which a car may be faster or slower than its speeds let one think
_ANY_TWIST, _ANY_LOAD, _ANY_TORQUE = 0.05, 2000.0, 200.0  # rad and N·m, as at a start
_TURNED = 0.1  # (rad/s)², variance at the wheel of speeds that have been turned round


@compiled_without_allocation
def apply_phases(f: Any, tuning: Any, open_1: bool, open_2: bool) -> None:
    """An open clutch carries its drag, and its torque does not change; a synchroniser has no torque for long."""
    for i in range(2):
        if f.gear[i] == 0:
            measure(f, T_C1 + i, 0.0, _NEUTRAL_TRUST * tuning.neutral[i] ** 2)
        elif open_1 if i == 0 else open_2:
            slip = f.x[W_D] - f.x[W_C1 + i]
            lasting, rate = open_deviation(tuning, slip), tuning.rate[_OPEN]
            measure_open(f, i, tuning.drag[i] * slip, tuning.open_torque**2, lasting, rate**2)


@compiled_without_allocation
def open_deviation(tuning: Any, slip: float) -> float:
    """Return the standard deviation of an open clutch's torque around its drag, N·m."""
    return math.sqrt(tuning.open_torque**2 + (tuning.drag_error * slip) ** 2)


@compiled_without_allocation
def let_roll(f: Any, tuning: Any, seconds: float) -> None:
    """Let the car be faster or slower than before: a speed without sign says nothing of its acceleration.

    Wheels, output shaft and shafts in gear are made uncertain together, so that what is known of their slip and
    twist stays.
    """
    variance = _ROLLING * _ROLLING * seconds
    for a in range(5):
        i, share = _rolling_state(f, tuning, a)
        for b in range(5):
            j, other = _rolling_state(f, tuning, b)
            f.P[i, j] += variance * share * other


@compiled_without_allocation
def _rolling_state(f: Any, tuning: Any, k: int) -> tuple[int, float]:
    """Return the k-th of the states that a rolling car turns, and how fast it turns with the wheels."""
    if k < 2:
        return W_C1 + k, float(tuning.ratio[k, f.gear[k] + 1])  # zero in neutral
    return W_O + k - 2, 1.0


@compiled_without_allocation
def turn_round(f: Any, tuning: Any) -> None:
    """Turn the speeds of the car: it goes the other way than was taken for granted."""
    for k in range(5):
        i, share = _rolling_state(f, tuning, k)
        if share != 0.0:
            forget(f, i, -f.x[i], share * share * _TURNED)
    for sensor in range(1, len(f.accepted)):  # shafts and wheels
        f.accepted[sensor] = math.nan


@compiled_without_allocation
def begin_shaft_anew(f: Any, tuning: Any, i: int, speed: float, variance: float) -> None:
    """Let a shaft in gear turn as it is told after all, behind a driveline of which nothing else is known."""
    forget(f, W_C1 + i, speed, variance)
    forget(f, TH_T1 + i, 0.0, _ANY_TWIST**2)
    forget(f, TH_O, 0.0, _ANY_TWIST**2)
    forget(f, T_X, 0.0, _ANY_LOAD**2)
    forget(f, T_V, 0.0, _ANY_LOAD**2)
    forget(f, T_C1 + i, 0.0, _ANY_TORQUE**2)
    forget(f, R_1 + i, 0.0, tuning.sliding_rate**2)
    forget(f, DT_E, 0.0, engine_variance(tuning, f.T_en))


@compiled_without_allocation
def change_gears(f: Any, tuning: Any, g1: int, g2: int) -> None:
    """Take new gears: a transfer shaft starts untwisted, and what its input shaft did before says nothing."""
    for i in range(2):
        gear = g1 if i == 0 else g2
        if gear != f.gear[i]:
            change_gear(f, tuning, i, gear)


@compiled_without_allocation
def change_gear(f: Any, tuning: Any, i: int, gear: int) -> None:
    """Take the new gear of one shaft."""
    engage(f, tuning, i, gear)
    forget(f, TH_T1 + i, 0.0, 1e-6)
    forget(f, W_C1 + i, f.x[W_C1 + i], 1e4)
    # the clutch is open, but the frame that says so may come late
    torque, rate = tuning.open_torque, tuning.rate[_OPEN]
    if gear == 0:
        torque, rate = tuning.neutral[i], tuning.neutral_rate[i]
        # a synchroniser is about to pull, and shakes the other clutch
        f.torque_rate[1 - i] = max(f.torque_rate[1 - i], tuning.rate[_LOCKED])
    forget(f, T_C1 + i, 0.0, torque**2)
    forget(f, R_1 + i, 0.0, rate**2)


@compiled_without_allocation
def engage(f: Any, tuning: Any, i: int, gear: int) -> None:
    """Let a gear be in on shaft i, whose ratio has an error of its own."""
    ratios.remember(f, i)
    f.gear[i], f.ratio[i] = gear, tuning.ratio[i, gear + 1]
    ratios.recall(f, tuning, i)


@compiled_without_allocation
def work_out_torques(f: Any, tables: Tables, tuning: Any) -> None:
    """Work out the published torques; in neutral a clutch has its drag alone."""
    f.T_c1, f.T_c2 = f.x[T_C1], f.x[T_C2]
    if f.gear[0] == 0:
        f.T_c1 = tuning.drag[0] * (f.x[W_D] - f.x[W_C1])
    if f.gear[1] == 0:
        f.T_c2 = tuning.drag[1] * (f.x[W_D] - f.x[W_C1 + 1])
    T_o = 0.0
    for i in OUTPUT:
        T_o += tables.output[i] * f.x[i]
    f.T_o = T_o


@compiled_without_allocation
def work_out_deviations(f: Any, tables: Tables, tuning: Any) -> None:
    """Work out what is known of the published torques, errors that last included."""
    variance_1, variance_2, product = f.P[T_C1, T_C1], f.P[T_C2, T_C2], f.P[T_C1, T_C2]
    variance = 0.0
    for i in OUTPUT:
        for j in OUTPUT:
            variance += tables.output[i] * tables.output[j] * f.P[i, j]
    for c in range(2):
        s, s_o = f.lasting[c], 0.0
        variance_1 += s[T_C1] ** 2
        variance_2 += s[T_C2] ** 2
        product += s[T_C1] * s[T_C2]
        for i in OUTPUT:
            s_o += tables.output[i] * s[i]
        variance += s_o**2
    f.sigma_1, f.sigma_2 = math.sqrt(max(variance_1, 0.0)), math.sqrt(max(variance_2, 0.0))
    f.sigma_o = math.sqrt(max(variance, 0.0))
    both = f.sigma_1 * f.sigma_2
    f.correlation = product / both if both > 0.0 else 0.0
    if f.gear[0] == 0:
        f.sigma_1 = open_deviation(tuning, f.x[W_D] - f.x[W_C1])
    if f.gear[1] == 0:
        f.sigma_2 = open_deviation(tuning, f.x[W_D] - f.x[W_C1 + 1])
    if f.gear[0] == 0 or f.gear[1] == 0:
        f.correlation = 0.0


@compiled_without_allocation
def admit_motion(f: Any, tuning: Any, phase_1: int, phase_2: int) -> None:
    """Let the torques be as uncertain as speeds make them that are not believed, should they be true.

    A first speed beyond its gate is taken for a spike; a clutch that gives way looks the same until the next ones
    come. It would be the torque that turns the engine's inertia by so much since the last speed that was believed.
    """
    for sensor in range(1, 3):
        if f.rejected[sensor] == 0 or f.gear[sensor - 1] == 0:
            continue
        seconds = max((f.t_us - f.accepted_us[sensor]) * 1e-6, SOONEST)
        torque = tuning.J_e * f.last_e[sensor, 0] / seconds
        if phase_1 != _OPEN:
            f.sigma_1 = math.hypot(f.sigma_1, torque)
        if phase_2 != _OPEN:
            f.sigma_2 = math.hypot(f.sigma_2, torque)
        f.sigma_o = math.hypot(f.sigma_o, torque * tuning.ratio[sensor - 1, f.gear[sensor - 1] + 1])


@compiled_without_allocation
def let_touch(f: Any, tuning: Any, inputs: Any, open_1: bool, open_2: bool) -> None:
    """Take how much torque clutches may carry before their kissing points, if they are called open.

    The pressure of plates grows with the square of their travel, or nearly so. One that closes may have begun to.
    """
    for i in range(2):
        touch = tuning.touch_torque * inputs.touches[i] ** 2
        if open_1 if i == 0 else open_2:
            f.touch[i] = touch
        elif f.touch[i] > 0.0:
            f.P[T_C1 + i, T_C1 + i] += touch**2
            f.touch[i] = 0.0


@compiled_without_allocation
def admit_touch(f: Any, tuning: Any, phase_1: int, phase_2: int) -> None:
    """Let the torques be as uncertain as a clutch makes them that is called open and may touch.

    What it carries is taken from the other clutch, or from what is known of the engine.
    """
    for i in range(2):
        other = phase_2 if i == 0 else phase_1
        if (phase_1 if i == 0 else phase_2) != _OPEN or f.gear[i] == 0 or f.touch[i] == 0.0:
            continue
        torque, ratio = f.touch[i], tuning.ratio[i, f.gear[i] + 1]
        if other != _OPEN:
            ratio -= tuning.ratio[1 - i, f.gear[1 - i] + 1]
        f.sigma_o = math.hypot(f.sigma_o, ratio * torque)
        if i == 0 or other != _OPEN:
            f.sigma_1 = math.hypot(f.sigma_1, torque)
        if i == 1 or other != _OPEN:
            f.sigma_2 = math.hypot(f.sigma_2, torque)


@compiled_without_allocation
def admit_synchronisers(f: Any, tuning: Any, phase_1: int, phase_2: int) -> None:
    """Let what is published be as uncertain as a synchroniser makes it that may begin to pull at any moment.

    It pulls within milliseconds, a locked clutch on the other shaft and the output shaft carry it at once, and no
    signal says when. The speeds show it 10 to 20 ms later; until then the estimate is off by that torque.
    """
    for i in range(2):
        if f.gear[i] != 0:
            continue
        at_wheel = tuning.synchroniser_torque * tuning.synchroniser_ratio[i]
        f.sigma_o = math.hypot(f.sigma_o, at_wheel)
        gear = f.gear[1 - i]
        if gear != 0 and (phase_2 if i == 0 else phase_1) == _LOCKED:
            jump = at_wheel / abs(tuning.ratio[1 - i, gear + 1])
            if i == 0:
                f.sigma_2 = math.hypot(f.sigma_2, jump)
            else:
                f.sigma_1 = math.hypot(f.sigma_1, jump)
