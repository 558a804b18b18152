"""What the filter did to its state, written down for the smoother that goes back over it (`smoother`).

Only with the switch ``on`` anything is written; the filter of a car never turns it on, and the memory of the tape
is then never touched. Noise that was only added to the covariance needs no word: going back it changes nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators.kalman.model import T_C1, TH_O, TH_T1, TH_T2, W_B, W_C1, W_D, W_E, N, Tables

OPERATIONS = 4096
ROWS = 512
ERRORS = 9  # that last (`lasting`)
PREDICT, MEASURE, FORGET, START = range(4)

TAPE = np.dtype(
    [
        ("on", "?"),
        ("full", "?"),  # something found no place: what is written is of no use
        ("operations", "i8"),
        ("rows", "i8"),
        ("what", "i8", (OPERATIONS,)),  # PREDICT, …
        ("which", "i8", (OPERATIONS, 2)),  # model and step of a prediction; state that was measured or forgotten
        ("per_error", "f8", (OPERATIONS, 3)),  # of `filter.FILTER`, in a prediction
        ("rate", "f8", (OPERATIONS, 5)),  # of `RATES`, in it: by these errors that last act
        ("times", "i8", (OPERATIONS,)),  # that the same prediction was made in a row
        ("w", "f8", (OPERATIONS,)),  # weight of the error that scales what was measured (`model.SCALED_BY`)
        ("v", "f8", (OPERATIONS,)),  # … and of the delay
        ("S", "f8", (OPERATIONS,)),  # variance of the innovation
        ("e", "f8", (OPERATIONS,)),  # innovation
        ("K", "f8", (OPERATIONS, N)),  # gain
        ("turns", "f8", (OPERATIONS,)),  # rate of what was measured, by which its age acts
        ("adds", "f8", (OPERATIONS, ERRORS)),  # what each adds to the innovation (`lasting`)
        ("after", "i8", (ROWS,)),  # operations before an estimate was published
        ("torque", "f8", (ROWS, 3)),  # N·m: clutches and output shaft, as the filter has them
        ("sigma", "f8", (ROWS, 3)),
        ("correlation", "f8", (ROWS,)),
        ("MP", "f8", (ROWS, 3, N)),  # M P, where M gives the torques from the state
        ("lasting", "f8", (ROWS, 3, ERRORS)),  # what each lasting error did to the estimate (`lasting`)
        ("neutral", "u1", (ROWS, 2)),  # the clutch has its drag alone, with a standard deviation that was set
    ],
    align=True,
)
"""Operations and estimates in order."""

RATES = np.array([W_E, W_B, TH_T1, TH_T2, TH_O], np.uint8)


def rewind(tape: NDArray[np.void], on: bool) -> None:
    """Forget what is written on `TAPE` ``[1]``, and write from here on or not."""
    tape["on"], tape["full"] = on, False
    tape["operations"] = tape["rows"] = 0


@compiled_without_allocation
def _next(tape: Any, what: int) -> int:
    """Return the place of a new operation, −1 if it needs none or there is none left."""
    if not tape.on:
        return -1
    n = tape.operations
    if n >= OPERATIONS:
        tape.full = True
        return -1
    tape.what[n] = what
    tape.operations = n + 1
    return int(n)


@compiled_without_allocation
def predicted(f: Any, model: int, step: int) -> None:
    """Write that the state has gone one step on."""
    tape = f.tape
    last = tape.operations - 1
    if tape.on and last >= 0 and (tape.rows == 0 or tape.after[tape.rows - 1] <= last):
        same = tape.what[last] == PREDICT and tape.which[last, 0] == model and tape.which[last, 1] == step
        for m in range(3):
            same = same and tape.per_error[last, m] == f.per_error[m]
        if same:
            tape.times[last] += 1
            return
    n = _next(tape, PREDICT)
    if n >= 0:
        tape.which[n, 0], tape.which[n, 1], tape.times[n] = model, step, 1
        for m in range(3):
            tape.per_error[n, m] = f.per_error[m]
        for k in range(len(RATES)):
            tape.rate[n, k] = f.rate[RATES[k]]


@compiled_without_allocation
def measured(f: Any, i: int, w: float, v: float, S: float, e: float) -> None:
    """Write that x_i was measured, w and v of `seen.Seen`, with the gain f.K."""
    n = _next(f.tape, MEASURE)
    if n >= 0:
        f.tape.which[n, 0], f.tape.w[n], f.tape.v[n], f.tape.S[n], f.tape.e[n] = i, w, v, S, e
        f.tape.turns[n] = f.rate[i]
        for k in range(N):
            f.tape.K[n, k] = f.K[k]


@compiled_without_allocation
def forgotten(tape: Any, i: int) -> None:
    """Write that x_i was replaced by a value that depends on nothing before."""
    n = _next(tape, FORGET)
    if n >= 0:
        tape.which[n, 0] = i


@compiled_without_allocation
def started(tape: Any) -> None:
    """Write that the whole state was replaced."""
    _next(tape, START)


@compiled_without_allocation
def published(f: Any, tables: Tables, tuning: Any) -> None:
    """Write an estimate and how it depends on the state."""
    t, r = f.tape, f.tape.rows
    if not t.on:
        return
    if r >= ROWS:
        t.full = True
        return
    t.rows = r + 1
    t.after[r] = t.operations
    t.torque[r, 0], t.torque[r, 1], t.torque[r, 2] = f.T_c1, f.T_c2, f.T_o
    t.sigma[r, 0], t.sigma[r, 1], t.sigma[r, 2] = f.sigma_1, f.sigma_2, f.sigma_o
    t.correlation[r] = f.correlation
    for i in range(2):
        t.neutral[r, i] = f.gear[i] == 0
        for k in range(N):
            t.MP[r, i, k] = f.P[T_C1 + i, k]
            if t.neutral[r, i]:
                t.MP[r, i, k] = tuning.drag[i] * (f.P[W_D, k] - f.P[W_C1 + i, k])
    for k in range(N):
        total = 0.0
        for j in range(N):
            total += tables.output[j] * f.P[j, k]
        t.MP[r, 2, k] = total
