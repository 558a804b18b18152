"""The compiled heart: one loop over samples that advances the observer and writes estimates and health.

Time comes from the samples alone, as integers. A frame first advances the internal grid to its own time and then
acts, so an estimate given in answer to a frame contains that frame. State changes nowhere else.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.driveline.phases import ClutchPhase, PhaseSource
from dctorque_can.estimators import oh2014
from dctorque_can.estimators.design import SubObserver
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.samples import N_QUANTITIES, Quantity, SampleStatus
from dctorque_can.pipeline.settings import DrivenAxle

NEVER = -(2**62)

RULES = np.dtype(
    [
        ("minimum", "f8", (N_QUANTITIES,)),
        ("maximum", "f8", (N_QUANTITIES,)),
        ("timeout_us", "i8", (N_QUANTITIES,)),
        ("mapped", "u1", (N_QUANTITIES,)),
        ("step_us", "i8"),
        ("estimate_period_us", "i8"),
        ("health_period_us", "i8"),
        ("max_gap_us", "i8"),
        ("max_step_back_us", "i8"),
        ("settling_us", "i8"),
        ("learning_us", "i8"),
        ("driven_axle", "i8"),
        ("infer_gears", "?"),
        ("engage_tolerance", "f8"),
        ("release_tolerance", "f8"),
        ("confirm_us", "i8"),
        ("min_wheel_speed", "f8"),
        ("phase_source", "i8", (2,)),
        ("closed_above", "f8", (2,)),  # positions and commands, in the direction of closing
        ("open_below", "f8", (2,)),
        ("closing_sign", "f8", (2,)),
        ("slip_locked", "f8"),
        ("slip_released", "f8"),
        ("lock_time_us", "i8"),
        ("torque_limit", "f8", (2,)),
        ("output_limit", "f8"),
        ("sub_observer", "i8"),
    ],
    align=True,
)
"""What the loop must know besides the observer's constants."""

CORE = np.dtype(
    [
        ("t_us", "i8"),  # time of the grid; NEVER before the first sample
        ("value", "f8", (N_QUANTITIES,)),
        ("seen_us", "i8", (N_QUANTITIES,)),
        ("available", "u1", (N_QUANTITIES,)),
        ("stale", "u1", (N_QUANTITIES,)),
        ("fresh", "u1", (N_QUANTITIES,)),  # renewed by the frame at hand
        ("frame_ok", "?"),  # the frame at hand has a usable sample
        ("running", "?"),  # the observer has been started
        ("reset_us", "i8"),
        ("learned_us", "i8"),  # how long the road load has been learned since the start
        ("settled_us", "i8"),  # when the torques were last drawn to the unknown input estimates
        ("engine_us", "i8"),  # time of the last correction by each speed
        ("shaft_us", "i8", (2,)),
        ("wheel_us", "i8"),
        ("w_c", "f8", (2,)),  # shaft speeds, carried on between their frames by the model
        ("w_c_last", "f8", (2,)),  # … as they were at the last use in (36)
        ("twist_us", "i8"),  # when the shafts were last compared; NEVER: not since the gears changed
        ("gear", "i8", (2,)),
        ("gear_known", "u1", (2,)),
        ("gear_candidate", "i8", (2,)),
        ("candidate_us", "i8", (2,)),
        ("closed", "u1", (2,)),
        ("closed_known", "u1", (2,)),
        ("phase", "u1", (2,)),
        ("slip_small_us", "i8", (2,)),  # since when the slip is small
        ("implausible_us", "i8"),  # since when shaft and wheel speed disagree, NEVER if they agree
        ("estimate_us", "i8"),
        ("health_us", "i8"),
        ("status", "u4"),
    ],
    align=True,
)
"""State of the loop, apart from the observer's."""

IMPLAUSIBLE_RATIO = 0.15
IMPLAUSIBLE_TIME_US = 300_000
MAX_SAMPLE_INTERVAL = 0.1  # s; a speed that was away longer corrects as if it had been away so long
"""Interval of samples beyond which a correction is not stretched any further."""

