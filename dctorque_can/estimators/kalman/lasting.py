"""Errors that last, and what they do to the estimates: forwards over the filter's tape, beside the state.

The filter takes an error that it is told of for white noise. Noise averages out over a recording. What lasts does
not: the age of a speed's samples, a mass, an inertia or a stiffness that is another one, an offset of the engine
torque. None of them is estimated. Each is a "consider" parameter by its sensitivity s (Tapley, Schutz, Born,
Statistical Orbit Determination, 2004, chapter 6): what one standard deviation of it makes of the error of the
state, estimate minus truth.

    prediction by F              s ← F s − g             g: what the error does to the car in this step
    measurement of x_i, gain K   s ← s + K a             a = h − s_i is what it adds to the innovation
    x_i replaced                 s_i = 0

h is what it adds to the measured value. The smoother needs s of every estimate and a of every measurement.
Speeds in rad/s, torques in N·m.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators.kalman.design import KalmanDesign
from dctorque_can.estimators.kalman.model import (
    GAIN,
    LAG_2,
    LATE,
    SCALED_BY,
    STEPS_US,
    T_C1,
    T_V,
    TH_O,
    TH_T1,
    TH_T2,
    W_B,
    W_C1,
    W_C2,
    W_D,
    W_E,
    W_W,
    N,
    Tables,
)
from dctorque_can.estimators.kalman.tape import ERRORS, FORGET, MEASURE, PREDICT

(
    AGE_ENGINE,  # of the samples of the engine's speed, of the shafts', the driven and the undriven wheels'
    AGE_SHAFTS,
    AGE_DRIVEN,
    AGE_UNDRIVEN,
    MASS,
    ENGINE_INERTIA,
    TRANSFER_STIFFNESS,
    OUTPUT_STIFFNESS,
    ENGINE_TORQUE,  # offset
) = range(ERRORS)
_AGES = 20.0  # timing errors of a vehicle file, which are those of noise: how late all are together nobody learns
_STIFFNESS = 2.0  # shares that a stiffness may be another: mounts and tyres wind up, too
_OF_STATE = np.full(N, -1, np.int8)  # whose age a measurement of each state has
_OF_STATE[[W_E, W_C1, W_C2, W_W, W_B]] = AGE_ENGINE, AGE_SHAFTS, AGE_SHAFTS, AGE_DRIVEN, AGE_UNDRIVEN
_SECONDS = np.array(STEPS_US) * 1e-6

SENSITIVITY = np.dtype([("s", "f8", (N, ERRORS)), ("next", "f8", (N, ERRORS))], align=True)
"""s of each error in its column; zero at the start of a recording."""


def deviations(design: KalmanDesign) -> NDArray[np.float64]:
    """Return the standard deviation of each error ``[ERRORS]``: s, shares, N·m."""
    sigma = np.zeros(ERRORS)
    sigma[AGE_ENGINE : AGE_UNDRIVEN + 1] = _AGES * design.timing_error_s
    sigma[MASS : OUTPUT_STIFFNESS + 1] = design.parameter_error_share
    sigma[TRANSFER_STIFFNESS : OUTPUT_STIFFNESS + 1] *= _STIFFNESS
    sigma[ENGINE_TORQUE] = design.engine_torque_error_nm
    return sigma


@compiled_without_allocation
def go_forth(
    filters: NDArray[np.void], tables: Tables, tunings: NDArray[np.void], sensitivities: NDArray[np.void]
) -> None:
    """Carry the sensitivities along the tape; write to it what the smoother needs.

    Args:
        filters: `filter.FILTER` ``[1]``, with the tape.
        tables: the filter's.
        tunings: `tuning.TUNING` ``[1]``.
        sensitivities: `SENSITIVITY` ``[1]`` at the beginning of the tape; afterwards that at its end.
    """
    tape, tuning, along = filters[0].tape, tunings[0], sensitivities[0]
    row = 0
    for n in range(tape.operations + 1):
        while row < tape.rows and tape.after[row] == n:
            write(tape, along, tables, tuning, row)
            row += 1
        if n == tape.operations:
            break
        if tape.what[n] == MEASURE:
            measure(tape, along, tuning, n)
        elif tape.what[n] == PREDICT:
            for _ in range(tape.times[n]):
                predict(tape, along, tables, tuning, n)
        elif tape.what[n] == FORGET:
            for p in range(ERRORS):
                along.s[tape.which[n, 0], p] = 0.0
        else:
            for i in range(N):
                for p in range(ERRORS):
                    along.s[i, p] = 0.0


@compiled_without_allocation
def measure(tape: Any, along: Any, tuning: Any, n: int) -> None:
    """s ← s + K a, and a onto the tape."""
    i, w, v = tape.which[n, 0], tape.w[n], tape.v[n]
    age, b = _OF_STATE[i], SCALED_BY[i]
    for p in range(ERRORS):
        tape.adds[n, p] = -along.s[i, p] - w * along.s[b, p] - v * along.s[LATE, p]
    if age >= 0:
        tape.adds[n, age] -= tape.turns[n] * tuning.lasting[age]
    for k in range(N):
        for p in range(ERRORS):
            along.s[k, p] += tape.K[n, k] * tape.adds[n, p]


@compiled_without_allocation
def predict(tape: Any, along: Any, tables: Tables, tuning: Any, n: int) -> None:
    """s ← F s − g; to F belong the columns of the errors of the engine torque (`filter.FILTER`)."""
    step = tables.steps[tape.which[n, 0], tape.which[n, 1]]
    s, new, sigma = along.s, along.next, tuning.lasting
    for i in range(N):
        for p in range(ERRORS):
            new[i, p] = 0.0
        for k in range(N):
            factor = step.phi[i, k]  # F is sparse
            if GAIN <= k <= LAG_2:
                factor += step.input[i] * tape.per_error[n, k - GAIN]
            if factor != 0.0:
                for p in range(ERRORS):
                    new[i, p] += factor * s[k, p]
    seconds = _SECONDS[tape.which[n, 1]]
    torque = sigma[ENGINE_INERTIA] * tuning.J_e * tape.rate[n, 0]  # what turns the inertia that is not known of
    load = sigma[MASS] * tuning.J_b * tape.rate[n, 1]
    for i in range(N):
        new[i, ENGINE_TORQUE] -= step.input[i] * sigma[ENGINE_TORQUE]
        new[i, ENGINE_INERTIA] += step.input[i] * torque
        if i != T_V:
            new[i, MASS] -= step.phi[i, T_V] * load
    new[TH_T1, TRANSFER_STIFFNESS] -= sigma[TRANSFER_STIFFNESS] * tape.rate[n, 2] * seconds
    new[TH_T2, TRANSFER_STIFFNESS] -= sigma[TRANSFER_STIFFNESS] * tape.rate[n, 3] * seconds
    new[TH_O, OUTPUT_STIFFNESS] -= sigma[OUTPUT_STIFFNESS] * tape.rate[n, 4] * seconds
    for i in range(N):
        for p in range(ERRORS):
            s[i, p] = new[i, p]


@compiled_without_allocation
def write(tape: Any, along: Any, tables: Tables, tuning: Any, row: int) -> None:
    """Write to the tape what each error did to an estimate."""
    for p in range(ERRORS):
        for i in range(2):
            effect = along.s[T_C1 + i, p]
            if tape.neutral[row, i]:
                effect = tuning.drag[i] * (along.s[W_D, p] - along.s[W_C1 + i, p])
            tape.lasting[row, i, p] = effect
        total = 0.0
        for k in range(N):
            total += tables.output[k] * along.s[k, p]
        tape.lasting[row, 2, p] = total
