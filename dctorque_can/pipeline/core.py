"""The compiled heart: one loop over samples that feeds the chosen estimator and writes estimates and health.

Time comes from the samples alone, as integers. A frame first advances the estimator to its own time and then acts,
so an estimate given in answer to a frame contains that frame. State changes nowhere else.

What a frame brings waits in a queue until nothing older can come any more (`delays`): without delays that is at
once. Everything that takes effect does so at one place of the loop, since machine code is made anew for each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators import contract
from dctorque_can.pipeline import delays, derived, direction, driving_shaft
from dctorque_can.pipeline.decisions import decide_gears, decide_phases, follow_speeds, judge_speeds, mark_stale
from dctorque_can.pipeline.intervals import learn_interval
from dctorque_can.pipeline.parts import Parts, Records
from dctorque_can.pipeline.rows import publish, report
from dctorque_can.pipeline.samples import N_QUANTITIES, SampleStatus
from dctorque_can.plausibility.findings import CLUTCHES
from dctorque_can.plausibility.monitor import watch

LATEST_US = 2**60  # times beyond ±36 000 years are taken as this, so that differences never overflow

_OK, _NOT_AVAILABLE = int(SampleStatus.OK), int(SampleStatus.NOT_AVAILABLE)
_OUT_OF_RANGE, _BAD_LENGTH = int(SampleStatus.OUT_OF_RANGE), int(SampleStatus.BAD_LENGTH)
_BAD_CRC, _NOT_BELIEVED = int(SampleStatus.BAD_CRC), int(SampleStatus.NOT_BELIEVED)
_BAD_RATE = int(SampleStatus.BAD_RATE)


@compiled_without_allocation
def is_due(origin_us: int, t_us: int, last_us: int, period_us: int) -> bool:
    """Return whether another period has begun at ``t_us`` since ``last_us``."""
    if last_us == NEVER:
        return True
    return bool((t_us - origin_us) // period_us != (last_us - origin_us) // period_us)


@compiled_without_allocation
def count_sample(health: Any, quantity: int, status: int) -> None:
    """Count a sample; the input of one that is not usable ages until its timeout."""
    if status == _OK:
        health.accepted[quantity] += 1
    elif status == _NOT_AVAILABLE:
        health.not_available[quantity] += 1
    elif status == _OUT_OF_RANGE:
        health.out_of_range[quantity] += 1
    elif status == _BAD_LENGTH:
        health.bad_length[quantity] += 1
    elif status == _BAD_CRC:
        health.bad_crc[quantity] += 1
    elif status == _NOT_BELIEVED:
        health.not_believed[quantity] += 1
    elif status == _BAD_RATE:
        health.bad_rate[quantity] += 1
    else:
        health.bad_counter[quantity] += 1


@compiled_without_allocation
def forget(p: Records, t_us: int) -> None:
    """Drop all inputs and go to ``t_us``."""
    core, inputs = p.core, p.inputs
    inputs.t_us = inputs.origin_us = t_us
    contract.stop(p.chosen, p.answer)
    core.driving_shaft.shaft = -1
    core.estimate_us = core.health_us = core.implausible_us = NEVER
    for quantity in range(N_QUANTITIES):
        inputs.seen_us[quantity] = NEVER
        inputs.available[quantity] = False
        inputs.stale[quantity] = False
        inputs.fresh[quantity] = False
    for i in range(2):
        core.candidate_us[i] = core.slip_small_us[i] = NEVER
        inputs.gear_known[i] = False
        inputs.gear_unsure[i] = inputs.one_gear
        core.one_gear.gear_known[i] = False
        inputs.phase[i] = ClutchPhase.OPEN
    direction.forget(core.direction, inputs)


@compiled_without_allocation
def follows(p: Records, rules: Any, t_us: int) -> bool:
    """Return whether a frame follows the last one; a gap or a step back of the clock starts anew at it."""
    core, health = p.core, p.health
    if core.arrived_us == NEVER:
        p.inputs.origin_us = t_us
        return False
    if t_us < core.arrived_us:
        if core.arrived_us - t_us <= rules.max_step_back_us:
            health.late_frames += 1
            return True
        health.clock_resets += 1
    elif t_us - core.arrived_us <= rules.max_gap_us:
        return True
    else:
        health.gap_resets += 1
    forget(p, t_us)
    return False


@compiled_without_allocation
def begin_frame(p: Records, rules: Any, queue: Any, t_us: int) -> None:
    """Note the time of a new frame; what waits from before a gap is dropped."""
    core = p.core
    if follows(p, rules, t_us):
        core.arrived_us = max(t_us, core.arrived_us)
    else:
        core.arrived_us = t_us
        p.inputs.t_us = t_us - rules.longest_delay_us
        queue.count = 0
    delays.note_frame(queue, t_us)


@compiled_without_allocation
def receive(p: Records, rules: Any, queue: Any, t_us: int, quantity: int, value: float, status: int) -> None:
    """Count a sample, and let it wait for its time if it is sound."""
    core, inputs = p.core, p.inputs
    if status == _OK and not rules.minimum[quantity] <= value <= rules.maximum[quantity]:
        status = _OUT_OF_RANGE
    sound = status in (_OK, _NOT_AVAILABLE)
    if sound and not core.frame_ok:
        # the frame itself is sound, so its time counts even if it brings no value
        begin_frame(p, rules, queue, min(max(t_us, -LATEST_US), LATEST_US))
        core.frame_ok = True
    count_sample(p.health, quantity, status)
    if sound:
        samples = delays.place(queue, queue.frame_us - inputs.delay_us[quantity])
        if status == _OK:
            samples.there[quantity] = True
            samples.value[quantity] = value
            if rules.learns_timeout[quantity]:
                learn_interval(core, quantity, queue.frame_us)


@compiled_without_allocation
def keep_values(inputs: Any, samples: Any) -> None:
    """Keep usable values until the frame takes effect."""
    for quantity in range(N_QUANTITIES):
        if samples.there[quantity]:
            inputs.value[quantity] = samples.value[quantity]
            inputs.seen_us[quantity] = inputs.t_us
            inputs.available[quantity] = True
            inputs.stale[quantity] = False
            inputs.fresh[quantity] = True


@compiled_without_allocation
def take(p: Records, rules: Any, queue: Any, place: int, t_us: int) -> None:
    """Go to ``t_us`` and let what stands at a place of the queue take effect; −1: only time has passed.

    An estimator whose state is no number any more starts anew.
    """
    core, inputs, answer, health = p.core, p.inputs, p.answer, p.health
    contract.advance(p.chosen, inputs, answer, t_us)
    inputs.t_us = max(inputs.t_us, t_us)
    if place >= 0:
        keep_values(inputs, queue.waiting[place])
    mark_stale(core, inputs, rules, health)
    direction.follow(core.direction, inputs, rules, answer)
    w_e = follow_speeds(inputs, answer)
    inputs.phases_believed = p.monitor.strong & CLUTCHES == 0
    decide_phases(core, inputs, rules, w_e)
    decide_gears(core, inputs, rules, answer, w_e)
    judge_speeds(core, inputs, rules)
    driving_shaft.give_speed(core.driving_shaft, inputs, rules)
    contract.act(p.chosen, inputs, answer)
    watch(p.monitor, rules.car, inputs, answer)
    for quantity in range(N_QUANTITIES):
        inputs.fresh[quantity] = False
    if not contract.is_finite(p.chosen):
        health.numeric_resets += 1
        contract.start(p.chosen, answer)
    derived.follow(core, inputs, rules, answer, p.derived)


@compiled_without_allocation
def run(
    n: int,
    t_us: NDArray[np.int64],
    quantities: NDArray[np.uint8],
    values: NDArray[np.float64],
    statuses: NDArray[np.uint8],
    lasts: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
    asked: bool,
    rule: NDArray[np.void],
    now: Parts,
    ahead: Parts,
    queues: NDArray[np.void],
    rows: NDArray[np.void],
    health_rows: NDArray[np.void],
) -> tuple[int, int]:
    """Feed the first n samples; return how many estimates and health rows were written.

    Where ``wanted`` is not empty, it tells after which samples an estimate is written, instead of the period.
    Where health is ``asked`` for, another row of it is written at the end.
    """
    rules, queue = rule[0], queues[0]
    present = Records(
        now.core[0], now.inputs[0], now.answer[0], now.health[0], now.derived[0], now.monitor[0], now.chosen
    )
    future = Records(
        ahead.core[0],
        ahead.inputs[0],
        ahead.answer[0],
        ahead.health[0],
        ahead.derived[0],
        ahead.monitor[0],
        ahead.chosen,
    )
    core, inputs = present.core, present.inputs
    n_rows = n_health = 0
    for k in range(n + (1 if asked else 0)):
        sound, estimate_due, health_due = False, False, True
        if k < n:
            quantity = int(quantities[k])
            if inputs.mapped[quantity]:
                receive(present, rules, queue, t_us[k], quantity, values[k], int(statuses[k]))
            sound = lasts[k] and bool(core.frame_ok)
            if sound:
                core.frame_ok = False
            origin_us, present_us = inputs.origin_us, core.arrived_us
            estimate_due = sound and is_due(origin_us, present_us, core.estimate_us, rules.estimate_period_us)
            if len(wanted) > 0:
                estimate_due = bool(wanted[k])
            health_due = sound and is_due(origin_us, present_us, core.health_us, rules.health_period_us)
            if estimate_due:
                core.estimate_us = present_us
            if health_due:
                core.health_us = present_us
        shows = estimate_due or health_due
        shown = present
        looks, seen = False, 0  # ahead, to those that wait
        while sound or shows:
            if not looks and sound and delays.is_ripe(queue, core.arrived_us, rules.longest_delay_us):
                place = delays.take_oldest(queue)  # for good
            elif not looks:
                if not shows or rules.longest_delay_us == 0:
                    break
                delays.copy(now, ahead)
                shown, looks = future, True
                continue
            elif seen < queue.count:
                place = delays.nth(queue, seen)
                seen += 1
            elif future.inputs.t_us < core.arrived_us:
                place = -1
            else:
                break
            take(shown, rules, queue, place, queue.waiting[place].t_us if place >= 0 else core.arrived_us)
        if looks:
            delays.count_timeouts(queue, shown.inputs, present.health)
        if estimate_due:
            publish(shown, rules, rows[n_rows])
            core.status = shown.core.status
            n_rows += 1
        if health_due:
            report(shown.inputs, present.health, shown.monitor, health_rows[n_health])
            contract.report(present.chosen, health_rows[n_health])
            health_rows[n_health].status = shown.core.status
            n_health += 1
    return n_rows, n_health
