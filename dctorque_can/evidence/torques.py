"""The engine torque against what engine and car do with it: sign, scale, offset, inertia, mass.

While one clutch alone has the engine's torque, or none has (equations of `plausibility.torques`),

    T_en = k_J ((J_e + J_d) dω_e/dt + J_c R dω_b/dt) + k_m (m r² + J_w)/(η^±1 R) dω_b/dt + T_v/(η^±1 R).

All terms are smoothed alike, and differences over 0.8 s are taken, in which grade, wind and offsets drop out. The
regression of torque on accelerations finds k_m too small, since hills accelerate without torque; that of
accelerations on torque finds it too large, since a driver meets hills with torque. The truth is between both.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from dctorque_can.evidence.fits import Number, fit, median
from dctorque_can.evidence.moments import RUNS_RAD_S, SHAFTS, STEP_S, Mask, Moments, change, lasting, rate, smooth
from dctorque_can.evidence.series import UNKNOWN_GEAR, Floats

SPAN_S = 0.4
"""Half of what differences are taken over: a tip-in is done in it, and grades have hardly changed."""
LEAST_S = 10.0
"""Seconds of equations that factors need."""
APART_RAD_S2 = 30.0
"""Change of the engine's acceleration that shows its inertia: some N·m, several times the noise of a torque."""
APART_S = 0.3
"""Seconds of them with the engine turning apart from the car, without which only the sum of inertias shows."""
KNOWN = 0.2
"""Relative standard error up to which k_J is known."""
MODEL = 0.05
"""Standard deviation of k_m by what the equation leaves out: efficiency, tyres, the engine's lag."""
STEADY_RAD_S2 = 25.0
"""While the engine changes faster, its inertia hides the mean of its torque."""
IDLE_S = 1.5
"""Seconds of idling that an offset needs."""
OVERRUN_RAD_S = 120.0
"""Faster, and with the car slowing down, the fuel is cut sooner or later."""
OVERRUN_S = 3.0
SYNCHRONISED_RAD_S2 = 100.0
"""A shaft without gear that changes faster is being brought to the speed of its next gear."""
_NONE, _UNKNOWN = -1, -2
_SMOOTH_S = 0.1


@dataclass(frozen=True, slots=True)
class Factors:
    """What the accelerations say of torque, inertia and mass.

    Attributes:
        inertia: k_J, engine inertia that fits over that of the file; None where the engine never turns alone.
        mass: k_m, the same of the car.
        correlation: of the torque with the car's acceleration times its inertia, differences over 0.8 s.
        x, y: for a picture: torque that the file means, and the one that is told, N·m ``[n]``.
    """

    inertia: Number | None
    mass: Number
    correlation: float
    x: Floats
    y: Floats


def carrier(m: Moments) -> NDArray[np.int64]:
    """Return which clutch has the engine's torque ``[n]``: 0, 1, −1 none, −2 not known.

    By speeds where one is locked; while none is, by what is told of both: one may slip, and the other one is open.
    """
    found = np.full(len(m.t_s), _UNKNOWN)
    open_ = [lasting((m.closed_told[i] == 0) | m.neutral[i], 0.15, 0.15) for i in range(2)]
    runs = m.engine > RUNS_RAD_S
    found[open_[0] & open_[1] & runs] = _NONE
    for i in range(2):
        alone = open_[1 - i] & (m.closed_told[i] == 1) & runs
        found[alone & (m.ratio[i] > 0.0) & ~m.locked[1 - i]] = i
    one = m.locked[0] != m.locked[1]
    for i in range(2):
        found[one & m.locked[i] & (m.ratio[i] > 0.0)] = i
    found[m.locked[0] & m.locked[1]] = _UNKNOWN
    return found


