"""What a frame does to the Kalman estimator: time, gears, phases and speeds in this order."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators import kalman, kalman_gearbox, oh2014
from dctorque_can.estimators.kalman import Kalman
from dctorque_can.estimators.kalman_model import W_B, W_C1, W_E, W_W, N
from dctorque_can.pipeline.decisions import (
    ENGINE_SPEED,
    ENGINE_TORQUE,
    SPEED_1,
    WHEEL,
    axle_speed,
    braking,
    usable,
)
from dctorque_can.pipeline.settings import DrivenAxle

_ENGINE, _SHAFT, _DRIVEN, _UNDRIVEN = 0, 1, 3, 4  # sensors of the gate
_REAR_WHEEL = WHEEL + 2
_OPEN = int(ClutchPhase.OPEN)


@compiled_without_allocation
def start_kalman(core: Any, k: Kalman, w_w: float) -> None:
    """Start at the present measurements; w_w in rad/s."""
    f, tuning = k.state[0], k.tuning[0]
    f.t_us = core.t_us
    f.gear[0], f.gear[1] = core.gear[0], core.gear[1]
    w_1, w_2 = core.value[SPEED_1], core.value[SPEED_1 + 1]
    kalman.start(f, tuning, core.value[ENGINE_SPEED], w_1, w_2, w_w, core.value[ENGINE_TORQUE])


@compiled_without_allocation
def act_kalman(core: Any, rules: Any, k: Kalman) -> None:
    """Let one whole frame take effect at the time of the grid."""
    f, tuning, tables = k.state[0], k.tuning[0], k.tables
    phase_1, phase_2 = phase_of(core, 0), phase_of(core, 1)
    stands = abs(f.x[W_B]) < oh2014.STANDSTILL
    kalman.predict(f, tables, tuning, phase_1, phase_2, braking(core), stands, core.t_us)
    if core.fresh[ENGINE_TORQUE]:
        kalman.take_engine_torque(f, tuning, core.value[ENGINE_TORQUE])
    kalman_gearbox.change_gears(f, tuning, core.gear[0], core.gear[1])
    kalman_gearbox.apply_phases(f, tuning, phase_1 == _OPEN, phase_2 == _OPEN)
    if core.fresh[ENGINE_SPEED]:
        kalman.measure_gated(f, tuning, _ENGINE, W_E, core.value[ENGINE_SPEED], tuning.engine_variance)
    for i in range(2):
        if core.fresh[SPEED_1 + i]:
            kalman.measure_gated(f, tuning, _SHAFT + i, W_C1 + i, core.value[SPEED_1 + i], tuning.shaft_variance)
    front = W_B if rules.driven_axle == DrivenAxle.REAR else W_W
    rear = W_B if rules.driven_axle == DrivenAxle.FRONT else W_W
    measure_axle(core, f, tuning, WHEEL, front)
    measure_axle(core, f, tuning, _REAR_WHEEL, rear)
    kalman_gearbox.decide_directions(f, tuning, phase_1, phase_2)
    kalman_gearbox.conclude(f, tables, tuning)


@compiled_without_allocation
def phase_of(core: Any, i: int) -> int:
    """Return the phase of a clutch; in neutral it carries nothing."""
    return int(core.phase[i]) if core.gear[i] != 0 else _OPEN


@compiled_without_allocation
def measure_axle(core: Any, f: Any, tuning: Any, left: int, state: int) -> None:
    """Take the mean of an axle's wheels when one of them is new."""
    if not (core.fresh[left] or core.fresh[left + 1]):
        return
    known, speed = axle_speed(core, left)
    if known:
        wheels = 2.0 if usable(core, left) and usable(core, left + 1) else 1.0
        sensor = _DRIVEN if state == W_W else _UNDRIVEN
        kalman.measure_gated(f, tuning, sensor, state, speed, tuning.wheel_variance / wheels)


@compiled_without_allocation
def kalman_finite(f: Any) -> bool:
    """Return whether every state and variance is a number, and no variance is negative."""
    total, smallest = 0.0, 0.0
    for i in range(N):
        total += f.x[i] + f.P[i, i]
        smallest = min(smallest, f.P[i, i])
    return math.isfinite(total) and smallest >= 0.0


@compiled_without_allocation
def kalman_torques(f: Any) -> tuple[float, float, float]:
    """Return both clutch torques and the output torque, N·m."""
    return float(f.T_c1), float(f.T_c2), float(f.T_o)
