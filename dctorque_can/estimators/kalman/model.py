"""The driveline as a linear stochastic model: what the Kalman estimator predicts with.

With the clutch torques as states the compliant driveline of section 2.2 is linear for each pair of engaged gears.
Here are its matrices and their exact discretisation on a ladder of steps, all made at configuration time:

    J_e ω̇_e = T_en + ΔT_e − T_d          J_d ω̇_d = T_d − T_c1 − T_c2        T_d = k_d θ_d + b_d (ω_e − ω_d)
    J_i ω̇_ci = T_ci − T_ti/(i_ti η) − T_si          T_ti = k_ti θ_ti + b_ti (ω_ci/i_ti − i_fi ω_o)     (12) to (16)
    J_o ω̇_o = η' (i_f1 T_t1 + i_f2 T_t2) − T_so − T_o           T_o = k_o θ_o + b_o (ω_o − ω_w)          (14), (17)
    J_w ω̇_w = T_o − T_x                  J_b ω̇_b = T_x − T_v
    Ṫ_x = Σ η i_ti i_fi r_i + D (ω̇_w − ω̇_b) + noise                 Ṫ_ci = r_i

Four states more are in no equation of motion but in what is measured of the speeds (`seen`).

T_x is what the tyres hand from the driven wheels to the body (undriven wheels turn with it). It carries what the
clutches' torques change, and damps the driven wheels against the body, by less than a tyre does at any but the
highest speeds. The rates r_i of the clutch torques forget within ``torque_rate_time_s``. A shaft in neutral has an
open clutch and perhaps a synchroniser: there the state T_ci is the torque between shaft and output shaft,
J_i ω̇_ci = T_ci and −R T_ci on the output shaft. Spin losses T_s of the shafts are inputs, as T_en is.

SI units: rad/s, rad, N·m, kg·m².
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from itertools import chain, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import STANDARD_GRAVITY, Gear, Vehicle
from dctorque_can.errors import DctorqueError
from dctorque_can.estimators.kalman.design import KalmanDesign

Floats = NDArray[np.float64]
Step = tuple[Floats, Floats, Floats]
"""F, responses to constant inputs, covariance of each noise."""


class State(IntEnum):
    """Place of each quantity in the state."""

    W_E = 0  # engine speed
    W_D = 1  # damper secondary side
    W_C1 = 2  # input shafts
    W_C2 = 3
    W_O = 4  # output shaft
    W_W = 5  # driven wheels
    W_B = 6  # body, as speed of the undriven wheels
    TH_D = 7  # twist of the damper
    TH_T1 = 8  # … of the transfer shafts, behind the gear
    TH_T2 = 9
    TH_O = 10  # … of the output shaft
    T_X = 11
    T_C1 = 12
    T_C2 = 13
    R_1 = 14  # rates of the clutch torques
    R_2 = 15
    T_V = 16  # road load, brakes included
    DT_E = 17  # error of the nominal engine torque
    GAIN = 18  # … and the share of the torque that it lastingly is
    LAG_1 = 19  # s, lag of the engine behind its nominal torque (`engine`), beyond the one that is told
    LAG_2 = 20
    SCALE = 21  # share by which the driven wheels are told too fast, as the ratios have it
    RATIO_1 = 22  # … and by which the ratio of the gear on each shaft is larger than in the vehicle file
    RATIO_2 = 23
    LATE = 24  # s, by which speeds of wheels come later than those of shafts, beyond what is told


N = len(State)
W_E, W_D, W_C1, W_C2, W_O, W_W, W_B, TH_D, TH_T1, TH_T2, TH_O, T_X, T_C1, T_C2, R_1, R_2, T_V, DT_E, *_LASTING = (
    range(N)
)
GAIN, LAG_1, LAG_2, SCALE, RATIO_1, RATIO_2, LATE = _LASTING

SCALED_BY = np.arange(N, dtype=np.int64)
"""By the error of which state a measurement of each speed is too large, as a share; of all others it is the state
itself. Ratios and wheels do not agree to the last digit, and a shaft is stiff: what is left would be a twist that
grows. So the model's shafts turn as the ratios of the vehicle file have it, and ω (1 + error) is measured."""
SCALED_BY[[W_W, W_C1, W_C2]] = SCALE, RATIO_1, RATIO_2

