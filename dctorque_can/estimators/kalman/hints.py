"""Weak measurements of torques: what an accelerometer, a known grade and the clutch commands hint at.

Their errors are offsets of sensors, the pitch of the body, the mass and the friction: they last, and must not be
averaged away as noise would be. An error of standard deviation σ that lasts for τ is taken as a white one of the
same power at low frequencies, 2 τ σ² over the time since the last value: information comes with time, however
often a message is sent.

With the body's balance J_b ω̇_b = T_x − T_v, and while no brake acts:

    accelerometer   f = r ω̇_b + g sin(grade)      T_x = r m f + (J_b − m r²) ω̇_b + rolling + air
    grade                                          T_v = r m g sin(grade) + rolling + air

Torques in N·m, speeds in rad/s, f in m/s².
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import STANDARD_GRAVITY
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.kalman.filter import measure
from dctorque_can.estimators.kalman.model import T_C1, T_V, T_X, W_B, W_C1, W_E
from dctorque_can.estimators.kalman.tuning import SLIDING

ACCELERATION, GRADE, COMMAND_1 = 0, 1, 2  # places of the hints; clutch 2's follows
_SLIPPING, _LOCKED = int(ClutchPhase.SLIPPING), int(ClutchPhase.LOCKED)
_LONGEST_S = 0.1  # since the last value, that counts for the information of a new one


@compiled_without_allocation
def resistance(f: Any, tuning: Any) -> float:
    """Return rolling resistance and air drag at the wheel; zero at rest."""
    w = f.x[W_B]
    rolling = math.copysign(tuning.rolling_torque, w) if w != 0.0 else 0.0
    return float(rolling + tuning.air_torque * w * abs(w))


@compiled_without_allocation
def take_acceleration(f: Any, tuning: Any, acceleration: float) -> None:
    """Take what an accelerometer along the car reads, while it rolls without brakes."""
    w_dot = (f.x[T_X] - f.x[T_V]) / tuning.J_b
    T_x = tuning.mass_arm * acceleration + tuning.J_b_wheels * w_dot + resistance(f, tuning)
    take(f, tuning, ACCELERATION, T_X, T_x, tuning.mass_arm * tuning.acceleration_error)


@compiled_without_allocation
def take_grade(f: Any, tuning: Any, grade: float) -> None:
    """Take the inclination of the road, while the car rolls without brakes."""
    arm = tuning.mass_arm * STANDARD_GRAVITY
    take(f, tuning, GRADE, T_V, arm * math.sin(grade) + resistance(f, tuning), arm * tuning.grade_error)


@compiled_without_allocation
def take(f: Any, tuning: Any, hint: int, i: int, z: float, error: float) -> None:
    """Take a hint z of x_i whose error lasts, unless it is beyond the gate.

    Args:
        f: filter.
        tuning: of it.
        hint: its place.
        i: state.
        z: value.
        error: standard deviation; that of the mass comes on top.
    """
    seconds = time_since(f, hint)
    variance = error * error + (tuning.parameter_error * z) ** 2
    e = z - f.x[i]
    if e * e <= tuning.gate * (f.P[i, i] + variance):  # false also when it is no number
        measure(f, i, z, variance * max(2.0 * tuning.inertial_time / seconds, 1.0))


@compiled_without_allocation
def time_since(f: Any, hint: int) -> float:
    """Return how much time a new value of a hint speaks for, s."""
    seconds = (f.t_us - f.hint_us[hint]) * 1e-6
    f.hint_us[hint] = f.t_us
    return float(min(max(seconds, 1e-4), _LONGEST_S))


@compiled_without_allocation
def take_command(f: Any, tuning: Any, i: int, phase: int, command: float) -> None:
    """Take the commanded capacity of clutch i (0, 1): what it carries while it slips, at most while it is locked.

    The clutch follows its command with a lag; the command that is on its way is part of the error. A negative
    command holds a clutch open.
    """
    command = max(command, 0.0)
    seconds = time_since(f, COMMAND_1 + i)
    if not math.isfinite(f.lagged_command[i]):
        f.lagged_command[i] = f.last_command[i] = command
    f.lagged_command[i] -= math.expm1(-seconds / tuning.command_lag) * (f.last_command[i] - f.lagged_command[i])
    f.last_command[i] = command
    lagged = f.lagged_command[i]
    torque, slip = f.x[T_C1 + i], f.x[W_E] - f.x[W_C1 + i]
    error = tuning.command_error + tuning.command_share * lagged
    variance = error * error + (command - lagged) ** 2
    if phase == _SLIPPING and abs(slip) > SLIDING:
        z = math.copysign(lagged, slip)
    elif phase == _LOCKED and abs(torque) > max(lagged, command) + error:
        z = math.copysign(max(lagged, command), torque)
    else:
        return
    e = z - torque
    if e * e <= tuning.gate * (f.P[T_C1 + i, T_C1 + i] + variance):
        measure(f, T_C1 + i, z, variance * max(2.0 * tuning.command_time / seconds, 1.0))
