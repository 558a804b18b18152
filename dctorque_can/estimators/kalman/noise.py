"""How much the driveline may do until the next frame: process noise by clutch phase and by what has just happened.

Rates of the fastest events, all the time, would make every band too wide. A clutch torque is lively while clutches
slip or hand over, while the engine torque changes, and for some time after, as long as the driveline rings.
Torques in N·m, times in s.
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.kalman.model import DT_E, R_1, T_C1, T_V, TH_D, TH_O, W_B, W_C1, W_E, W_W
from dctorque_can.estimators.kalman.thresholds import ROLLS, ROLLS_SHARE, SPINS
from dctorque_can.estimators.kalman.tuning import SLIDING

_OPEN, _SLIPPING, _LOCKED = (int(phase) for phase in ClutchPhase)
_HANDS_OVER = 3.0  # 1/s, of what both clutches carry, in a shift that nothing tells of
_RECENT = 0.2  # s, over which a change is one that has just happened
_RINGING = 0.04  # s, time constant of the driveline's oscillation, 1/ω
_LEAST_TYRE_TORQUE = 15.0  # N·m/√s
_SLIPPING_SHARE = 0.15  # of a torque's rate at the wheel that slip of the tyres takes up
_SYNCHRONISER_SHARE = 0.5  # of a synchroniser's torque at the wheel: which gear it turns to is not known
_ACCELERATION_TIME = 0.5  # s, for which an acceleration lasts, as far as errors of timing go
_HELD_SHARE = 0.2  # of the largest rate, while brakes stay as they are
_SPIN_SIGMA = 3.0  # standard deviations of the body's speed that driven wheels may leave it by on top
_SPIN_TIME = 0.02  # s, for which a torque that the model makes of the spin is wrong the same way
_DRIVEN_BRAKES = 0.5  # share of the brakes at the driven wheels


@compiled_without_allocation
def engine_variance(tuning: Any, T_en: float) -> float:
    """Return the variance of the error that a lasting nominal engine torque has, (N·m)²."""
    return float(tuning.engine_error**2 + (tuning.engine_share * T_en) ** 2)


@compiled_without_allocation
def decide_rates(f: Any, tuning: Any, phase_1: int, phase_2: int, seconds: float) -> None:
    """Decide how fast both clutch torques may change, N·m/s; it rises at once and falls in the settling time.

    A clutch that slides has the torque of its actuator; near lock-up friction turns, or gives way to what holds.
    """
    change = f.T_en - f.recent_torque
    f.recent_torque += min(seconds / _RECENT, 1.0) * change
    handover = phase_1 != _OPEN and phase_2 != _OPEN
    keep = math.exp(-seconds / tuning.settling)
    for i in range(2):
        phase = phase_1 if i == 0 else phase_2
        if f.gear[i] == 0:
            f.torque_rate[i] = tuning.neutral_rate[i]
        elif f.idle[0] or f.idle[1]:
            f.torque_rate[i] = quiet_rate(f, tuning, i, change, keep)
        elif phase == _OPEN:
            f.torque_rate[i] = tuning.rate[_OPEN]
        else:
            rate = abs(change) / _RECENT + shaken_rate(f, tuning, i)
            rate = max(tuning.steady_rate, min(rate, tuning.rate[_LOCKED]))
            if phase == _LOCKED and f.spin_rate > SPINS:
                rate = tuning.rate[_SLIPPING]
            if handover or phase == _SLIPPING:
                rubs = i if phase == _SLIPPING else 1 - i
                slides = abs(f.x[W_E] - f.x[W_C1 + rubs]) > SLIDING
                rate = tuning.sliding_rate if slides else tuning.rate[_SLIPPING]
            f.torque_rate[i] = max(rate, keep * f.torque_rate[i])


@compiled_without_allocation
def quiet_rate(f: Any, tuning: Any, i: int, change: float, keep: float) -> float:
    """Return how fast clutch i changes its torque while one is locked and the other perhaps takes over, N·m/s."""
    hands_over = _HANDS_OVER * abs(f.x[T_C1] + f.x[T_C1 + 1])
    rate = min(max(hands_over, tuning.steady_rate), tuning.rate[_SLIPPING])
    if not f.idle[i]:
        rate = max(rate, min(abs(change) / _RECENT + shaken_rate(f, tuning, i), tuning.rate[_LOCKED]))
    return float(max(rate, keep * f.torque_rate[i]))


@compiled_without_allocation
def shaken_rate(f: Any, tuning: Any, i: int) -> float:
    """Return how fast clutch i changes its torque while the other shaft's synchroniser shakes it, N·m/s."""
    other = 1 - i
    if f.gear[other] != 0:
        return 0.0
    ratio = tuning.synchroniser_ratio[other] / abs(tuning.ratio[i, f.gear[i] + 1])
    return float(abs(f.x[T_C1 + other]) * ratio / _RINGING)


