"""What a frame does to the Kalman estimator: time, gears, phases and speeds in this order; and what it answers."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import DrivenAxle, Vehicle
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators import contract
from dctorque_can.estimators.inputs import (
    ACCELERATION,
    BRAKE,
    COMMAND_1,
    ENGINE_SPEED,
    ENGINE_TORQUE,
    GEAR,
    GEAR_1,
    GRADE,
    SPEED_1,
    STANDSTILL,
    WHEEL,
    braking,
    may_brake,
    phase_of,
    usable,
    wheel_speeds,
)
from dctorque_can.estimators.kalman import answers, engine, faults, gearbox, hints, losses, one_gear, ratios
from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman.design import KalmanDesign
from dctorque_can.estimators.kalman.faults import SensorFault
from dctorque_can.estimators.kalman.filter import Kalman
from dctorque_can.estimators.kalman.learning import noise_factor
from dctorque_can.estimators.kalman.magnitudes import measure_magnitude
from dctorque_can.estimators.kalman.model import DT_E, GAIN, LATE, W_B, W_C1, W_D, W_E, W_W, N
from dctorque_can.estimators.kalman.noise import engine_variance
from dctorque_can.estimators.kalman.thresholds import BRIDGED_US, FASTEST_WHEEL, FIRES, IMPLAUSIBLE_TORQUE
from dctorque_can.estimators.kalman.wheels import measure_axle, measure_either_way, stand_in_for_undriven
from dctorque_can.pipeline.samples import Signs

_ENGINE, _SHAFT, _DRIVEN, _UNDRIVEN, _TORQUE = 0, 1, 3, 4, 5  # sensors
_REAR_WHEEL = WHEEL + 2
_SLOW = 2.0  # rad/s at the wheel, below which a shaft winds up or rings the other way than the car goes
_SIGNED = int(Signs.SIGNED)
_OPEN = int(ClutchPhase.OPEN)
_NONE, _SPIKE, _STUCK, _BIASED, _MISSING = (int(fault) for fault in SensorFault)


def new(vehicle: Vehicle, design: KalmanDesign) -> Kalman:
    """Return the estimator of a vehicle; see `filter.new`."""
    return kalman.new(vehicle, design)


@compiled_without_allocation
def start(k: Kalman, answer: Any) -> None:
    """Become as new; what is published next must be a number again."""
    f = k.state[0]
    f.gear[0] = f.gear[1] = 0
    kalman.start(f, k.tuning[0], 0.0, 0.0, 0.0, 0.0, 0.0)
    f.running = False
    f.w_c[0] = f.w_c[1] = 0.0
    give_answer(k, answer)


@compiled_without_allocation
def stop(k: Kalman, answer: Any) -> None:
    """Hold the torques; no sensor is at fault that is not there."""
    f = k.state[0]
    f.running = answer.running = False
    for signal in range(len(f.fault)):
        f.fault[signal] = 0


@compiled_without_allocation
def advance(k: Kalman, inputs: Any, answer: Any, t_us: int) -> None:
    """Carry shaft speeds on with the car; the filter predicts in `act`, when it knows the clutches' phases."""
    f, ratio = k.state[0], k.tuning[0].ratio
    if f.running and t_us > inputs.t_us:
        dt = (t_us - inputs.t_us) * 1e-6
        for i in range(2):
            if inputs.mapped[SPEED_1 + i]:
                f.w_c[i] += dt * f.rate[W_B] * ratio[i, f.gear[i] + 1]  # zero in neutral
                answer.w_c[i] = f.w_c[i]


@compiled_without_allocation
def act(k: Kalman, inputs: Any, answer: Any) -> None:
    """Let a whole frame take effect at ``inputs.t_us``, and answer."""
    f = k.state[0]
    if not f.running:
        if not may_start(inputs):
            return
        begin(inputs, k)
    elif not may_go_on(inputs):
        f.running = answer.running = False  # held: the torques stay as they are until the inputs are back
        return
    take_frame(k, inputs)
    for i in range(2):
        f.w_c[i] = inputs.w_c[i] if inputs.mapped[SPEED_1 + i] else f.x[W_C1 + i]
    give_answer(k, answer)


