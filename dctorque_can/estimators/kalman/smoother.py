"""A fixed-interval smoother: what a whole log says of each moment, by the very model of the filter.

The filter goes forward and leaves a tape (`tape`) of its operations; `go_back` follows it from the end with the
adjoint state λ and its information Λ. An estimate x with covariance P becomes x − P λ with P − P Λ P. This is the
smoother of Bryson and Frazier in Bierman's form, which inverts no covariance and takes measurements one by one:

    measurement of aᵀx, gain K:  C = 1 − K aᵀ      Λ ← Cᵀ Λ C + a aᵀ/S        λ ← Cᵀ λ − a e/S
    prediction by F:             Λ ← Fᵀ Λ F        λ ← Fᵀ λ
    x_i replaced:                row and column i of Λ, and λ_i, become zero

Errors that last (`lasting`) are in what comes later too. By each of them λ is another one, as if a were the
innovation; so it is known how far the correction P λ is to be trusted (`weigh`).

A. E. Bryson and M. Frazier, "Smoothing for linear and nonlinear dynamic systems", Proc. Optimum System Synthesis
Conference, Wright-Patterson AFB, ASD-TDR-63-119 (1963), 353-364. G. J. Bierman, "Fixed interval smoothing with
discrete measurements", International Journal of Control 18 (1973), 65-75.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators.kalman.model import GAIN, LAG_2, LATE, SCALED_BY, N, Tables
from dctorque_can.estimators.kalman.tape import ERRORS, FORGET, MEASURE, PREDICT

_LEAST_WEIGHT = 0.001  # of a correction: a smoothed estimate can be told from one that is as online

ADJOINT = np.dtype(
    [
        ("lam", "f8", (N,)),  # λ
        ("Lam", "f8", (N, N)),  # Λ
        ("scratch", "f8", (N, N)),
        ("v", "f8", (N,)),
        ("lasting", "f8", (N, ERRORS)),  # λ of what each lasting error adds to the innovations
        ("next", "f8", (N, ERRORS)),
        ("shift", "f8", (3, ERRORS)),  # by which each lasting error moves an estimate that is smoothed
    ],
    align=True,
)
"""What everything later says; zero at the end of a log."""

SMOOTHED = np.dtype([("torque", "f8", (3,)), ("sigma", "f8", (3,)), ("correlation", "f8")], align=True)
"""Both clutch torques and the output torque, N·m (NaN: cannot be said); standard deviations; correlation of the
clutches' errors."""


@compiled_without_allocation
def go_back(filters: NDArray[np.void], tables: Tables, adjoints: NDArray[np.void], out: NDArray[np.void]) -> None:
    """Smooth every estimate on the tape, the last one first.

    Args:
        filters: `filter.FILTER` ``[1]``, with the tape.
        tables: the filter's.
        adjoints: `ADJOINT` ``[1]`` at the end of the tape; afterwards that at its beginning.
        out: `SMOOTHED` ``[n]``, one for each estimate on the tape.
    """
    tape, a = filters[0].tape, adjoints[0]
    row = tape.rows - 1
    for n in range(tape.operations, -1, -1):
        while row >= 0 and tape.after[row] == n:
            smooth(tape, a, row, out[row])
            row -= 1
        if n > 0:
            undo(tape, a, tables, n - 1)


@compiled_without_allocation
def undo(tape: Any, a: Any, tables: Tables, n: int) -> None:
    """Carry the adjoint state back over operation n."""
    if tape.what[n] == MEASURE:
        undo_measurement(tape, a, n)
    elif tape.what[n] == PREDICT:
        for _ in range(tape.times[n]):
            undo_prediction(tape, a, tables, n)
    elif tape.what[n] == FORGET:
        i = tape.which[n, 0]
        a.lam[i] = 0.0
        for k in range(N):
            a.Lam[i, k] = a.Lam[k, i] = 0.0
        for p in range(ERRORS):
            a.lasting[i, p] = 0.0
    else:
        clear(a)


@compiled_without_allocation
def clear(a: Any) -> None:
    """Let nothing be known from later."""
    for i in range(N):
        a.lam[i] = 0.0
        for k in range(N):
            a.Lam[i, k] = 0.0
        for p in range(ERRORS):
            a.lasting[i, p] = 0.0


@compiled_without_allocation
def undo_measurement(tape: Any, a: Any, n: int) -> None:
    """Λ ← Cᵀ Λ C + a aᵀ/S, λ ← Cᵀ λ − a e/S, with a of `seen.Seen`: few rows and columns of Λ change."""
    i, S = tape.which[n, 0], tape.S[n]
    places, weights = (i, SCALED_BY[i], LATE), (1.0, tape.w[n], tape.v[n])
    along, twice = tape.e[n] / S, 1.0 / S
    for k in range(N):
        along += tape.K[n, k] * a.lam[k]
        total = 0.0
        for m in range(N):
            total += a.Lam[k, m] * tape.K[n, m]
        a.v[k] = total  # Λ K
        twice += tape.K[n, k] * total
    for p in range(3):
        i, w = places[p], weights[p]
        if w == 0.0:
            continue
        a.lam[i] -= w * along
        for k in range(N):
            a.Lam[i, k] -= w * a.v[k]
            a.Lam[k, i] -= w * a.v[k]
        for q in range(3):
            a.Lam[i, places[q]] += w * weights[q] * twice
    for error in range(ERRORS):
        along = tape.adds[n, error] / S
        for k in range(N):
            along += tape.K[n, k] * a.lasting[k, error]
        for p in range(3):
            a.lasting[places[p], error] -= weights[p] * along


