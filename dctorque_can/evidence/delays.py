"""How much later one speed tells of the same motion than another one.

Two speeds in a known ratio, one late by τ: y(t) = a x(t − τ) ≈ a x(t) − a τ dx/dt. Both are smoothed alike,
so the regression is free of what noise does to a rate. What twists between both grows with the rate of the torque,
not with the acceleration, and averages out. Wheels that are not driven turn slower than driven ones by the slip of
these, which grows with their force: it is a term of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dctorque_can.evidence.fits import TO_SIGMA, Number, fit
from dctorque_can.evidence.moments import SHAFTS, STEP_S, WHEELS, Mask, Moments, lasting, rate, smooth
from dctorque_can.evidence.series import Floats
from dctorque_can.evidence.torques import factors
from dctorque_can.pipeline.samples import Quantity

LEAST_S = 10.0
MOST_S = 0.25
"""More than a sensor and a bus can be late by: what fits better then is no delay."""
_ROUNDS = 3  # of linearisation
_APART = 0.04  # share by which a speed may be away from the line: more is no such pair
_ENGINE_SHARE = 0.5
FORCE = 0.2
"""Share by which the force of the tyres may be wrong. An acceleration that has less apart from that force, as on a
level road, does not tell a delay from slip."""
_MODEL_S = {"engine": 0.3e-3, "wheels": 0.5e-3, "body": 3e-3}
"""What a delay is wrong by beside chance: twist of damper and shafts; slip of the tyres."""


@dataclass(frozen=True, slots=True)
class Delay:
    """How late a signal is beyond what the file says of it, against most of the others.

    Attributes:
        quantities: that are measured together.
        late_s: positive: its frames come later than told.
        model_s: standard deviation by what the measurement leaves out.
        rate, lag: for a picture ``[n]``: the rate of a speed, rad/s², and by how much this one lags behind, rad/s.
    """

    quantities: tuple[Quantity, ...]
    late_s: Number
    model_s: float
    rate: Floats
    lag: Floats


@dataclass(frozen=True, slots=True)
class _Late:
    """By how much one speed is later than another one; ``rate`` and ``lag`` as of `Delay`."""

    number: Number
    rate: Floats
    lag: Floats

    def turned(self) -> _Late:
        """Return by how much the other one is later."""
        number = Number(-self.number.value, self.number.sigma, self.number.seconds)
        return _Late(number, self.rate, -self.lag)

    def after(self, first: Number) -> _Late:
        """Return by how much it is later than what the other one is itself later than by ``first``."""
        sigma = float(np.hypot(self.number.sigma, first.sigma))
        number = Number(self.number.value + first.value, sigma, min(self.number.seconds, first.seconds))
        return _Late(number, self.rate, self.lag + first.value * self.rate)


def delays(m: Moments) -> list[Delay]:
    """Return by how much each speed is later than most of them, as far as the drive shows it."""
    late: dict[tuple[Quantity, ...], list[tuple[_Late, float]]] = {}
    for i, quantity in enumerate(SHAFTS):
        if m.has(quantity):
            found = _late(m, m.shaft[i], m.engine, m.locked[i])
            if found is not None:
                late.setdefault((quantity,), []).append((found.turned(), _MODEL_S["engine"]))
    if not late:
        return []
    for front in m.driven_fronts if m.measures_driven else []:
        for i, quantity in enumerate(SHAFTS):
            if (quantity,) not in late:
                continue
            where = m.rolls & (m.ratio[i] > 0.0)
            found = _late(m, m.shaft[i], m.ratio[i] * m.axle(front), where)
            if found is not None:
                after = found.after(late[(quantity,)][0][0].number)
                late.setdefault(_axle(m, front), []).append((after, _MODEL_S["wheels"]))
    driven = _axle(m, m.driven_fronts[0])
    if m.knows_body and driven in late and _engine_fits(m):
        found = _late_body(m)
        other = _axle(m, not m.driven_fronts[0])
        if found is not None:
            late[other] = [(found.after(_mean(late[driven])), _MODEL_S["body"])]
    return _against_most(late)


def _engine_fits(m: Moments) -> bool:
    """Return whether engine torque and inertia fit: the force of the tyres is reckoned from them."""
    found = factors(m)
    return found is not None and found.inertia is not None and abs(found.inertia.value - 1.0) < _ENGINE_SHARE


def _axle(m: Moments, front: bool) -> tuple[Quantity, ...]:
    return tuple(each for each in (WHEELS[:2] if front else WHEELS[2:]) if m.has(each))


def _late(
    m: Moments, sooner: Floats, later: Floats, where: Mask, extra: list[Floats] | None = None
) -> _Late | None:
    """Return by how much ``later`` is late against ``sooner``, s."""
    y = smooth(later)
    known = lasting(where, 0.3, 0.3) & np.isfinite(y)
    total = 0.0
    late = None
    for _ in range(_ROUNDS):
        moved = np.interp(m.t_s - total, m.t_s, sooner) if total else sooner
        x, speed = smooth(moved), rate(moved)
        rows = known & np.isfinite(x + speed)
        for column in extra or []:
            rows &= np.isfinite(column)
        rows &= np.abs(y - x) < _APART * np.abs(x) + MOST_S * np.abs(speed)
        if np.count_nonzero(rows) * STEP_S < LEAST_S:
            return None
        columns = [x[rows], -speed[rows], np.ones(int(np.count_nonzero(rows)))]
        columns += [each[rows] for each in extra or []]
        found = fit(m.t_s[rows], columns, y[rows], STEP_S)
        if found is None:
            return None
        step = float(found.values[1] / found.values[0])
        total += step
        if abs(total) > MOST_S:
            return None
        number = Number(total, float(found.sigmas[1] / abs(found.values[0])), found.seconds)
        rest = (y[rows] - np.stack(columns, axis=1) @ found.values) / found.values[0]
        late = _Late(number, speed[rows], total * speed[rows] - rest)
    return late


def _late_body(m: Moments) -> _Late | None:
    """Return by how much the undriven wheels are later than the driven ones, s."""
    row = np.arange(len(m.t_s))
    i = np.where(m.locked[0], 0, 1)
    where = m.rolls & m.free & (m.locked[0] != m.locked[1])
    ratio = smooth(m.ratio[i, row])
    inertia = m.vehicle.engine_inertia_kgm2 + m.vehicle.damper.inertia_kgm2
    force = smooth(m.torque * m.ratio[i, row]) - ratio * inertia * rate(m.engine)
    slip = smooth(m.wheels) * force
    speed, gathers = smooth(m.body), rate(m.body)
    rows = lasting(where, 0.3, 0.3) & np.isfinite(gathers + slip)
    if _apart(m.t_s[rows], gathers[rows], [slip[rows], force[rows], speed[rows]]) < FORCE:
        return None
    found = _late(m, m.body, m.wheels, where, [slip, force])
    return None if found is None else found.turned()


def _apart(t_s: Floats, values: Floats, columns: list[Floats]) -> float:
    """Return the standard deviation of what columns and a constant leave of most values, over that of values."""
    columns = [*columns, np.ones(len(values))]
    found = fit(t_s, columns, values, STEP_S)
    if found is None:
        return 0.0
    rest = np.abs(values - np.stack(columns, axis=1) @ found.values)
    return TO_SIGMA * float(np.median(rest)) / float(np.std(values))


def _against_most(late: dict[tuple[Quantity, ...], list[tuple[_Late, float]]]) -> list[Delay]:
    """Return delays against that one which most signals agree on: the median, the engine's being zero."""
    numbers = {quantities: _mean(each) for quantities, each in late.items()}
    spread = min(number.sigma for number in numbers.values())
    first = next(iter(late.values()))[0][0]
    engine = (_Late(Number(0.0, 0.0, 0.0), first.rate, first.lag - first.number.value * first.rate), 0.0)
    numbers[(Quantity.ENGINE_SPEED,)] = engine[0].number
    values = sorted(number.value for number in numbers.values())
    common = values[(len(values) - 1) // 2]
    found = []
    for quantities, each in {(Quantity.ENGINE_SPEED,): [engine], **late}.items():
        number, (seen, model) = numbers[quantities], each[0]
        against = Number(number.value - common, float(np.hypot(number.sigma, spread)), number.seconds)
        found.append(Delay(quantities, against, model, seen.rate, seen.lag - common * seen.rate))
    return found


def _mean(late: list[tuple[_Late, float]]) -> Number:
    """Return the mean weighted by variances."""
    numbers = [each.number for each, _ in late]
    weights = np.array([1.0 / number.sigma**2 for number in numbers])
    values = np.array([number.value for number in numbers])
    seconds = sum(number.seconds for number in numbers)
    return Number(float(weights @ values / weights.sum()), float(weights.sum() ** -0.5), seconds)
