"""The Kalman estimator of both clutch torques, with their uncertainty.

A frame first carries the state to its own time (`predict`), then what the gearbox is known to do enters as
pseudo-measurements (`apply_phases`), then each of its speeds as one scalar measurement (`measure`), in Joseph's
form. Speeds in rad/s, torques in N·m.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators import kalman_model
from dctorque_can.estimators.design import KalmanDesign
from dctorque_can.estimators.kalman_model import (
    DT_E,
    R_1,
    STEPS_US,
    T_C1,
    T_C2,
    T_V,
    T_X,
    TH_T1,
    W_B,
    W_C1,
    W_D,
    W_E,
    W_O,
    W_W,
    N,
    Tables,
)

FINEST_US = STEPS_US[-1]
_STEPS = np.array(STEPS_US, np.int64)
_OPEN = int(ClutchPhase.OPEN)
_OPEN_RATE = 50.0  # N·m/s, of an open clutch's torque
_NEUTRAL_TRUST = 100.0  # … so weakly that it only keeps the state from running away
_REVERSAL_NM = 2.0  # beyond zero at which the losses change their direction
_REVERSAL_SIGMA = 0.1  # … and standard deviations of the torque
_SENSORS = 5  # engine, input shafts, driven and undriven wheels

FILTER = np.dtype(
    [
        ("x", "f8", (N,)),
        ("P", "f8", (N, N)),
        ("scratch", "f8", (N, N)),
        ("h", "f8", (N,)),
        ("K", "f8", (N,)),
        ("rate", "f8", (N,)),  # of the state over the last step
        ("T_en", "f8"),  # nominal engine torque of the last frame that had one
        ("t_us", "i8"),  # time of the state, at most half a finest step from the last frame
        ("gear", "i8", (2,)),
        ("drives", "u1", (2,)),  # direction of the losses
        ("rejected", "i8", (_SENSORS,)),  # measurements in a row beyond the gate
        ("taken", "i8", (_SENSORS,)),  # measurements within the gate, through all restarts
        ("squares", "f8", (_SENSORS,)),  # … and the sum of their normalised innovations squared
        ("beyond", "i8", (_SENSORS,)),  # … and those beyond the gate
        ("T_c1", "f8"),
        ("T_c2", "f8"),
        ("sigma_1", "f8"),  # standard deviations of what is published
        ("sigma_2", "f8"),
        ("sigma_o", "f8"),
        ("correlation", "f8"),
        ("T_o", "f8"),
    ],
    align=True,
)
"""State, covariance, and room to work in."""

TUNING = np.dtype(
    [
        ("rate", "f8", (3,)),  # N·m/s, standard deviation of a clutch torque's rate by `ClutchPhase`
        ("neutral", "f8", (2,)),  # N·m, of a synchroniser's torque on each shaft
        ("neutral_rate", "f8", (2,)),  # N·m/s
        ("road_load", "f8"),  # N·m/√s
        ("held_load", "f8"),  # … while the car stands or brakes
        ("open_torque", "f8"),  # N·m, of an open clutch around its drag
        ("drag", "f8", (2,)),
        ("engine_variance", "f8"),  # of one sample
        ("shaft_variance", "f8"),
        ("wheel_variance", "f8"),
        ("timing_error", "f8"),  # s, between the sample of a speed and its frame's time
        ("gate", "f8"),  # largest normalised innovation squared that is believed
        ("patience", "i8"),  # … until so many in a row are not
        ("engine_error", "f8"),  # N·m, at no torque
        ("engine_share", "f8"),  # … and by how much it grows with the torque
        ("engine_delay", "f8"),  # rad/s per N·m, what a change that comes late does to the engine speed
    ],
    align=True,
)
"""What the filter must know beside its tables."""


class Kalman(NamedTuple):
    """All that the filter needs, in one argument.

    Attributes:
        state: `FILTER` ``[1]``.
        tuning: `TUNING` ``[1]``.
        tables: the discrete model.
    """

    state: NDArray[np.void]
    tuning: NDArray[np.void]
    tables: Tables


def new(vehicle: Vehicle, design: KalmanDesign, table_size: int, needed: bool = True) -> Kalman:
    """Return a filter that has not been started; see `kalman_model.tables`."""
    return Kalman(
        np.zeros(1, FILTER), tuning(vehicle, design), kalman_model.tables(vehicle, design, table_size, needed)
    )


def tuning(vehicle: Vehicle, design: KalmanDesign) -> NDArray[np.void]:
    """Return the `TUNING` record ``[1]`` of a vehicle and a design."""
    t = np.zeros(1, TUNING)
    t["rate"] = (_OPEN_RATE, design.slipping_torque_rate_nm_per_s, design.locked_torque_rate_nm_per_s)
    t["road_load"] = design.road_load_rate_nm_per_sqrt_s
    t["held_load"] = design.held_load_rate_nm_per_sqrt_s
    t["open_torque"] = design.open_torque_nm
    t["drag"] = [clutch.drag_nms_per_rad for clutch in vehicle.clutches]
    t["engine_variance"] = design.engine_speed_noise_rad_s**2
    t["shaft_variance"] = design.shaft_speed_noise_rad_s**2
    t["wheel_variance"] = design.wheel_speed_noise_rad_s**2
    t["gate"] = design.gate_sigma**2
    t["patience"] = design.gate_patience
    t["timing_error"] = design.timing_error_s
    t["engine_error"] = design.engine_torque_error_nm
    t["engine_share"] = design.engine_torque_error_share
    t["engine_delay"] = design.engine_torque_delay_s / vehicle.engine_inertia_kgm2
    t["neutral"] = [design.synchroniser_rad_s2 * vehicle.shaft_inertia_kgm2(i) for i in (1, 2)]
    t["neutral_rate"] = t["neutral"] / design.torque_rate_time_s
    return t


@compiled_without_allocation
def start(f: Any, tuning: Any, w_e: float, w_1: float, w_2: float, w_w: float, T_en: float) -> None:
    """Start at the measured speeds; the torques are unknown."""
    for i in range(N):
        f.x[i] = 0.0
        for j in range(N):
            f.P[i, j] = 0.0
    f.x[W_E] = f.x[W_D] = w_e
    f.x[W_C1], f.x[W_C1 + 1] = w_1, w_2
    f.x[W_O] = f.x[W_W] = f.x[W_B] = w_w
    for i in range(W_E, W_C1 + 2):
        f.P[i, i] = 4.0
    for i in (W_O, W_W, W_B):
        f.P[i, i] = 0.1
    for i in range(TH_T1 - 1, TH_T1 + 3):
        f.P[i, i] = 0.05**2  # rad
    f.P[T_X, T_X] = f.P[T_V, T_V] = 2000.0**2
    f.P[T_C1, T_C1] = f.P[T_C2, T_C2] = 200.0**2
    f.P[R_1, R_1] = f.P[R_1 + 1, R_1 + 1] = 100.0**2
    f.P[DT_E, DT_E] = engine_variance(tuning, T_en)
    f.T_en = T_en
    f.drives[0] = f.drives[1] = True
    for i in range(N):
        f.rate[i] = 0.0
    for i in range(_SENSORS):
        f.rejected[i] = 0


@compiled_without_allocation
def engine_variance(tuning: Any, T_en: float) -> float:
    """Return the variance of the error that a lasting nominal engine torque has, (N·m)²."""
    return float(tuning.engine_error**2 + (tuning.engine_share * T_en) ** 2)


@compiled_without_allocation
def take_engine_torque(f: Any, tuning: Any, T_en: float) -> None:
    """Take a new nominal engine torque: what has changed may be late, or not have happened."""
    f.P[DT_E, DT_E] += (tuning.engine_share * (T_en - f.T_en)) ** 2
    f.P[W_E, W_E] += (tuning.engine_delay * (T_en - f.T_en)) ** 2
    f.T_en = T_en


@compiled_without_allocation
def predict(f: Any, tables: Tables, tuning: Any, phase_1: int, phase_2: int, q_v: float, t_us: int) -> None:
    """Carry the state to ``t_us`` (to the nearest finest step) at the last T_en; q_v in (N·m)²/s."""
    rest = t_us - f.t_us + FINEST_US // 2
    first = tables.row[f.gear[0] + 1, f.gear[1] + 1]
    r_1 = tuning.rate[phase_1] if f.gear[0] != 0 else tuning.neutral_rate[0]
    r_2 = tuning.rate[phase_2] if f.gear[1] != 0 else tuning.neutral_rate[1]
    q = (r_1**2, r_2**2, q_v, engine_variance(tuning, f.T_en))
    for step in range(len(_STEPS)):
        while rest >= _STEPS[step]:
            rest -= _STEPS[step]
            f.t_us += _STEPS[step]
            model = first + (2 if f.drives[0] else 0) + (1 if f.drives[1] else 0)
            _advance(f, tables, model, step, q)


@compiled_without_allocation
def _advance(f: Any, tables: Tables, model: int, step: int, q: tuple[float, float, float, float]) -> None:
    """x ← F x + b T_en, P ← F P Fᵀ + Q, with the variances of both clutches' rates, T_v and ΔT_e."""
    phi, per_s = tables.phi, 1e6 / _STEPS[step]
    for i in range(N):
        f.h[i] = tables.input[model, step, i] * f.T_en
        for j in range(N):
            f.h[i] += phi[model, step, i, j] * f.x[j]
            f.scratch[i, j] = 0.0
    for i in range(N):
        f.rate[i] = (f.h[i] - f.x[i]) * per_s
        f.x[i] = f.h[i]
        for k in range(N):
            factor = phi[model, step, i, k]
            if factor != 0.0:
                for j in range(N):
                    f.scratch[i, j] += factor * f.P[k, j]
    for i in range(N):
        for j in range(i + 1):
            total = tables.noise[model, step, i, j]
            total += q[0] * tables.noise_1[model, step, i, j] + q[1] * tables.noise_2[model, step, i, j]
            total += q[2] * tables.noise_v[model, step, i, j] + q[3] * tables.noise_e[model, step, i, j]
            for k in range(N):
                total += f.scratch[i, k] * phi[model, step, j, k]
            f.P[i, j] = total
            f.P[j, i] = total


