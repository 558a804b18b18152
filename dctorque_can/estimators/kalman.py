"""The Kalman estimator of both clutch torques, with their uncertainty.

A frame first carries the state to its own time (`predict`), then what the gearbox is known to do enters as
pseudo-measurements (`apply_phases`), then each of its speeds as one scalar measurement (`measure`), in Joseph's form.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.driveline.phases import ClutchPhase
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

NONE = -1  # the second state of a measurement that has only one
FINEST_US = STEPS_US[-1]
_STEPS = np.array(STEPS_US, np.int64)
_OPEN = int(ClutchPhase.OPEN)
_OPEN_RATE = 50.0  # N·m/s, of an open clutch's torque

FILTER = np.dtype(
    [
        ("x", "f8", (N,)),
        ("P", "f8", (N, N)),
        ("scratch", "f8", (N, N)),
        ("h", "f8", (N,)),
        ("K", "f8", (N,)),
        ("t_us", "i8"),  # time of the state, at most half a finest step from the last frame
        ("gear", "i8", (2,)),
        ("rejected", "i8", (5,)),  # measurements in a row beyond the gate: engine, shafts, driven, undriven wheels
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
        ("road_load", "f8"),  # N·m/√s
        ("held_load", "f8"),  # … while the car stands or brakes
        ("open_torque", "f8"),  # N·m, of an open clutch around its drag
        ("drag", "f8", (2,)),
        ("engine_variance", "f8"),  # of one sample
        ("shaft_variance", "f8"),
        ("wheel_variance", "f8"),
        ("gate", "f8"),  # largest normalised innovation squared that is believed
        ("patience", "i8"),  # … until so many in a row are not
        ("engine_error", "f8"),  # N·m
    ],
    align=True,
)
"""What the filter must know beside its tables."""


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
    t["engine_error"] = design.engine_torque_error_nm
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
    f.P[DT_E, DT_E] = tuning.engine_error**2
    for i in range(5):
        f.rejected[i] = 0


@compiled_without_allocation
def predict(
    f: Any, tables: Tables, tuning: Any, phase_1: int, phase_2: int, q_v: float, T_en: float, t_us: int
) -> None:
    """Carry the state to ``t_us`` (to the nearest finest step) at constant T_en."""
    rest = t_us - f.t_us + FINEST_US // 2
    first = tables.row[f.gear[0] + 1, f.gear[1] + 1]
    q_1, q_2 = tuning.rate[phase_1] ** 2, tuning.rate[phase_2] ** 2
    for step in range(len(_STEPS)):
        while rest >= _STEPS[step]:
            rest -= _STEPS[step]
            f.t_us += _STEPS[step]
            model = first + (2 if f.x[T_C1] >= 0.0 else 0) + (1 if f.x[T_C2] >= 0.0 else 0)
            _advance(f, tables, model, step, q_1, q_2, q_v, T_en)


@compiled_without_allocation
def _advance(
    f: Any, tables: Tables, model: int, step: int, q_1: float, q_2: float, q_v: float, T_en: float
) -> None:
    """x ← F x + b T_en, P ← F P Fᵀ + Q."""
    phi = tables.phi
    for i in range(N):
        f.h[i] = tables.input[model, step, i] * T_en
        for j in range(N):
            f.h[i] += phi[model, step, i, j] * f.x[j]
            f.scratch[i, j] = 0.0
    for i in range(N):
        f.x[i] = f.h[i]
        for k in range(N):
            factor = phi[model, step, i, k]
            if factor != 0.0:
                for j in range(N):
                    f.scratch[i, j] += factor * f.P[k, j]
    for i in range(N):
        for j in range(i + 1):
            total = tables.noise[model, step, i, j]
            total += q_1 * tables.noise_1[model, step, i, j] + q_2 * tables.noise_2[model, step, i, j]
            total += q_v * tables.noise_v[model, step, i, j]
            for k in range(N):
                total += f.scratch[i, k] * phi[model, step, j, k]
            f.P[i, j] = total
            f.P[j, i] = total


@compiled_without_allocation
def measure(f: Any, i: int, j: int, z: float, variance: float) -> None:
    """Take one measurement z of x_i, or of x_i − x_j; Joseph's form."""
    for k in range(N):
        f.h[k] = f.P[k, i] - (f.P[k, j] if j != NONE else 0.0)
    S = f.h[i] - (f.h[j] if j != NONE else 0.0) + variance
    e = z - f.x[i] + (f.x[j] if j != NONE else 0.0)
    for k in range(N):
        f.K[k] = f.h[k] / S
        f.x[k] += f.K[k] * e
    for k in range(N):
        for m in range(N):
            f.scratch[k, m] = f.P[k, m] - f.K[k] * f.h[m]
    for k in range(N):
        rest = f.scratch[k, i] - (f.scratch[k, j] if j != NONE else 0.0) - variance * f.K[k]
        for m in range(k + 1):
            f.P[k, m] = f.scratch[k, m] - rest * f.K[m]
            f.P[m, k] = f.P[k, m]


@compiled_without_allocation
def measure_gated(f: Any, tuning: Any, sensor: int, i: int, z: float, variance: float) -> None:
    """Take a speed unless it is beyond the gate; a sensor that stays there is right, and the state is opened to it."""
    e = z - f.x[i]
    S = f.P[i, i] + variance
    if e * e > tuning.gate * S:
        f.rejected[sensor] += 1
        if f.rejected[sensor] <= tuning.patience:
            return
        f.P[i, i] += e * e
    else:
        f.rejected[sensor] = 0
    measure(f, i, NONE, z, variance)


@compiled_without_allocation
def apply_phases(f: Any, tuning: Any, open_1: bool, open_2: bool) -> None:
    """An open clutch carries its drag, and its torque does not change."""
    for i in range(2):
        if open_1 if i == 0 else open_2:
            drag = tuning.drag[i] * (f.x[W_D] - f.x[W_C1 + i])
            measure(f, T_C1 + i, NONE, drag, tuning.open_torque**2)
            measure(f, R_1 + i, NONE, 0.0, tuning.rate[_OPEN] ** 2)


@compiled_without_allocation
def change_gears(f: Any, g1: int, g2: int) -> None:
    """Take new gears: a transfer shaft starts untwisted, and what its input shaft did before says nothing."""
    for i in range(2):
        gear = g1 if i == 0 else g2
        if gear == f.gear[i]:
            continue
        f.gear[i] = gear
        _forget(f, TH_T1 + i, 0.0, 1e-6)
        _forget(f, W_C1 + i, f.x[W_C1 + i], 1e4)


@compiled_without_allocation
def _forget(f: Any, i: int, value: float, variance: float) -> None:
    f.x[i] = value
    for k in range(N):
        f.P[i, k] = 0.0
        f.P[k, i] = 0.0
    f.P[i, i] = variance


@compiled_without_allocation
def conclude(f: Any, tables: Tables) -> None:
    """Work out the output torque and what is known of all three torques."""
    v_1, v_2 = max(f.P[T_C1, T_C1], 0.0), max(f.P[T_C2, T_C2], 0.0)
    f.sigma_1, f.sigma_2 = math.sqrt(v_1), math.sqrt(v_2)
    product = f.sigma_1 * f.sigma_2
    f.correlation = f.P[T_C1, T_C2] / product if product > 0.0 else 0.0
    T_o = variance = 0.0
    for i in range(N):
        T_o += tables.output[i] * f.x[i]
        if tables.output[i] != 0.0:
            for j in range(N):
                variance += tables.output[i] * tables.output[j] * f.P[i, j]
    f.T_o, f.sigma_o = T_o, math.sqrt(max(variance, 0.0))
