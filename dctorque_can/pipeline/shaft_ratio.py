"""The gear of a shaft by the ratio of its speed to that of the driven wheels."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import MAX_GEAR
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.estimators.inputs import SPEED_1, STANDSTILL, usable, wheel_speeds
from dctorque_can.pipeline.thresholds import HELD_US


@compiled_without_allocation
def follow_ratio(core: Any, inputs: Any, rules: Any, gears: Any, i: int) -> None:
    """Decide the gear of shaft i; slow, it is kept, and at rest the lowest is expected and not known.

    While its clutch is told to be closed no gear is left for neutral: a shaft that does not turn with the wheels
    then winds up or rings. In the end its gear is not known.

    Args:
        core: `rules.CORE`.
        inputs: `contract.INPUTS`.
        rules: `rules.RULES`.
        gears: with the fields ``gear`` and ``gear_known`` that are renewed.
        i: 0 or 1.
    """
    known, w_d, _, _, _ = wheel_speeds(inputs)
    if known and abs(w_d) < STANDSTILL:
        # at rest every gear fits: the lowest is expected at the next start, and is not known until it shows
        gears.gear_known[i] = False
        gears.gear[i] = lowest_gear(rules, i + 1)
    if not known or not usable(inputs, SPEED_1 + i) or abs(w_d) < rules.min_wheel_speed:
        return  # too slow to tell: the last gear is kept
    best, error = 0, math.inf
    for gear in range(-1, MAX_GEAR + 1):
        ratio = rules.ratio[gear + 1]
        if gear == 0 or ratio == 0.0 or rules.shaft[gear + 1] != i + 1:
            continue
        share = inputs.w_c[i] / (ratio * w_d)
        this = abs((abs(share) if inputs.magnitudes else share) - 1.0)  # reverse has no sign then
        if this < error:
            best, error = gear, this
    present = gears.gear[i]
    tolerance = rules.release_tolerance if best == present else rules.engage_tolerance
    closed = inputs.closed_known[i] and inputs.closed[i] and present != 0
    holds = closed and gears.gear_known[i]
    wanted = best if error < tolerance else 0
    if wanted == present and gears.gear_known[i]:
        core.candidate_us[i] = NEVER
    elif core.candidate_us[i] == NEVER or wanted != core.gear_candidate[i]:
        core.gear_candidate[i] = wanted
        core.candidate_us[i] = inputs.t_us
    elif inputs.t_us - core.candidate_us[i] >= (max(rules.confirm_us, HELD_US) if holds else rules.confirm_us):
        gears.gear_known[i] = wanted != 0 or not closed
        if gears.gear_known[i]:
            gears.gear[i] = wanted
        core.candidate_us[i] = NEVER


@compiled_without_allocation
def lowest_gear(rules: Any, shaft: int) -> int:
    """Return the lowest forward gear of a shaft, 0 for none."""
    for gear in range(1, MAX_GEAR + 1):
        if rules.shaft[gear + 1] == shaft:
            return gear
    return 0
