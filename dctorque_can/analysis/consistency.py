"""Whether stated uncertainties are true: coverage of bands, log score, NEES and NIS and what their limits are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from dctorque_can.pipeline.estimates import SENSORS

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LEVELS = (0.5, 0.9, 0.95)
"""Shares of a normal distribution whose central bands are held against the errors."""
_CLUTCHES = 2
_CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Bands:
    """How the errors of one torque lie to its standard deviations.

    Attributes:
        samples: rows that state a standard deviation.
        coverage: share of them within the central band of each of `LEVELS`.
        log_score: mean negative log of the stated normal density at the truth, density in 1/(N·m); less is better.
    """

    samples: int
    coverage: tuple[float, ...]
    log_score: float


@dataclass(frozen=True, slots=True)
class Nees:
    """Normalised estimation error squared of both clutch torques, eᵀP⁻¹e, of which 2 is the expectation.

    The errors of neighbouring samples are much alike, so the mean is as uncertain as that of a smaller number of
    independent samples. The limits are those of that number.

    Attributes:
        samples: rows that state a covariance.
        mean: over these.
        independent_samples: to how many independent ones they amount.
        low: lower limit of the mean of an honest estimator, which lies within both with 95 % probability.
        high: upper limit.
        log_score: mean negative log of the stated joint normal density, density in 1/(N·m)²; less is better.
    """

    samples: int
    mean: float
    independent_samples: float
    low: float
    high: float
    log_score: float


@dataclass(frozen=True, slots=True)
class Nis:
    """Normalised innovations squared of one speed, e²/S, of which 1 is the expectation.

    The innovations of a right filter are white, so every sample is an independent one.

    Attributes:
        samples: speeds that the filter took.
        rejected: those beyond its gate; they are not in the mean.
        mean: over the samples.
    """

    samples: int
    rejected: int
    mean: float

    @property
    def limits(self) -> tuple[float, float]:
        """Limits of the mean of an honest filter, which lies between them with 95 % probability."""
        return mean_limits(float(self.samples), freedom=1)


def bands(error: Floats, sigma: Floats) -> Bands | None:
    """Judge the standard deviations of one torque; rows without one (NaN, or σ ≤ 0) do not count.

    Args:
        error: estimate minus truth ``[n]``, N·m.
        sigma: stated standard deviation ``[n]``, N·m.

    Returns:
        None when no row states one.
    """
    stated = sigma > 0
    if not stated.any():
        return None
    spread = sigma[stated]
    deviation = np.abs(error[stated]) / spread
    coverage = tuple(float(np.mean(deviation <= NormalDist().inv_cdf((1 + p) / 2))) for p in LEVELS)
    score = np.mean(0.5 * deviation**2 + np.log(spread) + 0.5 * np.log(2 * np.pi))
    return Bands(len(spread), coverage, float(score))


def nees(parts: Sequence[tuple[Floats, Floats, Floats, Flags]]) -> Nees | None:
    """Judge the stated covariance of both clutch torques.

    Args:
        parts: of each drive, in order of time: errors ``[n, 2]``, standard deviations ``[n, 2]`` (N·m),
            correlation ``[n]``, and which rows to take ``[n]``.

    Returns:
        None when no row states a covariance. Rows without one (NaN) or without its inverse do not count.
    """
    series = []
    log_determinants = []
    for error, sigma, correlation, wanted in parts:
        rows = wanted & (sigma > 0).all(axis=1) & (np.abs(correlation) < 1)
        values = np.zeros(len(rows))
        if rows.any():
            a, b = (error[rows] / sigma[rows]).T
            rest = 1 - correlation[rows] ** 2
            values[rows] = (a**2 - 2 * correlation[rows] * a * b + b**2) / rest
            log_determinants.append(2 * np.log(sigma[rows]).sum(axis=1) + np.log(rest))
        series.append((values, rows))
    if not log_determinants:
        return None
    taken = np.concatenate([values[rows] for values, rows in series])
    independent = independent_samples(series)
    low, high = mean_limits(independent, _CLUTCHES)
    score = np.mean(0.5 * taken + 0.5 * np.concatenate(log_determinants) + np.log(2 * np.pi))
    return Nees(len(taken), float(taken.mean()), independent, low, high, float(score))


def mean_limits(independent: float, freedom: int) -> tuple[float, float]:
    """Return what the mean of that many independent normalised squares lies between with 95 % probability.

    Their sum is chi-square distributed with ``freedom`` degrees of freedom per sample.
    """
    from scipy.special import gammaincinv  # takes longer to import than a log to replay

    tails = ((1 - _CONFIDENCE) / 2, (1 + _CONFIDENCE) / 2)
    low, high = (float(2 * gammaincinv(freedom * independent / 2, tail)) / independent for tail in tails)
    return low, high


def nis(healths: NDArray[np.void]) -> dict[str, Nis]:
    """Judge the innovations of a Kalman filter.

    Args:
        healths: `HEALTH` ``[n]``, the last of each drive; they are cumulative.

    Returns:
        By name of the sensor (`SENSORS`), those that gave anything; nothing for the 2014 observer.
    """
    samples, rejected = healths["innovations"].sum(axis=0), healths["innovations_rejected"].sum(axis=0)
    squares = healths["innovation_squares"].sum(axis=0)
    return {
        name: Nis(int(n), int(r), float(total / n))
        for name, n, r, total in zip(SENSORS, samples, rejected, squares, strict=True)
        if n
    }


def independent_samples(series: Sequence[tuple[Floats, Flags]]) -> float:
    """Return to how many independent samples the mean of correlated ones amounts: n / (1 + 2 Σ ρ_k).

    ρ_k is the autocorrelation k rows apart within a drive, of pairs of which both rows count; the sum ends where
    it first is not positive. What is slower than a drive does not show in it: then the true number is smaller.

    Args:
        series: of each drive the values ``[n]`` and which rows count ``[n]``.

    Returns:
        A number from 1 to the count of rows; the latter for constant values.
    """
    values = np.concatenate([x[rows] for x, rows in series])
    n = len(values)
    variance = float(values.var()) if n else 0.0
    if variance == 0.0:
        return float(n)
    longest = max(len(rows) for _, rows in series)
    products, pairs = np.zeros(longest), np.zeros(longest)
    for x, rows in series:
        products[: len(rows)] += _sums_of_products(np.where(rows, x - values.mean(), 0.0))
        pairs[: len(rows)] += np.rint(_sums_of_products(rows.astype(np.float64)))
    correlation = products / np.maximum(pairs, 1.0) / variance
    ends = np.flatnonzero((correlation <= 0) | (pairs < 1))
    positive = correlation[1 : ends[0]] if len(ends) else correlation[1:]
    return float(np.clip(n / (1 + 2 * positive.sum()), 1.0, n))


def _sums_of_products(x: Floats) -> Floats:
    """Return Σ_i x_i x_(i+k) for k = 0 … n-1 ``[n]``."""
    size = 1 << (2 * len(x)).bit_length()  # room for every lag, so that the end does not meet the beginning
    power = np.abs(np.fft.rfft(x, size)) ** 2
    return np.asarray(np.fft.irfft(power, size)[: len(x)], np.float64)
