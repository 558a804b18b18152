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
from dctorque_can.estimators import kalman, kalman_gearbox, oh2014, oh2014_model, tape
from dctorque_can.estimators.design import Method
from dctorque_can.estimators.kalman import Kalman
from dctorque_can.pipeline import delays, derived
from dctorque_can.pipeline.core_state import NEVER
from dctorque_can.pipeline.decisions import (
    ENGINE_SPEED,
    ENGINE_TORQUE,
    SPEED_1,
    decide_gears,
    decide_phases,
    inputs_complete,
    mark_stale,
    speeds_fit,
    wheel_speeds,
    wheels_in_use,
)
from dctorque_can.pipeline.kalman_core import act_kalman, engine_speed, kalman_finite, stand_in_for_shafts
from dctorque_can.pipeline.parts import Parts
from dctorque_can.pipeline.rows import publish, report
from dctorque_can.pipeline.samples import N_QUANTITIES, SampleStatus

LATEST_US = 2**60  # times beyond ±36 000 years are taken as this, so that differences never overflow
ROAD_LOAD_MEMORY_US = 5_000_000  # for so long a pause the learned road load still holds

_OUT_OF_RANGE = int(SampleStatus.OUT_OF_RANGE)


@compiled_without_allocation
def restart(core: Any, rules: Any, s: Any, c: Any, pair: Any) -> None:
    """Start the observer at the present measurements."""
    _, _, _, w_w, _ = wheel_speeds(core, rules)
    for i in range(2):
        core.w_c[i] = core.w_c_last[i] = core.value[SPEED_1 + i]
        core.shaft_us[i] = core.t_us
    oh2014_model.set_pair(pair, c, core.gear[0], core.gear[1])
    w_s = core.w_c[1] if pair.side == 2 else core.w_c[0]
    T_n, pause_us = s.T_n, core.t_us - core.settled_us
    oh2014.reset(s, c, core.value[ENGINE_SPEED], w_s, w_w, core.value[ENGINE_TORQUE])
    if 0 <= pause_us < ROAD_LOAD_MEMORY_US and core.learned_us > 0:
        s.T_n = T_n
    else:
        core.learned_us = 0
    core.running = True
    core.wheels = wheels_in_use(core)
    core.reset_us = core.settled_us = core.engine_us = core.wheel_us = core.twist_us = core.t_us


@compiled_without_allocation
def advance(core: Any, rules: Any, s: Any, c: Any, pair: Any, t_us: int) -> None:
    """Move the grid to ``t_us``: whole steps, then the rest of a step up to the frame."""
    if rules.method == Method.KALMAN:  # it predicts once it knows the phases of the clutches
        core.t_us = max(core.t_us, t_us)
        return
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
    """Return the seconds between two samples of one speed, bounded away from zero."""
    return max((t_us - last_us) * 1e-6, 1e-4)


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
def correct_wheels(core: Any, rules: Any, s: Any, pair: Any) -> None:
    """Let new wheel speeds take effect; when other wheels take over, their offset is not an acceleration."""
    _, _, _, w_w, fresh = wheel_speeds(core, rules)
    wheels = wheels_in_use(core)
    if wheels != core.wheels:
        s.w_w = w_w
        core.wheels = wheels
        core.wheel_us = core.t_us
    elif fresh:
        oh2014.correct_wheel(s, pair, w_w, interval(core.t_us, core.wheel_us))
        core.wheel_us = core.t_us


@compiled_without_allocation
def correct_shafts(core: Any, s: Any, c: Any, pair: Any, carries_1: bool, carries_2: bool, fits: bool) -> None:
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
    if core.twist_us != NEVER and fits:
        # trapezoidal rule over the time since both shafts were last compared
        w_c1 = 0.5 * (core.w_c[0] + core.w_c_last[0])
        w_c2 = 0.5 * (core.w_c[1] + core.w_c_last[1])
        dT_c1, dT_c2 = oh2014.shaft_torque_rates(c, pair, carries_1, carries_2, w_c1, w_c2, 0.0)
        dt = (core.t_us - core.twist_us) * 1e-6
        oh2014.add_shaft_torques(s, (dt * dT_c1, dt * dT_c2))
    core.twist_us = core.t_us
    core.w_c_last[0], core.w_c_last[1] = core.w_c[0], core.w_c[1]


