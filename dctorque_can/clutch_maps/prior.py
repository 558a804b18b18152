"""What is believed of a clutch's characteristic before it is seen: a smooth curve that begins near zero.

The capacity C over the share u of the span is a Gaussian process: a straight line of unknown slope and an
integrated Wiener process, whose mean conditional on points of it is the cubic spline (Rasmussen and Williams,
Gaussian Processes for Machine Learning, 2006, section 6.3.1):

    cov(C(u), C(v)) = S² [σ_0² + σ_1² u v + q (½ |u − v| m² + ⅓ m³)],   m = min(u, v)

S is the clutch's capacity by the vehicle file. The numbers allow twice that at the end of the span, and a slope
that changes by itself over the span.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

OFFSET = 0.03  # σ_0 of the torque at the beginning of the span, short of the touch point
_SLOPE = 2.0  # σ_1
_ROUGHNESS = 3.0  # q
_NUGGET = 1e-4  # of S: what a grid of straight pieces cannot follow


def covariance(u: Floats, v: Floats) -> Floats:
    """Return the covariance over S² of C at ``u`` ``[n]`` and ``v`` ``[m]``, ``[n, m]``."""
    a, b = u[:, None], v[None, :]
    least = np.minimum(a, b)
    bends = _ROUGHNESS * (0.5 * np.abs(a - b) * least**2 + least**3 / 3.0)
    return np.asarray(OFFSET**2 + _SLOPE**2 * a * b + bends + _NUGGET**2 * (a == b))


def twice_the_span(nodes: int) -> tuple[Floats, Floats]:
    """Return what a grid of ``nodes`` becomes when its span doubles: ``[n, n]`` A and covariance over S².

    The new nodes are A times the old ones, and what the prior leaves open given those.
    """
    new = np.linspace(0.0, 1.0, nodes)
    old = 0.5 * new
    between = covariance(new, old)
    a = np.asarray(np.linalg.solve(covariance(old, old), between.T).T, np.float64)
    left_open = covariance(new, new) - a @ between.T
    return a, 0.5 * (left_open + left_open.T)