_SPEED_1 = int(Quantity.SHAFT1_SPEED)
_WHEEL = int(Quantity.WHEEL_SPEED_FL)
_GEAR_1 = int(Quantity.GEAR1)
_POSITION_1 = int(Quantity.CLUTCH1_POSITION)
_OPEN_1 = int(Quantity.CLUTCH1_OPEN)
_COMMAND_1 = int(Quantity.CLUTCH1_COMMAND)
_ENGINE_SPEED = int(Quantity.ENGINE_SPEED)
_ENGINE_TORQUE = int(Quantity.ENGINE_TORQUE)
_OUTPUT_VALID = int(Status.OUTPUT_VALID)
_ALL_VALID = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID)
_GEARS_KNOWN = int(Status.GEARS_KNOWN)
_PHASES_KNOWN = int(Status.PHASES_KNOWN)
_ROAD_LOAD_LEARNED = int(Status.ROAD_LOAD_LEARNED)
_CONVERGED = int(Status.CONVERGED)
_INPUT_STALE = int(Status.INPUT_STALE)
_SPEED_IMPLAUSIBLE = int(Status.SPEED_IMPLAUSIBLE)
_LIMITED = int(Status.LIMITED)


@compiled
def usable(core: Any, quantity: int) -> bool:
    """Return whether an input has a value that is not too old."""
    return bool(core.available[quantity]) and not core.stale[quantity]


@compiled
def axle_speed(core: Any, left: int) -> tuple[bool, float]:
    """Return whether an axle has a speed, and the mean of its wheels that are usable."""
    a, b = usable(core, left), usable(core, left + 1)
    if a and b:
        return True, 0.5 * (core.value[left] + core.value[left + 1])
    if a:
        return True, core.value[left]
    return b, core.value[left + 1]


@compiled
def wheel_speeds(core: Any, rules: Any) -> tuple[bool, float, bool, float, bool]:
    """Return (known, driven mean, known, undriven mean, whether the undriven ones were just renewed).

    Without undriven wheels the driven ones stand in, and the other way round.
    """
    front_known, front = axle_speed(core, _WHEEL)
    rear_known, rear = axle_speed(core, _WHEEL + 2)
    front_fresh = core.fresh[_WHEEL] or core.fresh[_WHEEL + 1]
    rear_fresh = core.fresh[_WHEEL + 2] or core.fresh[_WHEEL + 3]
    if rules.driven_axle == DrivenAxle.REAR:
        front_known, front, rear_known, rear = rear_known, rear, front_known, front
        front_fresh, rear_fresh = rear_fresh, front_fresh
    if rules.driven_axle == DrivenAxle.ALL and front_known and rear_known:
        front = rear = 0.5 * (front + rear)
        rear_fresh = front_fresh or rear_fresh
    if not rear_known:
        return front_known, front, front_known, front, front_fresh
    if not front_known:
        return rear_known, rear, rear_known, rear, rear_fresh
    return front_known, front, rear_known, rear, rear_fresh


@compiled
def decide_gears(core: Any, rules: Any, c: Any) -> None:
    """Take the engaged gear of each shaft from its signal, or from the ratio of its speed to the driven wheels."""
    for i in range(2):
        if not rules.infer_gears:
            known = usable(core, _GEAR_1 + i)
            core.gear_known[i] = known
            if known:
                gear = int(core.value[_GEAR_1 + i])
                exists = -1 <= gear <= oh2014.MAX_GEAR and (gear == 0 or c.i_t[gear + 1] != 0.0)
                core.gear_known[i] = exists
                core.gear[i] = gear if exists else 0
            continue
        known, w_d, _, _, _ = wheel_speeds(core, rules)
        if not known or not usable(core, _SPEED_1 + i) or abs(w_d) < rules.min_wheel_speed:
            continue  # too slow to tell: the last gear is kept
        best, error = 0, math.inf
        for gear in range(-1, oh2014.MAX_GEAR + 1):
            ratio = c.i_t[gear + 1] * c.i_f[gear + 1]
            if gear == 0 or ratio == 0.0 or c.shaft[gear + 1] != i + 1:
                continue
            this = abs(core.w_c[i] / (ratio * w_d) - 1.0)
            if this < error:
                best, error = gear, this
        present = core.gear[i]
        tolerance = rules.release_tolerance if best == present else rules.engage_tolerance
        wanted = best if error < tolerance else 0
        if wanted == present and core.gear_known[i]:
            core.candidate_us[i] = NEVER
        elif core.candidate_us[i] == NEVER or wanted != core.gear_candidate[i]:
            core.gear_candidate[i] = wanted
            core.candidate_us[i] = core.t_us
        elif core.t_us - core.candidate_us[i] >= rules.confirm_us:
            core.gear[i] = wanted
            core.gear_known[i] = True
            core.candidate_us[i] = NEVER


