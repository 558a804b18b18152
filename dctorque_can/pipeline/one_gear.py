"""One gear signal for the whole gearbox: which gears it means on both shafts, and how sure that is.

The actual gear's shaft has that gear. The other shaft has, in this order,

* what the ratio of its speed to the wheels says, where its speed is known,
* the target gear, if that is told and belongs to it,
* the gear that drove before, from a change of the actual gear until the new clutch is together,
* else the neighbour that the next shift is expected to be to: the higher one while the engine drives and the lower
  one while it is driven; and once the driving clutch slips, the one that the engine's speed moves to.

But for the first, nobody says whether that gear is engaged already, and the last one is a guess. It is good enough
to know that a torque may be on its way to the other clutch. While that is likely the gears are ambiguous, and no
torque is valid.
"""

from __future__ import annotations

from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import MAX_GEAR
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.estimators.inputs import SPEED_1, usable, wheel_speeds
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.pipeline.shaft_ratio import follow_ratio

GEAR, TARGET_GEAR = int(Quantity.GEAR), int(Quantity.TARGET_GEAR)
SHIFT_IN_PROGRESS = int(Quantity.SHIFT_IN_PROGRESS)

SETTLED_US = 300_000
"""For so long the clutch of the actual gear must have been together, before the old one counts as open."""
TOGETHER_RAD_S = 6.0
"""Slip below which it is: speeds come late, and the shaft's may be that of wheels."""
ODD_RAD_S, ODD_SHARE = 2.0, 0.01
"""By which a shaft and its gear may be apart, since their speeds are taken at different times."""
ODD_US = 200_000
"""For so long the speed of a shaft that has left its gear disturbs the torques."""
REVERSAL_NM = 5.0
"""Torque of both clutches beyond zero from which the next shift is expected to be the other way."""


@compiled_without_allocation
def exists(rules: Any, gear: int) -> bool:
    """Return whether the vehicle has this gear, −1 for reverse."""
    return -1 <= gear <= MAX_GEAR and gear != 0 and rules.shaft[gear + 1] != 0


@compiled_without_allocation
def told_gear(inputs: Any, rules: Any, quantity: int) -> tuple[bool, int]:
    """Return whether a gear is told that there is, and which."""
    if not usable(inputs, quantity):
        return False, 0
    gear = int(inputs.value[quantity])
    return gear == 0 or exists(rules, gear), gear


@compiled_without_allocation
def decide_both(core: Any, inputs: Any, rules: Any, answer: Any, w_e: float) -> None:
    """Decide the gears of both shafts."""
    d = core.one_gear
    inputs.ambiguous = inputs.idle[0] = inputs.idle[1] = False
    inputs.synchronises[0] = inputs.synchronises[1] = False
    known, actual = told_gear(inputs, rules, GEAR)
    if not known:  # the gears stay what they were
        inputs.gear_known[0] = inputs.gear_known[1] = False
        inputs.gear_unsure[0] = inputs.gear_unsure[1] = True
        inputs.ambiguous = True
        return
    note_actual(d, inputs, actual)
    if actual == 0:
        for i in range(2):
            inputs.gear[i], inputs.gear_known[i], inputs.gear_unsure[i] = 0, True, False
        inputs.ambiguous = inputs.t_us - d.changed_us < SETTLED_US
        return
    a = int(rules.shaft[actual + 1]) - 1
    b = 1 - a
    _, w_d, _, _, _ = wheel_speeds(inputs)
    slip = w_e - rules.ratio[actual + 1] * w_d
    note_slip(d, inputs, rules, slip)
    inputs.gear[a], inputs.gear_known[a], inputs.gear_unsure[a] = actual, True, False
    inputs.idle[b] = inputs.closed[b] and not inputs.closed_known[b] and not d.shifting
    if inputs.mapped[SPEED_1 + b]:
        take_ratio(core, inputs, rules, a, b, w_d)
        return
    torque = answer.T_c[0] + answer.T_c[1]
    if d.together_us == NEVER:
        d.up = slip < 0.0
    elif abs(torque) > REVERSAL_NM:
        d.up = torque > 0.0
    told, target = told_gear(inputs, rules, TARGET_GEAR)
    sure = told and target != 0 and rules.shaft[target + 1] == b + 1
    gear = target if sure else 0
    if not sure and d.former != 0 and rules.shaft[d.former + 1] == b + 1:
        gear, sure = d.former, True
    elif not sure:
        gear = expected(rules, actual, b, bool(d.up))
    inputs.gear[b], inputs.gear_known[b], inputs.gear_unsure[b] = gear, True, True
    inputs.synchronises[b] = gear != 0
    may_carry = bool(d.shifting) if not inputs.closed_known[b] else bool(inputs.closed[b])
    inputs.ambiguous = not sure and may_carry and gear != 0