def factors(m: Moments) -> Factors | None:
    """Return what accelerations say of the torque; None where the drive shows too little."""
    vehicle = m.vehicle
    has = carrier(m)
    row = np.arange(len(m.t_s))
    ratio = np.where(has >= 0, m.ratio[np.maximum(has, 0), row], 0.0)
    inertia = np.array([vehicle.shaft_inertia_kgm2(1), vehicle.shaft_inertia_kgm2(2)])[np.maximum(has, 0)]
    torque, engine = smooth(m.torque, _SMOOTH_S), rate(m.engine, _SMOOTH_S)
    body = rate(m.body, _SMOOTH_S)
    alone = (vehicle.engine_inertia_kgm2 + vehicle.damper.inertia_kgm2) * engine
    efficiency = vehicle.gear_efficiency * vehicle.final_drive_efficiency
    loss = np.where(torque > alone, efficiency, 1.0 / efficiency)
    alone += np.where(ratio > 0.0, inertia * ratio * body, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        car = np.where(ratio > 0.0, vehicle.chassis.inertia_kgm2 / (ratio * loss) * body, 0.0)
    driven = (ratio > 0.0) & m.free & other_rests(m, np.maximum(has, 0))
    state = np.where(has == _NONE, 1.0, np.where(driven, 1.0 + ratio, 0.0))
    changes = np.concatenate([[0], np.cumsum(np.diff(state) != 0.0)])
    n = round(SPAN_S / STEP_S)
    where = np.zeros(len(m.t_s), np.bool_)
    where[n:-n] = (changes[2 * n :] == changes[: -2 * n]) & (state[n:-n] > 0.0)
    y, x_1, x_2 = (change(each, SPAN_S) for each in (torque, alone, car))
    where &= np.isfinite(y + x_1 + x_2)
    if np.count_nonzero(where & (ratio > 0.0)) * STEP_S < LEAST_S:
        return None
    locked = m.locked[np.maximum(has, 0), row] & (has >= 0)
    moves = np.abs(change(engine, SPAN_S)) > APART_RAD_S2
    apart = bool(np.count_nonzero(where & ~locked & moves) * STEP_S >= APART_S)
    t_s, y, x_1, x_2 = m.t_s[where], y[where], x_1[where], x_2[where]
    found = fit(t_s, [x_1, x_2], y, STEP_S) if apart else None
    if found is None or found.sigmas[0] > KNOWN * abs(found.values[0]):
        apart = False
        found = fit(t_s, [x_1 + x_2], y, STEP_S)
    if found is None:
        return None
    k_J, k_m = (float(found.values[0]), float(found.values[1])) if apart else (float(found.values[0]),) * 2
    rest = y - k_J * x_1 if apart else y
    cause = x_2 if apart else x_1 + x_2
    back = fit(t_s, [rest], cause, STEP_S)
    correlation = float(np.corrcoef(rest, cause)[0, 1])
    if back is None or abs(correlation) < 0.1:
        return None
    most = 1.0 / float(back.values[0])
    middle = sqrt(abs(k_m * most)) * (1.0 if k_m > 0.0 else -1.0)
    spread = abs(most - k_m) / sqrt(12.0)  # evenly distributed between both
    sigma = sqrt(float(found.sigmas[-1]) ** 2 + spread**2 + (MODEL * middle) ** 2)
    mass = Number(middle, sigma, found.seconds)
    return Factors(found.number(0) if apart else None, mass, correlation, x_1 + x_2, y)


def other_rests(m: Moments, carrying: NDArray[np.int64]) -> Mask:
    """Return where the shaft that carries nothing is not being synchronised: that takes torque from the wheels."""
    row = np.arange(len(m.t_s))
    other = 1 - carrying
    in_gear = m.ratio[other, row] > 0.0
    calm = np.abs(np.stack([rate(m.shaft[i]) for i in range(2)])[other, row]) < SYNCHRONISED_RAD_S2
    told = m.gear[other, row] != UNKNOWN_GEAR
    measured = np.array([m.has(each) for each in SHAFTS])[other]
    return np.asarray(in_gear | (calm & measured) | ~(told | measured))


def idle_torque(m: Moments) -> Number | None:
    """Return the torque that is told while nothing takes it, N·m: both clutches are open, the engine steady."""
    free = (carrier(m) == _NONE) & ~m.locked[0] & ~m.locked[1]
    steady = np.abs(rate(m.engine, 0.2)) < STEADY_RAD_S2
    where = lasting(free & steady, 0.5, 0.2)
    alone = m.vehicle.engine_inertia_kgm2 + m.vehicle.damper.inertia_kgm2
    rest = smooth(m.torque, 0.2) - alone * rate(m.engine, 0.2)
    where &= np.isfinite(rest)
    if np.count_nonzero(where) * STEP_S < IDLE_S:
        return None
    return median(m.t_s[where], rest[where], STEP_S)


def overrun_torque(m: Moments) -> Number | None:
    """Return the least torque that is told for `OVERRUN_S` in all, N·m, while the engine brakes the car.

    An engine without fuel brakes: its net torque is negative.
    """
    where: Mask = (m.locked[0] | m.locked[1]) & (m.engine > OVERRUN_RAD_S) & (rate(m.body, 0.2) < 0.0)
    torque = smooth(m.torque, _SMOOTH_S)
    where &= np.isfinite(torque)
    seconds = np.count_nonzero(where) * STEP_S
    if seconds < 3.0 * OVERRUN_S:
        return None
    least = np.sort(torque[where])[: round(OVERRUN_S / STEP_S)]
    return Number(float(np.median(least)), float(np.std(least)), OVERRUN_S)
