"""What a speed sensor sees of the state: beside the speed two errors that last, of its scale and of its time."""

from __future__ import annotations

from typing import Any, NamedTuple

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators.kalman.model import LATE, SCALED_BY, W_B, W_C1, W_C2, W_W


class Seen(NamedTuple):
    """What a measurement sees of the state, beside it two errors that last: aᵀx = x_i + w x_b + v d, d of `LATE`.

    Attributes:
        i: state.
        b: state of the share by which it is told too large; i itself with w = 0 if there is none.
        w: what a unit of that adds.
        v: what a unit of d adds.
    """

    i: int
    b: int
    w: float
    v: float


@compiled_without_allocation
def seen(f: Any, i: int) -> Seen:
    """Return what a sensor of x_i sees: a share too much, and a moment that is not now.

    Wheels are d/2 late and shafts d/2 early: how late they are together is not told. How fast a shaft gains speed
    is taken from the whole car, through the gear that is in (in neutral it may do anything): the model's own rates
    ring with its errors, which would be taken for a delay. While tyres spin they are not known.
    """
    w, v = 0.0, 0.0
    if SCALED_BY[i] != i:
        w = f.x[i]
    if not f.spins:
        if W_C1 <= i <= W_C2:
            v = 0.5 * f.ratio[i - W_C1] * f.rate[W_B]
        elif W_W <= i <= W_B:
            v = -0.5 * f.rate[W_B]
    return Seen(i, SCALED_BY[i], w, v)


@compiled_without_allocation
def value(f: Any, a: Seen) -> float:
    """Return aᵀ x."""
    return float(f.x[a.i] + a.w * f.x[a.b] + a.v * f.x[LATE])


@compiled_without_allocation
def variance(f: Any, a: Seen) -> float:
    """Return aᵀ P a."""
    P = f.P
    scaled = P[a.i, a.i] + a.w * (2.0 * P[a.i, a.b] + a.w * P[a.b, a.b])
    return float(scaled + a.v * (2.0 * (P[a.i, LATE] + a.w * P[a.b, LATE]) + a.v * P[LATE, LATE]))