@compiled_without_allocation
def undo_prediction(tape: Any, a: Any, tables: Tables, n: int) -> None:
    """Λ ← Fᵀ Λ F, λ ← Fᵀ λ; to F belong the columns of the errors of the engine torque (`filter.FILTER`)."""
    step = tables.steps[tape.which[n, 0], tape.which[n, 1]]
    phi = step.phi
    for i in range(N):
        a.v[i] = 0.0
        for j in range(N):
            a.scratch[i, j] = 0.0
    for k in range(N):
        for i in range(N):
            a.v[i] += phi[k, i] * a.lam[k]
            factor = phi[i, k]  # F is sparse
            if factor != 0.0:
                for j in range(N):
                    a.scratch[k, j] += a.Lam[i, j] * factor  # Fᵀ Λ
    for m in range(3):
        for i in range(N):
            factor = step.input[i] * tape.per_error[n, m]
            a.v[GAIN + m] += factor * a.lam[i]
            for j in range(N):
                a.scratch[GAIN + m, j] += a.Lam[i, j] * factor
    for i in range(N):
        a.lam[i] = a.v[i]
    undo_prediction_of_errors(tape, a, step, n)
    for i in range(N):
        for j in range(N):
            a.v[j] = 0.0
        for k in range(N):
            for j in range(N):
                a.v[j] += a.scratch[i, k] * phi[k, j]
            for m in range(3):
                a.v[GAIN + m] += a.scratch[i, k] * step.input[k] * tape.per_error[n, m]
        for j in range(i + 1):
            a.Lam[i, j] = a.Lam[j, i] = a.v[j]


@compiled_without_allocation
def undo_prediction_of_errors(tape: Any, a: Any, step: Any, n: int) -> None:
    """λ ← Fᵀ λ for each lasting error."""
    for k in range(N):
        for p in range(ERRORS):
            a.next[k, p] = 0.0
        for i in range(N):
            factor = step.phi[i, k]
            if GAIN <= k <= LAG_2:
                factor += step.input[i] * tape.per_error[n, k - GAIN]
            if factor != 0.0:
                for p in range(ERRORS):
                    a.next[k, p] += factor * a.lasting[i, p]
    for k in range(N):
        for p in range(ERRORS):
            a.lasting[k, p] = a.next[k, p]


@compiled_without_allocation
def smooth(tape: Any, a: Any, row: int, out: Any) -> None:
    """Write the smoothed estimate; if it is no number, nothing more is known from later."""
    finite = True
    weights, variances = (0.0, 0.0), (0.0, 0.0)
    for i in range(3):
        shift, gain = 0.0, 0.0
        for k in range(N):
            total = 0.0
            for m in range(N):
                total += a.Lam[k, m] * tape.MP[row, i, m]
            shift += tape.MP[row, i, k] * a.lam[k]
            gain += tape.MP[row, i, k] * total
        weight, change = weigh(tape, a, row, i, gain)
        variance = tape.sigma[row, i] ** 2
        out.torque[i] = tape.torque[row, i] - weight * shift
        out.sigma[i] = math.sqrt(max(variance + min(change, 0.0), 0.0))
        finite = finite and math.isfinite(shift) and math.isfinite(gain)
        if i == 0:
            weights, variances = (weight, 0.0), (variance + change, 0.0)
        elif i == 1:
            weights, variances = (weights[0], weight), (variances[0], variance + change)
    out.correlation = correlate(tape, a, row, weights, variances)
    for i in range(2):
        if tape.neutral[row, i]:
            out.sigma[i], out.correlation = tape.sigma[row, i], 0.0
    if not finite:
        out.torque[0] = math.nan
        clear(a)


@compiled_without_allocation
def weigh(tape: Any, a: Any, row: int, i: int, gain: float) -> tuple[float, float]:
    """Return how much of the correction of torque i is worth taking, and how its variance changes by it.

    By the model alone the correction takes ``gain`` from the variance. Errors that last are in it, too: of one
    standard deviation each moves the estimate by s, and the correction moves it by d. The weight w makes

        (1 − w)² gain + Σ (s − w d)²

    the least. Also returned is by how much the variance then differs from the filter's, which has no lasting error
    but the drags'.
    """
    gain = max(gain, 0.0)
    worth, all_of_it, lasting = gain, gain, 0.0
    for p in range(ERRORS):
        d, s = 0.0, tape.lasting[row, i, p]
        for k in range(N):
            d += tape.MP[row, i, k] * a.lasting[k, p]
        a.shift[i, p] = d
        worth += s * d
        all_of_it += d * d
        lasting += s * s
    weight = min(max(worth / all_of_it, _LEAST_WEIGHT), 1.0) if all_of_it > 0.0 else 1.0
    return weight, lasting - 2.0 * weight * worth + weight * weight * all_of_it


@compiled_without_allocation
def correlate(tape: Any, a: Any, row: int, weights: tuple[float, float], variances: tuple[float, float]) -> float:
    """Return the correlation of both clutches' errors."""
    shared, lasting = 0.0, 0.0
    for k in range(N):
        for m in range(N):
            shared += tape.MP[row, 0, k] * a.Lam[k, m] * tape.MP[row, 1, m]
    for p in range(ERRORS):
        s_1, s_2 = tape.lasting[row, 0, p], tape.lasting[row, 1, p]
        lasting += (s_1 - weights[0] * a.shift[0, p]) * (s_2 - weights[1] * a.shift[1, p])
    if shared == 0.0:  # nothing that comes later tells of both: the very number stays
        return float(tape.correlation[row])
    joint = tape.correlation[row] * tape.sigma[row, 0] * tape.sigma[row, 1] + lasting
    joint -= (1.0 - (1.0 - weights[0]) * (1.0 - weights[1])) * shared
    product = math.sqrt(max(variances[0], 0.0) * max(variances[1], 0.0))
    return min(max(joint / product, -1.0), 1.0) if product > 0.0 else 0.0