@compiled
def decide_phases(core: Any, rules: Any, w_e: float) -> None:
    """Decide open, slipping or locked for each clutch (Fig. 3), with hysteresis in position, slip and time."""
    for i in range(2):
        source = rules.phase_source[i]
        if source == PhaseSource.FLAG:
            known = usable(core, _OPEN_1 + i)
            if known:
                core.closed[i] = core.value[_OPEN_1 + i] < 0.5
        else:
            quantity = (_POSITION_1 if source == PhaseSource.POSITION else _COMMAND_1) + i
            known = usable(core, quantity)
            if known:
                x = rules.closing_sign[i] * core.value[quantity]
                if x >= rules.closed_above[i]:
                    core.closed[i] = True
                elif x <= rules.open_below[i]:
                    core.closed[i] = False
        core.closed_known[i] = known
        if not known:
            core.closed[i] = True  # nothing says that it is open: it may carry torque
        slip = abs(w_e - core.w_c[i])
        if slip > rules.slip_locked:
            core.slip_small_us[i] = NEVER
        elif core.slip_small_us[i] == NEVER:
            core.slip_small_us[i] = core.t_us
        if not core.closed[i]:
            core.phase[i] = ClutchPhase.OPEN
            continue
        stays = core.phase[i] == ClutchPhase.LOCKED and slip <= rules.slip_released
        locks = core.slip_small_us[i] != NEVER and core.t_us - core.slip_small_us[i] >= rules.lock_time_us
        core.phase[i] = ClutchPhase.LOCKED if stays or locks else ClutchPhase.SLIPPING


@compiled
def mark_stale(core: Any, rules: Any, health: Any) -> None:
    """Mark the inputs that are older than their timeout, and count each time one becomes so."""
    for quantity in range(N_QUANTITIES):
        old = core.t_us - core.seen_us[quantity] > rules.timeout_us[quantity]
        if old and core.available[quantity] and not core.stale[quantity]:
            core.stale[quantity] = True
            health.timeouts[quantity] += 1


@compiled
def inputs_complete(core: Any, rules: Any) -> bool:
    """Return whether the observer has all it needs: engine, both shafts, gears and a wheel speed."""
    _, _, wheels, _, _ = wheel_speeds(core, rules)
    return (
        wheels
        and usable(core, _ENGINE_SPEED)
        and usable(core, _ENGINE_TORQUE)
        and usable(core, _SPEED_1)
        and usable(core, _SPEED_1 + 1)
        and bool(core.gear_known[0])
        and bool(core.gear_known[1])
    )


@compiled
def restart(core: Any, rules: Any, s: Any, c: Any, pair: Any) -> None:
    """Start the observer at the present measurements."""
    _, _, _, w_w, _ = wheel_speeds(core, rules)
    for i in range(2):
        core.w_c[i] = core.w_c_last[i] = core.value[_SPEED_1 + i]
        core.shaft_us[i] = core.t_us
    oh2014.set_pair(pair, c, core.gear[0], core.gear[1])
    w_s = core.w_c[1] if pair.side == 2 else core.w_c[0]
    oh2014.reset(s, c, core.value[_ENGINE_SPEED], w_s, w_w, core.value[_ENGINE_TORQUE])
    core.running = True
    core.learned_us = 0
    core.reset_us = core.settled_us = core.engine_us = core.wheel_us = core.twist_us = core.t_us


