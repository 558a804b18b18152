"""Which few wrong scales explain all contradictions between speeds.

Each comparison of two speeds gives the logarithm of measured over expected: a sum of the errors of what it
compares. Few things are wrong at once. So causes are added one by one, each time that which explains most, for as
long as what it explains is certain; what is left then has no cause of its own (forward selection).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dctorque_can.evidence.fits import Number

CERTAIN = 16.0
"""Fall of χ² that a cause needs: four standard deviations, since there are some twenty causes to choose from."""
MOST_CAUSES = 5


@dataclass(frozen=True, slots=True)
class Comparison:
    """One speed against another one.

    Attributes:
        parts: what is compared, with its exponent: ``{"shaft1": 1, "gear 3": -1, "fl": -1}``.
        log: logarithm of measured over expected.
        honest: its standard deviation on a right file: rounded ratios, unequal tyres.
    """

    parts: Mapping[str, int]
    log: Number
    honest: float


@dataclass(frozen=True, slots=True)
class Cause:
    """Something whose scale may be wrong.

    Attributes:
        name: of the cause.
        parts: all that it scales, as in `Comparison.parts`, with the exponent.
        honest: standard deviation of its logarithm on a right file, if it has one in common.
    """

    name: str
    parts: Mapping[str, int]
    honest: float = 0.0


@dataclass(frozen=True, slots=True)
class Found:
    """A cause with the logarithm of its scale: measured speeds are exp(log) times what is told."""

    cause: Cause
    log: Number


def explain(comparisons: Sequence[Comparison], causes: Sequence[Cause]) -> list[Found]:
    """Return the causes that are certain, that which explains most first.

    Args:
        comparisons: of speeds.
        causes: of two that explain the same the first one counts.
    """
    if not comparisons:
        return []
    y = np.array([each.log.value for each in comparisons])
    columns = {cause.name: _column(cause, comparisons) for cause in causes}
    covariance = np.diag([each.log.sigma**2 + each.honest**2 for each in comparisons])
    for cause in causes:
        covariance += cause.honest**2 * np.outer(columns[cause.name], columns[cause.name])
    weight = np.linalg.inv(covariance)
    chosen: list[Cause] = []
    solution, spread, chi2 = np.zeros(0), np.zeros((0, 0)), float(y @ weight @ y)
    while len(chosen) < MOST_CAUSES:
        tried = []
        for cause in causes:
            if cause in chosen or not columns[cause.name].any():
                continue
            fitted = _fit([columns[each.name] for each in (*chosen, cause)], y, weight)
            if fitted is not None:
                tried.append((cause, fitted))
        if not tried:
            break
        least = min(fitted[2] for _, fitted in tried)
        cause, fitted = next(each for each in tried if each[1][2] <= least + 1e-6 * (1.0 + least))
        if chi2 - fitted[2] < CERTAIN:
            break
        chosen.append(cause)
        solution, spread, chi2 = fitted
    seconds = sum(each.log.seconds for each in comparisons)
    return [
        Found(cause, Number(float(solution[k]), float(np.sqrt(spread[k, k])), seconds))
        for k, cause in enumerate(chosen)
    ]


def _column(cause: Cause, comparisons: Sequence[Comparison]) -> NDArray[np.float64]:
    sums = [sum(cause.parts.get(part, 0) * n for part, n in each.parts.items()) for each in comparisons]
    return np.array(sums, np.float64)


def _fit(
    columns: Sequence[NDArray[np.float64]], y: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float] | None:
    """Return the weighted solution, its covariance and χ²; None where the columns say the same."""
    x = np.stack(columns, axis=1)
    normal = x.T @ weight @ x
    if np.linalg.matrix_rank(normal / np.sqrt(np.outer(np.diag(normal), np.diag(normal)))) < x.shape[1]:
        return None
    spread = np.asarray(np.linalg.inv(normal), np.float64)
    solution = spread @ (x.T @ weight @ y)
    rest = y - x @ solution
    return solution, spread, float(rest @ weight @ rest)
