"""Which factor moves a response how much: a first-order sensitivity that sees V-shapes.

Errors grow on both sides of the nominal car, so that a slope or a correlation would see nothing. The response is
fitted by the sum of a second-order polynomial of every factor, all at once,

    y ≈ c_0 + Σ_i (a_i φ_1(x_i) + b_i φ_2(x_i)),

with φ_1, φ_2 orthonormal over the sample. With independent factors (a_i² + b_i²)/Var(y) is the first-order Sobol'
index as far as a parabola can show it: exactly for a parabola, 94 % of a V over a uniform factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MIDDLE = (0.05, 0.95)
"""The range of a factor over which its effect is taken: between these quantiles of its draws."""
CONFIDENCE = (0.05, 0.95)
CHANCE = 0.05
"""How often one of all factors may count as significant although none is."""
_BOOTSTRAPS = 4000
_GRID = 41


@dataclass(frozen=True, slots=True)
class Effect:
    """How a response depends on one factor, the others averaged out. In the unit of the response.

    Attributes:
        change: greatest less least expected response while the factor goes through the middle 90 % of its draws.
        low: 5 % quantile of the bootstrap of ``change``.
        high: 95 % quantile.
        chance: what ``change`` pure chance would give; 5 % probability that any one of all factors exceeds it.
        curve: expected response at the 5, 50 and 95 % quantile of the factor, less its mean.
        share: of the variance of the response, 0..1.
    """

    change: float
    low: float
    high: float
    chance: float
    curve: tuple[float, float, float]
    share: float

    @property
    def significant(self) -> bool:
        """Whether chance can hardly explain it."""
        return self.change > self.chance

    @property
    def shape(self) -> str:
        """Where the response is great: ↑ at large values, ↓ at small ones, ∪ at both ends, ∩ in between."""
        low, middle, high = self.curve
        if middle >= max(low, high):
            return "∩"
        if middle < min(low, high) and abs(high - low) < 0.5 * self.change:
            return "∪"
        return "↑" if high > low else "↓"


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Effects of all factors.

    Attributes:
        explained: share of the variance that the sum of all effects explains, 0..1, adjusted for the number of
            coefficients; the rest is interactions of factors, higher orders, and noise.
        effects: in the order of the factors.
    """

    explained: float
    effects: tuple[Effect, ...]


def fewest_runs(factors: int) -> int:
    """Return how many runs a ranking of so many factors needs: two per coefficient."""
    return 2 * (2 * factors + 1)


def sensitivity(values: Floats, response: Floats, seed: int) -> Sensitivity:
    """Fit the response and return the effect of every factor.

    Confidence and chance come from a wild bootstrap: residuals, freed from the leverage of their runs, with random
    signs.

    Args:
        values: of the factors ``[run, factor]``, independently drawn; at least `fewest_runs` runs.
        response: ``[run]``.
        seed: of the bootstrap.
    """
    n, d = values.shape
    bases = [_Basis.of(values[:, i]) for i in range(d)]
    design = np.hstack([np.ones((n, 1)), *(basis.at(values[:, i]) for i, basis in enumerate(bases))])
    solve = np.linalg.pinv(design)
    fit = solve @ response
    residual = response - design @ fit
    leverage = np.einsum("ij,ji->i", design, solve)
    freed = residual / np.maximum(1.0 - leverage, 1e-3)
    signs = np.random.default_rng(seed).choice((-1.0, 1.0), (_BOOTSTRAPS, n))
    drift = (signs * freed) @ solve.T  # [bootstrap, coefficient]
    variance = float(np.var(response))
    effects = []
    for i, basis in enumerate(bases):
        at = slice(1 + 2 * i, 3 + 2 * i)
        grid = basis.at(np.quantile(values[:, i], np.linspace(*MIDDLE, _GRID)))
        curve = grid @ fit[at]
        again = np.ptp(grid @ (fit[at] + drift[:, at]).T, axis=0)
        change = float(np.ptp(curve))
        low, high = np.quantile(again, CONFIDENCE)
        own = float(np.sum(fit[at] ** 2) - np.sum(np.var(drift[:, at], axis=0)))
        effects.append(
            Effect(
                change=change,
                low=min(float(low), change),
                high=max(float(high), change),
                chance=float(np.quantile(np.ptp(grid @ drift[:, at].T, axis=0), 1.0 - CHANCE / d)),
                curve=(float(curve[0]), float(curve[_GRID // 2]), float(curve[-1])),
                share=max(0.0, own / variance) if variance > 0.0 else 0.0,
            )
        )
    left = float(residual @ residual) / (n - 1 - 2 * d)
    explained = 1.0 - left / (variance * n / (n - 1)) if variance > 0.0 else 0.0
    return Sensitivity(max(0.0, explained), tuple(effects))


@dataclass(frozen=True, slots=True)
class _Basis:
    """First and second order polynomial of one factor, orthonormal over its sample."""

    mean: float
    std: float
    square: Floats  # coefficients of 1, z, z² in φ_2

    @classmethod
    def of(cls, x: Floats) -> _Basis:
        mean, std = float(x.mean()), float(x.std())
        z = (x - mean) / std
        skew = float(np.mean(z**3))
        raw = z**2 - skew * z - 1.0
        return cls(mean, std, np.array([-1.0, -skew, 1.0]) / float(raw.std()))

    def at(self, x: Floats) -> Floats:
        z = (x - self.mean) / self.std
        return np.column_stack([z, np.stack([np.ones_like(z), z, z**2], axis=1) @ self.square])
