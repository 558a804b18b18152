"""What the inputs say: how old they are, which gears are in, what the clutches do, whether the speeds fit."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import MAX_GEAR
from dctorque_can.driveline.phase_decision import NEVER, decide_phase, is_closed, small_slip_since
from dctorque_can.driveline.phases import ClutchPhase, PhaseSource
from dctorque_can.estimators.inputs import (
    COMMAND_1,
    ENGINE_SPEED,
    GEAR_1,
    SPEED_1,
    STANDSTILL,
    both_shafts_complete,
    usable,
    wheel_speeds,
)
from dctorque_can.pipeline.samples import N_QUANTITIES, Quantity
from dctorque_can.pipeline.thresholds import IMPLAUSIBLE_RATIO, IMPLAUSIBLE_TIME_US

POSITION_1 = int(Quantity.CLUTCH1_POSITION)
OPEN_1 = int(Quantity.CLUTCH1_OPEN)
_OPEN = int(ClutchPhase.OPEN)


@compiled_without_allocation
def decide_gears(core: Any, inputs: Any, rules: Any) -> None:
    """Take the engaged gear of each shaft from its signal, or from the ratio of its speed to the driven wheels."""
    for i in range(2):
        if not inputs.infer_gears:
            known = usable(inputs, GEAR_1 + i)
            inputs.gear_known[i] = known
            if known:
                gear = int(inputs.value[GEAR_1 + i])
                in_table = -1 <= gear <= MAX_GEAR
                exists = gear == 0 or (in_table and rules.shaft[gear + 1] == i + 1)
                inputs.gear_known[i] = exists
                inputs.gear[i] = gear if exists else 0
            continue
        known, w_d, _, _, _ = wheel_speeds(inputs)
        if known and abs(w_d) < STANDSTILL:
            # at rest every gear fits: the lowest is expected at the next start, and is not known until it shows
            inputs.gear_known[i] = False
            inputs.gear[i] = lowest_gear(rules, i + 1)
        if not known or not usable(inputs, SPEED_1 + i) or abs(w_d) < rules.min_wheel_speed:
            continue  # too slow to tell: the last gear is kept
        best, error = 0, math.inf
        for gear in range(-1, MAX_GEAR + 1):
            ratio = rules.ratio[gear + 1]
            if gear == 0 or ratio == 0.0 or rules.shaft[gear + 1] != i + 1:
                continue
            this = abs(inputs.w_c[i] / (ratio * w_d) - 1.0)
            if this < error:
                best, error = gear, this
        present = inputs.gear[i]
        tolerance = rules.release_tolerance if best == present else rules.engage_tolerance
        wanted = best if error < tolerance else 0
        if wanted == present and inputs.gear_known[i]:
            core.candidate_us[i] = NEVER
        elif core.candidate_us[i] == NEVER or wanted != core.gear_candidate[i]:
            core.gear_candidate[i] = wanted
            core.candidate_us[i] = inputs.t_us
        elif inputs.t_us - core.candidate_us[i] >= rules.confirm_us:
            inputs.gear[i] = wanted
            inputs.gear_known[i] = True
            core.candidate_us[i] = NEVER


@compiled_without_allocation
def lowest_gear(rules: Any, shaft: int) -> int:
    """Return the lowest forward gear of a shaft, 0 for none."""
    for gear in range(1, MAX_GEAR + 1):
        if rules.shaft[gear + 1] == shaft:
            return gear
    return 0


@compiled_without_allocation
def decide_phases(core: Any, inputs: Any, rules: Any, w_e: float) -> None:
    """Decide open, slipping or locked for each clutch (Fig. 3), with hysteresis in position, slip and time."""
    for i in range(2):
        source = rules.phase_source[i]
        if source == PhaseSource.GIVEN:
            inputs.closed_known[i] = usable(inputs, POSITION_1 + i)
            if inputs.closed_known[i]:
                inputs.phase[i] = int(inputs.value[POSITION_1 + i])
                inputs.closed[i] = inputs.phase[i] != _OPEN
            continue
        if source == PhaseSource.FLAG:
            quantity = OPEN_1 + i
        else:
            quantity = (POSITION_1 if source == PhaseSource.POSITION else COMMAND_1) + i
        known = usable(inputs, quantity)
        closed = True  # when nothing says that it is open, it may carry torque
        if known:
            sign, above, below = rules.closing_sign[i], rules.closed_above[i], rules.open_below[i]
            closed = is_closed(source, inputs.value[quantity], sign, above, below, bool(inputs.closed[i]))
        inputs.closed_known[i] = known
        inputs.closed[i] = closed
        slip = abs(w_e - inputs.w_c[i])
        since_us = small_slip_since(slip, rules.slip_locked, inputs.t_us, core.slip_small_us[i])
        core.slip_small_us[i] = since_us
        inputs.phase[i] = decide_phase(
            closed, slip, int(inputs.phase[i]), since_us, inputs.t_us, rules.slip_released, rules.lock_time_us
        )


@compiled_without_allocation
def mark_stale(inputs: Any, rules: Any, health: Any) -> None:
    """Mark the inputs that are older than their timeout, and count each time one becomes so."""
    for quantity in range(N_QUANTITIES):
        old = inputs.t_us - inputs.seen_us[quantity] > rules.timeout_us[quantity]
        if old and inputs.available[quantity] and not inputs.stale[quantity]:
            inputs.stale[quantity] = True
            if rules.longest_delay_us == 0:  # else when an estimate shows it
                health.timeouts[quantity] += 1


@compiled_without_allocation
def any_stale(inputs: Any) -> bool:
    """Return whether an input that was there is older than its timeout."""
    stale = False
    for quantity in range(N_QUANTITIES):
        stale |= bool(inputs.stale[quantity])
    return stale


@compiled_without_allocation
def follow_speeds(inputs: Any, answer: Any) -> float:
    """Bring the shaft speeds to the present; return the engine speed: as the estimator has it, while it runs."""
    for i in range(2):
        if inputs.fresh[SPEED_1 + i] or not answer.running:
            inputs.w_c[i] = inputs.value[SPEED_1 + i]
        else:
            inputs.w_c[i] = answer.w_c[i]
    return float(answer.w_e) if answer.running else float(inputs.value[ENGINE_SPEED])


@compiled_without_allocation
def judge_speeds(core: Any, inputs: Any, rules: Any) -> None:
    """Decide whether the shaft speeds fit gears and wheels now, and remember since when they do not."""
    inputs.fits_again = False
    if not both_shafts_complete(inputs):
        return
    known, w_d, _, _, _ = wheel_speeds(inputs)
    fits = True
    if known and abs(w_d) > rules.min_wheel_speed:
        for i in range(2):
            gear = inputs.gear[i]
            if gear != 0 and abs(inputs.w_c[i] / (rules.ratio[gear + 1] * w_d) - 1.0) > IMPLAUSIBLE_RATIO:
                fits = False
    inputs.fits = fits
    if not fits:
        if core.implausible_us == NEVER:
            core.implausible_us = inputs.t_us
        return
    inputs.fits_again = core.implausible_us != NEVER and inputs.t_us - core.implausible_us >= IMPLAUSIBLE_TIME_US
    core.implausible_us = NEVER
