"""Which speeds are believed: a spike, a stuck or a biased sensor is told from a driveline that surprises.

A shaft has inertia: it neither jumps nor stands still while its neighbours turn faster. Speeds in rad/s.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.kalman import measure
from dctorque_can.estimators.kalman_model import DT_E


class SensorFault(IntEnum):
    """Why the measurements of a sensor are not taken."""

    NONE = 0
    SPIKE = 1  # too far from the prediction to be a motion
    STUCK = 2  # the very same value again while the shaft has turned faster or slower
    BIASED = 3  # follows the prediction at a distance
    MISSING = 4  # no value for longer than its timeout


_SPIKE, _STUCK, _BIASED = int(SensorFault.SPIKE), int(SensorFault.STUCK), int(SensorFault.BIASED)
_SLIPPING = int(ClutchPhase.SLIPPING)
_ENGINE = 0
_MOVED = 4.0  # standard deviations by which a prediction must leave a value that is repeated
_NOISE_OF_CHANGE = 9.0  # three standard deviations, squared, of a difference of innovations
_MOTION = 3  # measurements that must lie on one line to be a motion


@compiled_without_allocation
def measure_gated(f: Any, tuning: Any, sensor: int, i: int, z: float, variance: float) -> None:
    """Take a speed z of x_i unless its sensor is at fault.

    Beyond the gate it is one, unless the last measurements move smoothly (something moves the shaft that the model
    does not know of), or have been there for the patience of the gate: then the state is opened to them.
    """
    e = z - f.x[i]
    variance += (tuning.timing_error * f.rate[i]) ** 2
    S = f.P[i, i] + variance
    if is_stuck(f, sensor, z, f.x[i], S):
        blame(f, sensor, _STUCK)
        return
    if e * e <= tuning.gate * S:
        f.fault[sensor] = f.rejected[sensor] = 0
        f.taken[sensor] += 1
        f.squares[sensor] += e * e / S
        measure(f, i, z, variance)
        return
    f.rejected[sensor] += 1
    d, last_d = e - f.last_e[sensor, 0], f.last_e[sensor, 0] - f.last_e[sensor, 1]
    f.last_e[sensor, 1], f.last_e[sensor, 0] = f.last_e[sensor, 0], e
    parallel = f.rejected[sensor] > 1 and d * d < _NOISE_OF_CHANGE * 2.0 * S
    smooth = (d - last_d) ** 2 < _NOISE_OF_CHANGE * 6.0 * S
    if f.fault[sensor] == 0:
        f.fault_us[sensor] = f.t_us
    if f.t_us - f.fault_us[sensor] < tuning.patience_us:
        if parallel:
            blame(f, sensor, _BIASED)
            return
        if f.rejected[sensor] < _MOTION or not smooth:
            blame(f, sensor, _SPIKE)
            return
    surprise(f, tuning, sensor, i, e)
    measure(f, i, z, variance)
    f.fault[sensor] = f.rejected[sensor] = 0


@compiled_without_allocation
def is_stuck(f: Any, sensor: int, z: float, predicted: float, S: float) -> bool:
    """Return whether a value is repeated although the prediction has left it."""
    if z != f.last[sensor]:
        f.last[sensor], f.repeats[sensor], f.repeat_from[sensor] = z, 0, predicted
        return False
    f.repeats[sensor] += 1
    moved = predicted - f.repeat_from[sensor]
    return bool(moved * moved > _MOVED * _MOVED * S)


@compiled_without_allocation
def blame(f: Any, sensor: int, fault: int) -> None:
    """Remember what is wrong with a sensor, and since when."""
    if f.fault[sensor] == 0:
        f.fault_us[sensor] = f.t_us
    f.fault[sensor] = fault


@compiled_without_allocation
def surprise(f: Any, tuning: Any, sensor: int, i: int, e: float) -> None:
    """Open the state to a motion that the model did not expect: of the speed, and of the torques behind it."""
    f.P[i, i] += e * e
    f.torque_rate[0] = f.torque_rate[1] = tuning.rate[_SLIPPING]
    if sensor == _ENGINE:  # then the nominal torque is not what the engine gives
        lasting = max((f.t_us - f.fault_us[sensor]) * 1e-6, 0.01)
        f.P[DT_E, DT_E] += (tuning.J_e * e / lasting) ** 2
