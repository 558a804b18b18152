"""Rows of estimates and of health from the state of the core, and the judgement that goes with them."""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators import oh2014
from dctorque_can.estimators.design import Method, SubObserver
from dctorque_can.estimators.kalman_engine import torque_error
from dctorque_can.estimators.kalman_model import GAIN, LAG_1, LAG_2, T_V, W_B, W_C1, W_E
from dctorque_can.pipeline import derived
from dctorque_can.pipeline.core_state import NEVER
from dctorque_can.pipeline.decisions import ENGINE_TORQUE, IMPLAUSIBLE_TIME_US, any_stale, braking
from dctorque_can.pipeline.derived import bounded, clutch_torques, observed_torques
from dctorque_can.pipeline.estimates import SENSORS, Status
from dctorque_can.pipeline.samples import N_QUANTITIES

_CLUTCH1_VALID = int(Status.CLUTCH1_VALID)
_CLUTCH2_VALID = int(Status.CLUTCH2_VALID)
_OUTPUT_VALID = int(Status.OUTPUT_VALID)
_ALL_VALID = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID)
_GEARS_KNOWN = int(Status.GEARS_KNOWN)
_PHASES_KNOWN = int(Status.PHASES_KNOWN)
_ROAD_LOAD_LEARNED = int(Status.ROAD_LOAD_LEARNED)
_CONVERGED = int(Status.CONVERGED)
_INPUT_STALE = int(Status.INPUT_STALE)
_SPEED_IMPLAUSIBLE = int(Status.SPEED_IMPLAUSIBLE)
_LIMITED = int(Status.LIMITED)
_FIRST_FAULT = int(Status.ENGINE_SPEED_FAULT)
_VALID_SHARE = 0.1  # of its plausibility limit that a clutch torque's standard deviation may be
_VALID_OUTPUT_SHARE = 0.02  # … the output torque's and the road load's
_KALMAN_SETTLING_US = 250_000  # a dozen frames of each sensor on a slow bus
_SENSORS = len(SENSORS)


@compiled_without_allocation
def judge_inputs(core: Any, running: bool, settled: bool, limited: bool) -> int:
    """Return the `Status` bits that do not depend on the method."""
    status = 0
    if core.gear_known[0] and core.gear_known[1]:
        status |= _GEARS_KNOWN
    if core.closed_known[0] and core.closed_known[1]:
        status |= _PHASES_KNOWN
    if settled:
        status |= _CONVERGED
    if not running or any_stale(core):
        status |= _INPUT_STALE
    if limited:
        status |= _LIMITED
    if core.implausible_us != NEVER and core.t_us - core.implausible_us >= IMPLAUSIBLE_TIME_US:
        status |= _SPEED_IMPLAUSIBLE
    return status


@compiled_without_allocation
def judge(core: Any, rules: Any, limited: bool) -> int:
    """Return the `Status` bits of an estimate of the 2014 observer."""
    settled = core.running and core.t_us - core.reset_us >= rules.settling_us
    learned = core.running and core.learned_us >= rules.learning_us
    status = judge_inputs(core, core.running, settled, limited)
    if learned:
        status |= _ROAD_LOAD_LEARNED
    if not settled or core.implausible_us != NEVER or limited or not status & _GEARS_KNOWN:
        return status
    # two clutches are told apart by the output torque, and that stands on the road load
    output_known = (learned or not rules.learns) and not braking(core)
    if rules.sub_observer == SubObserver.ADAPTIVE:
        if learned or not rules.learns:
            status |= _OUTPUT_VALID
    elif status & _PHASES_KNOWN and (output_known or not core.apart):
        status |= _ALL_VALID
    return status


@compiled_without_allocation
def judge_kalman(core: Any, rules: Any, f: Any, limited: bool) -> int:
    """Return the `Status` bits of a row of the Kalman filter: a torque is valid if it is known well enough."""
    settled = f.running and core.t_us - f.reset_us >= _KALMAN_SETTLING_US
    status = judge_inputs(core, f.running, settled, limited)
    for signal in range(len(f.fault)):
        if f.fault[signal] != 0:
            status |= _FIRST_FAULT << signal
    if settled and f.P[T_V, T_V] <= (_VALID_OUTPUT_SHARE * rules.output_limit) ** 2:
        status |= _ROAD_LOAD_LEARNED
    if not settled or core.implausible_us != NEVER or limited or not status & _GEARS_KNOWN:
        return status
    if not status & _PHASES_KNOWN:
        return status
    if f.sigma_1 <= _VALID_SHARE * rules.torque_limit[0]:
        status |= _CLUTCH1_VALID
    if f.sigma_2 <= _VALID_SHARE * rules.torque_limit[1]:
        status |= _CLUTCH2_VALID
    if f.sigma_o <= _VALID_OUTPUT_SHARE * rules.output_limit:
        status |= _OUTPUT_VALID
    return status


