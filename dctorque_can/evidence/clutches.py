"""What is told of the clutches against what the speeds say: direction, exchange, kissing point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erfcx

from dctorque_can.driveline.phases import PhaseSource
from dctorque_can.evidence.fits import Number
from dctorque_can.evidence.moments import RUNS_RAD_S, STEP_S, Mask, Moments, lasting, rate, smooth
from dctorque_can.evidence.series import Floats
from dctorque_can.evidence.torques import idle_torque
from dctorque_can.pipeline.samples import Quantity

SLIDES_RAD_S = 20.0
"""A clutch that slides by as much is not about to lock."""
LEAST_S = 2.0
"""Seconds that a clutch must hold, and slide, before anything is said of it."""
REST_RAD_S = 0.3
"""Wheels of a standing car."""
_POINTS = 120  # kissing points that are tried
_EXPONENTS = (1.0, 1.5, 2.0)
"""Of the torque over the way beyond the kissing point: from one stiffness to a cushion that hardens."""
_FIRST_PART = 0.5
"""Part of the largest torque up to which the beginning is looked at."""
_BINS_OF_WAY = 20  # from where it is open to where it holds
_FASTEST_BINS_PER_S = 20.0
"""A position that moves faster is another one by the time that the torque is told."""
_SMOOTH_S = 0.04
_LEAST_BINS, _LEAST_IN_BIN = 6, 5
LEAST_NM = 20.0
"""Torque that must have gone through: several times what an engine torque is wrong by."""
NOISE_NM = 1.0
"""What the median of a bin is wrong by, N·m, although nothing shows it."""
_FIRST = {
    PhaseSource.POSITION: Quantity.CLUTCH1_POSITION,
    PhaseSource.COMMAND: Quantity.CLUTCH1_COMMAND,
    PhaseSource.FLAG: Quantity.CLUTCH1_OPEN,
}


@dataclass(frozen=True, slots=True)
class Told:
    """What one clutch signal says, in its own unit; medians.

    Attributes:
        holds: while its clutch holds the engine and the other one does not.
        other_holds: while the other clutch holds the engine.
        rests: while the car stands and the engine runs; None if it never does.
        apart: share of the time that its clutch holds in which it is on that side of ``other_holds``.
        seconds: of holding, the lesser of both.
    """

    holds: float
    other_holds: float
    rests: float | None
    apart: float
    seconds: float

    @property
    def way(self) -> float:
        """Return by how much it changes as its clutch closes; negative: it closes decreasing."""
        return self.holds - self.other_holds


def signal(m: Moments, clutch: int) -> Floats | None:
    """Return what is told of a clutch, 1 or 2, in the unit of its signal; None where nothing is."""
    source = m.series.config.settings.phases.clutches[clutch - 1].source
    if source not in _FIRST:
        return None
    quantity = Quantity(_FIRST[source] + clutch - 1)
    if not m.has(quantity):
        return None
    if source is PhaseSource.FLAG:
        return -m.series.told(quantity, m.t_s)
    return m.speed(quantity)


def holding(m: Moments) -> tuple[Mask, Mask]:
    """Return where one clutch alone holds the engine, by speeds ``[n]``: the first, and the second."""
    slip = [np.abs(smooth(m.engine - m.shaft[i])) for i in range(2)]
    first, second = (
        m.locked[i] & (m.ratio[i] > 0.0) & ((slip[1 - i] > SLIDES_RAD_S) | m.neutral[1 - i]) for i in range(2)
    )
    return first, second


def told(m: Moments, clutch: int) -> Told | None:
    """Return what the signal of a clutch says while it holds and while it does not; None of too little."""
    values = signal(m, clutch)
    if values is None:
        return None
    own, other = holding(m) if clutch == 1 else holding(m)[::-1]
    known = np.isfinite(values)
    own, other = own & known, other & known
    seconds = min(np.count_nonzero(own), np.count_nonzero(other)) * STEP_S
    if seconds < LEAST_S:
        return None
    rest = lasting((np.abs(m.body) < REST_RAD_S) & (m.engine > RUNS_RAD_S), 0.5, 0.5) & known
    rests = float(np.median(values[rest])) if np.count_nonzero(rest) * STEP_S > 0.5 * LEAST_S else None
    holds = float(np.median(values[own]))
    other_holds = float(np.median(values[other]))
    apart = float(np.mean((values[own] - other_holds) * (holds - other_holds) > 0.0))
    return Told(holds, other_holds, rests, apart, float(seconds))


@dataclass(frozen=True, slots=True)
class Kiss:
    """Where a clutch begins to carry torque.

    Attributes:
        point: in the unit of the position.
        positions, torques: for a picture: what was seen ``[n]``, and what of the engine torque went through, N·m.
    """

    point: Number
    positions: Floats
    torques: Floats


def kissing_point(m: Moments, clutch: int, closes_increasing: bool) -> Kiss | None:
    """Return the position at which a clutch begins to carry torque; None where the drive does not show it.

    While the other clutch is as open as when this one holds, the torque that the engine does not need for itself
    goes through this one, T_en − (J_e + J_d) dω_e/dt, in the direction of its slip. It begins at the kissing point
    and grows with a power of the way beyond it, which is fitted too.

    Args:
        m: the recording.
        clutch: 1 or 2.
        closes_increasing: which way the position goes.
    """
    position, other = signal(m, clutch), signal(m, 3 - clutch)
    seen, across = told(m, clutch), told(m, 3 - clutch)
    if position is None or other is None or seen is None or across is None or across.way == 0.0:
        return None
    sign = 1.0 if closes_increasing else -1.0
    # not beyond a tenth of its way from where it is while this clutch holds
    apart = lasting((other - across.other_holds) / across.way < 0.1, 0.1, 0.1)
    slip = smooth(m.engine - m.shaft[clutch - 1])
    slips = lasting(np.abs(slip) > SLIDES_RAD_S / 2, 0.1, 0.1)
    inertia = m.vehicle.engine_inertia_kgm2 + m.vehicle.damper.inertia_kgm2
    idle = idle_torque(m)
    through = smooth(m.torque, _SMOOTH_S) - inertia * rate(m.engine, _SMOOTH_S)
    through -= 0.0 if idle is None else idle.value
    torque = np.sign(slip) * through
    way = sign * smooth(position, _SMOOTH_S)
    where = apart & slips & (m.engine > RUNS_RAD_S) & np.isfinite(torque + way)
    where &= lasting(m.gear[clutch - 1] > 0, 0.2, 0.2)
    if sign * seen.way <= 0.0 or np.count_nonzero(where) * STEP_S < LEAST_S:
        return None
    bin_width = sign * seen.way / _BINS_OF_WAY
    where &= np.abs(rate(position, _SMOOTH_S)) < _FASTEST_BINS_PER_S * bin_width
    x, y = _binned(way[where], torque[where], bin_width)
    first = np.flatnonzero(y > _FIRST_PART * float(y.max()))
    x, y = x[: first[0] + 1], y[: first[0] + 1]
    if len(x) < _LEAST_BINS or y[-1] < LEAST_NM or abs(y[0]) > 0.2 * y[-1]:
        return None  # its beginning was not seen
    found = [_begins(x, y, power) for power in _EXPONENTS]
    points = np.array([point for point, _, _ in found])
    costs = np.array([cost for _, _, cost in found])
    best = int(np.argmin(costs))
    likely = points[costs < 2.0 * costs[best]]
    sigma = float(np.hypot(found[best][1], np.ptp(likely) / np.sqrt(12.0)))
    begins = beyond(Number(float(points[best]), sigma, np.count_nonzero(where) * STEP_S), sign * seen.other_holds)
    return Kiss(Number(sign * begins.value, begins.sigma, begins.seconds), sign * way[where], torque[where])


def beyond(number: Number, least: float) -> Number:
    """Return what is known of a number, a normal distribution, when it is also known to be more than ``least``.

    Where a clutch waits while the other one has all of the torque, it carries none: it begins further on.
    """
    if number.sigma <= 0.0:
        return Number(max(number.value, least), number.sigma, number.seconds)
    z = (least - number.value) / number.sigma
    hazard = float(np.sqrt(2.0 / np.pi) / erfcx(z / np.sqrt(2.0)))  # φ/(1 − Φ)
    spread = float(np.sqrt(max(1.0 + z * hazard - hazard**2, 1e-6)))
    return Number(number.value + number.sigma * hazard, number.sigma * spread, number.seconds)


def _binned(x: Floats, y: Floats, width: float) -> tuple[Floats, Floats]:
    """Return medians of x and y in bins of x that hold enough, in order of x."""
    number = np.floor((x - x.min()) / width).astype(np.int64)
    kept = [number == each for each in np.unique(number)]
    kept = [rows for rows in kept if np.count_nonzero(rows) >= _LEAST_IN_BIN]
    return np.array([np.median(x[rows]) for rows in kept]), np.array([np.median(y[rows]) for rows in kept])


def _begins(x: Floats, y: Floats, power: float) -> tuple[float, float, float]:
    """Return where a power of the way begins, its standard error, and the mean square of what is left."""
    points = np.linspace(float(x[0]), float(x[-2]), _POINTS)
    costs = np.array([_cost(x - point, y, power) for point in points])
    best = int(np.argmin(costs))
    near = points[costs < costs[best] * (1.0 + 1.0 / max(len(x) - 2, 1))]
    step = float(points[1] - points[0])
    return float(points[best]), max(0.5 * float(near[-1] - near[0]), step), float(costs[best])


def _cost(beyond: Floats, torque: Floats, power: float) -> float:
    """Return the mean square of what a·beyond^power leaves of the torque, N²·m²."""
    shape = np.maximum(beyond, 0.0) ** power
    slope = max(float(shape @ torque) / float(shape @ shape), 0.0)
    return float(np.mean((torque - slope * shape) ** 2)) + NOISE_NM**2