@compiled_without_allocation
def take_ratio(core: Any, inputs: Any, rules: Any, a: int, b: int, w_d: float) -> None:
    """Take the gear of shaft b from its speed; a is the one that drives.

    A shaft that leaves its gear moves away from it slowly, and the model would make torque of that. So its speed
    counts for no more than this, unless its clutch is told to be closed. While it may be, and the other one does
    not drive alone, the gears are ambiguous once the speed has left the gear.
    """
    d = core.one_gear
    d.gear[a], d.gear_known[a] = inputs.gear[a], True
    follow_ratio(core, inputs, rules, d, b)
    gear = d.gear[b] if d.gear_known[b] else 0
    inputs.gear[b], inputs.gear_known[b] = gear, True
    inputs.gear_unsure[b] = not inputs.closed_known[b] or not inputs.closed[b] or not d.gear_known[b]
    inputs.synchronises[b] = gear != 0 and bool(inputs.gear_unsure[b])
    if usable(inputs, SPEED_1 + b) and gear != 0:
        apart = abs(abs(inputs.w_c[b]) - abs(rules.ratio[gear + 1] * w_d))
        if apart > ODD_RAD_S + ODD_SHARE * abs(inputs.w_c[b]):
            d.odd_us = inputs.t_us
        elif inputs.idle[b]:  # it turns as the gear makes it
            inputs.synchronises[b] = False
    may_carry = bool(inputs.closed[b]) and not inputs.idle[b]
    inputs.ambiguous = may_carry and d.odd_us != NEVER and inputs.t_us - d.odd_us < ODD_US


@compiled_without_allocation
def note_actual(d: Any, inputs: Any, actual: int) -> None:
    """Remember the gear that drove before."""
    if actual != d.actual or d.changed_us == NEVER:
        d.former = d.actual
        d.actual = actual
        d.changed_us = inputs.t_us
        d.together_us = NEVER


@compiled_without_allocation
def note_slip(d: Any, inputs: Any, rules: Any, slip: float) -> None:
    """Decide whether the clutch of the actual gear is together, and whether a shift is in progress."""
    if abs(slip) > TOGETHER_RAD_S:
        d.together_us = NEVER
    elif d.together_us == NEVER:
        d.together_us = inputs.t_us
    settled = d.together_us != NEVER and inputs.t_us - d.together_us >= SETTLED_US
    told = usable(inputs, SHIFT_IN_PROGRESS)
    d.shifting = not settled or (told and inputs.value[SHIFT_IN_PROGRESS] > 0.5)
    if settled and not d.shifting:
        d.former = 0


@compiled_without_allocation
def expected(rules: Any, actual: int, shaft: int, up: bool) -> int:
    """Return the gear of a shaft that the next shift is expected to be to; 0 for none."""
    if actual < 0:
        return 0
    first, second = (actual + 1, actual - 1) if up else (actual - 1, actual + 1)
    for gear in (first, second):
        if gear > 0 and exists(rules, gear) and rules.shaft[gear + 1] == shaft + 1:
            return gear
    return 0
