"""Speeds without sign of a shaft that winds up, or rings, while the car stands or nearly does.

What is told is |w + n|, of which w is expected as x ± √P and the noise n has the variance R. With S = P + R and z
told, the value with its sign was z with the odds exp(2 x z/S), and −z else. What is known then is a sum of two
normal distributions. One with their mean and variance stands for both: it is what a measurement of

    x + (z tanh(x z/S) − x) W/S        with the variance W − P,    W = S²/(S − D),    D = (z/cosh(x z/S))²

would leave. D is the variance of the sign; where it is beyond S nothing is learned.
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators.kalman import faults, gearbox
from dctorque_can.estimators.kalman.filter import measure
from dctorque_can.estimators.kalman.learning import noise_factor
from dctorque_can.estimators.kalman.model import T_C1, W_C1, W_D
from dctorque_can.estimators.kalman.tuning import SLIDING

_CERTAIN = 20.0  # half the logarithm of the odds of a sign, from which on the other one is impossible
_WITH_CLUTCH = 1.0  # … that a clutch which slides turns its shaft the way it pulls, and does not let it ring back
_NO_DOUBT = 0.01  # share of S that the variance of a sign may be, for the speed to be one like any other
_PULLED, _PULLED_NM = 3.0, 2.0  # σ, and N·m on top, by which no clutch pulls against its friction


@compiled_without_allocation
def measure_magnitude(
    inputs: Any, f: Any, tuning: Any, quantity: int, sensor: int, state: int, fastest: float
) -> None:
    """Take a new speed without sign of a shaft in gear.

    One that may as well be zero says nothing: slow teeth are not seen. That a clutch which slides pulls its shaft
    along counts as far as the speed is not known anyway; noise about a known one has either sign. A torque against
    the friction of such a clutch shows that the signs were wrong.

    Args:
        inputs: `contract.INPUTS`.
        f: `filter.FILTER`.
        tuning: `tuning.TUNING`.
        quantity: of ``inputs``, input shaft 1 or 2.
        sensor: the same shaft's.
        state: the same shaft's.
        fastest: acceleration that the shaft can have, rad/s².
    """
    if not inputs.fresh[quantity]:
        return
    z, x, i = abs(inputs.value[quantity]), f.x[state], state - W_C1
    noise = tuning.speed_variance[sensor] * noise_factor(f, tuning, sensor)
    variance = noise + (tuning.timing_error * f.rate[state]) ** 2
    P, slip = f.P[state, state], f.x[W_D] - x
    S = P + variance
    clearness = x * z / S
    if inputs.closed[i] and abs(slip) > SLIDING:
        pull = math.copysign(1.0, slip)
        if pull * f.x[T_C1 + i] < -_PULLED * math.sqrt(max(f.P[T_C1 + i, T_C1 + i], 0.0)) - _PULLED_NM:
            gearbox.begin_shaft_anew(f, tuning, i, pull * z, variance)
            return
        clearness += pull * _WITH_CLUTCH * P / S
    if max(abs(x), z) * z <= S:
        return
    doubt = (z / math.cosh(min(abs(clearness), _CERTAIN))) ** 2
    if doubt < _NO_DOUBT * S:
        faults.measure_gated(f, tuning, sensor, state, math.copysign(z, clearness), noise, fastest)
    elif doubt < S:
        wide = S * S / (S - doubt)
        measure(f, state, x + (z * math.tanh(clearness) - x) * wide / S, wide - P)