@compiled
def advance(core: Any, rules: Any, s: Any, c: Any, pair: Any, health: Any, t_us: int) -> None:
    """Move the grid to ``t_us``: whole steps, then the rest of a step up to the frame."""
    while core.t_us < t_us:
        until = min(t_us, (core.t_us // rules.step_us + 1) * rules.step_us)
        dt = (until - core.t_us) * 1e-6
        core.t_us = until
        if core.running:
            oh2014.predict(s, c, pair, core.value[_ENGINE_TORQUE], dt)
            core.w_c[0] += dt * s.a_w * pair.R_1  # zero in neutral
            core.w_c[1] += dt * s.a_w * pair.R_2


@compiled
def interval(t_us: int, last_us: int) -> float:
    """Return the seconds between two samples of one speed, bounded away from zero and from long silences."""
    return min(max((t_us - last_us) * 1e-6, 1e-4), MAX_SAMPLE_INTERVAL)


@compiled
def take_gears(core: Any, s: Any, c: Any, pair: Any) -> None:
    """Hand changed gears to the observer; a shaft speed from before says nothing about the new gear."""
    if core.gear[0] == pair.g1 and core.gear[1] == pair.g2:
        return
    if core.gear[0] != pair.g1:
        core.shaft_us[0] = NEVER
    if core.gear[1] != pair.g2:
        core.shaft_us[1] = NEVER
    oh2014.change_gears(s, c, pair, core.gear[0], core.gear[1], core.w_c[0], core.w_c[1])
    core.twist_us = NEVER


@compiled
def correct_shafts(core: Any, s: Any, c: Any, pair: Any, carries_1: bool, carries_2: bool) -> None:
    """Let new input-shaft speeds take effect: on the clutch-side observer, and by their twist on both torques."""
    if not (core.fresh[_SPEED_1] or core.fresh[_SPEED_1 + 1]):
        return
    for i in range(2):
        if not core.fresh[_SPEED_1 + i]:
            continue
        if pair.side == i + 1:
            if core.shaft_us[i] == NEVER:
                s.w_s = core.w_c[i]
            else:
                h = interval(core.t_us, core.shaft_us[i])
                oh2014.correct_shaft(s, c, pair, carries_1, carries_2, core.w_c[i], h)
        core.shaft_us[i] = core.t_us
    if core.shaft_us[0] == NEVER or core.shaft_us[1] == NEVER:
        return
    if core.twist_us != NEVER:
        # trapezoidal rule over the time since both shafts were last compared
        w_c1 = 0.5 * (core.w_c[0] + core.w_c_last[0])
        w_c2 = 0.5 * (core.w_c[1] + core.w_c_last[1])
        dT_c1, dT_c2 = oh2014.shaft_torque_rates(c, pair, carries_1, carries_2, w_c1, w_c2, 0.0)
        dt = (core.t_us - core.twist_us) * 1e-6
        oh2014.add_shaft_torques(s, (dt * dT_c1, dt * dT_c2))
    core.twist_us = core.t_us
    core.w_c_last[0], core.w_c_last[1] = core.w_c[0], core.w_c[1]


@compiled
def act(core: Any, rules: Any, s: Any, c: Any, pair: Any, health: Any) -> None:
    """Let one whole frame take effect at the time of the grid."""
    mark_stale(core, rules, health)
    for i in range(2):
        if core.fresh[_SPEED_1 + i]:
            core.w_c[i] = core.value[_SPEED_1 + i]
    decide_gears(core, rules, c)
    decide_phases(core, rules, s.w_e if core.running else core.value[_ENGINE_SPEED])
    if not inputs_complete(core, rules):
        core.running = False  # held: the torques stay as they are until the inputs are back
        return
    if not core.running:
        restart(core, rules, s, c, pair)
    take_gears(core, s, c, pair)
    gating = c.gating
    carries_1 = pair.g1 != 0 and (core.closed[0] or not gating)
    carries_2 = pair.g2 != 0 and (core.closed[1] or not gating)

    _, _, _, w_w, wheel_fresh = wheel_speeds(core, rules)
    if wheel_fresh:
        oh2014.correct_wheel(s, c, w_w, interval(core.t_us, core.wheel_us))
        core.wheel_us = core.t_us
    if core.fresh[_ENGINE_SPEED]:
        h = interval(core.t_us, core.engine_us)
        oh2014.correct_engine(s, c, pair, carries_1, carries_2, core.value[_ENGINE_SPEED], h)
        core.engine_us = core.t_us
    correct_shafts(core, s, c, pair, carries_1, carries_2)
    elapsed_us = core.t_us - core.settled_us
    if oh2014.settle(s, c, pair, carries_1, carries_2, elapsed_us * 1e-6):
        core.learned_us += elapsed_us
    core.settled_us = core.t_us


@compiled
def all_finite(s: Any) -> bool:
    """Return whether every state of the observer is a number."""
    total = s.T_c1 + s.T_c2 + s.tau_e + s.tau_o + s.w_e + s.T_c + s.w_s + s.T_a + s.T_n + s.w_w + s.a_w
    return math.isfinite(total)


@compiled
def plausible(core: Any, rules: Any, pair: Any) -> bool:
    """Return whether the shaft speeds have fitted gears and wheels within the last while."""
    known, w_d, _, _, _ = wheel_speeds(core, rules)
    fits = True
    if known and abs(w_d) > rules.min_wheel_speed:
        if pair.g1 != 0 and abs(core.w_c[0] / (pair.R_1 * w_d) - 1.0) > IMPLAUSIBLE_RATIO:
            fits = False
        if pair.g2 != 0 and abs(core.w_c[1] / (pair.R_2 * w_d) - 1.0) > IMPLAUSIBLE_RATIO:
            fits = False
    if fits:
        core.implausible_us = NEVER
    elif core.implausible_us == NEVER:
        core.implausible_us = core.t_us
    return fits or core.t_us - core.implausible_us < IMPLAUSIBLE_TIME_US


@compiled
def judge(core: Any, rules: Any, pair: Any, limited: bool, adaptive: bool) -> int:
    """Return the `Status` bits of an estimate."""
    status = 0
    settled = core.running and core.t_us - core.reset_us >= rules.settling_us
    fits = plausible(core, rules, pair)
    if core.gear_known[0] and core.gear_known[1]:
        status |= _GEARS_KNOWN
    if core.closed_known[0] and core.closed_known[1]:
        status |= _PHASES_KNOWN
    if settled:
        status |= _CONVERGED
    if core.running and core.learned_us >= rules.learning_us:
        status |= _ROAD_LOAD_LEARNED
    if not core.running:
        status |= _INPUT_STALE
    if limited:
        status |= _LIMITED
    if not fits:
        status |= _SPEED_IMPLAUSIBLE
    if settled and fits and not limited:
        status |= _OUTPUT_VALID if adaptive else _ALL_VALID
    return status


@compiled
def bounded(value: float, limit: float) -> float:
    """Return ``value`` within ±limit."""
    return min(max(value, -limit), limit)


@compiled
def publish(core: Any, rules: Any, s: Any, c: Any, pair: Any, row: Any) -> None:
    """Write one estimate."""
    row.t_us = core.t_us
    full = rules.sub_observer == SubObserver.FULL
    adaptive = rules.sub_observer == SubObserver.ADAPTIVE
    T_1 = s.T_c1 if full else s.T_c1_uio
    T_2 = s.T_c2 if full else s.T_c2_uio
    if adaptive:
        T_1 = T_2 = 0.0
    T_o_adaptive = s.T_n + s.a_w * s.tau_o  # (47)
    T_o = (pair.R_1 * T_1 + pair.R_2 * T_2) / oh2014.driving_loss(c, s)  # (31), after the losses
    if adaptive:
        T_o = T_o_adaptive
    row.clutch1_torque_nm = bounded(T_1, rules.torque_limit[0])
    row.clutch2_torque_nm = bounded(T_2, rules.torque_limit[1])
    row.output_torque_nm = bounded(T_o, rules.output_limit)
    row.output_torque_adaptive_nm = bounded(T_o_adaptive, rules.output_limit)
    row.clutch1_torque_uio_nm = bounded(s.T_c1_uio, rules.torque_limit[0])
    row.clutch2_torque_uio_nm = bounded(s.T_c2_uio, rules.torque_limit[1])
    row.clutch_torque_sum_nm = s.T_c
    row.engine_torque_nm = core.value[_ENGINE_TORQUE] + s.w_e * s.tau_e  # (46)
    row.road_load_nm = s.T_n
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
    )
    core.status = judge(core, rules, pair, limited, adaptive)
    row.status = core.status


@compiled
def report(core: Any, health: Any, row: Any) -> None:
    """Copy the counters into a health row."""
    row.t_us = core.t_us
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
    row.status = core.status


@compiled
def count_rejected(health: Any, quantity: int, status: int) -> None:
    """Count a sample that may not be used."""
    if status == SampleStatus.NOT_AVAILABLE:
        health.not_available[quantity] += 1
    elif status == SampleStatus.OUT_OF_RANGE:
        health.out_of_range[quantity] += 1
    elif status == SampleStatus.BAD_LENGTH:
        health.bad_length[quantity] += 1
    elif status == SampleStatus.BAD_CRC:
        health.bad_crc[quantity] += 1
    else:
        health.bad_counter[quantity] += 1


@compiled
def take_time(core: Any, rules: Any, s: Any, c: Any, pair: Any, health: Any, t_us: int) -> None:
    """Advance to the time of a sample; a gap or a step back of the clock starts anew there, and is counted."""
    if core.t_us == NEVER:
        core.t_us = t_us
    elif t_us < core.t_us:
        if core.t_us - t_us > rules.max_step_back_us:
            health.clock_resets += 1
            forget(core, t_us)
        else:
            health.late_frames += 1
    elif t_us - core.t_us > rules.max_gap_us:
        health.gap_resets += 1
        forget(core, t_us)
    else:
        advance(core, rules, s, c, pair, health, t_us)


@compiled
def forget(core: Any, t_us: int) -> None:
    """Drop all inputs and go to ``t_us``."""
    core.t_us = t_us
    core.running = False
    core.estimate_us = core.health_us = core.implausible_us = NEVER
    for quantity in range(N_QUANTITIES):
        core.available[quantity] = False
        core.stale[quantity] = False
        core.fresh[quantity] = False
    for i in range(2):
        core.candidate_us[i] = core.slip_small_us[i] = NEVER
        core.gear_known[i] = False
        core.phase[i] = ClutchPhase.OPEN


@compiled
def run(
    t_us: NDArray[np.int64],
    quantities: NDArray[np.uint8],
    values: NDArray[np.float64],
    statuses: NDArray[np.uint8],
    lasts: NDArray[np.bool_],
    cores: NDArray[np.void],
    rule: NDArray[np.void],
    states: NDArray[np.void],
    constants: NDArray[np.void],
    pairs: NDArray[np.void],
    healths: NDArray[np.void],
    rows: NDArray[np.void],
    health_rows: NDArray[np.void],
) -> tuple[int, int]:
    """Feed samples; return how many estimates and health rows were written."""
    core, rules, s = cores[0], rule[0], states[0]
    c, pair, health = constants[0], pairs[0], healths[0]
    n_rows = n_health = 0
    for k in range(len(t_us)):
        quantity = int(quantities[k])
        if statuses[k] != SampleStatus.OK:
            count_rejected(health, quantity, statuses[k])
            if statuses[k] == SampleStatus.NOT_AVAILABLE:
                core.available[quantity] = False
        elif not rules.minimum[quantity] <= values[k] <= rules.maximum[quantity]:
            health.out_of_range[quantity] += 1
        else:
            if not core.frame_ok:
                take_time(core, rules, s, c, pair, health, t_us[k])
                core.frame_ok = True
            core.value[quantity] = values[k]
            core.seen_us[quantity] = core.t_us
            core.available[quantity] = True
            core.stale[quantity] = False
            core.fresh[quantity] = True
            health.accepted[quantity] += 1
        if not lasts[k] or not core.frame_ok:
            continue
        act(core, rules, s, c, pair, health)
        core.frame_ok = False
        for q in range(N_QUANTITIES):
            core.fresh[q] = False
        if not all_finite(s):
            core.running = False
            oh2014.reset(s, c, 0.0, 0.0, 0.0, 0.0)
        if core.estimate_us == NEVER or (
            core.t_us // rules.estimate_period_us != core.estimate_us // rules.estimate_period_us
        ):
            core.estimate_us = core.t_us
            publish(core, rules, s, c, pair, rows[n_rows])
            n_rows += 1
        if core.health_us == NEVER or (
            core.t_us // rules.health_period_us != core.health_us // rules.health_period_us
        ):
            core.health_us = core.t_us
            report(core, health, health_rows[n_health])
            n_health += 1
    return n_rows, n_health
