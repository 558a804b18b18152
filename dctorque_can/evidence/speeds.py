"""Speeds against each other: engine and shafts, shafts and wheels in each gear, wheel and wheel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dctorque_can.driveline.parameters import DrivenAxle
from dctorque_can.evidence.causes import Cause, Comparison
from dctorque_can.evidence.fits import Number, fit, median
from dctorque_can.evidence.moments import (
    CONSTANT_RATE,
    LOCKED_S,
    RUNS_RAD_S,
    SHAFTS,
    STEP_S,
    WHEELS,
    Mask,
    Moments,
    lasting,
    rate,
    smooth,
)
from dctorque_can.evidence.series import Floats
from dctorque_can.pipeline.samples import Quantity

FITS = 0.03
"""A speed is that of a gear within this share."""
LEAST_S = 3.0
"""Seconds of evidence that a number needs."""
ROUNDED = 0.0015
"""Standard deviation of a ratio as it is written down: two digits behind the point."""
SLIPPING = 0.006
"""… where no driven wheel is measured: the driven ones turn faster by the slip of the tyres."""
SAME_TYRE = 0.006
"""… of one tyre's radius against another one's: wear and pressure."""
RADIUS = 0.008
"""… of the rolling radius that is told."""
ENGINE = 0.001
"""… of two speeds of one shaft."""
MANY = 0.1
"""Share of the time that two speeds are alike, from which on they have the same scale."""
UNITS = {
    "rpm instead of rad/s": 9.549297,
    "km/h instead of m/s": 3.6,
    "mph instead of km/h": 1.609344,
    "mph instead of m/s": 2.236936,
    "rev/s instead of rad/s": 0.1591549,
    "rev/s instead of rpm": 1 / 60,
    "deg/s instead of rad/s": 57.29578,
}
"""What a speed is too large by in one unit instead of another one; too small the other way round."""
STEADY_RATE = 0.3
"""Share by which speeds may change in a second: those taken 10 ms apart then differ by less than noise does."""
NAMES = {
    Quantity.ENGINE_SPEED: "engine",
    Quantity.SHAFT1_SPEED: "shaft1",
    Quantity.SHAFT2_SPEED: "shaft2",
    Quantity.WHEEL_SPEED_FL: "fl",
    Quantity.WHEEL_SPEED_FR: "fr",
    Quantity.WHEEL_SPEED_RL: "rl",
    Quantity.WHEEL_SPEED_RR: "rr",
}


def log_ratio(first: Floats, second: Floats) -> Floats:
    """Return ln(first/second) where both are positive, else not-a-number."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.log(np.where(first > 0.0, first, np.nan) / np.where(second > 0.0, second, np.nan)))


def measured(m: Moments, values: Floats, where: Mask) -> Number | None:
    """Return the median of values at some moments, None of less than `LEAST_S` of them."""
    known = where & np.isfinite(values)
    if np.count_nonzero(known) * STEP_S < LEAST_S:
        return None
    return median(m.t_s[known], values[known], STEP_S)


def unit_of(log: float) -> str | None:
    """Return which unit a scale of exp(log) means, or None."""
    for name, factor in UNITS.items():
        if abs(log - np.log(factor)) < 0.5 * FITS:
            return name
        if abs(log + np.log(factor)) < 0.5 * FITS:
            return " instead of ".join(reversed(name.split(" instead of ")))
    return None


def unit_of_wheels(m: Moments) -> float | None:
    """Return by which unit's factor the wheels are too fast, where gears are told by ratios alone; None: by none.

    Those ratios fit no gear then, so that nothing can be compared in any.
    """
    if m.series.config.settings.gear_inference is None:
        return None
    shares = {}
    for factor in [1.0, *UNITS.values(), *(1.0 / each for each in UNITS.values()), 2.0, 0.5, 10.0, 0.1]:
        near, total = 0, 0
        for i, quantity in enumerate(SHAFTS):
            if not m.has(quantity):
                continue
            ratio = smooth(log_ratio(m.speed(quantity), m.wheels))
            where = (np.abs(rate(ratio)) < CONSTANT_RATE) & (m.speed(quantity) > RUNS_RAD_S)
            logs = [np.log(abs(gear.total_ratio)) for gear in m.vehicle.gears_on(i + 1)]
            fits = np.min([np.abs(ratio + np.log(factor) - log) for log in logs], axis=0) < FITS
            near, total = near + int(np.count_nonzero(where & fits)), total + int(np.count_nonzero(where))
        shares[factor] = near / max(total, 1)
    best = max(shares, key=lambda factor: shares[factor])
    return best if shares[1.0] < 0.3 and shares[best] > 0.7 else None


def backwards(m: Moments) -> list[Quantity]:
    """Return the speeds that are negative while the car is driven forwards: nearly always, but for reverse."""
    reverse = (m.gear == -1).any(axis=0)
    found = []
    for quantity in NAMES:
        if m.has(quantity):
            value = m.speed(quantity)
            moving = np.isfinite(value) & (np.abs(value) > 5.0) & ~reverse
            if np.count_nonzero(moving) * STEP_S > LEAST_S and np.mean(value[moving] < 0.0) > 0.8:
                found.append(quantity)
    return found


