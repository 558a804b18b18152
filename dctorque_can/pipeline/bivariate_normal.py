"""Probability of a quadrant under a bivariate normal distribution.

The method of Drezner and Wesolowsky, "On the computation of the bivariate normal integral", J. Statist. Comput.
Simul. 35 (1990) 101-107, in the form of Genz, "Numerical computation of rectangular bivariate and trivariate
normal and t probabilities", Statistics and Computing 14 (2004) 151-160: Plackett's integral over the correlation
by Gauss-Legendre quadrature, and for correlations near ±1 the difference to those.
"""

from __future__ import annotations

import math

import numpy as np

from dctorque_can.compiled import compiled_without_allocation

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(20)
_NEAR_ONE = 0.925  # |r| from which the integrand is too steep for the first form
_FAR = 9.0  # standard deviations; the tail beyond is less than 1e-18
_NEGLIGIBLE = -100.0  # exponent


@compiled_without_allocation
def normal_cdf(x: float) -> float:
    """Return P(X < x) of a standard normal X."""
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


@compiled_without_allocation
def upper_quadrant(h: float, k: float, r: float) -> float:
    """Return P(X > h, Y > k) of two standard normals with correlation r, to about 1e-14.

    Args:
        h: lower bound of X.
        k: lower bound of Y.
        r: correlation, −1 … 1.
    """
    if max(h, k) > _FAR:
        return 0.0
    h, k = max(h, -_FAR), max(k, -_FAR)
    p = _moderate(h, k, r) if abs(r) < _NEAR_ONE else _near_one(h, k, r)
    return min(max(p, 0.0), 1.0)


@compiled_without_allocation
def _moderate(h: float, k: float, r: float) -> float:
    """Add to Φ(−h) Φ(−k) the integral of the density at (h, k) over the correlation, sin θ from 0 to r."""
    half_angle = 0.5 * math.asin(r)
    total = 0.0
    for i in range(len(_NODES)):
        s = math.sin(half_angle * (1.0 + _NODES[i]))
        total += _WEIGHTS[i] * math.exp((s * h * k - 0.5 * (h * h + k * k)) / (1.0 - s * s))
    return total * half_angle / (2.0 * math.pi) + normal_cdf(-h) * normal_cdf(-k)


@compiled_without_allocation
def _near_one(h: float, k: float, r: float) -> float:
    """Take from the probability at r = ±1 what is missing; the steep part of the integrand is exact."""
    if r < 0.0:
        k = -k
    hk = h * k
    missing = 0.0
    if abs(r) < 1.0:
        a2 = (1.0 - r) * (1.0 + r)
        a, b = math.sqrt(a2), abs(h - k)
        b2 = b * b
        c, d = (4.0 - hk) / 8.0, (12.0 - hk) / 80.0
        exponent = -0.5 * (b2 / a2 + hk)
        if exponent > _NEGLIGIBLE:
            missing = a * math.exp(exponent) * (1.0 - c * (b2 - a2) * (1.0 - d * b2) / 3.0 + c * d * a2 * a2)
        if hk > _NEGLIGIBLE:
            tail = math.sqrt(2.0 * math.pi) * normal_cdf(-b / a)
            missing -= math.exp(-0.5 * hk) * tail * b * (1.0 - c * b2 * (1.0 - d * b2) / 3.0)
        for i in range(len(_NODES)):
            x = 0.5 * a * (1.0 + _NODES[i])
            x2 = x * x
            exponent = -0.5 * (b2 / x2 + hk)
            if exponent > _NEGLIGIBLE:
                root = math.sqrt(1.0 - x2)
                smooth = 1.0 + c * x2 * (1.0 + 5.0 * d * x2)
                exact = math.exp(-0.5 * hk * x2 / (1.0 + root) ** 2) / root
                missing += 0.5 * a * _WEIGHTS[i] * math.exp(exponent) * (exact - smooth)
        missing /= 2.0 * math.pi
    if r > 0.0:
        return normal_cdf(-max(h, k)) - missing
    if h >= k:
        return missing
    between = normal_cdf(k) - normal_cdf(h) if h < 0.0 else normal_cdf(-h) - normal_cdf(-k)
    return between + missing
