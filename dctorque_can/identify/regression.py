"""Linear regression with what is believed beforehand, on several kinds of equations at once.

What is left of an equation is noise, whose size the residuals tell; where it walks, as the load of the road does,
a scalar Kalman filter makes it white first (generalised least squares). Far residuals count less (Huber 1964).
Residuals of neighbouring moments hang together: standard deviations are those of the sandwich estimator with
blocks of some seconds (Liang and Zeger, Biometrika 73, 1986, 13), and never less than those of independent ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dctorque_can.identify.equations import Equations

Floats = NDArray[np.float64]
BLOCK_S = 4.0
_HUBER = 2.0  # standard deviations
_TO_SIGMA = 1.4826  # median absolute deviation of a normal distribution to its σ
_ROUNDS = 5
_BROKEN_S = 3.0  # after so long without an equation the load is not known any more
_WALKS = np.geomspace(0.05, 20.0, 9)  # σ of a second's walk over that of one equation's noise


@dataclass(frozen=True, slots=True)
class Belief:
    """What is known of a number: a normal distribution."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Posterior:
    """What is known after a regression.

    Attributes:
        names: of the numbers ``[k]``.
        values: ``[k]``.
        covariance: ``[k, k]``.
        noise: standard deviation of what is left, by the name of the equations.
        walk: σ of a second's walk over that noise, of equations that walk, by their name.
    """

    names: list[str]
    values: Floats
    covariance: Floats
    noise: dict[str, float]
    walk: dict[str, float]

    def of(self, name: str) -> Belief:
        """Return what is known of one number.

        Raises:
            ValueError: there is no such number.
        """
        k = self.names.index(name)
        return Belief(float(self.values[k]), float(np.sqrt(self.covariance[k, k])))

    def considering(self, name: str, sigma: float) -> Posterior:
        """Return what is known if one number, which was taken to be right, may be wrong.

        That no equation tells of it is not left to chance: it moves no value, but makes all that depend on it less
        sure (Schmidt's "consider" parameter).
        """
        if name not in self.names:
            return self
        k = self.names.index(name)
        moved = self.covariance[:, k] / self.covariance[k, k]
        more = (sigma**2 - self.covariance[k, k]) * np.outer(moved, moved)
        return replace(self, covariance=self.covariance + more)

    def given(self, name: str, value: float) -> dict[str, float]:
        """Return the most likely numbers if one of them had a value."""
        k = self.names.index(name)
        change = self.covariance[:, k] / self.covariance[k, k] * (value - self.values[k])
        return dict(zip(self.names, (self.values + change).tolist(), strict=True))

    def correlation(self, first: str, second: str) -> float:
        """Return the correlation of the errors of two numbers."""
        i, j = self.names.index(first), self.names.index(second)
        return float(self.covariance[i, j] / np.sqrt(self.covariance[i, i] * self.covariance[j, j]))


@dataclass(frozen=True, slots=True)
class _White:
    """Equations whose residuals are white: y and x ``[n]``, ``[n, k]``, and blocks ``[n]``."""

    name: str
    y: Floats
    x: Floats
    block: NDArray[np.int64]


def solve(equations: Sequence[Equations], beliefs: Mapping[str, Belief]) -> Posterior:
    """Return what equations say of the numbers that are believed in.

    Args:
        equations: with columns of these numbers.
        beliefs: what is known beforehand.
    """
    names = [name for name in beliefs if any(name in each.columns for each in equations)]
    some = [each for each in equations if len(each) > 2]
    first = _solved(some, names, beliefs, np.array([beliefs[name].value for name in names]))
    return _solved(some, names, beliefs, first.values)


def _solved(
    equations: Sequence[Equations], names: list[str], beliefs: Mapping[str, Belief], expected: Floats
) -> Posterior:
    """Return the solution, with the walks that are likeliest for the residuals at expected values."""
    middle = np.array([beliefs[name].value for name in names])
    certainty = np.array([1.0 / beliefs[name].sigma ** 2 for name in names])
    walk = {
        kind: _likeliest_walk([each for each in equations if each.name == kind], names, expected)
        for kind in dict.fromkeys(each.name for each in equations if each.walks)
    }
    white = [_whitened(each, names, walk) for each in equations]
    kinds = {each.name: [w for w in white if w.name == each.name] for each in white}
    values, information = expected.copy(), np.diag(certainty)
    together = dict.fromkeys(kinds, 1.0)
    for n in range(_ROUNDS):
        noise = {kind: _scale(some, values) for kind, some in kinds.items()}
        if n == _ROUNDS - 2:
            together = {kind: _together(some, values, noise[kind], certainty) for kind, some in kinds.items()}
        information, slope = np.diag(certainty), certainty * middle
        for kind, some in kinds.items():
            for each in some:
                weight = _weights(each, values, noise[kind]) / together[kind]
                information = information + (each.x * weight[:, None]).T @ each.x
                slope = slope + (each.x * weight[:, None]).T @ each.y
        values = np.linalg.solve(information, slope)
    noise = {kind: _scale(some, values) * together[kind] ** 0.5 for kind, some in kinds.items()}
    bread = np.linalg.inv(information)
    meat = np.diag(certainty)
    for kind, some in kinds.items():
        for each in some:
            meat = meat + _scatter(each, values, noise[kind] / together[kind] ** 0.5) / together[kind] ** 2
    sandwich = bread @ meat @ bread
    more = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(bread), 1.0))
    return Posterior(names, values, bread * np.outer(more, more), noise, walk)