STEPS_US = (16_000, 8_000, *range(4_000, 0, -250))
"""A time is bridged by as many of these as fit, the longest first: mostly one, from frame to frame of a bus."""

_HALVINGS = 15  # of the shortest step: there |A| h is small even for an output shaft of 0.0002 kg·m²
GAIN_TIME = 20.0  # s, for which the torque's error is the same share of it
LAG_TIME = 300.0  # … and the engine's lag the same
SCALE_WALK = 3e-5  # 1/√s, by which wheels lastingly roll on another radius: tyres get warm, axle loads change
LATE_TIME = 1e4  # s, for which a delay stays as it is
GAIN_SHARE = 0.75  # of the variance of an error that grows with the torque
_TERMS = 12  # of the series at such a step
_FASTEST_CAR = 30.0  # m/s up to which the tyres damp at least as much as the model
_SLACK_RATE = 50.0  # 1/s, at which the twist of a shaft in neutral is forgotten
_LEAST_INERTIA = 1e-4  # kg·m²; a lighter output shaft has no dynamics that any sensor sees


ENGINE = (W_E, W_D, TH_D)
"""States of the engine's side of the clutches."""

CAR = (W_C1, W_C2, W_O, W_W, W_B, TH_T1, TH_T2, TH_O, T_X)
"""States of the gearbox's and the car's side."""

OUTPUT = (W_O, W_W, TH_O)
"""States that T_o depends on."""

COUPLED = T_X + 1
"""Number of these: they come first."""

WIDTH = 16
"""Length of the columns of F in `STEP`, which end in zeros: a shorter loop is not given to a vector unit."""

_OF_ENGINE = 0, 1, 2, 5  # which noises of `tables` act on them, and
_OF_CAR = 0, 1, 2, 3, 4
_OF_REST = 1, 2, 1, 2, 4, 5  # which one on T_C1, T_C2, R_1, R_2, T_V and DT_E

STEP = np.dtype(
    [
        ("phi", "f8", (N, N)),  # F
        ("columns", "f8", (N, WIDTH)),  # … of its first rows, one after the other
        ("input", "f8", (N,)),  # response to T_en
        (
            "losses",
            "f8",
            (3, len(CAR)),
        ),  # … of `CAR` to losses of input shafts and output shaft
        # rows of Q, columns of `COUPLED` states: of what always acts, the rates of T_c1 and T_c2, ΔT_e
        ("noise_engine", "f8", (len(_OF_ENGINE), len(ENGINE) * COUPLED)),
        # … of what always acts, the rates of T_c1 and T_c2, T_x, T_v
        ("noise_car", "f8", (len(_OF_CAR), len(CAR) * COUPLED)),
        ("noise_rest", "f8", (len(_OF_REST), N)),  # T_C1, T_C2, R_1, R_2, T_V, DT_E: each of its own noise
        ("noise_lasting", "f8", (N - GAIN,)),  # variances of GAIN, LAG_1, …
    ],
    align=True,
)
"""One step of one model. All but the first noise are per unit of their factor of `noise.process_noise`."""


class Tables(NamedTuple):
    """The discrete model of each pair of gears (0 neutral), loss direction and step.

    Attributes:
        row: int64 ``[gears, gears]`` by gear number + 1 on shaft 1 and 2: first row of the pair; −1: no such pair.
            Row + 2·(shaft 1 drives) + (shaft 2 drives) is the model.
        steps: `STEP` ``[rows, steps]``.
        output: T_o as a combination of the states ``[N]``.
    """

    row: NDArray[np.int64]
    steps: NDArray[np.void]
    output: Floats


