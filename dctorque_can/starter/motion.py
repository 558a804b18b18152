"""How the car moved, and how speeds go with that: what a name cannot say.

While a clutch holds, engine and input shaft turn together, and with the wheels by the ratio of a gear. So either
has a few lasting ratios to the wheels. What only follows the road has one. At rest an engine idles and an engaged
shaft stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from dctorque_can.starter.recording import GRID_US

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
STEP_S = GRID_US / 1e6
_MOVES, _RESTS = 0.08, 0.01  # of the highest wheel speed: 10 and 1 km/h of 120
_SHORTEST_S = 5.0  # of driving and of rest that say anything
_STEADY_STEPS, _STEADY = 15, 0.012  # a ratio that changes by less in 0.3 s lasts
_BIN = 0.01  # of the logarithm of a ratio
_WIDEST = 0.08  # a lasting value with its noise
_VARIES = 1.08  # by so much speeds must change at one ratio, or it lasts for nothing
_LEAST_SHARE = 0.015  # of the driving, at one ratio
_SMOOTH_STEPS = 25


@dataclass(frozen=True)
class Motion:
    """The wheels on the grid.

    Attributes:
        wheel: speed, in any unit, float64 ``[n]``; NaN where it is not known.
    """

    wheel: Floats

    @cached_property
    def _fastest(self) -> float:
        known = np.abs(self.wheel[np.isfinite(self.wheel)])
        return float(np.percentile(known, 99)) if len(known) else 0.0

    @cached_property
    def moving(self) -> Mask:
        """Where the car drives, forwards."""
        with np.errstate(invalid="ignore"):
            return np.isfinite(self.wheel) & (self.wheel > _MOVES * self._fastest) & (self._fastest > 0.0)

    @cached_property
    def resting(self) -> Mask:
        """Where it stands."""
        with np.errstate(invalid="ignore"):
            return np.isfinite(self.wheel) & (np.abs(self.wheel) <= _RESTS * self._fastest)

    @property
    def drives(self) -> bool:
        """Whether it drives for long enough to tell anything, and not at one speed."""
        if self.moving.sum() * STEP_S < _SHORTEST_S:
            return False
        slow, fast = np.percentile(self.wheel[self.moving], [5, 95])
        return bool(fast > _VARIES * slow)

    @property
    def stands(self) -> bool:
        """Whether it is seen at rest, for two seconds at least."""
        return bool(self.resting.sum() * STEP_S > 2.0)

    @cached_property
    def acceleration(self) -> Floats:
        """Of the wheels, 1/s of their unit, smoothed over half a second; NaN where not known."""
        return slope(self.wheel)


def slope(values: Floats) -> Floats:
    """Return the change per second, smoothed over half a second; NaN where values are not known."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(values), np.nan)
    filled = np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])
    smooth = uniform_filter1d(filled, _SMOOTH_STEPS)
    result = np.gradient(smooth, STEP_S)
    result[~known] = np.nan
    return result


@dataclass(frozen=True, slots=True)
class RatioPattern:
    """How a speed goes with the wheels.

    Attributes:
        lasting: share of the driving during which the ratio is one of ``levels``.
        levels: lasting ratios, the highest (lowest gear) first.
        turns_at_rest: share of the rest in which it turns; NaN where the car is not seen at rest.
    """

    lasting: float
    levels: tuple[float, ...]
    turns_at_rest: float


def ratio_pattern(speed: Floats, motion: Motion) -> RatioPattern:
    """Return how ``speed`` (any unit, ``[n]``) goes with the wheels."""
    known = np.isfinite(speed)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(motion.moving & known & (speed > 0.0), np.log(speed / motion.wheel), np.nan)
        before = np.roll(ratio, _STEADY_STEPS)
        before[:_STEADY_STEPS] = np.nan
        steady = np.abs(ratio - before) < _STEADY
    driving = max(int((motion.moving & known).sum()), 1)
    groups = _levels(ratio[steady], motion.wheel[steady], _LEAST_SHARE * driving)
    usual = float(np.median(speed[motion.moving & known])) if (motion.moving & known).any() else 0.0
    rest = motion.resting & known
    turns = float((speed[rest] > 0.15 * usual).mean()) if rest.sum() * STEP_S > 2.0 else float("nan")
    lasting = sum(count for _, count in groups) / driving
    return RatioPattern(lasting, tuple(sorted((level for level, _ in groups), reverse=True)), turns)


def _levels(ratio: Floats, wheel: Floats, least: float) -> list[tuple[float, int]]:
    """Return the lasting ratios with how many samples have each, from logarithms of ratios."""
    if len(ratio) < 2:
        return []
    bins = np.floor((ratio - ratio.min()) / _BIN).astype(np.int64)
    counts = np.bincount(bins)
    full = counts > max(0.1 * least, 0.02 * counts.max())
    found: list[tuple[float, int]] = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], full, [False]]).astype(np.int8)))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        inside = (bins >= first) & (bins < end)
        if inside.sum() < least or (end - first) * _BIN > _WIDEST:
            continue
        slow, fast = np.percentile(wheel[inside], [2, 98])
        if fast > _VARIES * slow:
            found.append((float(np.exp(np.median(ratio[inside]))), int(inside.sum())))
    return found


def share_together(first: Floats, second: Floats, where: Mask, tolerance: float = 0.015) -> float:
    """Return the share of the known samples of ``where`` in which two speeds differ by less than ``tolerance``."""
    usable = where & np.isfinite(first) & np.isfinite(second)
    if not usable.any():
        return 0.0
    a, b = first[usable], second[usable]
    largest = np.maximum(np.maximum(np.abs(a), np.abs(b)), 1e-9)
    return float((np.abs(a - b) < tolerance * largest).mean())


def correlation(first: Floats, second: Floats, where: Mask) -> float:
    """Return the correlation coefficient over the known samples of ``where``; 0 where one of both is constant."""
    usable = where & np.isfinite(first) & np.isfinite(second)
    if usable.sum() < 10:
        return 0.0
    a, b = first[usable], second[usable]
    if a.std() == 0.0 or b.std() == 0.0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])
