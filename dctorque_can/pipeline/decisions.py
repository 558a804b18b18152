"""What the inputs say: which are usable, how fast the wheels turn, which gears are in, what the clutches do."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phase_decision import decide_phase, is_closed, small_slip_since
from dctorque_can.driveline.phases import ClutchPhase, PhaseSource
from dctorque_can.estimators import oh2014, oh2014_model
from dctorque_can.pipeline.core_state import NEVER
from dctorque_can.pipeline.samples import N_QUANTITIES, Quantity
from dctorque_can.pipeline.settings import DrivenAxle

ENGINE_SPEED = int(Quantity.ENGINE_SPEED)
ENGINE_TORQUE = int(Quantity.ENGINE_TORQUE)
SPEED_1 = int(Quantity.SHAFT1_SPEED)
WHEEL = int(Quantity.WHEEL_SPEED_FL)
GEAR_1 = int(Quantity.GEAR1)
POSITION_1 = int(Quantity.CLUTCH1_POSITION)
OPEN_1 = int(Quantity.CLUTCH1_OPEN)
COMMAND_1 = int(Quantity.CLUTCH1_COMMAND)
ACCELERATION = int(Quantity.ACCELERATION)
GRADE = int(Quantity.GRADE)
BRAKE = int(Quantity.BRAKE)
_OPEN = int(ClutchPhase.OPEN)
IMPLAUSIBLE_RATIO = 0.15
IMPLAUSIBLE_TIME_US = 300_000


@compiled_without_allocation
def usable(core: Any, quantity: int) -> bool:
    """Return whether an input has a value that is not too old."""
    return bool(core.available[quantity]) and not core.stale[quantity]


@compiled_without_allocation
def axle_speed(core: Any, left: int) -> tuple[bool, float]:
    """Return whether an axle has a speed, and the mean of its wheels that are usable."""
    a, b = usable(core, left), usable(core, left + 1)
    if a and b:
        return True, 0.5 * (core.value[left] + core.value[left + 1])
    if a:
        return True, core.value[left]
    return b, core.value[left + 1]


@compiled_without_allocation
def wheel_speeds(core: Any, rules: Any) -> tuple[bool, float, bool, float, bool]:
    """Return (known, driven mean, known, undriven mean, whether the undriven ones were just renewed).

    Without undriven wheels the driven ones stand in, and the other way round.
    """
    front_known, front = axle_speed(core, WHEEL)
    rear_known, rear = axle_speed(core, WHEEL + 2)
    front_fresh = core.fresh[WHEEL] or core.fresh[WHEEL + 1]
    rear_fresh = core.fresh[WHEEL + 2] or core.fresh[WHEEL + 3]
    if rules.driven_axle == DrivenAxle.REAR:
        front_known, front, rear_known, rear = rear_known, rear, front_known, front
        front_fresh, rear_fresh = rear_fresh, front_fresh
    if rules.driven_axle == DrivenAxle.ALL and front_known and rear_known:
        front = rear = 0.5 * (front + rear)
        rear_fresh = front_fresh or rear_fresh
    if not rear_known:
        return front_known, front, front_known, front, front_fresh
    if not front_known:
        return rear_known, rear, rear_known, rear, rear_fresh
    return front_known, front, rear_known, rear, rear_fresh


@compiled_without_allocation
def decide_gears(core: Any, rules: Any, c: Any) -> None:
    """Take the engaged gear of each shaft from its signal, or from the ratio of its speed to the driven wheels."""
    for i in range(2):
        if not rules.infer_gears:
            known = usable(core, GEAR_1 + i)
            core.gear_known[i] = known
            if known:
                gear = int(core.value[GEAR_1 + i])
                in_table = -1 <= gear <= oh2014_model.MAX_GEAR
                exists = gear == 0 or (in_table and c.shaft[gear + 1] == i + 1)
                core.gear_known[i] = exists
                core.gear[i] = gear if exists else 0
            continue
        known, w_d, _, _, _ = wheel_speeds(core, rules)
        if known and abs(w_d) < oh2014.STANDSTILL:
            # at rest every gear fits: the lowest is expected at the next start, and is not known until it shows
            core.gear_known[i] = False
            core.gear[i] = lowest_gear(c, i + 1)
        if not known or not usable(core, SPEED_1 + i) or abs(w_d) < rules.min_wheel_speed:
            continue  # too slow to tell: the last gear is kept
        best, error = 0, math.inf
        for gear in range(-1, oh2014_model.MAX_GEAR + 1):
            ratio = c.i_t[gear + 1] * c.i_f[gear + 1]
            if gear == 0 or ratio == 0.0 or c.shaft[gear + 1] != i + 1:
                continue
            this = abs(core.w_c[i] / (ratio * w_d) - 1.0)
            if this < error:
                best, error = gear, this
        present = core.gear[i]
        tolerance = rules.release_tolerance if best == present else rules.engage_tolerance
        wanted = best if error < tolerance else 0
        if wanted == present and core.gear_known[i]:
            core.candidate_us[i] = NEVER
        elif core.candidate_us[i] == NEVER or wanted != core.gear_candidate[i]:
            core.gear_candidate[i] = wanted
            core.candidate_us[i] = core.t_us
        elif core.t_us - core.candidate_us[i] >= rules.confirm_us:
            core.gear[i] = wanted
            core.gear_known[i] = True
            core.candidate_us[i] = NEVER


@compiled_without_allocation
def lowest_gear(c: Any, shaft: int) -> int:
    """Return the lowest forward gear of a shaft, 0 for none."""
    for gear in range(1, oh2014_model.MAX_GEAR + 1):
        if c.shaft[gear + 1] == shaft:
            return gear
    return 0


@compiled_without_allocation
def decide_phases(core: Any, rules: Any, w_e: float) -> None:
    """Decide open, slipping or locked for each clutch (Fig. 3), with hysteresis in position, slip and time."""
    for i in range(2):
        source = rules.phase_source[i]
        if source == PhaseSource.GIVEN:
            core.closed_known[i] = usable(core, POSITION_1 + i)
            if core.closed_known[i]:
                core.phase[i] = int(core.value[POSITION_1 + i])
                core.closed[i] = core.phase[i] != _OPEN
            continue
        if source == PhaseSource.FLAG:
            quantity = OPEN_1 + i
        else:
            quantity = (POSITION_1 if source == PhaseSource.POSITION else COMMAND_1) + i
        known = usable(core, quantity)
        closed = True  # when nothing says that it is open, it may carry torque
        if known:
            sign, above, below = rules.closing_sign[i], rules.closed_above[i], rules.open_below[i]
            closed = is_closed(source, core.value[quantity], sign, above, below, bool(core.closed[i]))
        core.closed_known[i] = known
        core.closed[i] = closed
        slip = abs(w_e - core.w_c[i])
        since_us = small_slip_since(slip, rules.slip_locked, core.t_us, core.slip_small_us[i])
        core.slip_small_us[i] = since_us
        core.phase[i] = decide_phase(
            closed, slip, int(core.phase[i]), since_us, core.t_us, rules.slip_released, rules.lock_time_us
        )


@compiled_without_allocation
def mark_stale(core: Any, rules: Any, health: Any) -> None:
    """Mark the inputs that are older than their timeout, and count each time one becomes so."""
    for quantity in range(N_QUANTITIES):
        old = core.t_us - core.seen_us[quantity] > rules.timeout_us[quantity]
        if old and core.available[quantity] and not core.stale[quantity]:
            core.stale[quantity] = True
            if rules.longest_delay_us == 0:  # else when an estimate shows it
                health.timeouts[quantity] += 1


@compiled_without_allocation
def any_stale(core: Any) -> bool:
    """Return whether an input that was there is older than its timeout."""
    stale = False
    for quantity in range(N_QUANTITIES):
        stale |= bool(core.stale[quantity])
    return stale


@compiled_without_allocation
def wheels_in_use(core: Any) -> int:
    """Return one bit for each wheel whose speed is usable."""
    bits = 0
    for k in range(4):
        if usable(core, WHEEL + k):
            bits |= 1 << k
    return bits


@compiled_without_allocation
def braking(core: Any) -> bool:
    """Return whether the bus says that the brake is on."""
    return usable(core, BRAKE) and core.value[BRAKE] > 0.0


@compiled_without_allocation
def inputs_complete(core: Any, rules: Any) -> bool:
    """Return whether the observer has all it needs: engine, both shafts, gears and a wheel speed."""
    _, _, wheels, _, _ = wheel_speeds(core, rules)
    gears = rules.infer_gears or (core.gear_known[0] and core.gear_known[1])
    return bool(
        wheels
        and gears
        and usable(core, ENGINE_SPEED)
        and usable(core, ENGINE_TORQUE)
        and usable(core, SPEED_1)
        and usable(core, SPEED_1 + 1)
    )


@compiled_without_allocation
def speeds_fit(core: Any, rules: Any, c: Any) -> bool:
    """Return whether the shaft speeds fit gears and wheels now, and remember since when they do not."""
    known, w_d, _, _, _ = wheel_speeds(core, rules)
    fits = True
    if known and abs(w_d) > rules.min_wheel_speed:
        for i in range(2):
            gear = core.gear[i]
            ratio = c.i_t[gear + 1] * c.i_f[gear + 1]
            if gear != 0 and abs(core.w_c[i] / (ratio * w_d) - 1.0) > IMPLAUSIBLE_RATIO:
                fits = False
    if not fits:
        if core.implausible_us == NEVER:
            core.implausible_us = core.t_us
        return False
    if core.implausible_us != NEVER and core.t_us - core.implausible_us >= IMPLAUSIBLE_TIME_US:
        core.reset_us = core.t_us  # what was estimated meanwhile must settle anew
    core.implausible_us = NEVER
    return True
