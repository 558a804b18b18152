"""The compiled heart: one loop over samples that advances the observer and writes estimates and health.

Time comes from the samples alone, as integers. A frame first advances the internal grid to its own time and then
acts, so an estimate given in answer to a frame contains that frame. State changes nowhere else.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators import oh2014, oh2014_model
from dctorque_can.estimators.design import SubObserver
from dctorque_can.pipeline.core_state import NEVER
from dctorque_can.pipeline.decisions import (
    ENGINE_SPEED,
    ENGINE_TORQUE,
    SPEED_1,
    decide_gears,
    decide_phases,
    inputs_complete,
    mark_stale,
    plausible,
    wheel_speeds,
)
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.samples import N_QUANTITIES, SampleStatus

MAX_SAMPLE_INTERVAL = 0.1  # s; a speed that was away longer corrects as if it had been away so long
"""Interval of samples beyond which a correction is not stretched any further."""

_OUTPUT_VALID = int(Status.OUTPUT_VALID)
_ALL_VALID = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID)
_GEARS_KNOWN = int(Status.GEARS_KNOWN)
_PHASES_KNOWN = int(Status.PHASES_KNOWN)
_ROAD_LOAD_LEARNED = int(Status.ROAD_LOAD_LEARNED)
_CONVERGED = int(Status.CONVERGED)
_INPUT_STALE = int(Status.INPUT_STALE)
_SPEED_IMPLAUSIBLE = int(Status.SPEED_IMPLAUSIBLE)
_LIMITED = int(Status.LIMITED)


@compiled_without_allocation
def restart(core: Any, rules: Any, s: Any, c: Any, pair: Any) -> None:
    """Start the observer at the present measurements."""
    _, _, _, w_w, _ = wheel_speeds(core, rules)
    for i in range(2):
        core.w_c[i] = core.w_c_last[i] = core.value[SPEED_1 + i]
        core.shaft_us[i] = core.t_us
    oh2014_model.set_pair(pair, c, core.gear[0], core.gear[1])
    w_s = core.w_c[1] if pair.side == 2 else core.w_c[0]
    oh2014.reset(s, c, core.value[ENGINE_SPEED], w_s, w_w, core.value[ENGINE_TORQUE])
    core.running = True
    core.learned_us = 0
    core.reset_us = core.settled_us = core.engine_us = core.wheel_us = core.twist_us = core.t_us


@compiled_without_allocation
def advance(core: Any, rules: Any, s: Any, c: Any, pair: Any, health: Any, t_us: int) -> None:
    """Move the grid to ``t_us``: whole steps, then the rest of a step up to the frame."""
    while core.t_us < t_us:
        until = min(t_us, core.t_us + rules.step_us - (core.t_us - core.origin_us) % rules.step_us)
        dt = (until - core.t_us) * 1e-6
        core.t_us = until
        if core.running:
            oh2014.predict(s, c, pair, core.value[ENGINE_TORQUE], dt)
            core.w_c[0] += dt * s.a_w * pair.R_1  # zero in neutral
            core.w_c[1] += dt * s.a_w * pair.R_2


@compiled_without_allocation
def interval(t_us: int, last_us: int) -> float:
    """Return the seconds between two samples of one speed, bounded away from zero and from long silences."""
    return min(max((t_us - last_us) * 1e-6, 1e-4), MAX_SAMPLE_INTERVAL)


@compiled_without_allocation
def take_gears(core: Any, s: Any, c: Any, pair: Any) -> None:
    """Hand changed gears to the observer; a shaft speed from before says nothing about the new gear."""
    if core.gear[0] == pair.g1 and core.gear[1] == pair.g2:
        return
    if core.gear[0] != pair.g1:
        core.shaft_us[0] = NEVER
    if core.gear[1] != pair.g2:
        core.shaft_us[1] = NEVER
    oh2014.change_gears(s, c, pair, core.gear[0], core.gear[1], core.w_c[0], core.w_c[1])
    core.twist_us = NEVER


@compiled_without_allocation
def correct_shafts(core: Any, s: Any, c: Any, pair: Any, carries_1: bool, carries_2: bool) -> None:
    """Let new input-shaft speeds take effect: on the clutch-side observer, and by their twist on both torques."""
    if not (core.fresh[SPEED_1] or core.fresh[SPEED_1 + 1]):
        return
    for i in range(2):
        if not core.fresh[SPEED_1 + i]:
            continue
        if pair.side == i + 1:
            if core.shaft_us[i] == NEVER:
                s.w_s = core.w_c[i]
            else:
                h = interval(core.t_us, core.shaft_us[i])
                oh2014.correct_shaft(s, c, pair, carries_1, carries_2, core.w_c[i], h)
        core.shaft_us[i] = core.t_us
    if core.shaft_us[0] == NEVER or core.shaft_us[1] == NEVER:
        return
    if core.twist_us != NEVER:
        # trapezoidal rule over the time since both shafts were last compared
        w_c1 = 0.5 * (core.w_c[0] + core.w_c_last[0])
        w_c2 = 0.5 * (core.w_c[1] + core.w_c_last[1])
        dT_c1, dT_c2 = oh2014.shaft_torque_rates(c, pair, carries_1, carries_2, w_c1, w_c2, 0.0)
        dt = (core.t_us - core.twist_us) * 1e-6
        oh2014.add_shaft_torques(s, (dt * dT_c1, dt * dT_c2))
    core.twist_us = core.t_us
    core.w_c_last[0], core.w_c_last[1] = core.w_c[0], core.w_c[1]


@compiled_without_allocation
def act(core: Any, rules: Any, s: Any, c: Any, pair: Any, health: Any) -> None:
    """Let one whole frame take effect at the time of the grid."""
    mark_stale(core, rules, health)
    for i in range(2):
        if core.fresh[SPEED_1 + i]:
            core.w_c[i] = core.value[SPEED_1 + i]
    decide_gears(core, rules, c)
    decide_phases(core, rules, s.w_e if core.running else core.value[ENGINE_SPEED])
    if not inputs_complete(core, rules):
        core.running = False  # held: the torques stay as they are until the inputs are back
        return
    if not core.running:
        restart(core, rules, s, c, pair)
    take_gears(core, s, c, pair)
    gating = c.gating
    carries_1 = pair.g1 != 0 and (core.closed[0] or not gating)
    carries_2 = pair.g2 != 0 and (core.closed[1] or not gating)

    _, _, _, w_w, wheel_fresh = wheel_speeds(core, rules)
    if wheel_fresh:
        oh2014.correct_wheel(s, c, w_w, interval(core.t_us, core.wheel_us))
        core.wheel_us = core.t_us
    if core.fresh[ENGINE_SPEED]:
        h = interval(core.t_us, core.engine_us)
        oh2014.correct_engine(s, c, pair, carries_1, carries_2, core.value[ENGINE_SPEED], h)
        core.engine_us = core.t_us
    correct_shafts(core, s, c, pair, carries_1, carries_2)
    elapsed_us = core.t_us - core.settled_us
    if oh2014.settle(s, c, pair, carries_1, carries_2, elapsed_us * 1e-6):
        core.learned_us += elapsed_us
    core.settled_us = core.t_us


@compiled_without_allocation
def all_finite(s: Any) -> bool:
    """Return whether every state of the observer is a number."""
    total = s.T_c1 + s.T_c2 + s.tau_e + s.tau_o + s.w_e + s.T_c + s.w_s + s.T_a + s.T_n + s.w_w + s.a_w
    return math.isfinite(total)


@compiled_without_allocation
def judge(core: Any, rules: Any, pair: Any, limited: bool, adaptive: bool) -> int:
    """Return the `Status` bits of an estimate."""
    status = 0
    settled = core.running and core.t_us - core.reset_us >= rules.settling_us
    fits = plausible(core, rules, pair)
    if core.gear_known[0] and core.gear_known[1]:
        status |= _GEARS_KNOWN
    if core.closed_known[0] and core.closed_known[1]:
        status |= _PHASES_KNOWN
    if settled:
        status |= _CONVERGED
    if core.running and core.learned_us >= rules.learning_us:
        status |= _ROAD_LOAD_LEARNED
    if not core.running:
        status |= _INPUT_STALE
    if limited:
        status |= _LIMITED
    if not fits:
        status |= _SPEED_IMPLAUSIBLE
    if settled and fits and not limited:
        status |= _OUTPUT_VALID if adaptive else _ALL_VALID
    return status


@compiled_without_allocation
def bounded(value: float, limit: float) -> float:
    """Return ``value`` within ±limit."""
    return min(max(value, -limit), limit)


@compiled_without_allocation
def publish(core: Any, rules: Any, s: Any, c: Any, pair: Any, row: Any) -> None:
    """Write one estimate."""
    row.t_us = core.t_us
    full = rules.sub_observer == SubObserver.FULL
    adaptive = rules.sub_observer == SubObserver.ADAPTIVE
    T_1 = s.T_c1 if full else s.T_c1_uio
    T_2 = s.T_c2 if full else s.T_c2_uio
    if adaptive:
        T_1 = T_2 = 0.0
    T_o_adaptive = s.T_n + s.a_w * s.tau_o  # (47)
    T_o = (pair.R_1 * T_1 + pair.R_2 * T_2) / oh2014.driving_loss(c, s)  # (31), after the losses
    if adaptive:
        T_o = T_o_adaptive
    row.clutch1_torque_nm = bounded(T_1, rules.torque_limit[0])
    row.clutch2_torque_nm = bounded(T_2, rules.torque_limit[1])
    row.output_torque_nm = bounded(T_o, rules.output_limit)
    row.output_torque_adaptive_nm = bounded(T_o_adaptive, rules.output_limit)
    row.clutch1_torque_uio_nm = bounded(s.T_c1_uio, rules.torque_limit[0])
    row.clutch2_torque_uio_nm = bounded(s.T_c2_uio, rules.torque_limit[1])
    row.clutch_torque_sum_nm = s.T_c
    row.engine_torque_nm = core.value[ENGINE_TORQUE] + s.w_e * s.tau_e  # (46)
    row.road_load_nm = s.T_n
    row.engine_speed_rad_s = s.w_e
    row.clutch1_slip_rad_s = s.w_e - core.w_c[0]
    row.clutch2_slip_rad_s = s.w_e - core.w_c[1]
    row.wheel_acceleration_rad_s2 = s.a_w
    row.gear1 = core.gear[0]
    row.gear2 = core.gear[1]
    row.phase1 = core.phase[0]
    row.phase2 = core.phase[1]

    limited = (
        row.clutch1_torque_nm != T_1
        or row.clutch2_torque_nm != T_2
        or row.output_torque_nm != T_o
        or row.output_torque_adaptive_nm != T_o_adaptive
    )
    core.status = judge(core, rules, pair, limited, adaptive)
    row.status = core.status


@compiled_without_allocation
def report(core: Any, health: Any, row: Any) -> None:
    """Copy the counters into a health row."""
    row.t_us = core.t_us
    for quantity in range(N_QUANTITIES):
        row.accepted[quantity] = health.accepted[quantity]
        row.not_available[quantity] = health.not_available[quantity]
        row.out_of_range[quantity] = health.out_of_range[quantity]
        row.bad_length[quantity] = health.bad_length[quantity]
        row.bad_crc[quantity] = health.bad_crc[quantity]
        row.bad_counter[quantity] = health.bad_counter[quantity]
        row.timeouts[quantity] = health.timeouts[quantity]
        seen = core.seen_us[quantity]
        row.age_us[quantity] = core.t_us - seen if seen != NEVER else -1
    row.late_frames = health.late_frames
    row.gap_resets = health.gap_resets
    row.clock_resets = health.clock_resets
    row.status = core.status


@compiled_without_allocation
def is_due(core: Any, last_us: int, period_us: int) -> bool:
    """Return whether another period has begun since ``last_us``."""
    if last_us == NEVER:
        return True
    return bool((core.t_us - core.origin_us) // period_us != (last_us - core.origin_us) // period_us)


@compiled_without_allocation
def count_rejected(health: Any, quantity: int, status: int) -> None:
    """Count a sample that may not be used."""
    if status == SampleStatus.NOT_AVAILABLE:
        health.not_available[quantity] += 1
    elif status == SampleStatus.OUT_OF_RANGE:
        health.out_of_range[quantity] += 1
    elif status == SampleStatus.BAD_LENGTH:
        health.bad_length[quantity] += 1
    elif status == SampleStatus.BAD_CRC:
        health.bad_crc[quantity] += 1
    else:
        health.bad_counter[quantity] += 1


@compiled_without_allocation
def take_time(core: Any, rules: Any, s: Any, c: Any, pair: Any, health: Any, t_us: int) -> None:
    """Advance to the time of a sample; a gap or a step back of the clock starts anew there, and is counted."""
    if core.t_us == NEVER:
        core.t_us = core.origin_us = t_us
    elif t_us < core.t_us:
        if core.t_us - t_us > rules.max_step_back_us:
            health.clock_resets += 1
            forget(core, t_us)
        else:
            health.late_frames += 1
    elif t_us - core.t_us > rules.max_gap_us:
        health.gap_resets += 1
        forget(core, t_us)
    else:
        advance(core, rules, s, c, pair, health, t_us)


@compiled_without_allocation
def forget(core: Any, t_us: int) -> None:
    """Drop all inputs and go to ``t_us``."""
    core.t_us = core.origin_us = t_us
    core.running = False
    core.estimate_us = core.health_us = core.implausible_us = NEVER
    for quantity in range(N_QUANTITIES):
        core.available[quantity] = False
        core.stale[quantity] = False
        core.fresh[quantity] = False
    for i in range(2):
        core.candidate_us[i] = core.slip_small_us[i] = NEVER
        core.gear_known[i] = False
        core.phase[i] = ClutchPhase.OPEN


@compiled_without_allocation
def run(
    t_us: NDArray[np.int64],
    quantities: NDArray[np.uint8],
    values: NDArray[np.float64],
    statuses: NDArray[np.uint8],
    lasts: NDArray[np.bool_],
    cores: NDArray[np.void],
    rule: NDArray[np.void],
    states: NDArray[np.void],
    constants: NDArray[np.void],
    pairs: NDArray[np.void],
    healths: NDArray[np.void],
    rows: NDArray[np.void],
    health_rows: NDArray[np.void],
) -> tuple[int, int]:
    """Feed samples; return how many estimates and health rows were written."""
    core, rules, s = cores[0], rule[0], states[0]
    c, pair, health = constants[0], pairs[0], healths[0]
    n_rows = n_health = 0
    for k in range(len(t_us)):
        quantity = int(quantities[k])
        if statuses[k] != SampleStatus.OK:
            count_rejected(health, quantity, statuses[k])
            if statuses[k] == SampleStatus.NOT_AVAILABLE:
                core.available[quantity] = False
        elif not rules.minimum[quantity] <= values[k] <= rules.maximum[quantity]:
            health.out_of_range[quantity] += 1
        else:
            if not core.frame_ok:
                take_time(core, rules, s, c, pair, health, t_us[k])
                core.frame_ok = True
            core.value[quantity] = values[k]
            core.seen_us[quantity] = core.t_us
            core.available[quantity] = True
            core.stale[quantity] = False
            core.fresh[quantity] = True
            health.accepted[quantity] += 1
        if not lasts[k] or not core.frame_ok:
            continue
        act(core, rules, s, c, pair, health)
        core.frame_ok = False
        for q in range(N_QUANTITIES):
            core.fresh[q] = False
        if not all_finite(s):
            core.running = False
            oh2014.reset(s, c, 0.0, 0.0, 0.0, 0.0)
        if is_due(core, core.estimate_us, rules.estimate_period_us):
            core.estimate_us = core.t_us
            publish(core, rules, s, c, pair, rows[n_rows])
            n_rows += 1
        if is_due(core, core.health_us, rules.health_period_us):
            core.health_us = core.t_us
            report(core, health, health_rows[n_health])
            n_health += 1
    return n_rows, n_health