def comparisons(m: Moments) -> list[Comparison]:
    """Return each pair of speeds that should be in a known ratio, at moments when they are."""
    return [*_wheels(m), *_gears(m), *_engine(m)]


def causes(m: Moments, radius: float = RADIUS) -> list[Cause]:
    """Return whose scales may be wrong, the likeliest first; ``radius`` is how sure that of the wheels is."""
    wheels = {NAMES[each]: 1 for each in WHEELS if m.has(each)}
    front = {NAMES[each]: 1 for each in WHEELS[:2] if m.has(each)}
    rear = {NAMES[each]: 1 for each in WHEELS[2:] if m.has(each)}
    shafts = {NAMES[each]: 1 for each in SHAFTS if m.has(each)}
    found = [Cause("wheels", wheels, radius), Cause("engine", {"engine": 1})]
    found += [Cause(name, {name: 1}) for name in shafts]
    found += [Cause("shafts", shafts)] if len(shafts) == 2 else []
    found += [Cause(name, parts) for name, parts in (("front", front), ("rear", rear)) if len(parts) == 2]
    found += [Cause(name, {name: 1}) for name in wheels] if len(wheels) > 1 else []
    gears = [gear for gear in m.vehicle.gears if gear.number > 0]
    found += [Cause(f"gear {gear.number}", {f"gear {gear.number}": 1}) for gear in gears]
    drives = sorted({gear.final_drive for gear in gears})
    for drive in drives if len(drives) > 1 else []:
        own = {f"gear {gear.number}": 1 for gear in gears if gear.final_drive == drive}
        if len(own) > 1:
            found.append(Cause(f"final drive {drive:g}", own))
    return found


def _wheels(m: Moments) -> list[Comparison]:
    """Return left against right, and front against rear where neither drive nor brake makes a slip."""
    pairs = [(WHEELS[0], WHEELS[1]), (WHEELS[2], WHEELS[3]), (WHEELS[0], WHEELS[2]), (WHEELS[1], WHEELS[3])]
    quiet = m.rolls & (np.abs(rate(m.body, 0.2)) < 0.05 * m.body) & m.free
    found = []
    for first, second in pairs:
        if not m.has(first, second):
            continue
        other_axle = (first in WHEELS[:2]) != (second in WHEELS[:2])
        where = quiet if other_axle else m.rolls
        number = measured(m, log_ratio(m.speed(first), m.speed(second)), where)
        if number is not None:
            honest = float(np.hypot(SAME_TYRE, SLIPPING)) if other_axle else SAME_TYRE
            found.append(Comparison({NAMES[first]: 1, NAMES[second]: -1}, number, honest))
    return found


def _gears(m: Moments) -> list[Comparison]:
    """Return each shaft against each driven wheel in each gear; the engine where the shaft is not measured."""
    found = []
    honest = ROUNDED if m.measures_driven else SLIPPING
    driven = [each for front in m.driven_fronts for each in (WHEELS[:2] if front else WHEELS[2:]) if m.has(each)]
    for gear in m.vehicle.gears:
        i = gear.shaft - 1
        name = NAMES[SHAFTS[i]] if m.has(SHAFTS[i]) else "engine"
        speed = m.speed(SHAFTS[i]) if m.has(SHAFTS[i]) else m.engine
        if gear.number < 0:
            continue
        where = m.rolls & (m.ratio[i] == gear.total_ratio)
        if not m.has(SHAFTS[i]):
            where &= m.locked[i]
        for wheel in driven:
            w = m.speed(wheel)
            calm = where & (np.abs(rate(w)) < STEADY_RATE * np.abs(w))
            number = measured(m, log_ratio(speed, w) - np.log(gear.total_ratio), calm)
            if number is not None and number.sigma < 0.02:
                parts = {name: 1, f"gear {gear.number}": -1, NAMES[wheel]: -1}
                found.append(Comparison(parts, number, honest))
    return found


def _engine(m: Moments) -> list[Comparison]:
    """Return the engine against each shaft, while the ratio of both is constant although they change.

    With one clutch locked both shafts turn in a constant ratio to the engine, one of them through two gears. Where
    that is what they do, nothing is said of the other shaft.
    """
    found = []
    for i, quantity in enumerate(SHAFTS):
        if not m.has(quantity):
            continue
        ratio = log_ratio(m.engine, m.speed(quantity))
        turns = np.maximum(m.engine, m.speed(quantity)) > RUNS_RAD_S
        fixed = lasting(np.abs(rate(smooth(ratio))) < CONSTANT_RATE, LOCKED_S, 0.1) & turns
        moving = np.abs(rate(m.engine, 0.2)) > 0.05 * m.engine
        own, other = m.ratio[i], m.ratio[1 - i]
        through = log_ratio(np.where(other > 0.0, other, np.nan), np.where(own > 0.0, own, np.nan))
        tied = np.abs(ratio - through) < FITS
        number = _mode(m, ratio, fixed & moving & (own > 0.0) & ~tied)
        if number is not None:
            found.append(Comparison({"engine": 1, NAMES[quantity]: -1}, number, ENGINE))
    return found


