"""Rows of estimates and of health from the state of the core, and the judgement that goes with them."""

from __future__ import annotations

from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators import oh2014
from dctorque_can.estimators.design import Method, SubObserver
from dctorque_can.pipeline.core_state import NEVER
from dctorque_can.pipeline.decisions import ENGINE_TORQUE, IMPLAUSIBLE_TIME_US, any_stale, braking
from dctorque_can.pipeline.estimates import SENSORS, Status
from dctorque_can.pipeline.kalman_core import kalman_torques
from dctorque_can.pipeline.samples import N_QUANTITIES

_OUTPUT_VALID = int(Status.OUTPUT_VALID)
_ALL_VALID = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID)
_GEARS_KNOWN = int(Status.GEARS_KNOWN)
_PHASES_KNOWN = int(Status.PHASES_KNOWN)
_ROAD_LOAD_LEARNED = int(Status.ROAD_LOAD_LEARNED)
_CONVERGED = int(Status.CONVERGED)
_INPUT_STALE = int(Status.INPUT_STALE)
_SPEED_IMPLAUSIBLE = int(Status.SPEED_IMPLAUSIBLE)
_LIMITED = int(Status.LIMITED)
_SENSORS = len(SENSORS)


@compiled_without_allocation
def judge(core: Any, rules: Any, limited: bool) -> int:
    """Return the `Status` bits of an estimate."""
    adaptive = rules.sub_observer == SubObserver.ADAPTIVE
    settled = core.running and core.t_us - core.reset_us >= rules.settling_us
    learned = core.running and core.learned_us >= rules.learning_us
    gears_known = core.gear_known[0] and core.gear_known[1]
    phases_known = core.closed_known[0] and core.closed_known[1]
    fits = core.implausible_us == NEVER
    # two clutches are told apart by the output torque, and that stands on the road load
    output_known = (learned or not rules.learns) and not braking(core)
    status = 0
    if gears_known:
        status |= _GEARS_KNOWN
    if phases_known:
        status |= _PHASES_KNOWN
    if settled:
        status |= _CONVERGED
    if learned:
        status |= _ROAD_LOAD_LEARNED
    if not core.running or any_stale(core):
        status |= _INPUT_STALE
    if limited:
        status |= _LIMITED
    if not fits and core.t_us - core.implausible_us >= IMPLAUSIBLE_TIME_US:
        status |= _SPEED_IMPLAUSIBLE
    if settled and fits and gears_known and not limited:
        if adaptive:
            if learned or not rules.learns:
                status |= _OUTPUT_VALID
        elif phases_known and (output_known or not core.apart):
            status |= _ALL_VALID
    return status


@compiled_without_allocation
def bounded(value: float, limit: float) -> float:
    """Return ``value`` within ±limit."""
    return min(max(value, -limit), limit)


@compiled_without_allocation
def publish(core: Any, rules: Any, s: Any, c: Any, pair: Any, f: Any, row: Any) -> None:
    """Write one estimate."""
    row.t_us = core.t_us
    limit_1, limit_2, limit_o = rules.torque_limit[0], rules.torque_limit[1], rules.output_limit
    adaptive = rules.sub_observer == SubObserver.ADAPTIVE
    T_1, T_2 = s.T_c1, s.T_c2
    if rules.sub_observer == SubObserver.UNKNOWN_INPUT:
        T_1, T_2 = s.T_c1_uio, s.T_c2_uio
    T_o = oh2014.after_losses(c, pair, pair.R_1 * T_1 + pair.R_2 * T_2)  # (31)
    T_o_adaptive = s.T_n + s.a_w * s.tau_o  # (47)
    if abs(s.w_w) < oh2014.STANDSTILL:
        T_o_adaptive = T_o  # (47) sees nothing at rest: brakes hold whatever the clutches do not
    if adaptive:
        T_1, T_2, T_o = 0.0, 0.0, T_o_adaptive
    if rules.method == Method.KALMAN:
        T_1, T_2, T_o = kalman_torques(f)
        row.clutch1_sigma_nm = min(f.sigma_1, limit_1)
        row.clutch2_sigma_nm = min(f.sigma_2, limit_2)
        row.output_sigma_nm = min(f.sigma_o, limit_o)
        row.clutch_correlation = bounded(f.correlation, 1.0)
    T_e = core.value[ENGINE_TORQUE] + s.w_e * s.tau_e  # (46)
    limit_sum = limit_1 + limit_2
    row.clutch1_torque_nm = bounded(T_1, limit_1)
    row.clutch2_torque_nm = bounded(T_2, limit_2)
    row.output_torque_nm = bounded(T_o, limit_o)
    row.output_torque_adaptive_nm = bounded(T_o_adaptive, limit_o)
    row.clutch1_torque_uio_nm = bounded(s.T_c1_uio, limit_1)
    row.clutch2_torque_uio_nm = bounded(s.T_c2_uio, limit_2)
    row.clutch_torque_sum_nm = bounded(s.T_c, limit_sum)
    row.engine_torque_nm = bounded(T_e, limit_sum)
    row.road_load_nm = bounded(s.T_n, limit_o)
    row.engine_speed_rad_s = s.w_e
    row.clutch1_slip_rad_s = s.w_e - core.w_c[0]
    row.clutch2_slip_rad_s = s.w_e - core.w_c[1]
    row.wheel_acceleration_rad_s2 = s.a_w
    row.gear1 = core.gear[0]
    row.gear2 = core.gear[1]
    row.phase1 = core.phase[0]
    row.phase2 = core.phase[1]
    limited = (
        row.clutch1_torque_nm != T_1
        or row.clutch2_torque_nm != T_2
        or row.output_torque_nm != T_o
        or row.output_torque_adaptive_nm != T_o_adaptive
        or row.clutch_torque_sum_nm != s.T_c
        or row.engine_torque_nm != T_e
        or row.road_load_nm != s.T_n
    )
    core.status = judge(core, rules, limited)
    row.status = core.status


@compiled_without_allocation
def report(core: Any, health: Any, f: Any, row: Any) -> None:
    """Copy the counters into a health row."""
    row.t_us = core.t_us
    for sensor in range(_SENSORS):
        row.innovations[sensor] = f.taken[sensor]
        row.innovation_squares[sensor] = f.squares[sensor]
        row.innovations_rejected[sensor] = f.beyond[sensor]
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