@compiled_without_allocation
def publish(core: Any, rules: Any, s: Any, c: Any, pair: Any, f: Any, d: Any, row: Any) -> None:
    """Write one estimate."""
    row.t_us = core.t_us
    limit_1, limit_2, limit_o = rules.torque_limit[0], rules.torque_limit[1], rules.output_limit
    adaptive = rules.sub_observer == SubObserver.ADAPTIVE
    T_1, T_2 = observed_torques(rules, s)
    T_o = oh2014.after_losses(c, pair, pair.R_1 * T_1 + pair.R_2 * T_2)  # (31)
    T_o_adaptive = s.T_n + s.a_w * s.tau_o  # (47)
    if abs(s.w_w) < oh2014.STANDSTILL:
        T_o_adaptive = T_o  # (47) sees nothing at rest: brakes hold whatever the clutches do not
    T_1, T_2 = clutch_torques(rules, s, f)
    if adaptive:
        T_o = T_o_adaptive
    T_e = core.value[ENGINE_TORQUE] + s.w_e * s.tau_e  # (46)
    T_c, T_v, w_e, w_1, w_2, a_w = s.T_c, s.T_n, s.w_e, core.w_c[0], core.w_c[1], s.a_w
    if rules.method == Method.KALMAN:
        T_o_adaptive = f.T_o  # to be told as not known
        T_o, T_c, T_e, T_v = f.T_o, T_1 + T_2, f.T_en + torque_error(f), f.x[T_V]
        w_e, w_1, w_2, a_w = f.x[W_E], f.x[W_C1], f.x[W_C1 + 1], f.rate[W_B]
        row.clutch1_sigma_nm = min(f.sigma_1, limit_1)
        row.clutch2_sigma_nm = min(f.sigma_2, limit_2)
        row.output_sigma_nm = min(f.sigma_o, limit_o)
        row.clutch_correlation = bounded(f.correlation, 1.0)
    limit_sum = limit_1 + limit_2
    row.clutch1_torque_nm = bounded(T_1, limit_1)
    row.clutch2_torque_nm = bounded(T_2, limit_2)
    row.output_torque_nm = bounded(T_o, limit_o)
    row.output_torque_adaptive_nm = bounded(T_o_adaptive, limit_o)
    row.clutch1_torque_uio_nm = bounded(s.T_c1_uio, limit_1)
    row.clutch2_torque_uio_nm = bounded(s.T_c2_uio, limit_2)
    row.clutch_torque_sum_nm = bounded(T_c, limit_sum)
    row.engine_torque_nm = bounded(T_e, limit_sum)
    row.road_load_nm = bounded(T_v, limit_o)
    row.engine_speed_rad_s = w_e
    row.clutch1_slip_rad_s = w_e - w_1
    row.clutch2_slip_rad_s = w_e - w_2
    row.wheel_acceleration_rad_s2 = a_w
    row.gear1 = core.gear[0]
    row.gear2 = core.gear[1]
    row.phase1 = core.phase[0]
    row.phase2 = core.phase[1]
    limited = (
        row.clutch1_torque_nm != T_1
        or row.clutch2_torque_nm != T_2
        or row.output_torque_nm != T_o
        or row.output_torque_adaptive_nm != T_o_adaptive
        or row.clutch_torque_sum_nm != T_c
        or row.engine_torque_nm != T_e
        or row.road_load_nm != T_v
    )
    if rules.method == Method.KALMAN:
        core.status = judge_kalman(core, rules, f, limited)
    else:
        core.status = judge(core, rules, limited)
    core.status |= derived.report(core, rules, pair, f, d, row)
    row.status = core.status


@compiled_without_allocation
def report(core: Any, health: Any, f: Any, row: Any) -> None:
    """Copy the counters into a health row."""
    row.t_us = core.t_us
    for sensor in range(_SENSORS):
        row.innovations[sensor] = f.taken[sensor]
        row.innovation_squares[sensor] = f.squares[sensor]
        row.innovations_rejected[sensor] = f.beyond[sensor]
    row.engine_torque_gain_error = f.x[GAIN]
    row.engine_torque_gain_sigma = math.sqrt(max(f.P[GAIN, GAIN], 0.0))
    row.engine_torque_lag_error_s = f.x[LAG_1] + f.x[LAG_2]
    row.engine_torque_lag_sigma_s = math.sqrt(
        max(f.P[LAG_1, LAG_1] + 2.0 * f.P[LAG_1, LAG_2] + f.P[LAG_2, LAG_2], 0.0)
    )
    for quantity in range(N_QUANTITIES):
        row.accepted[quantity] = health.accepted[quantity]
        row.not_available[quantity] = health.not_available[quantity]
        row.out_of_range[quantity] = health.out_of_range[quantity]
        row.bad_length[quantity] = health.bad_length[quantity]
        row.bad_crc[quantity] = health.bad_crc[quantity]
        row.bad_counter[quantity] = health.bad_counter[quantity]
        row.timeouts[quantity] = health.timeouts[quantity]
        seen = core.seen_us[quantity]
        row.age_us[quantity] = core.t_us - seen if seen != NEVER else -1
    row.late_frames = health.late_frames
    row.gap_resets = health.gap_resets
    row.clock_resets = health.clock_resets
    row.numeric_resets = health.numeric_resets
    row.status = core.status