@compiled_without_allocation
def act(core: Any, rules: Any, s: Any, c: Any, pair: Any, health: Any, k: Kalman) -> None:
    """Let one whole frame take effect at the time of the grid."""
    mark_stale(core, rules, health)
    for i in range(2):
        if core.fresh[SPEED_1 + i]:
            core.w_c[i] = core.value[SPEED_1 + i]
    if rules.method == Method.KALMAN:
        stand_in_for_shafts(core, k.state[0])
        decide_gears(core, rules, c)
        decide_phases(core, rules, engine_speed(core, k.state[0]))
        act_kalman(core, rules, k)
        if inputs_complete(core, rules):
            speeds_fit(core, rules, c)
        return
    decide_gears(core, rules, c)
    decide_phases(core, rules, s.w_e if core.running else core.value[ENGINE_SPEED])
    if not inputs_complete(core, rules):
        core.running = False  # held: the torques stay as they are until the inputs are back
        return
    if not core.running:
        restart(core, rules, s, c, pair)
    take_gears(core, s, c, pair)
    fits = speeds_fit(core, rules, c)
    may_1, may_2 = pair.g1 != 0 and bool(core.closed[0]), pair.g2 != 0 and bool(core.closed[1])
    carries_1 = may_1 or (pair.g1 != 0 and not c.gating)
    carries_2 = may_2 or (pair.g2 != 0 and not c.gating)
    core.apart = carries_1 and carries_2

    correct_wheels(core, rules, s, pair)
    if core.fresh[ENGINE_SPEED]:
        h = interval(core.t_us, core.engine_us)
        oh2014.correct_engine(s, c, pair, carries_1, carries_2, core.value[ENGINE_SPEED], h)
        core.engine_us = core.t_us
    correct_shafts(core, s, c, pair, carries_1, carries_2, fits)
    elapsed_us = core.t_us - core.settled_us
    oh2014.settle(s, c, pair, carries_1, carries_2, elapsed_us * 1e-6)
    if fits and oh2014.learn_road_load(s, c, pair, may_1, may_2, elapsed_us * 1e-6):
        core.learned_us += elapsed_us
    core.settled_us = core.t_us


@compiled_without_allocation
def all_finite(s: Any) -> bool:
    """Return whether every state of the observer is a number."""
    total = s.T_c1 + s.T_c2 + s.tau_e + s.tau_o + s.w_e + s.T_c + s.w_s + s.T_a + s.T_n + s.w_w + s.a_w
    return math.isfinite(total)