def _scatter(white: _White, values: Floats, noise: float) -> Floats:
    """Return the covariance of the slope ``[k, k]`` as its blocks scatter."""
    weight = _weights(white, values, noise)
    scores = white.x * (weight * (white.y - white.x @ values))[:, None]
    sums = np.zeros((int(white.block.max(initial=0)) + 1, white.x.shape[1]))
    np.add.at(sums, white.block, scores)
    return np.asarray(sums.T @ sums)


def _together(white: Sequence[_White], values: Floats, noise: float, certainty: Floats) -> float:
    """Return how many equations of a kind tell only as much as one: their errors hang together.

    A likelihood that takes them for independent would outweigh what was believed (Ribatet, Cooley and Davison,
    Statistica Sinica 22, 2012, 813).
    """
    information = sum((each.x * _weights(each, values, noise)[:, None]).T @ each.x for each in white)
    scatter = sum(_scatter(each, values, noise) for each in white)
    inverse = np.linalg.inv(information + np.diag(certainty))
    return max(float(np.trace(inverse @ scatter) / max(np.trace(inverse @ information), 1e-9)), 1.0)


def log_likelihood(equations: Sequence[Equations], values: Mapping[str, float], fitted: Posterior) -> float:
    """Return the logarithm of the likelihood of equations that were not fitted, but for a constant.

    Args:
        equations: these.
        values: of all numbers in them.
        fitted: whose noise and walk hold.
    """
    names, found = list(values), 0.0
    middle = np.array([values[name] for name in names])
    for each in equations:
        if len(each) > 2 and each.name in fitted.noise:
            white = _whitened(each, names, fitted.walk)
            found -= float(np.sum(_cost((white.y - white.x @ middle) / fitted.noise[each.name])))
    return found


def _cost(r: Floats) -> Floats:
    """Return what residuals in standard deviations cost ``[n]``."""
    far = np.abs(r)
    return np.where(far < _HUBER, 0.5 * far**2, _HUBER * (far - 0.5 * _HUBER))


def _scale(white: Sequence[_White], values: Floats) -> float:
    rest = np.concatenate([each.y - each.x @ values for each in white])
    return max(_TO_SIGMA * float(np.median(np.abs(rest))), 0.3 * float(np.std(rest)), 1e-12)


def _weights(white: _White, values: Floats, noise: float) -> Floats:
    rest = np.abs(white.y - white.x @ values) / noise
    return np.minimum(1.0, _HUBER / np.maximum(rest, 1e-12)) / noise**2


def _whitened(equations: Equations, names: Sequence[str], walk: Mapping[str, float]) -> _White:
    x = np.stack([equations.columns.get(name, np.zeros(len(equations))) for name in names], axis=1)
    _, block = np.unique(np.floor(equations.t_s / BLOCK_S), return_inverse=True)
    if not equations.walks:
        return _White(equations.name, equations.y, x, block)
    white = _without_walk(np.column_stack([equations.y, x]), equations.t_s, walk[equations.name])
    known = white[:, -1] > 0.0
    return _White(equations.name, white[known, 0], white[known, 1:-1], block[known])


def _likeliest_walk(equations: Sequence[Equations], names: Sequence[str], expected: Floats) -> float:
    """Return the walk for which residuals at expected values are likeliest, whatever their size."""
    rests = [
        each.y
        - sum(
            each.columns[name] * value for name, value in zip(names, expected, strict=True) if name in each.columns
        )
        for each in equations
    ]

    def cost(walk: float) -> float:
        white = np.concatenate(
            [_without_walk(rest[:, None], each.t_s, walk) for rest, each in zip(rests, equations, strict=True)]
        )
        r, inverse = white[white[:, -1] > 0.0].T
        size = _TO_SIGMA * float(np.median(np.abs(r))) + 1e-15
        return float(np.sum(_cost(r / size) - np.log(inverse / size)))

    return float(min(_WALKS, key=cost))


def _without_walk(columns: Floats, t_s: Floats, walk: float) -> Floats:
    """Return columns ``[n, k + 1]`` with a random walk filtered out, as the innovations over their deviation.

    The last column is one over that deviation; nought where the walk was not known.

    Args:
        columns: ``[n, k]``.
        t_s: times ``[n]``, s.
        walk: σ of a second's walk over that of the noise.
    """
    found = np.zeros((len(columns), columns.shape[1] + 1))
    level, variance, last_s = np.zeros(columns.shape[1]), np.inf, -np.inf
    for n, (row, now_s) in enumerate(zip(columns, t_s.tolist(), strict=True)):
        if now_s - last_s > _BROKEN_S:
            variance = np.inf
        else:
            variance += walk**2 * (now_s - last_s)
        last_s = now_s
        if np.isinf(variance):
            level, variance = row.copy(), 1.0
            continue
        total = variance + 1.0
        innovation = row - level
        found[n, :-1], found[n, -1] = innovation / np.sqrt(total), 1.0 / np.sqrt(total)
        level += variance / total * innovation
        variance /= total
    return found
