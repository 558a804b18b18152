"""The Kalman estimator of both clutch torques, with their uncertainty.

A frame first carries the state to its own time (`predict`), then what the gearbox is known to do enters
(`gearbox`), then each of its speeds as one scalar measurement (`measure`). Speeds in rad/s, torques in N·m.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import GEARS, Vehicle
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.kalman import arithmetic, losses, tape
from dctorque_can.estimators.kalman import model as kalman_model
from dctorque_can.estimators.kalman import tuning as kalman_tuning
from dctorque_can.estimators.kalman.design import KalmanDesign
from dctorque_can.estimators.kalman.engine import FIRST_NOISE, follow_torque
from dctorque_can.estimators.kalman.learning import forget_noise
from dctorque_can.estimators.kalman.model import (
    CAR,
    COUPLED,
    DT_E,
    ENGINE,
    GAIN,
    LAG_1,
    LAG_2,
    LATE,
    R_1,
    RATIO_1,
    SCALE,
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
from dctorque_can.estimators.kalman.noise import (
    admit_parameter_errors,
    decide_brake_rate,
    decide_rates,
    decide_spin_rate,
    engine_variance,
    process_noise,
)
from dctorque_can.estimators.kalman.seen import seen, value, variance
from dctorque_can.estimators.kalman.thresholds import PLAINLY
from dctorque_can.estimators.kalman.tuning import SPEEDS

FINEST_US = STEPS_US[-1]
_STEPS = np.array(STEPS_US, np.int64)
_OPEN = int(ClutchPhase.OPEN)
_SENSORS = 5  # engine, input shafts, driven and undriven wheels
_SIGNALS = 6  # the sensors and the nominal engine torque

FILTER = np.dtype(
    [
        ("x", "f8", (N,)),
        ("P", "f8", (N, N)),
        # `arithmetic`; a product stands behind what it is made of, so that none needs a test for overlap
        # s: what the lasting error of each open clutch's drag, of one standard deviation, did to the state;
        # the covariance of all errors is P + Σ s sᵀ
        ("lasting", "f8", (2, N)),
        ("lasts", "u1", (2,)),  # whether it was open since the start
        ("next", "f8", (N,)),  # x of the step that is being made
        ("Q_engine", "f8", (len(ENGINE) * COUPLED,)),
        ("Q_car", "f8", (len(CAR) * COUPLED,)),
        ("PF", "f8", (N, COUPLED)),
        ("FP", "f8", (COUPLED, N)),
        ("h", "f8", (N,)),
        ("K", "f8", (N,)),
        ("along", "f8", (N,)),
        ("h_2", "f8", (N,)),
        ("along_2", "f8", (N,)),
        ("rate", "f8", (N,)),  # of the state over the last step
        ("touch", "f8", (2,)),  # N·m, that clutches may carry before their kissing points
        ("torque_rate", "f8", (2,)),  # N·m/s, how fast a clutch torque may change now
        ("recent_torque", "f8"),  # N·m, what T_en, T_o, T_v and the engine's inertial torque were lately
        ("recent_output", "f8"),
        ("recent_load", "f8"),
        ("recent_inertial", "f8"),
        ("recent_twist", "f8", (4,)),  # rad, likewise TH_D … TH_O
        ("brake_rate", "f8"),  # N·m/√s, how fast brakes may change the load now
        ("spin_rate", "f8"),  # N·m/√s, how fast the tyres' torque may change since they slip
        ("spins", "u1"),
        ("brakes", "u1"),  # whether they act, and whether the car stands
        ("stands", "u1"),
        ("T_en", "f8"),  # nominal engine torque, behind the engine's lag
        ("told", "f8"),  # … as the last frame with one told it, and its time
        ("torque_us", "i8"),
        ("told_before", "f8"),  # … as the frame before that one did
        ("held", "f8"),  # … that jumped and waits for the next one to confirm it; NaN: none
        ("torque_noise", "f8"),  # … and its noise, as learned
        ("lagged", "f8", (2,)),  # T_en behind each of `engine.LAGS`
        ("per_error", "f8", (3,)),  # N·m in the last step, per unit of the states GAIN, LAG_1 and LAG_2
        ("t_us", "i8"),  # time of the state, at most half a finest step from the last frame
        ("gear", "i8", (2,)),
        ("ratio", "f8", (2,)),  # … and their total ratios, 0 in neutral
        ("ratio_known", "u1", (GEARS,)),  # by gear number + 1: what is known of ratios out of gear (`ratios`)
        ("ratio_mean", "f8", (GEARS,)),
        ("ratio_of_scale", "f8", (GEARS,)),
        ("ratio_variance", "f8", (GEARS,)),
        ("drives", "u1", (2,)),  # direction of the losses
        ("against", "u1", (2,)),  # the shaft turns against the engine: the car rolls against its gear
        ("idle", "u1", (2,)),  # of `contract.INPUTS`
        (
            "expected_us",
            "i8",
            (2,),
        ),  # when another gear was last told as the target of a shaft, that it may still go into
        ("heading", "i8"),  # ±1, the direction of the car that the speeds were measured in
        ("started", "u1"),  # once
        ("running", "u1"),
        ("reset_us", "i8"),  # when it was started
        ("fault", "u1", (_SIGNALS,)),  # `faults.SensorFault`
        ("fault_us", "i8", (_SIGNALS,)),  # since when
        ("rejected", "i8", (_SENSORS,)),  # measurements in a row that were not believed
        ("accepted", "f8", (_SENSORS,)),  # last measurement that was believed, and its time
        ("accepted_us", "i8", (_SENSORS,)),
        ("last", "f8", (SPEEDS,)),  # last measurement, wheels apart
        ("repeats", "i8", (SPEEDS,)),  # for how many measurements it has been the very same
        ("repeat_from", "f8", (SPEEDS,)),  # … and what was predicted for the first repetition
        ("repeat_share", "f8", (SPEEDS,)),  # how often it repeats itself otherwise
        ("spread", "f8", (2,)),  # rad/s, left less right wheel of the front and of the rear axle
        ("spread_known", "u1", (2,)),
        ("spread_us", "i8", (2,)),  # when it was last found as usual
        ("noise_ratio", "f8", (_SENSORS,)),  # `learning`: true variance of a sample over the configured one
        ("noise_samples", "f8", (_SENSORS,)),  # … and how many samples it was learned from
        ("all_noise", "f8", (_SENSORS,)),  # the same over all samples since the beginning, times …
        ("all_samples", "f8", (_SENSORS,)),  # … how many these are
        ("last_e", "f8", (_SENSORS, 2)),  # innovations of the last two that were not believed
        ("taken", "i8", (_SENSORS,)),  # measurements within the gate but zeros, through all restarts
        ("squares", "f8", (_SENSORS,)),  # … and the sum of their normalised innovations squared
        ("beyond", "i8", (_SENSORS,)),  # … and those that were not believed
        ("hint_us", "i8", (4,)),  # when each of `hints` was last given
        ("lagged_command", "f8", (2,)),  # N·m, as a clutch follows it
        ("last_command", "f8", (2,)),  # … as it was given
        ("T_c1", "f8"),
        ("T_c2", "f8"),
        ("sigma_1", "f8"),  # standard deviations of what is published
        ("sigma_2", "f8"),
        ("sigma_o", "f8"),
        ("correlation", "f8"),
        ("T_o", "f8"),
        ("w_c", "f8", (2,)),  # rad/s, shaft speeds as the bus tells them, carried on between their frames
        ("tape", tape.TAPE),  # for smoothing a log; must stay the last (`Estimator.snapshot`)
    ],
    align=True,
)
"""State, covariance, and room to work in."""


class Kalman(NamedTuple):
    """All that the filter needs, in one argument.

    Attributes:
        state: `FILTER` ``[1]``.
        tuning: `tuning.TUNING` ``[1]``.
        tables: the discrete model.
    """

    state: NDArray[np.void]
    tuning: NDArray[np.void]
    tables: Tables


def new(vehicle: Vehicle, design: KalmanDesign) -> Kalman:
    """Return a filter that has not been started."""
    return Kalman(
        np.zeros(1, FILTER), kalman_tuning.tuning(vehicle, design), kalman_model.tables(vehicle, design, GEARS)
    )


@compiled_without_allocation
def start(f: Any, tuning: Any, w_e: float, w_1: float, w_2: float, w_w: float, T_en: float) -> None:
    """Start at the measured speeds; the torques are unknown.

    A delay or a ratio that was found plainly wrong stays so: until it were found again it would be a torque.
    """
    tape.started(f.tape)
    late, late_variance = 0.0, tuning.delay_error**2
    if f.started and abs(f.x[LATE]) > PLAINLY * tuning.delay_error:
        late, late_variance = f.x[LATE], f.P[LATE, LATE]
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
    f.P[GAIN, GAIN] = tuning.gain_error**2
    f.P[LAG_1, LAG_1] = f.P[LAG_2, LAG_2] = tuning.lag_error**2
    f.x[LATE], f.P[LATE, LATE] = late, late_variance
    f.P[SCALE, SCALE] = tuning.scale_error**2
    for i in range(2):
        f.ratio[i] = tuning.ratio[i, f.gear[i] + 1]
        f.P[RATIO_1 + i, RATIO_1 + i] = tuning.ratio_error**2 if f.gear[i] != 0 else 0.0
    for g in range(GEARS):
        f.ratio_known[g] &= abs(f.ratio_mean[g]) > PLAINLY * tuning.ratio_error
    f.lagged[0] = f.lagged[1] = T_en
    for m in range(3):
        f.per_error[m] = 0.0
    f.torque_noise, f.held = FIRST_NOISE, math.nan
    f.T_en = f.told = f.told_before = f.recent_torque = T_en
    f.recent_output = f.recent_load = f.recent_inertial = f.T_o = 0.0
    f.brake_rate, f.brakes, f.stands = 0.0, False, False
    f.spin_rate, f.spins = 0.0, False
    for i in range(2):
        f.torque_rate[i] = tuning.rate[_OPEN]
    for i in range(4):
        f.recent_twist[i] = 0.0
    f.drives[0] = f.drives[1] = True
    f.against[0] = f.against[1] = False
    f.lasts[0] = f.lasts[1] = False
    for i in range(N):
        f.rate[i] = f.lasting[0, i] = f.lasting[1, i] = 0.0
    for i in range(_SENSORS):
        f.rejected[i] = 0
        f.accepted[i] = math.nan
    for i in range(SPEEDS):
        f.repeats[i] = 0
        f.last[i], f.repeat_share[i] = math.nan, 0.5
    f.lagged_command[0] = f.lagged_command[1] = math.nan
    f.spread_known[0] = f.spread_known[1] = False
    for i in range(_SIGNALS):
        f.fault[i] = 0
    forget_noise(f)
    f.started = f.running = True
    f.reset_us = f.torque_us = f.t_us


@compiled_without_allocation
def predict(
    f: Any, tables: Tables, tuning: Any, phase_1: int, phase_2: int, brakes: bool, stands: bool, t_us: int
) -> None:
    """Carry the state to ``t_us`` (to the nearest finest step)."""
    rest = t_us - f.t_us + FINEST_US // 2
    seconds = max(rest // FINEST_US, 0) * FINEST_US * 1e-6
    decide_rates(f, tuning, phase_1, phase_2, seconds)
    decide_brake_rate(f, tuning, brakes, stands, seconds)
    decide_spin_rate(f, tuning, seconds)
    admit_parameter_errors(f, tuning, seconds)
    if rest < FINEST_US:  # another frame at the same instant
        return
    q = process_noise(f, tuning, phase_1, phase_2)
    first = tables.row[f.gear[0] + 1, f.gear[1] + 1]
    for step in range(len(_STEPS)):
        if rest < FINEST_US:
            break
        while rest >= _STEPS[step]:
            rest -= _STEPS[step]
            f.t_us += _STEPS[step]
            model = first + (2 if f.drives[0] else 0) + (1 if f.drives[1] else 0)
            _advance(f, tables, tuning, model, step, q, follow_torque(f, tuning, _STEPS[step] * 1e-6))


@compiled_without_allocation
def _advance(
    f: Any, tables: Tables, tuning: Any, model: int, step: int, q: arithmetic.Noises, T_en: float
) -> None:
    """Carry state and covariance one step on, with q of `process_noise`."""
    arithmetic.carry_on(f, tables.steps[model, step], T_en, q)
    if not tuning.spins_freely:
        losses.take_spin_losses(f, tuning, tables.steps[model, step])
    per_s = 1e6 / _STEPS[step]
    for i in range(N):
        f.rate[i] = (f.next[i] - f.x[i]) * per_s
        f.x[i] = f.next[i]
    tape.predicted(f, model, step)


@compiled_without_allocation
def measure(f: Any, i: int, z: float, R: float) -> None:
    """Take one measurement z of x_i with variance R, as its sensor sees it (`seen`)."""
    a = seen(f, i)
    e = z - value(f, a)
    S = arithmetic.take_measurement(f, a, e, R)
    arithmetic.correct_lasting(f, a)
    tape.measured(f, a.i, a.w, a.v, S, e)


@compiled_without_allocation
def told(f: Any, i: int) -> float:
    """Return what a sensor of x_i should tell."""
    return value(f, seen(f, i))


@compiled_without_allocation
def told_variance(f: Any, i: int) -> float:
    """Return the variance of `told`."""
    return variance(f, seen(f, i))


@compiled_without_allocation
def measure_open(f: Any, c: int, drag: float, variance: float, lasting: float, rate_variance: float) -> None:
    """Take it that clutch c has its drag, and that its torque does not change; P is gone through once.

    Said in each frame, that is as if a sensor measured it, whose noise has this variance. That the drag is another
    one lasts, with a standard deviation ``lasting``: no frame makes it less. So gains ignore it, but the published
    deviations do not. It is a "consider" parameter by its sensitivity s (Tapley, Schutz, Born, Statistical Orbit
    Determination, 2004, chapter 6).
    """
    T, R = seen(f, T_C1 + c), seen(f, R_1 + c)
    e = drag - f.x[T.i]
    tape.measured(f, T.i, 0.0, 0.0, arithmetic.weigh(f, T, e, variance), e)
    arithmetic.correct_lasting(f, T)
    for k in range(N):
        f.lasting[c, k] += f.K[k] * lasting
    f.lasts[c] = True
    e = -f.x[R.i]
    tape.measured(f, R.i, 0.0, 0.0, arithmetic.weigh_second(f, T.i, R.i, e, rate_variance), e)
    arithmetic.correct_lasting(f, R)
    arithmetic.take_both(f, T.i, R.i)


@compiled_without_allocation
def forget(f: Any, i: int, value: float, variance: float) -> None:
    """Replace what is known of x_i by a value that has nothing to do with the rest."""
    tape.forgotten(f.tape, i)
    f.x[i] = value
    f.lasting[0, i] = f.lasting[1, i] = 0.0
    for k in range(N):
        f.P[i, k] = 0.0
        f.P[k, i] = 0.0
    f.P[i, i] = variance
