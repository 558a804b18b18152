"""What a frame does to the 2014 observer, and what it answers.

Between frames the observer goes on in steps of a grid; a frame corrects it once by each speed that is new.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import MAX_GEAR, Vehicle
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.estimators import contract
from dctorque_can.estimators.inputs import (
    ENGINE_SPEED,
    ENGINE_TORQUE,
    SPEED_1,
    STANDSTILL,
    both_shafts_complete,
    braking,
    phases_known,
    wheel_speeds,
    wheels_in_use,
)
from dctorque_can.estimators.oh2014 import model, observer
from dctorque_can.estimators.oh2014.design import Oh2014Design, RoadLoad, SubObserver
from dctorque_can.estimators.oh2014.thresholds import ROAD_LOAD_MEMORY_US, SETTLING
from dctorque_can.pipeline.estimates import Status

_OUTPUT_VALID = int(Status.OUTPUT_VALID)
_ALL_VALID = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID)
_ROAD_LOAD_LEARNED = int(Status.ROAD_LOAD_LEARNED)
_CONVERGED = int(Status.CONVERGED)

RULES = np.dtype(
    [
        ("settling_us", "i8"),
        ("learning_us", "i8"),
        ("sub_observer", "i8"),
        ("learns", "u1"),  # the road load is learned
    ],
    align=True,
)
"""When an estimate is valid, and which sub-observer gives it."""

STATE = np.dtype(
    [
        ("observer", observer.STATE),
        ("pair", model.PAIR),
        ("running", "u1"),
        ("reset_us", "i8"),
        ("learned_us", "i8"),  # how long the road load has been learned since the start
        ("settled_us", "i8"),  # when the torques were last drawn to the unknown input estimates
        ("engine_us", "i8"),  # time of the last correction by each speed
        ("shaft_us", "i8", (2,)),
        ("wheel_us", "i8"),
        ("w_c", "f8", (2,)),  # shaft speeds, carried on between their frames by the model
        ("w_c_last", "f8", (2,)),  # … as they were at the last use in (36)
        ("twist_us", "i8"),  # when the shafts were last compared; NEVER: not since the gears changed
        ("wheels", "i8"),  # which wheels gave the acceleration last, one bit each
        ("apart", "u1"),  # two clutch torques had to be told apart by (65), (66)
    ],
    align=True,
)
"""The observer and what it must remember from frame to frame."""


class Oh2014(NamedTuple):
    """All that the observer needs, in one argument.

    Attributes:
        state: `STATE` ``[1]``.
        constants: `model.CONSTANTS` ``[1]``.
        rules: `RULES` ``[1]``.
    """

    state: NDArray[np.void]
    constants: NDArray[np.void]
    rules: NDArray[np.void]


def new(vehicle: Vehicle, design: Oh2014Design) -> Oh2014:
    """Return an observer that has seen nothing yet."""
    rules = np.zeros(1, RULES)
    slowest = min(
        design.engine_bandwidth_rad_s,
        design.shaft_bandwidth_rad_s,
        design.torque_crossover_rad_s,
        model.slowest_acceleration_bandwidth(vehicle, design),
    )
    rules["settling_us"] = int(SETTLING / slowest * 1e6)
    rules["learning_us"] = int(SETTLING * design.road_load_time_s * 1e6)
    rules["sub_observer"] = design.sub_observer
    rules["learns"] = design.road_load is RoadLoad.LEARNED
    constants, state = model.constants(vehicle, design), np.zeros(1, STATE)
    state["settled_us"] = NEVER
    model.set_pair(state["pair"][0], constants[0], 0, 0)
    return Oh2014(state, constants, rules)


@compiled_without_allocation
def start(o: Oh2014, answer: Any) -> None:
    """Become as new."""
    state = o.state[0]
    state.running, state.learned_us = False, 0
    observer.reset(state.observer, o.constants[0], 0.0, 0.0, 0.0, 0.0)
    for i in range(2):
        state.w_c[i] = 0.0
    give_answer(o, answer)


@compiled_without_allocation
def stop(o: Oh2014, answer: Any) -> None:
    """Hold the torques."""
    o.state[0].running = answer.running = False


@compiled_without_allocation
def advance(o: Oh2014, inputs: Any, answer: Any, t_us: int) -> None:
    """Move the grid to ``t_us``: whole steps, then the rest of a step up to the frame."""
    state, c = o.state[0], o.constants[0]
    if not state.running:
        return
    s, pair, now_us = state.observer, state.pair, inputs.t_us
    while now_us < t_us:
        until = min(t_us, now_us + inputs.step_us - (now_us - inputs.origin_us) % inputs.step_us)
        dt = (until - now_us) * 1e-6
        now_us = until
        observer.predict(s, c, pair, inputs.value[ENGINE_TORQUE], dt)
        state.w_c[0] += dt * s.a_w * pair.R_1  # zero in neutral
        state.w_c[1] += dt * s.a_w * pair.R_2
    answer.w_e = s.w_e
    answer.w_c[0], answer.w_c[1] = state.w_c[0], state.w_c[1]


@compiled_without_allocation
def act(o: Oh2014, inputs: Any, answer: Any) -> None:
    """Let a whole frame take effect at ``inputs.t_us``, and answer."""
    state, c = o.state[0], o.constants[0]
    s, pair = state.observer, state.pair
    for i in range(2):
        state.w_c[i] = inputs.w_c[i]
    if not both_shafts_complete(inputs):
        state.running = False  # held: the torques stay as they are until the inputs are back
        give_answer(o, answer)
        return
    if not state.running:
        restart(o, inputs)
    elif inputs.fits_again:
        state.reset_us = inputs.t_us  # what was estimated meanwhile must settle anew
    take_gears(o, inputs)
    fits = bool(inputs.fits)
    may_1, may_2 = pair.g1 != 0 and bool(inputs.closed[0]), pair.g2 != 0 and bool(inputs.closed[1])
    carries_1 = may_1 or (pair.g1 != 0 and not c.gating)
    carries_2 = may_2 or (pair.g2 != 0 and not c.gating)
    state.apart = carries_1 and carries_2

    correct_wheels(state, inputs)
    if inputs.fresh[ENGINE_SPEED]:
        h = interval(inputs.t_us, state.engine_us)
        observer.correct_engine(s, c, pair, carries_1, carries_2, inputs.value[ENGINE_SPEED], h)
        state.engine_us = inputs.t_us
    correct_shafts(o, inputs, carries_1, carries_2)
    elapsed_us = inputs.t_us - state.settled_us
    observer.settle(s, c, pair, carries_1, carries_2, elapsed_us * 1e-6)
    if fits and observer.learn_road_load(s, c, pair, may_1, may_2, elapsed_us * 1e-6):
        state.learned_us += elapsed_us
    state.settled_us = inputs.t_us
    give_answer(o, answer)


@compiled_without_allocation
def give_answer(o: Oh2014, answer: Any) -> None:
    """Say what every frame has an answer to."""
    state = o.state[0]
    T_1, T_2 = observed_torques(o)
    if o.rules[0].sub_observer == SubObserver.ADAPTIVE:
        T_1, T_2 = 0.0, 0.0  # it knows the output torque alone
    answer.running, answer.reset_us = state.running, state.reset_us
    answer.T_c[0], answer.T_c[1] = T_1, T_2
    answer.w_e = state.observer.w_e
    for i in range(2):
        answer.w_c[i] = state.w_c[i]
        answer.slip[i] = state.observer.w_e - state.w_c[i]


@compiled_without_allocation
def observed_torques(o: Oh2014) -> tuple[float, float]:
    """Return the torques of both clutches, N·m."""
    s = o.state[0].observer
    if o.rules[0].sub_observer == SubObserver.UNKNOWN_INPUT:
        return s.T_c1_uio, s.T_c2_uio
    return s.T_c1, s.T_c2


@compiled_without_allocation
def restart(o: Oh2014, inputs: Any) -> None:
    """Start at the present measurements; the road load that was learned lately holds."""
    state, c = o.state[0], o.constants[0]
    s, pair = state.observer, state.pair
    _, _, _, w_w, _ = wheel_speeds(inputs)
    for i in range(2):
        state.w_c[i] = state.w_c_last[i] = inputs.value[SPEED_1 + i]
        state.shaft_us[i] = inputs.t_us
    model.set_pair(pair, c, inputs.gear[0], inputs.gear[1])
    w_s = state.w_c[1] if pair.side == 2 else state.w_c[0]
    T_n, pause_us = s.T_n, inputs.t_us - state.settled_us
    observer.reset(s, c, inputs.value[ENGINE_SPEED], w_s, w_w, inputs.value[ENGINE_TORQUE])
    if 0 <= pause_us < ROAD_LOAD_MEMORY_US and state.learned_us > 0:
        s.T_n = T_n
    else:
        state.learned_us = 0
    state.running = True
    state.wheels = wheels_in_use(inputs)
    state.reset_us = state.settled_us = state.engine_us = state.wheel_us = state.twist_us = inputs.t_us


@compiled_without_allocation
def interval(t_us: int, last_us: int) -> float:
    """Return the seconds between two samples of one speed, bounded away from zero."""
    return max((t_us - last_us) * 1e-6, 1e-4)


@compiled_without_allocation
def take_gears(o: Oh2014, inputs: Any) -> None:
    """Hand changed gears to the observer; a shaft speed from before says nothing about the new gear."""
    state = o.state[0]
    pair = state.pair
    if inputs.gear[0] == pair.g1 and inputs.gear[1] == pair.g2:
        return
    if inputs.gear[0] != pair.g1:
        state.shaft_us[0] = NEVER
    if inputs.gear[1] != pair.g2:
        state.shaft_us[1] = NEVER
    w_c = state.w_c
    observer.change_gears(state.observer, o.constants[0], pair, inputs.gear[0], inputs.gear[1], w_c[0], w_c[1])
    state.twist_us = NEVER


@compiled_without_allocation
def correct_wheels(state: Any, inputs: Any) -> None:
    """Let new wheel speeds take effect; when other wheels take over, their offset is not an acceleration."""
    _, _, _, w_w, fresh = wheel_speeds(inputs)
    wheels = wheels_in_use(inputs)
    if wheels != state.wheels:
        state.observer.w_w = w_w
        state.wheels = wheels
        state.wheel_us = inputs.t_us
    elif fresh:
        observer.correct_wheel(state.observer, state.pair, w_w, interval(inputs.t_us, state.wheel_us))
        state.wheel_us = inputs.t_us


@compiled_without_allocation
def correct_shafts(o: Oh2014, inputs: Any, carries_1: bool, carries_2: bool) -> None:
    """Let new input-shaft speeds take effect: on the clutch-side observer, and by their twist on both torques."""
    state, c = o.state[0], o.constants[0]
    s, pair = state.observer, state.pair
    if not (inputs.fresh[SPEED_1] or inputs.fresh[SPEED_1 + 1]):
        return
    for i in range(2):
        if not inputs.fresh[SPEED_1 + i]:
            continue
        if pair.side == i + 1:
            if state.shaft_us[i] == NEVER:
                s.w_s = state.w_c[i]
            else:
                h = interval(inputs.t_us, state.shaft_us[i])
                observer.correct_shaft(s, c, pair, carries_1, carries_2, state.w_c[i], h)
        state.shaft_us[i] = inputs.t_us
    if state.shaft_us[0] == NEVER or state.shaft_us[1] == NEVER:
        return
    if state.twist_us != NEVER and inputs.fits:
        # trapezoidal rule over the time since both shafts were last compared
        w_c1 = 0.5 * (state.w_c[0] + state.w_c_last[0])
        w_c2 = 0.5 * (state.w_c[1] + state.w_c_last[1])
        dT_c1, dT_c2 = observer.shaft_torque_rates(c, pair, carries_1, carries_2, w_c1, w_c2, 0.0)
        dt = (inputs.t_us - state.twist_us) * 1e-6
        observer.add_shaft_torques(s, (dt * dT_c1, dt * dT_c2))
    state.twist_us = inputs.t_us
    state.w_c_last[0], state.w_c_last[1] = state.w_c[0], state.w_c[1]


@compiled_without_allocation
def conclude(o: Oh2014, inputs: Any, answer: Any, row: Any) -> int:
    """Fill an estimate; see `contract.conclude`. It states no standard deviations."""
    state, c = o.state[0], o.constants[0]
    s, pair = state.observer, state.pair
    T_1, T_2 = observed_torques(o)
    T_o = observer.after_losses(c, pair, pair.R_1 * T_1 + pair.R_2 * T_2)  # (31)
    T_o_adaptive = s.T_n + s.a_w * s.tau_o  # (47)
    if abs(s.w_w) < STANDSTILL:
        T_o_adaptive = T_o  # (47) sees nothing at rest: brakes hold whatever the clutches do not
    if o.rules[0].sub_observer == SubObserver.ADAPTIVE:
        T_o = T_o_adaptive
    row.clutch1_torque_nm, row.clutch2_torque_nm, row.output_torque_nm = answer.T_c[0], answer.T_c[1], T_o
    row.output_torque_adaptive_nm = T_o_adaptive
    row.clutch1_torque_uio_nm, row.clutch2_torque_uio_nm = s.T_c1_uio, s.T_c2_uio
    row.clutch_torque_sum_nm = s.T_c
    row.engine_torque_nm = inputs.value[ENGINE_TORQUE] + s.w_e * s.tau_e  # (46)
    row.road_load_nm = s.T_n
    row.engine_speed_rad_s = s.w_e
    row.clutch1_slip_rad_s = s.w_e - state.w_c[0]
    row.clutch2_slip_rad_s = s.w_e - state.w_c[1]
    row.wheel_acceleration_rad_s2 = s.a_w
    return judge(o, inputs)


@compiled_without_allocation
def judge(o: Oh2014, inputs: Any) -> int:
    """Return the `Status` bits of an estimate."""
    state, rules = o.state[0], o.rules[0]
    if not state.running:
        return 0
    learned = state.learned_us >= rules.learning_us
    status = _ROAD_LOAD_LEARNED if learned else 0
    if inputs.t_us - state.reset_us < rules.settling_us:
        return status
    status |= _CONVERGED
    # two clutches are told apart by the output torque, and that stands on the road load
    learned = learned or not rules.learns
    if rules.sub_observer == SubObserver.ADAPTIVE:
        return status | (_OUTPUT_VALID if learned else 0)
    if phases_known(inputs) and ((learned and not braking(inputs)) or not state.apart):
        status |= _ALL_VALID
    return status


@compiled_without_allocation
def is_finite(o: Oh2014) -> bool:
    """Return whether every state of the observer is a number."""
    s = o.state[0].observer
    total = s.T_c1 + s.T_c2 + s.tau_e + s.tau_o + s.w_e + s.T_c + s.w_s + s.T_a + s.T_n + s.w_w + s.a_w
    return math.isfinite(total)


@compiled_without_allocation
def report(o: Oh2014, row: Any) -> None:
    """Do nothing: the observer has no innovations of its own, and learns no gain."""


contract.implement(
    Oh2014,
    contract.Functions(start, stop, advance, act, conclude, is_finite, report),
    {"g1": (-1, MAX_GEAR), "g2": (-1, MAX_GEAR), "side": (0, 2), "wheels": (0, 15)},
)
