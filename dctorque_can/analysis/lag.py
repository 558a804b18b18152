"""By how much an estimate comes later than the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LARGEST_S = 0.1
_COARSE_S, _FINE_S = 0.005, 0.001


@dataclass(frozen=True, slots=True)
class Stretch:
    """One torque over one uninterrupted time.

    Attributes:
        t_s: times of the estimates ``[n]``, s.
        estimate: ``[n]``, N·m.
        truth_t_s: times of the truth ``[m]``, ascending and on the same scale, s.
        truth: ``[m]``, N·m; linear in between.
    """

    t_s: Floats
    estimate: Floats
    truth_t_s: Floats
    truth: Floats


def lag_s(stretches: Sequence[Stretch]) -> float | None:
    """Return the lag of the estimates, s; positive when they come late.

    It is the τ within ±100 ms that minimises the sum over all stretches of Σ (estimate(t) - truth(t - τ) - c)²,
    with a constant c of its own for each stretch, so that a bias is not taken for a lag. What counts in such least
    squares is where the torque changes much. The minimum is found on a grid of 1 ms and refined by a parabola.

    Only estimates with 100 ms of truth before and after them count, so that every τ is judged by the same rows.

    Returns:
        None when no τ is best: the truth never changes, nothing is left to compare, or the best one is at the end
        of the range.
    """
    usable = [part for part in map(_with_margin, stretches) if len(part.t_s) > 1]
    if not any(np.ptp(_true_at(part, 0.0)) > 0 for part in usable):
        return None
    coarse = np.arange(-LARGEST_S, LARGEST_S + _COARSE_S / 2, _COARSE_S)
    around = float(coarse[np.argmin([_squares(usable, lag) for lag in coarse])])
    fine = around + np.arange(-_COARSE_S, _COARSE_S + _FINE_S / 2, _FINE_S)
    fine = fine[np.abs(fine) <= LARGEST_S + _FINE_S / 2]
    squares = [_squares(usable, lag) for lag in fine]
    best = int(np.argmin(squares))
    if best in (0, len(fine) - 1):
        return None
    before, at, after = squares[best - 1 : best + 2]
    bend = before - 2 * at + after
    return float(fine[best] + (0.5 * _FINE_S * (before - after) / bend if bend > 0 else 0.0))


def _with_margin(part: Stretch) -> Stretch:
    if not len(part.truth_t_s):
        return Stretch(part.t_s[:0], part.estimate[:0], part.truth_t_s, part.truth)
    begin, end = part.truth_t_s[0] + LARGEST_S, part.truth_t_s[-1] - LARGEST_S
    inside = (part.t_s >= begin) & (part.t_s <= end)
    return Stretch(part.t_s[inside], part.estimate[inside], part.truth_t_s, part.truth)


def _true_at(part: Stretch, lag: float) -> Floats:
    return np.asarray(np.interp(part.t_s - lag, part.truth_t_s, part.truth), np.float64)


def _squares(stretches: Sequence[Stretch], lag: float) -> float:
    """Return the sum of squared errors about their mean of each stretch, (N·m)²."""
    total = 0.0
    for part in stretches:
        error = part.estimate - _true_at(part, lag)
        total += float(np.sum((error - error.mean()) ** 2))
    return total
