"""What the filter has learned of the ratio of each gear, kept until the gear is in again.

The state has room for the gear that is in on each shaft. What was learned of a ratio says nothing of another
gear's, but it holds when the same gear is in again. Wheels and ratios are told apart in part only: so what is kept
is how the error of the ratio follows that of the wheels' scale, and what is known of it beside that.
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import GEARS
from dctorque_can.estimators.kalman.filter import forget
from dctorque_can.estimators.kalman.model import RATIO_1, SCALE, N


@compiled_without_allocation
def remember(f: Any, i: int) -> None:
    """Keep what is known of the ratio of the gear that is in on shaft i, before it is left.

    Given the scale s of the wheels its error is mean + of_scale s, with that variance.
    """
    if f.gear[i] == 0:
        return
    own, g = RATIO_1 + i, f.gear[i] + 1
    of_scale = f.P[own, SCALE] / f.P[SCALE, SCALE] if f.P[SCALE, SCALE] > 0.0 else 0.0
    variance = f.P[own, own] - of_scale * f.P[own, SCALE]
    mean = f.x[own] - of_scale * f.x[SCALE]
    if math.isfinite(mean) and math.isfinite(of_scale) and math.isfinite(variance):
        f.ratio_mean[g], f.ratio_of_scale[g], f.ratio_variance[g] = mean, of_scale, max(variance, 0.0)
        f.ratio_known[g] = True


@compiled_without_allocation
def recall(f: Any, tuning: Any, i: int) -> None:
    """Let the error of the ratio on shaft i be what is known of it for the gear that is in now."""
    own, g = RATIO_1 + i, f.gear[i] + 1
    if f.gear[i] == 0:
        forget(f, own, 0.0, 0.0)
        return
    of_scale, variance = f.ratio_of_scale[g], f.ratio_variance[g]
    mean = f.ratio_mean[g] + of_scale * f.x[SCALE]
    if not (f.ratio_known[g] and math.isfinite(mean) and 0.0 <= variance < math.inf):
        forget(f, own, 0.0, tuning.ratio_error**2)
        return
    variance += tuning.ratio_again**2
    forget(f, own, mean, 0.0)
    for k in range(N):
        if k != own:
            f.P[own, k] = f.P[k, own] = of_scale * f.P[SCALE, k]
    f.P[own, own] = of_scale * of_scale * f.P[SCALE, SCALE] + variance
    for c in range(2):
        f.lasting[c, own] = of_scale * f.lasting[c, SCALE]


@compiled_without_allocation
def reference(f: Any) -> int:
    """Return the place of the gear whose ratio has the median of all errors that are known; −1: of none is any."""
    known = 0
    for g in range(GEARS):
        known += f.ratio_known[g]
    for g in range(GEARS):
        if not f.ratio_known[g]:
            continue
        before = 0
        for other in range(GEARS):
            if f.ratio_known[other]:
                smaller, own = error_of(f, other), error_of(f, g)
                before += smaller < own or (smaller == own and other < g)
        if before == (known - 1) // 2:
            return g
    return -1


@compiled_without_allocation
def error_of(f: Any, g: int) -> float:
    """Return the share by which the ratio at a place of the tables is larger."""
    return float(f.ratio_mean[g] + f.ratio_of_scale[g] * f.x[SCALE])


@compiled_without_allocation
def report(f: Any, row: Any) -> None:
    """Fill what has been learned of wheels and ratios in a health row.

    What all of them have in common no speed tells. So they are told against one ratio, that of the median.
    """
    for i in range(2):
        remember(f, i)
    ref = reference(f)
    scale, variance = f.x[SCALE], f.P[SCALE, SCALE]
    if ref < 0:
        row.wheel_scale_error, row.wheel_scale_sigma = scale, math.sqrt(max(variance, 0.0))
        return
    apart = 1.0 - f.ratio_of_scale[ref]
    row.wheel_scale_error = scale - error_of(f, ref)
    row.wheel_scale_sigma = math.sqrt(max(apart * apart * variance, 0.0) + f.ratio_variance[ref])
    for g in range(GEARS):
        if f.ratio_known[g]:
            apart, own = f.ratio_of_scale[g] - f.ratio_of_scale[ref], f.ratio_variance[g]
            if g != ref:
                own += f.ratio_variance[ref]
            row.gear_ratio_error[g] = error_of(f, g) - error_of(f, ref)
            row.gear_ratio_sigma[g] = math.sqrt(max(apart * apart * variance, 0.0) + own)
