"""The nominal engine torque as the filter takes it: between its frames, behind a lag, and with its lasting errors.

The torque that turns the engine is, with the nominal torque T_en and what two first-order lags leave of it,

    T_en + g T_l1 − τ_1 (T_en − T_l1)/t_1 − τ_2 (T_en − T_l2)/t_2 + ΔT_e        t_m Ṫ_lm = T_en − T_lm

g, τ_1 and τ_2 are states (`State.GAIN`, `State.LAG_1`, `State.LAG_2`), so it is linear in all that is not known.
An engine that follows its torque at once has τ_1 = τ_2 = 0, one with the lag t_1 has τ_1 = t_1 exactly, and a lag
between or somewhat beyond is nearly a sum of the two. Torques in N·m, times in s.
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.kalman.model import DT_E, GAIN, LAG_1, LAG_2, W_E
from dctorque_can.estimators.kalman.thresholds import FASTEST_TORQUE, JUMP

LAGS = (0.08, 0.25)  # s
_LONGEST_RAMP_US = 50_000
_SURELY_CHANGED = 2.0  # N·m; a smaller change may be noise, which would be taken for a lag that smooths it
_SURELY_THERE = 5.0  # … and for a gain
_CERTAIN = 4.5  # standard deviations of the torque signal's noise, likewise
_LEAST_NOISE = 0.3  # N·m
FIRST_NOISE = 2.0  # … until it is known
_MEDIAN = 0.455  # of χ² with one degree of freedom
_LEARNED = 0.02  # share by which a sample changes the noise's variance: a second or two of 100 Hz
_ENGINE = 0
_LOCKED = int(ClutchPhase.LOCKED)


@compiled_without_allocation
def judge_jump(f: Any, T_en: float) -> tuple[bool, bool]:
    """Return whether a nominal engine torque can be taken, and whether the one before it was a spike.

    A torque that jumps is held back, as ``f.held``, until the next one confirms it by being nearer to it than to
    the last one that was taken.
    """
    distance = abs(T_en - f.told)
    spike = distance <= abs(T_en - f.held)  # not of a NaN: none was held back
    if distance > JUMP + FASTEST_TORQUE * 1e-6 * (f.t_us - f.torque_us) and not abs(T_en - f.held) < distance:
        f.held = T_en
        return False, spike
    f.held = math.nan
    return True, spike


@compiled_without_allocation
def take_engine_torque(f: Any, tuning: Any, T_en: float) -> None:
    """Take a new nominal engine torque: what has changed may be late, or not have happened.

    Since the last one it has risen or fallen evenly, and was not held: half of the change is made up for, as far
    as the engine speed has not told it. After a silence nothing is known of the time between.
    That it depends on the lags enters the state alone: the covariance has `engine_torque_delay_ms` for it.
    """
    change = T_en - f.told
    learn_torque_noise(f, T_en)
    f.P[DT_E, DT_E] += (tuning.engine_share * change) ** 2
    f.P[W_E, W_E] += (tuning.engine_delay * change) ** 2
    half = 0.5e-6 * (f.t_us - f.torque_us)
    if f.t_us - f.torque_us > _LONGEST_RAMP_US:
        half = 0.0
    elif not math.isnan(f.accepted[_ENGINE]):
        half = min(half, 0.5e-6 * (f.t_us - f.accepted_us[_ENGINE]))
    if tuning.engine_lag == 0.0:
        at_once = 1.0 - f.x[LAG_1] / LAGS[0] - f.x[LAG_2] / LAGS[1]
        f.x[W_E] += change * half / tuning.J_e * at_once
        f.T_en = T_en
        for m in range(2):
            f.lagged[m] -= change * math.expm1(-half / LAGS[m])
    else:
        f.T_en -= change * math.expm1(-half / tuning.engine_lag)
    f.told_before, f.told, f.torque_us = f.told, T_en, f.t_us


@compiled_without_allocation
def take_no_torque(f: Any) -> None:
    """Take it that the engine has no torque of its own: what it has else is ΔT_e."""
    f.T_en = f.told = f.told_before = 0.0
    f.lagged[0] = f.lagged[1] = 0.0
    f.torque_us, f.held = f.t_us, math.nan


@compiled_without_allocation
def learn_torque_noise(f: Any, T_en: float) -> None:
    """Learn the noise of the torque signal from how it bends: its second difference has six times the variance.

    The variance is moved until half of the samples are above its median, so that steps and kinks hardly count.
    """
    bend = T_en - 2.0 * f.told + f.told_before
    above = bend * bend > 6.0 * _MEDIAN * f.torque_noise**2
    f.torque_noise = max(f.torque_noise * (1.0 + (0.5 if above else -0.5) * _LEARNED), _LEAST_NOISE)


@compiled_without_allocation
def let_engine_torque_age(f: Any, tuning: Any, seconds: float) -> None:
    """Let time pass without a new nominal engine torque: it may have changed as fast as a locked clutch's."""
    f.P[DT_E, DT_E] += 2.0 * tuning.rate_time * tuning.rate[_LOCKED] ** 2 * seconds


@compiled_without_allocation
def follow_torque(f: Any, tuning: Any, h: float) -> float:
    """Let the engine follow what the bus told for a step of h seconds; return its mean torque in it, N·m.

    What a unit of `State.GAIN`, `State.LAG_1` and `State.LAG_2` adds to that is then in ``f.per_error``.
    """
    T_en = f.T_en
    if tuning.engine_lag > 0.0:
        share = -math.expm1(-h / tuning.engine_lag)
        behind = f.T_en - f.told
        f.T_en -= share * behind
        T_en = f.told + behind * share * tuning.engine_lag / h
    noise = _CERTAIN * f.torque_noise
    f.per_error[0] = beyond(f.lagged[0], max(_SURELY_THERE, noise))
    for m in range(2):
        share = -math.expm1(-h / LAGS[m])
        change = T_en - f.lagged[m]
        f.lagged[m] += share * change
        f.per_error[1 + m] = -beyond(change, max(_SURELY_CHANGED, noise)) * share / h
    return float(T_en)


@compiled_without_allocation
def beyond(value: float, doubt: float) -> float:
    """Return a value that is nothing within ±doubt, and well beyond itself."""
    return value - doubt * doubt / value if abs(value) > doubt else 0.0


@compiled_without_allocation
def torque_error(f: Any) -> float:
    """Return by how much the engine's torque is above the nominal one, lag and all, N·m."""
    return float(
        f.x[DT_E] + f.per_error[0] * f.x[GAIN] + f.per_error[1] * f.x[LAG_1] + f.per_error[2] * f.x[LAG_2]
    )