@compiled_without_allocation
def measure(f: Any, i: int, z: float, variance: float) -> None:
    """Take one measurement z of x_i; Joseph's form."""
    for k in range(N):
        f.h[k] = f.P[k, i]
    S = f.h[i] + variance
    e = z - f.x[i]
    for k in range(N):
        f.K[k] = f.h[k] / S
        f.x[k] += f.K[k] * e
    for k in range(N):
        for m in range(N):
            f.scratch[k, m] = f.P[k, m] - f.K[k] * f.h[m]
    for k in range(N):
        rest = f.scratch[k, i] - variance * f.K[k]
        for m in range(k + 1):
            f.P[k, m] = f.scratch[k, m] - rest * f.K[m]
            f.P[m, k] = f.P[k, m]


@compiled_without_allocation
def measure_gated(f: Any, tuning: Any, sensor: int, i: int, z: float, variance: float) -> None:
    """Take a speed unless it is beyond the gate; one that stays there is right, and the state is opened to it."""
    e = z - f.x[i]
    variance += (tuning.timing_error * f.rate[i]) ** 2
    S = f.P[i, i] + variance
    square = e * e / S
    if not square <= tuning.gate:  # also when it is no number
        f.rejected[sensor] += 1
        f.beyond[sensor] += 1
        if f.rejected[sensor] <= tuning.patience:
            return
        f.P[i, i] += e * e
    else:
        f.rejected[sensor] = 0
        f.taken[sensor] += 1
        f.squares[sensor] += square
    measure(f, i, z, variance)


