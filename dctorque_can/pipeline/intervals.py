"""How often an input comes, learned from its first samples: what its timeout stands on, if the file says so."""

from __future__ import annotations

from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.pipeline.samples import LONGEST_LEARNED_US
from dctorque_can.pipeline.thresholds import (
    ENOUGH_INTERVALS,
    FIRST_TIMEOUT_US,
    INTERVALS_LEARNED_FROM,
    SHORTEST_TIMEOUT_US,
    TIMEOUT_INTERVALS,
)

_STEP = 16  # the median moves by this part of itself


@compiled_without_allocation
def learn_interval(core: Any, quantity: int, t_us: int) -> None:
    """Learn from a usable sample of an input: a running median, which single gaps and doubles hardly move."""
    before_us = core.sampled_us[quantity]
    core.sampled_us[quantity] = t_us
    n = core.intervals[quantity]
    if before_us == NEVER or n >= INTERVALS_LEARNED_FROM or not 0 < t_us - before_us < LONGEST_LEARNED_US:
        return
    ago_us = t_us - before_us
    usual_us = core.interval_us[quantity]
    step_us = max(usual_us // _STEP, 1)
    core.interval_us[quantity] = ago_us if n == 0 else usual_us + min(max(ago_us - usual_us, -step_us), step_us)
    core.intervals[quantity] = n + 1


@compiled_without_allocation
def timeout_us(core: Any, rules: Any, quantity: int) -> int:
    """Return the age at which an input is stale, from when it was taken, µs."""
    if not rules.learns_timeout[quantity]:
        return rules.timeout_us[quantity]  # type: ignore[no-any-return]
    learned_us = FIRST_TIMEOUT_US
    if core.intervals[quantity] >= ENOUGH_INTERVALS:
        learned_us = min(
            max(TIMEOUT_INTERVALS * core.interval_us[quantity], SHORTEST_TIMEOUT_US), LONGEST_LEARNED_US
        )
    return learned_us + rules.delay_us[quantity]  # type: ignore[no-any-return]
