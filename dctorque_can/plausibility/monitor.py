"""The monitor: looks at the inputs now and then, adds what they say, and judges."""

from __future__ import annotations

from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.plausibility import clutches, signals, speeds, torques
from dctorque_can.plausibility.thresholds import DECIDE_EVERY, PERIOD_US


@compiled_without_allocation
def watch(m: Any, car: Any, inputs: Any, answer: Any) -> None:
    """Look at the inputs if it is time to.

    Args:
        m: `MONITOR`.
        car: `CAR`.
        inputs: `INPUTS`, as the frame at hand has left them.
        answer: `ANSWER` of the estimator to it.
    """
    if m.t_us != NEVER and 0 <= inputs.t_us - m.t_us < PERIOD_US:
        return
    if not signals.complete(inputs):
        return
    dt = signals.follow(m, car, inputs)
    if dt == 0.0:
        return
    m.looks += 1
    speeds.compare_ratios(m, car, inputs, dt)
    clutches.compare_phases(m, car, inputs, dt)
    torques.compare_idle(m, car, inputs, dt)
    torques.compare_torque(m, car, inputs, dt)
    if m.looks % DECIDE_EVERY == 0:
        speeds.compare_axles(m, car, inputs)
        speeds.judge_ratios(m)
        speeds.judge_axles(m)
        speeds.judge_delay(m, answer)
        clutches.judge_phases(m)
        torques.judge_idle(m)
        torques.judge_factors(m)
        torques.judge_grade(m)