@compiled_without_allocation
def take_frame(k: Kalman, inputs: Any) -> None:
    """Predict to the present and take what is new."""
    f, tuning = k.state[0], k.tuning[0]
    phase_1, phase_2 = phase_of(inputs, 0), phase_of(inputs, 1)
    stands = abs(f.x[W_B]) < STANDSTILL
    before_us = f.t_us
    f.idle[0], f.idle[1] = inputs.idle[0], inputs.idle[1]
    kalman.predict(f, k.tables, tuning, phase_1, phase_2, may_brake(inputs), stands, inputs.t_us)
    seconds = (f.t_us - before_us) * 1e-6
    take_torque(inputs, f, tuning, seconds)
    if inputs.one_gear:
        one_gear.change_gears(f, tuning, inputs)
    else:
        gearbox.change_gears(f, tuning, inputs.gear[0], inputs.gear[1])
    one_gear.expect_open(f, seconds)
    gearbox.let_touch(f, tuning, inputs, phase_1 == _OPEN, phase_2 == _OPEN)
    gearbox.apply_phases(f, tuning, phase_1 == _OPEN, phase_2 == _OPEN)
    take_direction(inputs, f, tuning, stands, seconds)
    measure_speed(inputs, f, tuning, ENGINE_SPEED, _ENGINE, W_E, tuning.fastest_engine)
    for i in range(2):
        measure_shaft(inputs, f, tuning, i, stands, seconds)
    measure_wheels(inputs, f, tuning, seconds)
    take_hints(inputs, f, tuning, phase_1, phase_2)
    losses.decide_directions(f, tuning, phase_1, phase_2)


@compiled_without_allocation
def take_direction(inputs: Any, f: Any, tuning: Any, stands: bool, seconds: float) -> None:
    """Take which way the car goes: while that is not known it may roll either way, unless brakes hold it."""
    if inputs.direction == 0 and not (stands and braking(inputs)):
        gearbox.let_roll(f, tuning, seconds)
    elif inputs.magnitudes and inputs.heading != f.heading and f.x[W_B] * inputs.heading < 0.0:
        gearbox.turn_round(f, tuning)
    f.heading = inputs.heading


@compiled_without_allocation
def measure_shaft(inputs: Any, f: Any, tuning: Any, i: int, stands: bool, seconds: float) -> None:
    """Take a new speed of input shaft i (0, 1); of one in gear that is told without sign, what it may mean."""
    quantity, sensor, state = SPEED_1 + i, _SHAFT + i, W_C1 + i
    if inputs.gear[i] == 0:
        measure_speed(inputs, f, tuning, quantity, sensor, state, math.inf)
        return
    if inputs.gear_unsure[i]:
        return  # it may turn as it likes
    ratio, sure, z = tuning.ratio[i, inputs.gear[i] + 1], inputs.direction != 0, inputs.value[quantity]
    slow = abs(z) < _SLOW * abs(ratio) if sure else stands
    if inputs.signs[quantity] != _SIGNED and slow:
        measure_magnitude(inputs, f, tuning, quantity, sensor, state, FASTEST_WHEEL * abs(ratio))
    elif sure:
        measure_speed(inputs, f, tuning, quantity, sensor, state, FASTEST_WHEEL * abs(ratio))
    elif inputs.fresh[quantity]:
        _, _, _, body, _ = wheel_speeds(inputs)
        measure_either_way(f, state, z, ratio, body, seconds)


@compiled_without_allocation
def measure_wheels(inputs: Any, f: Any, tuning: Any, seconds: float) -> None:
    """Take new wheel speeds; of driven wheels, while nobody knows which way they go, what they may mean."""
    sure, rear = inputs.direction != 0, inputs.driven_axle == DrivenAxle.REAR
    if sure or rear:
        measure_axle(inputs, f, tuning, WHEEL, not rear, _UNDRIVEN if rear else _DRIVEN)
    if sure or inputs.driven_axle == DrivenAxle.FRONT:
        driven = inputs.driven_axle != DrivenAxle.FRONT
        measure_axle(inputs, f, tuning, _REAR_WHEEL, driven, _DRIVEN if rear else _UNDRIVEN)
    stand_in_for_undriven(inputs, f)
    if not sure:
        known, driven_speed, _, body, _ = wheel_speeds(inputs)
        if known:
            measure_either_way(f, W_W, driven_speed, 1.0, body, seconds)