@compiled_without_allocation
def is_due(core: Any, t_us: int, last_us: int, period_us: int) -> bool:
    """Return whether another period has begun at ``t_us`` since ``last_us``."""
    if last_us == NEVER:
        return True
    return bool((t_us - core.origin_us) // period_us != (last_us - core.origin_us) // period_us)


@compiled_without_allocation
def keep_value(core: Any, quantity: int, value: float) -> None:
    """Keep a usable value until the frame takes effect."""
    core.value[quantity] = value
    core.seen_us[quantity] = core.t_us
    core.available[quantity] = True
    core.stale[quantity] = False
    core.fresh[quantity] = True


@compiled_without_allocation
def count_sample(health: Any, quantity: int, status: int) -> None:
    """Count a sample; the input of one that is not usable ages until its timeout."""
    if status == SampleStatus.OK:
        health.accepted[quantity] += 1
    elif status == SampleStatus.NOT_AVAILABLE:
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
def forget(core: Any, f: Any, t_us: int) -> None:
    """Drop all inputs and go to ``t_us``."""
    core.t_us = core.origin_us = t_us
    core.running = f.running = False
    for signal in range(len(f.fault)):
        f.fault[signal] = 0
    core.estimate_us = core.health_us = core.implausible_us = NEVER
    for quantity in range(N_QUANTITIES):
        core.seen_us[quantity] = NEVER
        core.available[quantity] = False
        core.stale[quantity] = False
        core.fresh[quantity] = False
    for i in range(2):
        core.candidate_us[i] = core.slip_small_us[i] = NEVER
        core.gear_known[i] = False
        core.phase[i] = ClutchPhase.OPEN


@compiled_without_allocation
def judge_time(core: Any, rules: Any, health: Any, f: Any, last_us: int, t_us: int) -> bool:
    """Return whether a frame follows the last one; a gap or a step back of the clock starts anew at it."""
    if last_us == NEVER:
        core.t_us = core.origin_us = t_us
        return False
    if t_us < last_us:
        if last_us - t_us <= rules.max_step_back_us:
            health.late_frames += 1
            return True
        health.clock_resets += 1
    elif t_us - last_us <= rules.max_gap_us:
        return True
    else:
        health.gap_resets += 1
    forget(core, f, t_us)
    return False


@compiled_without_allocation
def begin_frame(p: Parts, rules: Any, c: Any, queue: Any, t_us: int) -> None:
    """Go to the time of a new frame; what waits until its delay has passed takes effect."""
    core = p.core[0]
    if rules.longest_delay_us == 0:
        if judge_time(core, rules, p.health[0], p.kalman.state[0], core.t_us, t_us):
            advance(core, rules, p.state[0], c, p.pair[0], t_us)
        return
    if not judge_time(core, rules, p.health[0], p.kalman.state[0], queue.arrived_us, t_us):
        core.t_us = t_us - rules.longest_delay_us
        queue.count = 0
        queue.arrived_us = t_us
    delays.note_frame(queue, t_us)
    while queue.count > 0 and delays.waiting(queue, 0).t_us < queue.arrived_us - rules.longest_delay_us:
        take_oldest(p, rules, c, queue)


@compiled_without_allocation
def take_oldest(p: Parts, rules: Any, c: Any, queue: Any) -> None:
    """Let the oldest samples that wait take effect for good."""
    take_waiting(p, rules, c, delays.waiting(queue, 0))
    delays.drop_oldest(queue)


@compiled_without_allocation
def take_waiting(p: Parts, rules: Any, c: Any, samples: Any) -> None:
    """Let samples take effect at the time at which they were taken."""
    core = p.core[0]
    advance(core, rules, p.state[0], c, p.pair[0], samples.t_us)
    for quantity in range(N_QUANTITIES):
        if samples.there[quantity]:
            keep_value(core, quantity, samples.value[quantity])
    take_effect(p, rules, c)


@compiled_without_allocation
def look_ahead(p: Parts, ahead: Parts, rules: Any, c: Any, queue: Any) -> None:
    """Make ``ahead`` what the estimator will be when all that waits has taken effect, at the present."""
    delays.copy(p, ahead)
    for n in range(queue.count):
        take_waiting(ahead, rules, c, delays.waiting(queue, n))
    core = ahead.core[0]
    if core.t_us < queue.arrived_us:
        advance(core, rules, ahead.state[0], c, ahead.pair[0], queue.arrived_us)
        take_effect(ahead, rules, c)


@compiled_without_allocation
def take_effect(p: Parts, rules: Any, c: Any) -> None:
    """Let all values that were kept act; a state that is no number any more starts anew."""
    core, s, f, k = p.core[0], p.state[0], p.kalman.state[0], p.kalman
    act(core, rules, s, c, p.pair[0], p.health[0], k)
    for quantity in range(N_QUANTITIES):
        core.fresh[quantity] = False
    if not all_finite(s) or (rules.method == Method.KALMAN and not kalman_finite(f)):
        core.running = False
        core.learned_us = 0
        p.health[0].numeric_resets += 1
        oh2014.reset(s, c, 0.0, 0.0, 0.0, 0.0)
        kalman.start(f, k.tuning[0], 0.0, 0.0, 0.0, 0.0, 0.0)
        if rules.method == Method.KALMAN:  # what is published next must be a number again
            kalman_gearbox.conclude(f, k.tables, k.tuning[0])
        f.running = False
    derived.follow(core, rules, s, f, p.derived[0])


@compiled_without_allocation
def run(
    t_us: NDArray[np.int64],
    quantities: NDArray[np.uint8],
    values: NDArray[np.float64],
    statuses: NDArray[np.uint8],
    lasts: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
    rule: NDArray[np.void],
    constants: NDArray[np.void],
    now: Parts,
    ahead: Parts,
    queues: NDArray[np.void],
    rows: NDArray[np.void],
    health_rows: NDArray[np.void],
) -> tuple[int, int]:
    """Feed samples; return how many estimates and health rows were written.

    Where ``wanted`` is not empty, it tells after which samples an estimate is written, instead of the period.
    """
    rules, c, queue = rule[0], constants[0], queues[0]
    core, health = now.core[0], now.health[0]
    n_rows = n_health = 0
    for k in range(len(t_us)):
        quantity = int(quantities[k])
        if rules.mapped[quantity]:
            status = statuses[k]
            if status == SampleStatus.OK and not rules.minimum[quantity] <= values[k] <= rules.maximum[quantity]:
                status = _OUT_OF_RANGE
            if (status == SampleStatus.OK or status == SampleStatus.NOT_AVAILABLE) and not core.frame_ok:
                # the frame itself is sound, so its time counts even if it brings no value
                begin_frame(now, rules, c, queue, min(max(t_us[k], -LATEST_US), LATEST_US))
                core.frame_ok = True
            count_sample(health, quantity, status)
            if status == SampleStatus.OK and rules.longest_delay_us == 0:
                keep_value(core, quantity, values[k])
            elif status == SampleStatus.OK or status == SampleStatus.NOT_AVAILABLE:
                if queue.count == delays.PLACES:
                    take_oldest(now, rules, c, queue)
                samples = delays.place(queue, queue.frame_us - rules.delay_us[quantity])
                if status == SampleStatus.OK:
                    samples.there[quantity] = True
                    samples.value[quantity] = values[k]
        sound = lasts[k] and core.frame_ok
        if sound:
            core.frame_ok = False
            if rules.longest_delay_us == 0:
                take_effect(now, rules, c)
        present_us = core.t_us if rules.longest_delay_us == 0 else queue.arrived_us
        estimate_due = sound and is_due(core, present_us, core.estimate_us, rules.estimate_period_us)
        if len(wanted) > 0:
            estimate_due = wanted[k]
        health_due = sound and is_due(core, present_us, core.health_us, rules.health_period_us)
        if not estimate_due and not health_due:
            continue
        shown = now
        if rules.longest_delay_us > 0:
            look_ahead(now, ahead, rules, c, queue)
            delays.count_timeouts(queue, ahead.core[0], health)
            shown = ahead
        f = shown.kalman.state[0]
        if estimate_due:
            core.estimate_us = present_us
            row = rows[n_rows]
            publish(shown.core[0], rules, shown.state[0], c, shown.pair[0], f, shown.derived[0], row)
            core.status = shown.core[0].status
            tape.published(f, shown.kalman.tables, shown.kalman.tuning[0])
            n_rows += 1
        if health_due:
            core.health_us = present_us
            report(shown.core[0], health, now.kalman.state[0], health_rows[n_health])
            n_health += 1
    return n_rows, n_health
