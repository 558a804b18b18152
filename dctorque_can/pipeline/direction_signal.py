"""What a direction that the bus tells is worth: forwards, backwards, or nothing.

Such a signal is late by a filter's time, says at rest what it said before, can be lost, and can be wrong: stuck,
or taken from the lever instead of the wheels. So it is evidence beside that of the drive (`direction`), and only
once it cannot be of a motion before this one:

* It lasts if it has said the same for half a second, and the car has moved all the time. No signal is later.
* It is alive if it has changed since the car began to move, after a rest of half a second; or if it lasts and has
  changed since the last such rest. One that is stuck never changes.

A signal that lasts is wrong one time in ninety. One that is alive may decide alone. But first the drive alone must
have agreed with it, so that its values are not exchanged; and it must be a signal that measures: the vehicle file
says so, or it has told a car that rolled against its gear. A lever says backwards while the car still rolls
forwards. A signal that the drive alone refutes, or that turns round while the car does not stand, counts for
nothing until it says something else. After the former it must be proven anew.
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.estimators.inputs import usable
from dctorque_can.pipeline.samples import Quantity

DIRECTION_SIGNAL = int(Quantity.DIRECTION)
_WEIGHT = 4.5  # logarithm of the odds: one in ninety is wrong
_ALIVE = 9.0  # … one in 8000
_LATEST_US = 500_000  # by which a signal may be late
_SURE_US = 100_000  # for which one that decides alone must have said so, and less than any motion: wheels rock
_MOST = 0.5  # of the wheels must agree


@compiled_without_allocation
def forget_signal(d: Any) -> None:
    """Know nothing of what the signal said, and of how long the car stood; what it is worth stays."""
    d.said = d.spoke = d.counted = 0
    d.said_us = d.changed_us = d.stands_us = d.rested_us = NEVER
    d.refuted = False


@compiled_without_allocation
def signal_odds(d: Any, inputs: Any, rules: Any, odds: float, decided: float, by_gear: int) -> float:
    """Return how much likelier forwards is, as a logarithm, by what the signal says.

    Args:
        d: `direction.DIRECTION`, up to this frame.
        inputs: `contract.INPUTS`.
        rules: `rules.RULES`.
        odds: the same by the drive alone.
        decided: odds that decide.
        by_gear: direction that the gears drive in, ±1.
    """
    note_rest(d, inputs.t_us)
    note_signal(d, inputs)
    if d.said == 0 or d.t_us == NEVER or d.refuted:
        return 0.0
    age_us = inputs.t_us - max(d.said_us, d.moved_us)
    lasts = age_us >= _LATEST_US
    from_rest = d.moved_us - d.rested_us < _SURE_US
    alive = d.rested_us != NEVER and d.changed_us > d.rested_us and (from_rest or lasts)
    if not alive and not lasts:
        return 0.0
    if d.said == -d.counted:  # no car turns round without standing
        d.refuted = True
        return 0.0
    d.counted = d.said
    agreed = d.said * odds
    if agreed < -decided:
        d.refuted, d.proven, d.measures = True, False, False
        return 0.0
    if alive and agreed > decided:
        d.proven = True
        d.measures |= d.said != by_gear
    decides = alive and bool(d.proven) and age_us >= _SURE_US
    decides &= bool(d.measures) or bool(rules.direction_measured)
    return float(math.copysign(_ALIVE if decides else _WEIGHT, d.said))


@compiled_without_allocation
def note_rest(d: Any, t_us: int) -> None:
    """Note since when the car stands, and when it last had stood for long."""
    if d.t_us != NEVER:
        d.stands_us = NEVER
        return
    d.counted = 0
    if d.stands_us == NEVER:
        d.stands_us = t_us
    if t_us - d.stands_us >= _LATEST_US:
        d.rested_us = t_us


@compiled_without_allocation
def note_signal(d: Any, inputs: Any) -> None:
    """Note what the signal says, and since when; wheels that disagree, and a signal that is lost, say nothing."""
    said = 0
    if usable(inputs, DIRECTION_SIGNAL):
        if abs(inputs.value[DIRECTION_SIGNAL]) > _MOST:
            said = 1 if inputs.value[DIRECTION_SIGNAL] > 0.0 else -1
        if said != d.spoke:
            d.spoke, d.changed_us = said, inputs.t_us  # what is lost and comes back the same has not changed
    if said != d.said or d.said_us == NEVER:
        d.said, d.said_us, d.refuted = said, inputs.t_us, False