@compiled_without_allocation
def give_answer(k: Kalman, answer: Any) -> None:
    """Say what every frame has an answer to."""
    f = k.state[0]
    gearbox.work_out_torques(f, k.tables, k.tuning[0])
    answer.running, answer.reset_us = f.running, f.reset_us
    answer.T_c[0], answer.T_c[1] = f.T_c1, f.T_c2
    answer.w_e = f.x[W_E]
    answer.wheels_late, answer.wheels_late_sigma = f.x[LATE], math.sqrt(max(f.P[LATE, LATE], 0.0))
    for i in range(2):
        answer.w_c[i] = f.w_c[i]
        answer.slip[i] = f.x[W_D] - f.x[W_C1 + i]


@compiled_without_allocation
def begin(inputs: Any, k: Kalman) -> None:
    """Start at the present measurements; a shaft without a speed turns with the wheels."""
    f, tuning = k.state[0], k.tuning[0]
    f.t_us = inputs.t_us
    for i in range(2):
        ratios.remember(f, i)
        f.gear[i] = inputs.gear[i]
    f.heading = inputs.heading
    _, w_w, _, _, _ = wheel_speeds(inputs)
    w_1 = shaft_speed(inputs, tuning, 0, w_w)
    w_2 = shaft_speed(inputs, tuning, 1, w_w)
    kalman.start(f, tuning, inputs.value[ENGINE_SPEED], w_1, w_2, w_w, inputs.value[ENGINE_TORQUE])
    for i in range(2):
        ratios.recall(f, tuning, i)
        if not inputs.mapped[SPEED_1 + i] and inputs.gear[i] == 0:
            kalman.forget(f, W_C1 + i, inputs.value[ENGINE_SPEED], 1e4)


@compiled_without_allocation
def shaft_speed(inputs: Any, tuning: Any, i: int, w_w: float) -> float:
    """Return the speed of an input shaft as the bus or the wheels have it."""
    if inputs.mapped[SPEED_1 + i]:
        return float(inputs.value[SPEED_1 + i])
    return float(tuning.ratio[i, inputs.gear[i] + 1] * w_w)


@compiled_without_allocation
def seen_lately(inputs: Any, quantity: int) -> bool:
    """Return whether an input has had a value within the time that the model bridges."""
    seen = inputs.seen_us[quantity]
    lately = seen != NEVER and inputs.t_us - seen <= BRIDGED_US + inputs.delay_us[quantity]
    return usable(inputs, quantity) or (bool(inputs.available[quantity]) and lately)


@compiled_without_allocation
def may_start(inputs: Any) -> bool:
    """Return whether all is there that a start needs: engine, gears, a wheel, and the shafts that the bus has."""
    known, w_d, wheels, _, _ = wheel_speeds(inputs)
    expects_gears = bool(inputs.infer_gears) and known and abs(w_d) < STANDSTILL
    complete = wheels and usable(inputs, ENGINE_SPEED) and usable(inputs, ENGINE_TORQUE)
    for i in range(2):
        complete &= usable(inputs, SPEED_1 + i) or not inputs.mapped[SPEED_1 + i]
        complete &= bool(inputs.gear_known[i]) or expects_gears  # while unknown, gear 0 is not neutral
    return complete


@compiled_without_allocation
def may_go_on(inputs: Any) -> bool:
    """Return whether a running filter has seen all that it needs lately."""
    wheels = False
    for quantity in range(WHEEL, WHEEL + 4):
        wheels |= seen_lately(inputs, quantity)
    complete = wheels and seen_lately(inputs, ENGINE_SPEED) and seen_lately(inputs, ENGINE_TORQUE)
    for i in range(2):
        complete &= seen_lately(inputs, SPEED_1 + i) or not inputs.mapped[SPEED_1 + i]
        complete &= seen_lately(inputs, GEAR if inputs.one_gear else GEAR_1 + i) or inputs.infer_gears
    return complete