def _mode(m: Moments, values: Floats, where: Mask) -> Number | None:
    """Return what most values are near to: the median of those within `FITS` of it; zero if many are near that."""
    known = where & np.isfinite(values)
    total = np.count_nonzero(known)
    if total * STEP_S < LEAST_S:
        return None
    near = known & (np.abs(values) < FITS)
    if np.count_nonzero(near) > MANY * total:
        return measured(m, values, near)
    bins = np.round(values[known] / FITS).astype(np.int64)
    numbers, counts = np.unique(bins, return_counts=True)
    totals = np.array([counts[np.abs(numbers - number) <= 1].sum() for number in numbers])
    middle = float(np.median(values[known][np.abs(bins - numbers[np.argmax(totals)]) <= 1]))
    near = known & (np.abs(values - middle) < FITS)
    if np.count_nonzero(near) < 0.5 * np.count_nonzero(known):
        return None
    return measured(m, values, near)


@dataclass(frozen=True, slots=True)
class Exchange:
    """How often a shaft turns as its gear wants it, and how often the other shaft does.

    Attributes:
        own: share of the time in gear.
        other: the same of the other shaft.
        seconds: in gear.
    """

    own: float
    other: float
    seconds: float

    @property
    def certain(self) -> bool:
        """Whether the signals of both shafts are exchanged."""
        return self.seconds >= LEAST_S and self.other > 0.8 and self.own < 0.5


def exchange(m: Moments) -> Exchange | None:
    """Return how the shafts fit the gears of each other; None where they are not both measured."""
    if not m.has(*SHAFTS):
        return None
    own = other = total = 0
    inferred = m.series.config.settings.gear_inference is not None
    for gear in m.vehicle.gears:
        i = gear.shaft - 1
        if gear.number < 0:
            continue
        both = [
            np.abs(log_ratio(m.speed(SHAFTS[j]), m.wheels) - np.log(gear.total_ratio)) < FITS for j in (i, 1 - i)
        ]
        where = m.rolls & (np.abs(rate(m.wheels)) < STEADY_RATE * m.wheels)
        where &= (both[0] | both[1]) if inferred else m.ratio[i] == gear.total_ratio
        own += int(np.count_nonzero(where & both[0]))
        other += int(np.count_nonzero(where & both[1]))
        total += int(np.count_nonzero(where))
    return Exchange(own / max(total, 1), other / max(total, 1), total * STEP_S)


def misread_gears(m: Moments) -> dict[int, int]:
    """Return which gear it is that is told as another one, for each that turns as another one.

    A shaft turns as another gear of its own; with one gear for the whole gearbox the engine does, while locked.
    """
    found = {}
    one = m.has(Quantity.GEAR)
    for gear in m.vehicle.gears:
        i = gear.shaft - 1
        if gear.number < 0 or not (one or m.has(SHAFTS[i])):
            continue
        where = m.rolls & (m.ratio[i] == gear.total_ratio) & (np.abs(rate(m.wheels)) < STEADY_RATE * m.wheels)
        where &= (m.locked[0] | m.locked[1]) if one else True
        number = measured(m, log_ratio(m.engine if one else m.speed(SHAFTS[i]), m.wheels), where)
        if number is None or number.sigma > FITS:
            continue
        for other in m.vehicle.gears if one else m.vehicle.gears_on(gear.shaft):
            is_other = abs(number.value - np.log(abs(other.total_ratio))) < FITS
            if other.number not in (gear.number, -1) and is_other:
                found[gear.number] = other.number
    return found


def drive_slope(m: Moments) -> Number | None:
    """Return by which share the front wheels turn faster than the rear ones, for each m/s² without brake.

    Positive: the front ones drive. Driven tyres slip in proportion to their force.
    """
    if m.driven is DrivenAxle.ALL or not (m.measures(True) and m.measures(False)):
        return None
    front, rear = m.axle(True), m.axle(False)
    slip = log_ratio(smooth(front, 0.15), smooth(rear, 0.15))
    acceleration = rate(0.5 * (front + rear), 0.15) * m.vehicle.chassis.wheel_radius_m
    where = lasting(m.rolls & m.free & np.isfinite(slip + acceleration) & (np.abs(slip) < 0.5), 0.2, 0.2)
    if np.count_nonzero(where) * STEP_S < 3 * LEAST_S:
        return None
    columns = [acceleration[where], np.ones(int(np.count_nonzero(where)))]
    found = fit(m.t_s[where], columns, slip[where], STEP_S)
    return None if found is None else found.number(0)
