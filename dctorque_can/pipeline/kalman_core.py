"""What a frame does to the Kalman estimator: time, gears, phases and speeds in this order."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators import kalman, kalman_engine, kalman_faults, kalman_gearbox, kalman_hints, oh2014
from dctorque_can.estimators.kalman import Kalman
from dctorque_can.estimators.kalman_faults import SensorFault
from dctorque_can.estimators.kalman_learning import noise_factor
from dctorque_can.estimators.kalman_model import DT_E, GAIN, W_B, W_C1, W_E, W_W, N
from dctorque_can.estimators.kalman_noise import engine_variance
from dctorque_can.pipeline.core_state import NEVER
from dctorque_can.pipeline.decisions import (
    ACCELERATION,
    BRAKE,
    COMMAND_1,
    ENGINE_SPEED,
    ENGINE_TORQUE,
    GEAR_1,
    GRADE,
    SPEED_1,
    WHEEL,
    braking,
    usable,
    wheel_speeds,
)
from dctorque_can.pipeline.settings import DrivenAxle

BRIDGED_US = 500_000  # for so long the model stands in for an input that is missing
FASTEST_WHEEL = 200.0  # rad/s² of the driven wheels on ice, or locked by brakes
SLIP_VARIANCE = 0.25  # (rad/s)², of driven wheels against the body
SAME_TIME_US = 25_000  # apart, two wheels of an axle can still be compared
_ENGINE, _SHAFT, _DRIVEN, _UNDRIVEN, _TORQUE = 0, 1, 3, 4, 5  # sensors
_REAR_WHEEL = WHEEL + 2
_OPEN = int(ClutchPhase.OPEN)
_NONE, _SPIKE, _STUCK, _BIASED, _MISSING = (int(fault) for fault in SensorFault)
_IMPLAUSIBLE_TORQUE = 4.0  # standard deviations of the nominal engine torque's error


@compiled_without_allocation
def start_kalman(core: Any, rules: Any, k: Kalman) -> None:
    """Start at the present measurements; a shaft without a speed turns with the wheels."""
    f, tuning = k.state[0], k.tuning[0]
    f.t_us = core.t_us
    f.gear[0], f.gear[1] = core.gear[0], core.gear[1]
    _, w_w, _, _, _ = wheel_speeds(core, rules)
    w_1 = shaft_speed(core, rules, tuning, 0, w_w)
    w_2 = shaft_speed(core, rules, tuning, 1, w_w)
    kalman.start(f, tuning, core.value[ENGINE_SPEED], w_1, w_2, w_w, core.value[ENGINE_TORQUE])
    for i in range(2):
        if not rules.mapped[SPEED_1 + i] and core.gear[i] == 0:
            kalman.forget(f, W_C1 + i, core.value[ENGINE_SPEED], 1e4)


@compiled_without_allocation
def shaft_speed(core: Any, rules: Any, tuning: Any, i: int, w_w: float) -> float:
    """Return the speed of an input shaft as the bus or the wheels have it."""
    if rules.mapped[SPEED_1 + i]:
        return float(core.value[SPEED_1 + i])
    return float(tuning.ratio[i, core.gear[i] + 1] * w_w)


@compiled_without_allocation
def seen_lately(core: Any, rules: Any, quantity: int) -> bool:
    """Return whether an input has had a value within the time that the model bridges."""
    seen = core.seen_us[quantity]
    lately = seen != NEVER and core.t_us - seen <= BRIDGED_US + rules.delay_us[quantity]
    return usable(core, quantity) or (bool(core.available[quantity]) and lately)


@compiled_without_allocation
def may_start(core: Any, rules: Any) -> bool:
    """Return whether all is there that a start needs: engine, gears, a wheel, and the shafts that the bus has."""
    known, w_d, wheels, _, _ = wheel_speeds(core, rules)
    expects_gears = bool(rules.infer_gears) and known and abs(w_d) < oh2014.STANDSTILL
    complete = wheels and usable(core, ENGINE_SPEED) and usable(core, ENGINE_TORQUE)
    for i in range(2):
        complete &= usable(core, SPEED_1 + i) or not rules.mapped[SPEED_1 + i]
        complete &= bool(core.gear_known[i]) or expects_gears  # while unknown, gear 0 is not neutral
    return complete


@compiled_without_allocation
def may_go_on(core: Any, rules: Any) -> bool:
    """Return whether a running filter has seen all that it needs lately."""
    wheels = False
    for quantity in range(WHEEL, WHEEL + 4):
        wheels |= seen_lately(core, rules, quantity)
    complete = wheels and seen_lately(core, rules, ENGINE_SPEED) and seen_lately(core, rules, ENGINE_TORQUE)
    for i in range(2):
        complete &= seen_lately(core, rules, SPEED_1 + i) or not rules.mapped[SPEED_1 + i]
        complete &= seen_lately(core, rules, GEAR_1 + i) or rules.infer_gears
    return complete


@compiled_without_allocation
def act_kalman(core: Any, rules: Any, k: Kalman) -> None:
    """Let one whole frame take effect at the time of the grid."""
    f, tuning, tables = k.state[0], k.tuning[0], k.tables
    if not f.running:
        if not may_start(core, rules):
            return
        start_kalman(core, rules, k)
    elif not may_go_on(core, rules):
        f.running = False  # held: the torques stay as they are until the inputs are back
        return
    phase_1, phase_2 = phase_of(core, 0), phase_of(core, 1)
    stands = abs(f.x[W_B]) < oh2014.STANDSTILL
    before_us = f.t_us
    kalman.predict(f, tables, tuning, phase_1, phase_2, braking(core), stands, core.t_us)
    take_torque(core, f, tuning, (f.t_us - before_us) * 1e-6)
    kalman_gearbox.change_gears(f, tuning, core.gear[0], core.gear[1])
    kalman_gearbox.apply_phases(f, tuning, phase_1 == _OPEN, phase_2 == _OPEN)
    measure_speed(core, rules, f, tuning, ENGINE_SPEED, _ENGINE, W_E, tuning.fastest_engine)
    for i in range(2):
        fastest = FASTEST_WHEEL * abs(tuning.ratio[i, core.gear[i] + 1]) if core.gear[i] != 0 else math.inf
        measure_speed(core, rules, f, tuning, SPEED_1 + i, _SHAFT + i, W_C1 + i, fastest)
    rear = rules.driven_axle == DrivenAxle.REAR
    measure_axle(core, f, tuning, WHEEL, not rear, _UNDRIVEN if rear else _DRIVEN)
    measure_axle(
        core, f, tuning, _REAR_WHEEL, rules.driven_axle != DrivenAxle.FRONT, _DRIVEN if rear else _UNDRIVEN
    )
    stand_in_for_undriven(core, rules, f)
    take_hints(core, f, tuning, phase_1, phase_2)
    kalman_gearbox.decide_directions(f, tuning, phase_1, phase_2)
    kalman_gearbox.conclude(f, tables, tuning)


@compiled_without_allocation
def take_hints(core: Any, f: Any, tuning: Any, phase_1: int, phase_2: int) -> None:
    """Take new hints at torques; those of the road only while the brake is known to be off."""
    rolls = usable(core, BRAKE) and not braking(core) and abs(f.x[W_B]) >= oh2014.STANDSTILL
    if core.fresh[ACCELERATION] and rolls:
        kalman_hints.take_acceleration(f, tuning, core.value[ACCELERATION])
    if core.fresh[GRADE] and rolls:
        kalman_hints.take_grade(f, tuning, core.value[GRADE])
    if math.isnan(tuning.command_share):
        return
    for i in range(2):
        if core.fresh[COMMAND_1 + i]:
            kalman_hints.take_command(f, tuning, i, phase_1 if i == 0 else phase_2, core.value[COMMAND_1 + i])


@compiled_without_allocation
def phase_of(core: Any, i: int) -> int:
    """Return the phase of a clutch; in neutral it carries nothing."""
    return int(core.phase[i]) if core.gear[i] != 0 else _OPEN


@compiled_without_allocation
def take_torque(core: Any, f: Any, tuning: Any, seconds: float) -> None:
    """Take a new nominal engine torque, or let the old one age; judge it by the error that the speeds tell of."""
    spike = False
    if core.fresh[ENGINE_TORQUE]:
        taken, spike = kalman_engine.judge_jump(f, core.value[ENGINE_TORQUE])
        if taken:
            kalman_engine.take_engine_torque(f, tuning, core.value[ENGINE_TORQUE])
    if core.stale[ENGINE_TORQUE]:
        kalman_engine.let_engine_torque_age(f, tuning, seconds)
        kalman_faults.blame(f, _TORQUE, _MISSING)
        return
    error = f.x[DT_E] + f.T_en * f.x[GAIN]
    variance = engine_variance(tuning, f.T_en) + (tuning.gain_error * f.T_en) ** 2
    if error * error > _IMPLAUSIBLE_TORQUE**2 * (variance + f.P[DT_E, DT_E]):
        kalman_faults.blame(f, _TORQUE, _BIASED)
        kalman_faults.forget_lasting_errors(f, tuning)
    elif spike:
        kalman_faults.blame(f, _TORQUE, _SPIKE)
    elif core.fresh[ENGINE_TORQUE]:
        f.fault[_TORQUE] = _NONE


@compiled_without_allocation
def measure_speed(
    core: Any, rules: Any, f: Any, tuning: Any, quantity: int, sensor: int, state: int, fastest: float
) -> None:
    """Take a speed that is new; say when it has been missing or is stuck."""
    z, variance = core.value[quantity], tuning.speed_variance[sensor] * noise_factor(f, tuning, sensor)
    if core.fresh[quantity]:
        stuck = kalman_faults.is_stuck(f, tuning, sensor, state, z, variance)
        if stuck and not math.isinf(fastest):  # in neutral a shaft may keep its speed whatever is predicted
            kalman_faults.leave_out(f, sensor, _STUCK)
            f.beyond[sensor] += 1
        else:
            kalman_faults.measure_gated(f, tuning, sensor, state, z, variance, fastest)
    elif core.stale[quantity] and rules.mapped[quantity]:
        kalman_faults.leave_out(f, sensor, _MISSING)


@compiled_without_allocation
def stand_in_for_undriven(core: Any, rules: Any, f: Any) -> None:
    """Let the driven wheels tell of the body, within their slip, when no wheel is there that rolls with it."""
    undriven = WHEEL if rules.driven_axle == DrivenAxle.REAR else _REAR_WHEEL
    rolls = usable(core, undriven) or usable(core, undriven + 1)
    if rolls and rules.driven_axle != DrivenAxle.ALL:
        return
    _, _, _, speed, fresh = wheel_speeds(core, rules)
    if fresh:
        kalman.measure(f, W_B, speed, SLIP_VARIANCE)


@compiled_without_allocation
def near_in_time(core: Any, left: int) -> bool:
    """Return whether the wheels of an axle, in messages of their own, have been seen at nearly the same time."""
    both = usable(core, left) and usable(core, left + 1)
    return both and abs(core.seen_us[left] - core.seen_us[left + 1]) <= SAME_TIME_US


@compiled_without_allocation
def measure_axle(core: Any, f: Any, tuning: Any, left: int, driven: bool, sensor: int) -> None:
    """Take the new wheel speeds of an axle: their mean, or one corrected for its usual distance from the other."""
    state, axle = W_W if driven else W_B, (left - WHEEL) // 2
    there_l, there_r = bool(core.fresh[left]), bool(core.fresh[left + 1])
    if not there_l and not there_r:
        if core.stale[left] or core.stale[left + 1]:
            kalman_faults.leave_out(f, sensor, _MISSING)
        return
    w_l, w_r, fault = core.value[left], core.value[left + 1], 0
    signal = _SHAFT + 2 + left - WHEEL
    factor = noise_factor(f, tuning, sensor)
    variance_l, variance_r = factor * tuning.speed_variance[signal], factor * tuning.speed_variance[signal + 1]
    if there_l and kalman_faults.is_stuck(f, tuning, signal, state, w_l, variance_l):
        there_l, fault = False, _STUCK
    if there_r and kalman_faults.is_stuck(f, tuning, signal + 1, state, w_r, variance_r):
        there_r, fault = False, _STUCK
    if fault == 0 and ((there_l and there_r) or near_in_time(core, left)):
        odd = kalman_faults.odd_wheel(f, tuning, axle, state, w_l, w_r, variance_l + variance_r)
        there_l, there_r = there_l and odd != 1, there_r and odd != 2
        if odd != 0:
            fault = _SPIKE
    if fault == 0 and (core.stale[left] or core.stale[left + 1]):
        fault = _MISSING
    usual = 0.5 * f.spread[axle] if f.spread_known[axle] else 0.0
    if not there_l and not there_r:
        f.rejected[sensor] = 0  # of the mean
        f.beyond[sensor] += 1
    elif there_l and there_r:
        mean, variance = 0.5 * (w_l + w_r), 0.25 * (variance_l + variance_r)
        kalman_faults.measure_gated(f, tuning, sensor, state, mean, variance, FASTEST_WHEEL)
    elif there_l:
        z = alone(w_l, -usual)
        kalman_faults.measure_gated(f, tuning, sensor, state, z, variance_l, FASTEST_WHEEL)
    else:
        z = alone(w_r, usual)
        kalman_faults.measure_gated(f, tuning, sensor, state, z, variance_r, FASTEST_WHEEL)
    if fault != 0:
        kalman_faults.blame(f, sensor, fault)


@compiled_without_allocation
def alone(speed: float, correction: float) -> float:
    """Return an axle's speed by one wheel, corrected for its usual distance from the mean unless it stands."""
    return speed + correction if abs(speed) > kalman_faults.TOLD_AS_ZERO else 0.0


@compiled_without_allocation
def kalman_finite(f: Any) -> bool:
    """Return whether every state and variance is a number, and no variance is negative."""
    total, smallest = 0.0, 0.0
    for i in range(N):
        total += f.x[i] + f.P[i, i]
        smallest = min(smallest, f.P[i, i])
    return math.isfinite(total) and smallest >= 0.0


@compiled_without_allocation
def engine_speed(core: Any, f: Any) -> float:
    """Return the engine speed as far as it is known."""
    return float(f.x[W_E]) if f.running else float(core.value[ENGINE_SPEED])


@compiled_without_allocation
def stand_in_for_shafts(core: Any, f: Any) -> None:
    """Let the filter's speed stand for that of a shaft that the frame does not tell, so that it can be judged."""
    for i in range(2):
        if f.running and not core.fresh[SPEED_1 + i]:
            core.w_c[i] = f.x[W_C1 + i]