@compiled_without_allocation
def take_hints(inputs: Any, f: Any, tuning: Any, phase_1: int, phase_2: int) -> None:
    """Take new hints at torques; those of the road only while the brake is known to be off."""
    rolls = usable(inputs, BRAKE) and not braking(inputs) and abs(f.x[W_B]) >= STANDSTILL
    if inputs.fresh[ACCELERATION] and rolls:
        hints.take_acceleration(f, tuning, inputs.value[ACCELERATION])
    if inputs.fresh[GRADE] and rolls:
        hints.take_grade(f, tuning, inputs.value[GRADE])
    if math.isnan(tuning.command_share):
        return
    for i in range(2):
        if inputs.fresh[COMMAND_1 + i]:
            hints.take_command(f, tuning, i, phase_1 if i == 0 else phase_2, inputs.value[COMMAND_1 + i])


@compiled_without_allocation
def take_torque(inputs: Any, f: Any, tuning: Any, seconds: float) -> None:
    """Take a new nominal engine torque, or let the old one age; judge it by the error that the speeds tell of.

    An engine that does not fire is stopped by its drag, or turned by a starter that no signal tells of.
    """
    spike = False
    if f.x[W_E] < FIRES:
        engine.take_no_torque(f)
        engine.let_engine_torque_age(f, tuning, seconds)
        return
    if inputs.fresh[ENGINE_TORQUE]:
        taken, spike = engine.judge_jump(f, inputs.value[ENGINE_TORQUE])
        if taken:
            engine.take_engine_torque(f, tuning, inputs.value[ENGINE_TORQUE])
    if inputs.stale[ENGINE_TORQUE]:
        engine.let_engine_torque_age(f, tuning, seconds)
        faults.blame(f, _TORQUE, _MISSING)
        return
    error = f.x[DT_E] + f.T_en * f.x[GAIN]
    variance = engine_variance(tuning, f.T_en) + (tuning.gain_error * f.T_en) ** 2
    if error * error > IMPLAUSIBLE_TORQUE**2 * (variance + f.P[DT_E, DT_E]):
        faults.blame(f, _TORQUE, _BIASED)
        faults.forget_lasting_errors(f, tuning)
    elif spike:
        faults.blame(f, _TORQUE, _SPIKE)
    elif inputs.fresh[ENGINE_TORQUE]:
        f.fault[_TORQUE] = _NONE


@compiled_without_allocation
def measure_speed(
    inputs: Any, f: Any, tuning: Any, quantity: int, sensor: int, state: int, fastest: float
) -> None:
    """Take a speed that is new; say when it has been missing or is stuck."""
    z, variance = inputs.value[quantity], tuning.speed_variance[sensor] * noise_factor(f, tuning, sensor)
    if inputs.fresh[quantity]:
        stuck = faults.is_stuck(f, tuning, sensor, state, z, variance)
        if stuck and not math.isinf(fastest):  # in neutral a shaft may keep its speed whatever is predicted
            faults.leave_out(f, sensor, _STUCK)
            f.beyond[sensor] += 1
        else:
            faults.measure_gated(f, tuning, sensor, state, z, variance, fastest)
    elif inputs.stale[quantity] and inputs.mapped[quantity]:
        faults.leave_out(f, sensor, _MISSING)


@compiled_without_allocation
def is_finite(k: Kalman) -> bool:
    """Return whether every state and variance is a number, and no variance is negative."""
    f = k.state[0]
    total, smallest = 0.0, 0.0
    for i in range(N):
        total += f.x[i] + f.P[i, i]
        smallest = min(smallest, f.P[i, i])
    return math.isfinite(total) and smallest >= 0.0


contract.implement(
    Kalman,
    contract.Functions(start, stop, advance, act, answers.conclude, is_finite, answers.report),
    {"heading": (-1, 1), "fault": (0, int(_MISSING))},
)
