"""Where a clutch begins to carry torque, and how steeply: a power law through the lower nodes of its map.

    C = a (x − x_t)^p

A cushion spring that is pressed flat is between a linear one (p = 1) and one that stiffens as it goes (p = 2).
Torques near zero are seldom seen, so that x_t is extrapolated; its σ says by how much. Fitted by Gauss-Newton with
the covariance of the nodes; what is believed of x_t and p beforehand counts as two more measurements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

EXPONENT, EXPONENT_SIGMA = 1.5, 0.35
PRIOR_FACTOR = 2.0  # σ of x_t before, over the error that the vehicle file gives
SLOPE_SHARE = 0.2  # of the capacity, at which the slope is told
_HIGHEST_SHARE = 0.5  # of the capacity, up to which nodes count
_MODEL_SHARE = 0.004  # of the capacity: what the power law is wrong by
_STEPS, _DONE = 12, 1e-3


class Touch(NamedTuple):
    """The lower end of a map, in the unit of the actuation times the closing sign.

    Attributes:
        point: where the torque begins; NaN where too little has been seen.
        point_sigma: its standard deviation.
        slope: N·m per unit where the clutch carries `SLOPE_SHARE` of its capacity.
        slope_sigma: its standard deviation.
    """

    point: float
    point_sigma: float
    slope: float
    slope_sigma: float


UNKNOWN = Touch(np.nan, np.nan, np.nan, np.nan)


def touch_of(
    grid: Floats,
    torque: Floats,
    covariance: Floats,
    seen: NDArray[np.bool_],
    prior: tuple[float, float],
    scale: float,
) -> Touch:
    """Return the lower end of a map.

    Args:
        grid: actuation of the nodes ``[n]``.
        torque: capacity ``[n]``, N·m.
        covariance: of the capacity ``[n, n]``.
        seen: which nodes have seen anything ``[n]``.
        prior: x_t beforehand, and by how much it may be wrong.
        scale: capacity of the clutch, N·m.
    """
    point, error = prior[0], PRIOR_FACTOR * prior[1]
    rows = np.flatnonzero(seen & (torque < _HIGHEST_SHARE * scale))
    if len(rows) < 3 or torque[rows].max() < 0.1 * scale:
        return UNKNOWN
    x, y = grid[rows], torque[rows]
    noise = covariance[np.ix_(rows, rows)] + (_MODEL_SHARE * scale) ** 2 * np.eye(len(rows))
    information = np.linalg.inv(noise)
    weights = np.diag([1.0 / error**2, 1.0 / EXPONENT_SIGMA**2, 0.0])
    before = np.array([point, EXPONENT, 0.0])
    width = max(x[-1] - point, error)
    state = np.array([point, EXPONENT, np.log(max(y[-1], 1.0) / width**EXPONENT)])
    normal = np.eye(3)
    for _ in range(_STEPS):
        value, jacobian = _power_law(x, state)
        normal = jacobian.T @ information @ jacobian + weights
        step = np.linalg.solve(normal, jacobian.T @ information @ (y - value) + weights @ (before - state))
        step[0] = min(max(step[0], -0.5 * error), 0.5 * error)
        step[1] = min(max(step[1], -0.3), 0.3)
        state = state + step
        state[1] = min(max(state[1], 1.0), 2.5)
        if abs(step[0]) < _DONE * error and abs(step[1]) < _DONE:
            break
    inverse = np.linalg.inv(normal)
    carried = SLOPE_SHARE * scale
    # where it carries that: x − x_t = (C/a)^(1/p), and dC/dx = p C/(x − x_t)
    p, log_a = state[1], state[2]
    log_way = (np.log(carried) - log_a) / p
    slope = p * carried * np.exp(-log_way)
    gradient = slope * np.array([0.0, 1.0 / p + log_way / p, 1.0 / p])
    return Touch(
        float(state[0]),
        float(np.sqrt(inverse[0, 0])),
        float(slope),
        float(np.sqrt(max(gradient @ inverse @ gradient, 0.0))),
    )


def _power_law(x: Floats, state: Floats) -> tuple[Floats, Floats]:
    """Return C ``[n]`` and its derivatives ``[n, 3]`` by x_t, p and ln a."""
    point, p, log_a = state
    way = np.maximum(x - point, 1e-9)
    value = np.where(x > point, np.exp(log_a + p * np.log(way)), 0.0)
    return value, np.column_stack([-p * value / way, value * np.log(way), value])