@compiled_without_allocation
def apply_phases(f: Any, tuning: Any, open_1: bool, open_2: bool) -> None:
    """An open clutch carries its drag, and its torque does not change; a synchroniser has no torque for long."""
    for i in range(2):
        if f.gear[i] == 0:
            measure(f, T_C1 + i, 0.0, _NEUTRAL_TRUST * tuning.neutral[i] ** 2)
        elif open_1 if i == 0 else open_2:
            drag = tuning.drag[i] * (f.x[W_D] - f.x[W_C1 + i])
            measure(f, T_C1 + i, drag, tuning.open_torque**2)
            measure(f, R_1 + i, 0.0, tuning.rate[_OPEN] ** 2)


@compiled_without_allocation
def decide_directions(f: Any, open_1: bool, open_2: bool) -> None:
    """Decide where losses go. A choice that followed the noise would make two models of one torque contradict."""
    for i in range(2):
        if open_1 if i == 0 else open_2:
            f.drives[i] = f.x[T_C1 + i] >= 0.0
            continue
        band = _REVERSAL_NM + _REVERSAL_SIGMA * math.sqrt(max(f.P[T_C1 + i, T_C1 + i], 0.0))
        if f.drives[i]:
            f.drives[i] = f.x[T_C1 + i] > -band
        else:
            f.drives[i] = f.x[T_C1 + i] > band


