"""Numbers with the uncertainty that their own scatter shows: robust medians and fits, by blocks of time."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
BLOCK_S = 2.0
"""Errors of neighbouring moments are alike for about so long: shifts, gusts, the driver's foot."""
FEWEST_BLOCKS = 3
TO_SIGMA = 1.4826
"""Times the median absolute deviation of a normal distribution is its σ."""
_HUBER = 1.5  # standard deviations from which on a residual counts linearly (Huber 1964)
_ROUNDS = 6


@dataclass(frozen=True, slots=True)
class Number:
    """A measured number.

    Attributes:
        value: in the unit of what was measured.
        sigma: its standard error, by the scatter between blocks of time.
        seconds: of evidence.
    """

    value: float
    sigma: float
    seconds: float

    def is_off(self, told: float, honest: float, sigmas: float = 3.0) -> bool:
        """Return whether it cannot be ``told``, which itself is known to ``honest`` (a standard deviation)."""
        return abs(self.value - told) > sigmas * sqrt(self.sigma**2 + honest**2)

    def shown(self, unit: str = "") -> str:
        """Return value ± sigma, to the digits that sigma leaves, with its unit."""
        sigma = max(self.sigma, 1e-3 * abs(self.value), 1e-12)
        digits = max(0, 1 - int(np.floor(np.log10(sigma))))
        digits -= 1 if digits and round(sigma * 10**digits) >= 20 else 0
        return f"{self.value:.{digits}f} ± {sigma:.{digits}f}{' ' + unit if unit else ''}"


def median(t_s: Floats, values: Floats, step_s: float) -> Number | None:
    """Return the median of values ``[n]`` and its standard error from the medians of blocks; None of too few.

    Args:
        t_s: times of the values ``[n]``, s.
        values: ``[n]``, finite.
        step_s: what each stands for.
    """
    if len(values) < 2:
        return None
    block = np.floor(t_s / BLOCK_S)
    edges = np.flatnonzero(np.diff(block)) + 1
    parts = [part for part in np.split(values, edges) if len(part) * step_s >= 0.1 * BLOCK_S]
    if len(parts) < FEWEST_BLOCKS:
        return None
    medians = np.array([np.median(part) for part in parts])
    middle = float(np.median(medians))
    scatter = TO_SIGMA * float(np.median(np.abs(medians - middle)))
    scatter = max(scatter, 0.1 * float(np.std(medians)))  # most blocks may be alike to the last bit
    # the median of n normal numbers scatters by √(π/2n)
    return Number(middle, scatter * sqrt(np.pi / 2 / len(parts)), len(values) * step_s)


@dataclass(frozen=True, slots=True)
class Fit:
    """y ≈ a · x by robust least squares.

    Attributes:
        values: the coefficients ``[k]``.
        sigmas: their standard errors ``[k]``, from the scatter between blocks of time.
        residual: standard deviation of what is left.
        seconds: of evidence.
    """

    values: Floats
    sigmas: Floats
    residual: float
    seconds: float

    def number(self, k: int) -> Number:
        """Return one coefficient."""
        return Number(float(self.values[k]), float(self.sigmas[k]), self.seconds)


def fit(t_s: Floats, columns: list[Floats], y: Floats, step_s: float, block_s: float = BLOCK_S) -> Fit | None:
    """Return the Huber regression of y ``[n]`` on columns ``[k][n]``; None where they cannot be told apart.

    Standard errors are those of the sandwich estimator with the blocks as clusters (Liang and Zeger 1986).
    """
    if len(y) < 10 * len(columns):
        return None
    x = np.stack(columns, axis=1)
    scale = np.sqrt(np.mean(x * x, axis=0))
    if not (scale > 0.0).all():
        return None
    x = x / scale
    weights = np.ones(len(y))
    found = np.zeros(len(columns))
    for _ in range(_ROUNDS):
        root = np.sqrt(weights)
        found, _, rank, _ = np.linalg.lstsq(x * root[:, None], y * root, rcond=1e-8)
        if rank < len(columns):
            return None
        rest = y - x @ found
        limit = _HUBER * (TO_SIGMA * float(np.median(np.abs(rest))) + 1e-12)
        weights = np.minimum(1.0, limit / np.maximum(np.abs(rest), 1e-300))
    inverse = np.linalg.inv((x * weights[:, None]).T @ x)
    _, block = np.unique(np.floor(t_s / block_s), return_inverse=True)
    blocks = int(block.max()) + 1
    if blocks < FEWEST_BLOCKS + len(columns):
        return None
    scores = np.zeros((blocks, len(columns)))
    np.add.at(scores, block, x * (weights * rest)[:, None])
    covariance = inverse @ (scores.T @ scores) @ inverse * blocks / (blocks - len(columns))
    sigmas = np.sqrt(np.diag(covariance))
    return Fit(found / scale, sigmas / scale, float(np.std(rest)), len(y) * step_s)


@dataclass(frozen=True, slots=True)
class Slope:
    """k of y ≈ k · x, where both have errors.

    Attributes:
        number: k; its sigma is infinite where the two regressions disagree even in its sign.
        least: k by the regression of y on x: errors of x make it too small.
        correlation: of what is left of both by the other columns.
    """

    number: Number
    least: Number
    correlation: float


def slope(
    t_s: Floats, x: Floats, y: Floats, others: list[Floats], step_s: float, block_s: float = BLOCK_S
) -> Slope | None:
    """Return the slope of y ``[n]`` over x ``[n]``, beside other columns; None where there is none to be told.

    The regression of y on x finds it too small, since x has errors; that of x on y finds it too large, since y has
    more in it than x. The truth is between both.
    """
    there = fit(t_s, [x, *others], y, step_s, block_s)
    back = fit(t_s, [y, *others], x, step_s, block_s)
    if there is None or back is None:
        return None
    least, inverse = there.number(0), float(back.values[0])
    if least.value * inverse <= 0.0:
        return Slope(Number(0.0, inf, least.seconds), least, 0.0)
    most = 1.0 / inverse
    middle = float(np.copysign(sqrt(least.value * most), least.value))
    spread = abs(most - least.value) / sqrt(12.0)  # evenly distributed between both
    number = Number(middle, sqrt(least.sigma**2 + spread**2), least.seconds)
    return Slope(number, least, float(np.copysign(min(sqrt(least.value * inverse), 1.0), least.value)))