def continuous(
    vehicle: Vehicle, design: KalmanDesign, gear1: int, gear2: int, drives: tuple[bool, bool]
) -> tuple[Floats, Floats]:
    """Return A ``[N, N]`` of dx/dt = A x + B T_en + noise, and the row ``[N]`` that gives T_o.

    Args:
        vehicle: parameters.
        design: times in which rates and torque error forget.
        gear1: on shaft 1, 0 for neutral.
        gear2: on shaft 2.
        drives: for each shaft, whether its transfer shaft drives the car, else it is driven: where losses go.
    """
    A = np.zeros((N, N))
    damper, output, chassis = vehicle.damper, vehicle.output_shaft, vehicle.chassis
    T_d = np.zeros(N)
    T_d[[TH_D, W_E, W_D]] = damper.stiffness_nm_per_rad, damper.damping_nms_per_rad, -damper.damping_nms_per_rad
    A[W_E] = -T_d / vehicle.engine_inertia_kgm2
    A[W_E, DT_E] = 1.0 / vehicle.engine_inertia_kgm2
    A[W_D] = T_d / damper.inertia_kgm2
    A[TH_D, [W_E, W_D]] = 1.0, -1.0
    J_o = max(output.inertia_kgm2, _LEAST_INERTIA)
    for i, number in enumerate((gear1, gear2)):
        shaft = vehicle.shafts[i]
        J = vehicle.shaft_inertia_kgm2(i + 1)
        A[W_C1 + i, T_C1 + i] = 1.0 / J
        if number == 0:
            ratio = synchroniser_ratio(vehicle, i, gear2 if i == 0 else gear1)
            A[W_O, T_C1 + i] = -ratio / J_o
            A[T_X, R_1 + i] = -ratio
            A[TH_T1 + i, TH_T1 + i] = -_SLACK_RATE
            continue
        A[W_D, T_C1 + i] = -1.0 / damper.inertia_kgm2
        gear = vehicle.gear(number)
        arm_in, arm_out = arms(vehicle, gear, drives[i])
        T_t = np.zeros(N)
        T_t[TH_T1 + i] = shaft.transfer_stiffness_nm_per_rad
        T_t[W_C1 + i] = shaft.transfer_damping_nms_per_rad / gear.ratio
        T_t[W_O] = -shaft.transfer_damping_nms_per_rad * gear.final_drive
        A[W_C1 + i] -= arm_in * T_t / J  # (12), (13)
        A[W_O] += arm_out * T_t / J_o  # (14)
        A[T_X, R_1 + i] = arm_out / arm_in
        A[TH_T1 + i, [W_C1 + i, W_O]] = 1.0 / gear.ratio, -gear.final_drive
    T_o = np.zeros(N)
    T_o[list(OUTPUT)] = output.damping_nms_per_rad, -output.damping_nms_per_rad, output.stiffness_nm_per_rad
    A[W_O] -= T_o / J_o
    A[TH_O, [W_O, W_W]] = 1.0, -1.0
    J_w = 0.5 * chassis.wheel_inertia_kgm2  # two of four wheels are driven
    J_b = chassis.inertia_kgm2 - J_w
    A[W_W] = T_o / J_w
    A[W_W, T_X] = -1.0 / J_w
    A[W_B, [T_X, T_V]] = 1.0 / J_b, -1.0 / J_b
    A[T_X] += tyre_damping(vehicle, design) * (A[W_W] - A[W_B])
    for i in range(2):
        A[T_C1 + i, R_1 + i] = 1.0
        A[R_1 + i, R_1 + i] = -1.0 / design.torque_rate_time_s
    A[DT_E, DT_E] = -1.0 / design.engine_torque_error_time_s
    A[GAIN, GAIN] = -1.0 / GAIN_TIME
    A[LAG_1, LAG_1] = A[LAG_2, LAG_2] = -1.0 / LAG_TIME
    A[LATE, LATE] = -1.0 / LATE_TIME
    if design.wheel_scale_error_share > 0.0:
        A[SCALE, SCALE] = -0.5 * (SCALE_WALK / design.wheel_scale_error_share) ** 2
    return A, T_o


def tyre_damping(vehicle: Vehicle, design: KalmanDesign) -> float:
    """Return D, N·m·s/rad: slip stiffness · load of the driven axle · r² / v, at a high speed v."""
    chassis = vehicle.chassis
    load = 0.5 * chassis.mass_kg * STANDARD_GRAVITY
    return design.tyre_slip_stiffness * load * chassis.wheel_radius_m**2 / _FASTEST_CAR


