"""Linear regression with what is believed beforehand, on several kinds of equations at once.

What is left of an equation is noise, whose size the residuals tell; where it walks, as the load of the road does,
a scalar Kalman filter makes it white first (generalised least squares). Far residuals count less (Huber 1964).
Residuals of neighbouring moments hang together: standard deviations are those of the sandwich estimator with
blocks of some time, `Equations.block_s` (Liang and Zeger, Biometrika 73, 1986, 13), and never less than those of
independent ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dctorque_can.identify.equations import Equations

Floats = NDArray[np.float64]
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
    """Equations whose residuals are white.

    Attributes:
        name: of their kind.
        y: ``[n]``.
        x: columns ``[n, m]`` of those numbers that are in them.
        where: places of these among all numbers ``[m]``.
        block: ``[n]``, rising.
    """

    name: str
    y: Floats
    x: Floats
    where: NDArray[np.intp]
    block: NDArray[np.int64]

    def rest(self, values: Floats) -> Floats:
        """Return what is left of each equation ``[n]``."""
        return self.y - self.x @ values[self.where]

    def weights(self, values: Floats, noise: float) -> Floats:
        """Return how much each equation counts ``[n]``: far residuals less."""
        far = np.abs(self.rest(values)) / noise
        return np.minimum(1.0, _HUBER / np.maximum(far, 1e-12)) / noise**2

    def add_normal(self, weight: Floats, information: Floats, slope: Floats) -> None:
        """Add the normal equations to ``information`` ``[k, k]`` and ``slope`` ``[k]``."""
        weighted = (self.x * weight[:, None]).T
        information[np.ix_(self.where, self.where)] += weighted @ self.x
        slope[self.where] += weighted @ self.y

    def add_scatter(self, weight: Floats, values: Floats, share: float, scatter: Floats) -> None:
        """Add a share of the covariance of the slope, as blocks scatter, to ``scatter`` ``[k, k]``."""
        scores = self.x * (weight * self.rest(values))[:, None]
        bounds = np.flatnonzero(np.diff(self.block, prepend=-1))
        sums = np.add.reduceat(scores, bounds, axis=0)
        scatter[np.ix_(self.where, self.where)] += share * (sums.T @ sums)


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
        for each in white:
            each.add_normal(each.weights(values, noise[each.name]) / together[each.name], information, slope)
        values = np.linalg.solve(information, slope)
    bread, meat = np.linalg.inv(information), np.diag(certainty)
    noise = {kind: _scale(some, values) for kind, some in kinds.items()}
    for each in white:
        weight = each.weights(values, noise[each.name])
        each.add_scatter(weight, values, together[each.name] ** -2, meat)
    sandwich = bread @ meat @ bread
    more = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(bread), 1.0))
    wider = {kind: noise[kind] * together[kind] ** 0.5 for kind in kinds}
    return Posterior(names, values, bread * np.outer(more, more), wider, walk)


def _together(white: Sequence[_White], values: Floats, noise: float, certainty: Floats) -> float:
    """Return how many equations of a kind tell only as much as one: their errors hang together.

    A likelihood that takes them for independent would outweigh what was believed (Ribatet, Cooley and Davison,
    Statistica Sinica 22, 2012, 813).
    """
    k = len(certainty)
    information, slope, scatter = np.zeros((k, k)), np.zeros(k), np.zeros((k, k))
    for each in white:
        weight = each.weights(values, noise)
        each.add_normal(weight, information, slope)
        each.add_scatter(weight, values, 1.0, scatter)
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
            found -= float(np.sum(_cost(white.rest(middle) / fitted.noise[each.name])))
    return found


def _cost(r: Floats) -> Floats:
    """Return what residuals in standard deviations cost ``[n]``."""
    far = np.abs(r)
    return np.where(far < _HUBER, 0.5 * far**2, _HUBER * (far - 0.5 * _HUBER))


def _scale(white: Sequence[_White], values: Floats) -> float:
    rest = np.concatenate([each.rest(values) for each in white])
    return max(_TO_SIGMA * float(np.median(np.abs(rest))), 0.3 * float(np.std(rest)), 1e-12)


def _whitened(equations: Equations, names: Sequence[str], walk: Mapping[str, float]) -> _White:
    here = [name for name in names if name in equations.columns]
    where = np.array([names.index(name) for name in here], np.intp)
    x = np.stack([equations.columns[name] for name in here], axis=1)
    block = np.floor(equations.t_s / equations.block_s).astype(np.int64)
    if not equations.walks:
        return _White(equations.name, equations.y, x, where, block)
    white, deviation = without_walk(np.column_stack([equations.y, x]), equations.t_s, walk[equations.name])
    known = deviation > 0.0
    return _White(equations.name, white[known, 0], white[known, 1:], where, block[known])


def _likeliest_walk(equations: Sequence[Equations], names: Sequence[str], expected: Floats) -> float:
    """Return the walk for which residuals at expected values are likeliest, whatever their size."""
    values = dict(zip(names, expected.tolist(), strict=True))
    found = []
    for each in equations:
        rest = each.y - sum(column * values.get(name, 0.0) for name, column in each.columns.items())
        found.append(without_walk(np.tile(rest[:, None], len(_WALKS)), each.t_s, _WALKS))
    white, deviation = (np.concatenate(parts) for parts in zip(*found, strict=True))
    costs = []
    for r, s in zip(white.T, deviation.T, strict=True):
        r, s = r[s > 0.0], s[s > 0.0]
        size = _TO_SIGMA * float(np.median(np.abs(r))) + 1e-15
        costs.append(float(np.sum(_cost(r / size) + np.log(s * size))))
    return float(_WALKS[int(np.argmin(costs))])


def without_walk(columns: Floats, t_s: Floats, walk: float | Floats) -> tuple[Floats, Floats]:
    """Return columns with a random walk filtered out: the innovations over their deviation.

    Args:
        columns: ``[n, k]``.
        t_s: times ``[n]``, s.
        walk: σ of a second's walk over that of the noise; one for all columns, or of each ``[k]``.

    Returns:
        The columns ``[n, k]``, and that deviation ``[n]``, or ``[n, k]``: nought where the walk was not known.
    """
    per_s = np.square(walk)
    white, deviation = np.zeros(columns.shape), np.zeros((len(columns), *per_s.shape))
    level, variance, last_s = columns[0] if len(columns) else np.zeros(0), np.ones_like(per_s), -np.inf
    for n, now_s in enumerate(t_s.tolist()):
        if now_s - last_s > _BROKEN_S:
            level, variance, last_s = columns[n], np.ones_like(per_s), now_s
            continue
        variance = variance + per_s * (now_s - last_s)
        total, last_s = variance + 1.0, now_s
        innovation, deviation[n] = columns[n] - level, np.sqrt(total)
        white[n] = innovation / deviation[n]
        level = level + variance / total * innovation
        variance = variance / total
    return white, deviation
