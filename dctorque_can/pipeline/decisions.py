"""What the inputs say: how old they are, which gears are in, what the clutches do, whether the speeds fit."""

from __future__ import annotations

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
    both_shafts_complete,
    usable,
    wheel_speeds,
)
from dctorque_can.pipeline import one_gear
from dctorque_can.pipeline.intervals import timeout_us
from dctorque_can.pipeline.samples import N_QUANTITIES, Quantity
from dctorque_can.pipeline.shaft_ratio import follow_ratio
from dctorque_can.pipeline.thresholds import IMPLAUSIBLE_RATIO, IMPLAUSIBLE_TIME_US

POSITION_1 = int(Quantity.CLUTCH1_POSITION)
OPEN_1 = int(Quantity.CLUTCH1_OPEN)
CLUTCH_STATE = int(Quantity.CLUTCH_STATE)
_OPEN, _LOCKED = int(ClutchPhase.OPEN), int(ClutchPhase.LOCKED)


@compiled_without_allocation
def decide_gears(core: Any, inputs: Any, rules: Any, answer: Any, w_e: float) -> None:
    """Take the engaged gear of each shaft from its signal, from that of the whole gearbox, or from a ratio."""
    if rules.one_gear:
        one_gear.decide_both(core, inputs, rules, answer, w_e)
        return
    for i in range(2):
        inputs.idle[i] = is_idle(core, inputs, i)
        if inputs.infer_gears:
            follow_ratio(core, inputs, rules, inputs, i)
            inputs.gear_unsure[i] = not inputs.closed[i]  # it may be leaving the gear that its speed still fits
            continue
        known = usable(inputs, GEAR_1 + i)
        inputs.gear_known[i] = known
        if known:
            gear = int(inputs.value[GEAR_1 + i])
            in_table = -1 <= gear <= MAX_GEAR
            exists = gear == 0 or (in_table and rules.shaft[gear + 1] == i + 1)
            inputs.gear_known[i] = exists
            inputs.gear[i] = gear if exists else 0


@compiled_without_allocation
def is_idle(core: Any, inputs: Any, i: int) -> bool:
    """Return whether nothing says that clutch i is open, but it slips while the other one has not for long."""
    told = (inputs.phases_told and inputs.phases_believed) or inputs.closed_known[i]
    if told or not inputs.closed[i] or inputs.gear[1 - i] == 0:
        return False
    since_us = core.slip_small_us[1 - i]
    drives = since_us != NEVER and inputs.t_us - since_us >= one_gear.SETTLED_US
    return bool(drives and core.slip_small_us[i] == NEVER)


@compiled_without_allocation
def decide_phases(core: Any, inputs: Any, rules: Any, w_e: float) -> None:
    """Decide open, slipping or locked for each clutch (Fig. 3), with hysteresis in position, slip and time.

    What is told and contradicts the speeds over a while is not believed: it is then as if nothing was told.
    """
    for i in range(2):
        source = rules.phase_source[i]
        if source == PhaseSource.GIVEN:
            inputs.closed_known[i] = usable(inputs, POSITION_1 + i)
            if inputs.closed_known[i]:
                inputs.phase[i] = int(inputs.value[POSITION_1 + i])
                inputs.closed[i] = inputs.phase[i] != _OPEN
            inputs.called[i] = inputs.closed[i] if inputs.closed_known[i] else -1
            continue
        if source == PhaseSource.NONE or source == PhaseSource.STATE:
            quantity = CLUTCH_STATE
        elif source == PhaseSource.FLAG:
            quantity = OPEN_1 + i
        else:
            quantity = (POSITION_1 if source == PhaseSource.POSITION else COMMAND_1) + i
        known = usable(inputs, quantity) and source != PhaseSource.NONE
        closed = True  # when nothing says that it is open, it may carry torque
        if known:
            sign, above, below = rules.closing_sign[i], rules.closed_above[i], rules.open_below[i]
            closed = is_closed(source, inputs.value[quantity], sign, above, below, inputs.called[i] != 0)
        inputs.called[i] = (1 if closed else 0) if known else -1
        if not inputs.phases_believed:
            known, closed = False, True
        inputs.closed_known[i] = known
        inputs.closed[i] = closed
        inputs.touches[i] = 0.0
        if known and rules.touches_before[i] > 0.0:
            before = rules.closed_above[i] - rules.closing_sign[i] * inputs.value[quantity]
            inputs.touches[i] = min(max(1.0 - before / rules.touches_before[i], 0.0), 1.0)
        slip = abs(w_e - inputs.w_c[i])
        since_us = small_slip_since(slip, rules.slip_locked, inputs.t_us, core.slip_small_us[i])
        core.slip_small_us[i] = since_us
        inputs.phase[i] = decide_phase(
            closed, slip, int(inputs.phase[i]), since_us, inputs.t_us, rules.slip_released, rules.lock_time_us
        )
        if source == PhaseSource.STATE and closed and inputs.phase[i] != _LOCKED:
            inputs.closed_known[i] = False  # one of them is closed, or both
            inputs.called[i] = -1


@compiled_without_allocation
def mark_stale(core: Any, inputs: Any, rules: Any, health: Any) -> None:
    """Mark the inputs that are older than their timeout, and count each time one becomes so."""
    for quantity in range(N_QUANTITIES):
        old = inputs.t_us - inputs.seen_us[quantity] > timeout_us(core, rules, quantity)
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
            if gear == 0 or inputs.gear_unsure[i]:
                continue
            if abs(inputs.w_c[i] / (rules.ratio[gear + 1] * w_d) - 1.0) > IMPLAUSIBLE_RATIO:
                fits = False
    inputs.fits = fits
    if not fits:
        if core.implausible_us == NEVER:
            core.implausible_us = inputs.t_us
        return
    inputs.fits_again = core.implausible_us != NEVER and inputs.t_us - core.implausible_us >= IMPLAUSIBLE_TIME_US
    core.implausible_us = NEVER