def arms(vehicle: Vehicle, gear: Gear, drives: bool) -> tuple[float, float]:
    """Return the lever arms of a transfer shaft's torque on its input shaft and on the output shaft."""
    if drives:
        return 1.0 / (gear.ratio * vehicle.gear_efficiency), gear.final_drive * vehicle.final_drive_efficiency
    return vehicle.gear_efficiency / gear.ratio, gear.final_drive / vehicle.final_drive_efficiency


def intensities(design: KalmanDesign) -> Floats:
    """Return the intensity ``[N, N]`` of the white noise that always acts."""
    q = np.zeros(N)
    q[[W_E, W_D, W_C1, W_C2]] = design.unmodelled_rad_s_per_sqrt_s**2
    gain, lag = lasting_errors(design)
    q[GAIN] = 2.0 * gain**2 / GAIN_TIME
    q[[LAG_1, LAG_2]] = 2.0 * lag**2 / LAG_TIME
    q[SCALE] = SCALE_WALK**2 if design.wheel_scale_error_share > 0.0 else 0.0
    q[LATE] = 2.0 * design.delay_error_s**2 / LATE_TIME
    return np.diag(q)


def lasting_errors(design: KalmanDesign) -> tuple[float, float]:
    """Return the standard deviations of `State.GAIN`, and of `State.LAG_1` and `State.LAG_2` each, s."""
    return math.sqrt(GAIN_SHARE) * design.engine_torque_error_share, design.engine_torque_lag_error_s / math.sqrt(
        2.0
    )


def synchroniser_ratio(vehicle: Vehicle, i: int, other: int) -> float:
    """Return the total ratio of the gear that shaft i (0, 1) probably takes: beside the other shaft's gear."""
    candidates = vehicle.gears_on(i + 1)
    nearest = min((abs(gear.number - other) for gear in candidates), default=0)
    ratios = [gear.total_ratio for gear in candidates if abs(gear.number - other) == nearest]
    return float(np.mean(ratios)) if ratios else 0.0


def discrete(A: Floats, B: Floats, intensity: Floats) -> list[Step]:
    """Return (F, responses to constant inputs, covariance of each noise) for each of `STEPS_US`.

    The integrals of Van Loan (1978) by their series at a step so short that |A| h is small, then one step after
    another (`both`).

    Args:
        A: ``[..., n, n]``, of one model or more.
        B: ``[n, m]``, of m inputs.
        intensity: of each white noise, ``[k, n, n]``.

    Returns:
        F ``[..., n, n]``, responses ``[..., n, m]`` and covariances ``[k, ..., n, n]`` of each step.
    """
    h = STEPS_US[-1] * 1e-6 / 2**_HALVINGS
    n = len(B)
    At = np.swapaxes(A, -1, -2)
    power = np.broadcast_to(np.eye(n), A.shape)  # (A h)^m / m!
    q = h * intensity.reshape(len(intensity), *(1,) * (A.ndim - 2), n, n)
    q = np.broadcast_to(q, (len(intensity), *A.shape))
    F, b, Q = np.zeros(A.shape), np.zeros((*A.shape[:-1], B.shape[1])), np.zeros(q.shape)
    for m in range(1, _TERMS + 1):
        F, b, Q = F + power, b + h / m * (power @ B), Q + q
        power = h / m * (power @ A)
        q = h / (m + 1) * (A @ q + q @ At)
    finest = F, b, Q
    for _ in range(_HALVINGS):
        finest = both(finest, finest)
    found = {STEPS_US[-1]: finest}
    for length in STEPS_US[-2::-1]:
        shorter = max(known for known in found if known < length)
        found[length] = both(found[shorter], found[length - shorter])
    return [found[length] for length in STEPS_US]


def both(first: Step, second: Step) -> Step:
    """Return the step that two make, one after the other: F₂ F₁, F₂ b₁ + b₂, F₂ Q₁ F₂ᵀ + Q₂."""
    F, b, Q = second
    Q = F @ first[2] @ np.swapaxes(F, -1, -2) + Q
    return F @ first[0], F @ first[1] + b, 0.5 * (Q + np.swapaxes(Q, -1, -2))


