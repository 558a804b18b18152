"""What the filter says in an estimate and of itself, and when it calls a torque valid."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators.inputs import phase_of, phases_known
from dctorque_can.estimators.kalman import gearbox, losses, one_gear, ratios, tape
from dctorque_can.estimators.kalman.engine import torque_error
from dctorque_can.estimators.kalman.filter import Kalman, told
from dctorque_can.estimators.kalman.learning import report_noise
from dctorque_can.estimators.kalman.model import (
    GAIN,
    LAG_1,
    LAG_2,
    LATE,
    T_V,
    W_B,
    W_C1,
    W_E,
)
from dctorque_can.estimators.kalman.thresholds import SETTLING_US, VALID_OUTPUT_SHARE, VALID_SHARE
from dctorque_can.pipeline.estimates import SENSORS, Status

_CLUTCH1_VALID = int(Status.CLUTCH1_VALID)
_CLUTCH2_VALID = int(Status.CLUTCH2_VALID)
_OUTPUT_VALID = int(Status.OUTPUT_VALID)
_ROAD_LOAD_LEARNED = int(Status.ROAD_LOAD_LEARNED)
_CONVERGED = int(Status.CONVERGED)
_FIRST_FAULT = int(Status.ENGINE_SPEED_FAULT)
_SENSORS = len(SENSORS)


@compiled_without_allocation
def conclude(k: Kalman, inputs: Any, answer: Any, row: Any) -> int:
    """Fill an estimate, and note it on the tape for the smoother; see `contract.conclude`."""
    f = k.state[0]
    if f.started:
        gearbox.work_out_deviations(f, k.tables, k.tuning[0])
        losses.admit_spin_losses(f, k.tuning[0])
        if inputs.direction == 0:
            losses.admit_either_direction(f, k.tuning[0], inputs.doubt)
        phase_1, phase_2 = phase_of(inputs, 0), phase_of(inputs, 1)
        gearbox.admit_touch(f, k.tuning[0], phase_1, phase_2)
        gearbox.admit_motion(f, k.tuning[0], phase_1, phase_2)
        if inputs.one_gear:
            one_gear.admit_synchronisers(f, k.tuning[0], inputs, phase_1, phase_2)
        else:
            gearbox.admit_synchronisers(f, k.tuning[0], phase_1, phase_2)
    tape.published(f, k.tables, k.tuning[0])
    row.clutch1_torque_nm, row.clutch2_torque_nm, row.output_torque_nm = f.T_c1, f.T_c2, f.T_o
    row.clutch1_sigma_nm, row.clutch2_sigma_nm, row.output_sigma_nm = f.sigma_1, f.sigma_2, f.sigma_o
    row.clutch_correlation = f.correlation
    row.clutch_torque_sum_nm = f.T_c1 + f.T_c2
    row.engine_torque_nm = f.T_en + torque_error(f)
    row.road_load_nm = f.x[T_V]
    row.engine_speed_rad_s = f.x[W_E]
    row.clutch1_slip_rad_s = f.x[W_E] - told(f, W_C1)
    row.clutch2_slip_rad_s = f.x[W_E] - told(f, W_C1 + 1)
    row.wheel_acceleration_rad_s2 = f.rate[W_B]
    return judge(f, inputs)


@compiled_without_allocation
def judge(f: Any, inputs: Any) -> int:
    """Return the `Status` bits: a torque is valid if it is known well enough."""
    status = 0
    for signal in range(len(f.fault)):
        if f.fault[signal] != 0:
            status |= _FIRST_FAULT << signal
    if not f.running or inputs.t_us - f.reset_us < SETTLING_US:
        return status
    status |= _CONVERGED
    if f.P[T_V, T_V] <= (VALID_OUTPUT_SHARE * inputs.output_limit) ** 2:
        status |= _ROAD_LOAD_LEARNED
    if inputs.phases_told and not phases_known(inputs):
        return status
    if f.sigma_1 <= VALID_SHARE * inputs.torque_limit[0]:
        status |= _CLUTCH1_VALID
    if f.sigma_2 <= VALID_SHARE * inputs.torque_limit[1]:
        status |= _CLUTCH2_VALID
    if f.sigma_o <= VALID_OUTPUT_SHARE * inputs.output_limit:
        status |= _OUTPUT_VALID
    return status


@compiled_without_allocation
def report(k: Kalman, row: Any) -> None:
    """Fill innovations and what has been learned of the engine torque in a health row."""
    f = k.state[0]
    for sensor in range(_SENSORS):
        row.innovations[sensor] = f.taken[sensor]
        row.innovation_squares[sensor] = f.squares[sensor]
        row.innovations_rejected[sensor] = f.beyond[sensor]
    report_noise(f, k.tuning[0], row)
    ratios.report(f, row)
    row.wheels_late_s, row.wheels_late_sigma_s = f.x[LATE], math.sqrt(max(f.P[LATE, LATE], 0.0))
    row.engine_torque_gain_error = f.x[GAIN]
    row.engine_torque_gain_sigma = math.sqrt(max(f.P[GAIN, GAIN], 0.0))
    row.engine_torque_lag_error_s = f.x[LAG_1] + f.x[LAG_2]
    row.engine_torque_lag_sigma_s = math.sqrt(
        max(f.P[LAG_1, LAG_1] + 2.0 * f.P[LAG_1, LAG_2] + f.P[LAG_2, LAG_2], 0.0)
    )