@compiled_without_allocation
def change_gears(f: Any, tuning: Any, g1: int, g2: int) -> None:
    """Take new gears: a transfer shaft starts untwisted, and what its input shaft did before says nothing."""
    for i in range(2):
        gear = g1 if i == 0 else g2
        if gear == f.gear[i]:
            continue
        f.gear[i] = gear
        _forget(f, TH_T1 + i, 0.0, 1e-6)
        _forget(f, W_C1 + i, f.x[W_C1 + i], 1e4)
        # the clutch is open, but the frame that says so may come late
        torque, rate = tuning.open_torque, tuning.rate[_OPEN]
        if gear == 0:
            torque, rate = tuning.neutral[i], tuning.neutral_rate[i]
        _forget(f, T_C1 + i, 0.0, torque**2)
        _forget(f, R_1 + i, 0.0, rate**2)


@compiled_without_allocation
def _forget(f: Any, i: int, value: float, variance: float) -> None:
    f.x[i] = value
    for k in range(N):
        f.P[i, k] = 0.0
        f.P[k, i] = 0.0
    f.P[i, i] = variance


@compiled_without_allocation
def conclude(f: Any, tables: Tables, tuning: Any) -> None:
    """Work out the published torques and what is known of them; in neutral a clutch has its drag alone."""
    f.T_c1, f.sigma_1 = f.x[T_C1], math.sqrt(max(f.P[T_C1, T_C1], 0.0))
    f.T_c2, f.sigma_2 = f.x[T_C2], math.sqrt(max(f.P[T_C2, T_C2], 0.0))
    product = f.sigma_1 * f.sigma_2
    f.correlation = f.P[T_C1, T_C2] / product if product > 0.0 else 0.0
    if f.gear[0] == 0:
        f.T_c1, f.sigma_1 = tuning.drag[0] * (f.x[W_D] - f.x[W_C1]), tuning.open_torque
    if f.gear[1] == 0:
        f.T_c2, f.sigma_2 = tuning.drag[1] * (f.x[W_D] - f.x[W_C1 + 1]), tuning.open_torque
    if f.gear[0] == 0 or f.gear[1] == 0:
        f.correlation = 0.0
    T_o = variance = 0.0
    for i in range(N):
        T_o += tables.output[i] * f.x[i]
        if tables.output[i] != 0.0:
            for j in range(N):
                variance += tables.output[i] * tables.output[j] * f.P[i, j]
    f.T_o, f.sigma_o = T_o, math.sqrt(max(variance, 0.0))
