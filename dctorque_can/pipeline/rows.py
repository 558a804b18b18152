"""Rows of estimates and of health, and the judgement that goes with them."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import GEARS
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.estimators import contract
from dctorque_can.estimators.inputs import gears_known, phases_known
from dctorque_can.pipeline import derived
from dctorque_can.pipeline.decisions import any_stale
from dctorque_can.pipeline.estimates import SENSORS, Status
from dctorque_can.pipeline.parts import Records
from dctorque_can.pipeline.samples import N_QUANTITIES
from dctorque_can.pipeline.thresholds import IMPLAUSIBLE_TIME_US
from dctorque_can.plausibility.findings import N_FINDINGS

_CONVERGED = int(Status.CONVERGED)
_ALL_VALID = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID)
_GEARS_KNOWN = int(Status.GEARS_KNOWN)
_PHASES_KNOWN = int(Status.PHASES_KNOWN)
_INPUT_STALE = int(Status.INPUT_STALE)
_SPEED_IMPLAUSIBLE = int(Status.SPEED_IMPLAUSIBLE)
_LIMITED = int(Status.LIMITED)
_VEHICLE_FILE_IMPLAUSIBLE = int(Status.VEHICLE_FILE_IMPLAUSIBLE)
_SENSORS = len(SENSORS)


@compiled_without_allocation
def publish(p: Records, rules: Any, row: Any) -> None:
    """Write one estimate."""
    core, inputs, answer = p.core, p.inputs, p.answer
    clear(row)
    row.t_us = inputs.t_us
    row.gear1, row.gear2 = inputs.gear[0], inputs.gear[1]
    row.phase1, row.phase2 = inputs.phase[0], inputs.phase[1]
    status = contract.conclude(p.chosen, inputs, answer, row)
    limited = limit(inputs, row)
    core.status = judge(core, inputs, p.monitor, bool(answer.running), status, limited)
    core.status |= derived.report(inputs, rules, answer, p.derived, row)
    row.status = core.status


@compiled_without_allocation
def clear(row: Any) -> None:
    """Empty an estimate; of all that only some estimators know it says that it is not known."""
    row.clutch1_torque_nm = row.clutch2_torque_nm = row.output_torque_nm = row.clutch_torque_sum_nm = 0.0
    row.clutch1_sigma_nm = row.clutch2_sigma_nm = row.output_sigma_nm = row.clutch_correlation = math.nan
    row.clutch1_torque_uio_nm = row.clutch2_torque_uio_nm = row.output_torque_adaptive_nm = math.nan
    row.engine_torque_nm = row.road_load_nm = row.engine_speed_rad_s = row.wheel_acceleration_rad_s2 = 0.0
    row.clutch1_slip_rad_s = row.clutch2_slip_rad_s = 0.0
    row.clutch1_residual_nm = row.clutch2_residual_nm = 0.0
    row.recirculated_torque_nm = row.tie_up_probability = row.transmission_torque_nm = 0.0


@compiled_without_allocation
def within(value: float, limit: float) -> tuple[float, bool]:
    """Return a value within ±limit, and whether it was beyond; what is not known stays so."""
    if value > limit:
        return limit, True
    if value < -limit:
        return -limit, True
    return value, False


@compiled_without_allocation
def limit(inputs: Any, row: Any) -> bool:
    """Keep the torques of an estimate within what is plausible; return whether one of them was beyond."""
    limit_1, limit_2, limit_o = inputs.torque_limit[0], inputs.torque_limit[1], inputs.output_limit
    both = limit_1 + limit_2
    row.clutch1_torque_nm, beyond_1 = within(row.clutch1_torque_nm, limit_1)
    row.clutch2_torque_nm, beyond_2 = within(row.clutch2_torque_nm, limit_2)
    row.output_torque_nm, beyond_o = within(row.output_torque_nm, limit_o)
    row.output_torque_adaptive_nm, beyond_a = within(row.output_torque_adaptive_nm, limit_o)
    row.clutch_torque_sum_nm, beyond_c = within(row.clutch_torque_sum_nm, both)
    row.engine_torque_nm, beyond_e = within(row.engine_torque_nm, both)
    row.road_load_nm, beyond_v = within(row.road_load_nm, limit_o)
    row.clutch1_torque_uio_nm, _ = within(row.clutch1_torque_uio_nm, limit_1)
    row.clutch2_torque_uio_nm, _ = within(row.clutch2_torque_uio_nm, limit_2)
    row.clutch1_sigma_nm, _ = within(row.clutch1_sigma_nm, limit_1)
    row.clutch2_sigma_nm, _ = within(row.clutch2_sigma_nm, limit_2)
    row.output_sigma_nm, _ = within(row.output_sigma_nm, limit_o)
    row.clutch_correlation, _ = within(row.clutch_correlation, 1.0)
    return beyond_1 or beyond_2 or beyond_o or beyond_a or beyond_c or beyond_e or beyond_v


@compiled_without_allocation
def judge(core: Any, inputs: Any, monitor: Any, running: bool, status: int, limited: bool) -> int:
    """Return the `Status` bits of an estimate from those that the estimator gave it.

    No torque is valid that is limited, stands on gears that are not known or are ambiguous, or on speeds that do
    not fit them, or while the vehicle file is strongly contradicted.
    """
    if gears_known(inputs):
        status |= _GEARS_KNOWN
    if phases_known(inputs):
        status |= _PHASES_KNOWN
    if not running or any_stale(inputs):
        status |= _INPUT_STALE
    if limited:
        status |= _LIMITED
    if core.implausible_us != NEVER and inputs.t_us - core.implausible_us >= IMPLAUSIBLE_TIME_US:
        status |= _SPEED_IMPLAUSIBLE
    gears = bool(status & _GEARS_KNOWN) and not inputs.ambiguous
    if not status & _CONVERGED or core.implausible_us != NEVER or limited or not gears:
        status &= ~_ALL_VALID
    if monitor.findings != 0:
        status |= _VEHICLE_FILE_IMPLAUSIBLE
    if monitor.strong != 0:
        status &= ~_ALL_VALID
    return status


@compiled_without_allocation
def report(inputs: Any, health: Any, monitor: Any, row: Any) -> None:
    """Copy the counters and findings into a health row."""
    row.t_us = inputs.t_us
    for sensor in range(_SENSORS):
        row.innovations[sensor] = row.innovations_rejected[sensor] = 0
        row.innovation_squares[sensor] = 0.0
        row.speed_noise_told_rad_s[sensor] = row.speed_noise_rad_s[sensor] = 0.0
        row.speed_noise_samples[sensor] = 0.0
    row.engine_torque_gain_error = row.engine_torque_gain_sigma = 0.0
    row.engine_torque_lag_error_s = row.engine_torque_lag_sigma_s = 0.0
    row.wheel_scale_error = row.wheel_scale_sigma = 0.0
    row.wheels_late_s = row.wheels_late_sigma_s = 0.0
    for gear in range(GEARS):
        row.gear_ratio_error[gear] = row.gear_ratio_sigma[gear] = 0.0
    for quantity in range(N_QUANTITIES):
        row.accepted[quantity] = health.accepted[quantity]
        row.not_available[quantity] = health.not_available[quantity]
        row.out_of_range[quantity] = health.out_of_range[quantity]
        row.bad_length[quantity] = health.bad_length[quantity]
        row.bad_crc[quantity] = health.bad_crc[quantity]
        row.bad_counter[quantity] = health.bad_counter[quantity]
        row.not_believed[quantity] = health.not_believed[quantity]
        row.bad_rate[quantity] = health.bad_rate[quantity]
        row.timeouts[quantity] = health.timeouts[quantity]
        seen = inputs.seen_us[quantity]
        row.age_us[quantity] = inputs.t_us - seen if seen != NEVER else -1
    row.late_frames = health.late_frames
    row.gap_resets = health.gap_resets
    row.clock_resets = health.clock_resets
    row.numeric_resets = health.numeric_resets
    row.findings, row.findings_strong, row.findings_ever = monitor.findings, monitor.strong, monitor.ever
    row.finding_gear = monitor.finding_gear
    for place in range(N_FINDINGS):
        row.finding_measured[place] = monitor.measured[place]