@compiled_without_allocation
def decide_brake_rate(f: Any, tuning: Any, brakes: bool, stands: bool, seconds: float) -> None:
    """Decide how fast brakes, or what holds a car that stands, may change the load, N·m/√s.

    It rises at once when one of them begins or ends and when the load changes meanwhile, and falls in the settling
    time: brakes that stay as they are are a steady load.
    """
    change = f.x[T_V] - f.recent_load
    f.recent_load += min(seconds / _RECENT, 1.0) * change
    rate = 0.0
    if brakes or stands:
        rate = max(_HELD_SHARE * tuning.held_load, min(abs(change) / math.sqrt(_RECENT), tuning.held_load))
    if brakes != bool(f.brakes) or stands != bool(f.stands):
        rate = tuning.held_load
    f.brakes, f.stands = brakes, stands
    f.brake_rate = max(rate, math.exp(-seconds / tuning.settling) * f.brake_rate)


@compiled_without_allocation
def decide_spin_rate(f: Any, tuning: Any, seconds: float) -> None:
    """Decide how fast the tyres' torque may change because they spin or lock, N·m/√s.

    A tyre that rolls hands on what the clutches give. One that slips gives what the road takes, which no speed
    tells, and anything when it grips again. The rate rises at once and falls in the settling time.
    """
    spin, change = f.x[W_W] - f.x[W_B], f.rate[W_W] - f.rate[W_B]
    rate = 0.0
    usual = ROLLS_SHARE * abs(f.x[W_B]) + ROLLS + _SPIN_SIGMA * math.sqrt(max(f.P[W_B, W_B], 0.0))
    if abs(spin) > usual or abs(f.rate[W_B]) > tuning.fastest_grip:
        rate = tuning.grip / math.sqrt(tuning.settling) + abs(tuning.tyre_damping * change) * math.sqrt(_SPIN_TIME)
    f.spins = rate > 0.0
    f.spin_rate = max(rate, math.exp(-seconds / tuning.settling) * f.spin_rate)


@compiled_without_allocation
def process_noise(f: Any, tuning: Any, phase_1: int, phase_2: int) -> tuple[float, float, float, float, float]:
    """Return the factors of the five noises of `Tables`: variances of r_1 and r_2, T_x and T_v in (N·m)²/s, ΔT_e.

    By the model the tyres follow the clutches through the gears; on top come a share of the rate that may be, or
    of that which is, since a torque that grows makes tyres slip; and the driven wheels' brakes.
    """
    wheel_rate = synchroniser_rate = handed_on = 0.0
    for i in range(2):
        if f.gear[i] == 0:
            synchroniser_rate = max(synchroniser_rate, tuning.synchroniser_ratio[i] * f.torque_rate[i])
        elif (phase_1 if i == 0 else phase_2) != _OPEN:
            ratio = tuning.ratio[i, f.gear[i] + 1]
            wheel_rate = max(wheel_rate, abs(ratio) * f.torque_rate[i])
            handed_on += ratio * f.x[R_1 + i]
    load = max(f.brake_rate, tuning.road_load) ** 2
    tyre = _LEAST_TYRE_TORQUE**2
    if f.brakes or not f.stands:  # of a car that is held without them the driven wheels are as free as ever
        tyre = max(_DRIVEN_BRAKES * f.brake_rate, _LEAST_TYRE_TORQUE) ** 2
    own_rate = max(tuning.tyre_share * wheel_rate, _SLIPPING_SHARE * abs(handed_on))
    own_rate = max(own_rate, _SYNCHRONISER_SHARE * synchroniser_rate)
    tyre += 2.0 * tuning.rate_time * own_rate**2 + f.spin_rate**2
    return f.torque_rate[0] ** 2, f.torque_rate[1] ** 2, tyre, load, engine_variance(tuning, f.T_en)


@compiled_without_allocation
def admit_parameter_errors(f: Any, tuning: Any, seconds: float) -> None:
    """Spread what wrong parameters would falsify: a wrong stiffness the twists, mass the load, inertia the engine.

    A torque that changes by ΔT leaves a twist wrong by s ΔT/k if the stiffness is wrong by the share s, and so for
    the others. The change is that of the last moments; a step of ΔT adds (s ΔT)² in all.

    Speeds that are sampled at times further apart than is known are apart by a constant while the car accelerates,
    and the twist between them would run away with it.
    """
    share = min(seconds / _RECENT, 1.0)
    grow = 2.0 * share * tuning.parameter_error**2
    change = f.T_o - f.recent_output
    f.recent_output += share * change
    f.P[T_V, T_V] += grow * change * change
    change = tuning.J_e * f.rate[W_E] - f.recent_inertial
    f.recent_inertial += share * change
    f.P[DT_E, DT_E] += grow * change * change
    apart = tuning.timing_error * f.rate[W_B]
    f.P[TH_O, TH_O] += 2.0 * _ACCELERATION_TIME * apart * apart * seconds
    for i in range(4):
        change = f.x[TH_D + i] - f.recent_twist[i]
        f.recent_twist[i] += share * change
        f.P[TH_D + i, TH_D + i] += grow * change * change