def tables(vehicle: Vehicle, design: KalmanDesign, table_size: int) -> Tables:
    """Return the discrete model of every pair of gears.

    Args:
        vehicle: parameters.
        design: noise and times.
        table_size: number of gear numbers + 1 that ``row`` must hold.

    Raises:
        DctorqueError: with these parameters the model moves so fast that its steps are no numbers.
    """
    pairs = list(product(*([0, *(gear.number for gear in vehicle.gears_on(i))] for i in (1, 2))))
    row = np.full((table_size, table_size), -1, np.int64)
    A, T_o = np.zeros((4 * len(pairs), N, N)), np.zeros(N)
    for first, (gear1, gear2) in zip(range(0, len(A), 4), pairs, strict=True):
        row[gear1 + 1, gear2 + 1] = first
        for k, drives in enumerate(product((False, True), repeat=2)):
            A[first + k], T_o = continuous(vehicle, design, gear1, gear2, (drives[0], drives[1]))
    B = np.zeros((N, 4))  # T_en, and losses of both input shafts and the output shaft
    B[W_E, 0] = 1.0 / vehicle.engine_inertia_kgm2
    B[[W_C1, W_C2], [1, 2]] = [-1.0 / vehicle.shaft_inertia_kgm2(shaft) for shaft in (1, 2)]
    B[W_O, 3] = -1.0 / max(vehicle.output_shaft.inertia_kgm2, _LEAST_INERTIA)
    intensity = np.zeros((6, N, N))
    intensity[0] = intensities(design)
    intensity[1, R_1, R_1] = intensity[2, R_2, R_2] = 2.0 / design.torque_rate_time_s
    intensity[3, T_X, T_X] = intensity[4, T_V, T_V] = 1.0
    intensity[5, DT_E, DT_E] = 2.0 / design.engine_torque_error_time_s
    steps = np.zeros((len(A), len(STEPS_US)), STEP)
    with np.errstate(over="ignore", invalid="ignore"):
        found = discrete(A, B, intensity)
    for number, pair in enumerate(pairs):
        if not all(np.isfinite(array[..., 4 * number : 4 * number + 4, :, :]).all() for array in chain(*found)):
            raise DctorqueError(
                f"vehicle: with gears {pair[0]} and {pair[1]} (0: neutral) its motions are too fast to be "
                "computed; is an inertia too small, or a ratio, stiffness or damping too large?"
            )
    for step, (F, b, Q) in enumerate(found):
        at = steps[:, step]
        at["phi"], at["input"] = F, b[..., 0]
        at["losses"] = b[:, CAR, 1:].transpose(0, 2, 1)
        at["columns"][..., :COUPLED] = F[:, :COUPLED].transpose(0, 2, 1)
        for n, k in enumerate(_OF_ENGINE):
            at["noise_engine"][:, n] = Q[k][:, ENGINE, :COUPLED].reshape(-1, len(ENGINE) * COUPLED)
        for n, k in enumerate(_OF_CAR):
            at["noise_car"][:, n] = Q[k][:, CAR, :COUPLED].reshape(-1, len(CAR) * COUPLED)
        for n, k in enumerate(_OF_REST):
            at["noise_rest"][:, n] = Q[k][:, COUPLED + n]
        at["noise_lasting"] = np.diagonal(Q[0], axis1=1, axis2=2)[:, GAIN:]
    return Tables(row, steps, T_o)


def process_covariance(step: np.void, factors: Sequence[float]) -> Floats:
    """Return Q ``[N, N]`` of a `STEP`, with the five ``factors`` of `noise.process_noise`."""
    q, Q = np.array([1.0, *factors]), np.zeros((N, N))
    Q[ENGINE, :COUPLED] = (q[list(_OF_ENGINE)] @ step["noise_engine"]).reshape(len(ENGINE), COUPLED)
    Q[CAR, :COUPLED] = (q[list(_OF_CAR)] @ step["noise_car"]).reshape(len(CAR), COUPLED)
    Q[COUPLED:GAIN] = q[list(_OF_REST), None] * step["noise_rest"]
    Q[:COUPLED, COUPLED:] = Q[COUPLED:, :COUPLED].T
    Q[range(GAIN, N), range(GAIN, N)] = step["noise_lasting"]
    return Q
