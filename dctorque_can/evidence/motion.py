"""What is told of the car's motion against its speeds: brake, acceleration, grade, direction.

An accelerometer along the car has dv/dt + g sin(grade). Its changes within 0.8 s are those of dv/dt, since the
grade has hardly changed; what it has beside dv/dt for seconds is the grade. Without it the engine's force tells,

    g sin(grade) = F_e/m − dv/dt (m + J/r²)/m − what grows with the square of the speed − a constant.

While the car gathers speed it is not braked: what the signal of the brake says then means off. All signs are those
of a car that goes forwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dctorque_can.driveline.parameters import STANDARD_GRAVITY
from dctorque_can.evidence.fits import BLOCK_S, Slope, slope
from dctorque_can.evidence.moments import (
    RUNS_RAD_S,
    SHAFTS,
    STEP_S,
    Mask,
    Moments,
    change,
    lasting,
    rate,
    smooth,
)
from dctorque_can.evidence.series import Floats
from dctorque_can.evidence.torques import SPAN_S
from dctorque_can.pipeline.samples import Quantity

LEAST_S = 1.5
"""Seconds that something must have been seen for: one braking to a stop is longer."""
NEARLY_ALWAYS = 0.8
"""Share of the time."""
ACCELERATION_S = 3.0
"""Seconds of changes that an acceleration needs."""
GRADE_S = 30.0
"""Seconds of driving that a grade needs: some hills."""
MOVES_M_S2 = 0.5
"""Change of the acceleration within 0.8 s that shows its scale: several times the noise of sensors."""
GATHERS_M_S2 = 0.7
"""A car that gathers speed so is not being braked: more than a road of 7 % alone makes it do."""
SLOWS_M_S2 = 3.5
"""A car that slows down so is being braked: an engine in first gear and a road of 20 % do less."""
ALIKE = 0.7
"""Correlation from which on two signals have a scale: half of what they do is alike."""
FITS = 0.3
"""Share by which the scale of an acceleration may be off that still tells a grade."""
TURNS_RAD_S = 2.0
"""Wheels that turn faster are no longer at rest for any sensor of a direction."""
HILL_S = 15.0
"""What is left of a grade is alike for so long: wind, and the hill itself."""
_ACCELERATION_S, _GRADE_S = 0.15, 1.0  # of smoothing
_REVERSE = -1


@dataclass(frozen=True, slots=True)
class Compared:
    """What is told, x, and what the speeds say of it, y.

    Attributes:
        slope: of y over x: what is told is to be multiplied with that.
        x, y: for a picture ``[n]``, less their medians.
    """

    slope: Slope
    x: Floats
    y: Floats


def speed_rate(m: Moments, sigma_s: float = _ACCELERATION_S) -> Floats:
    """Return dv/dt of the wheels that are not driven, m/s² ``[n]``."""
    return m.vehicle.chassis.wheel_radius_m * rate(m.body, sigma_s)


def acceleration(m: Moments) -> Compared | None:
    """Return changes of dv/dt over those of the told acceleration, m/s²; None where the drive shows too little."""
    if not m.has(Quantity.ACCELERATION):
        return None
    x = change(smooth(m.speed(Quantity.ACCELERATION), _ACCELERATION_S), SPAN_S)
    y = change(speed_rate(m), SPAN_S)
    where = lasting(m.rolls, SPAN_S, SPAN_S) & np.isfinite(x + y)
    if np.count_nonzero(where & (np.abs(y) > MOVES_M_S2)) * STEP_S < ACCELERATION_S:
        return None
    return _compared(m, where, x, y, [])


def feels_grade(m: Moments) -> bool:
    """Return whether the told acceleration is one from which the grade can be taken."""
    found = acceleration(m)
    return found is not None and found.slope.correlation > ALIKE and abs(found.slope.number.value - 1.0) < FITS


def grade(m: Moments) -> Compared | None:
    """Return the grade by accelerometer, or else by engine torque, over the told one; None of too little.

    The rate of the speed is a column of its own: it takes what is wrong with pitch, mass and scales.
    """
    if not m.has(Quantity.GRADE):
        return None
    gathers = speed_rate(m, _GRADE_S) / STANDARD_GRAVITY
    ones = np.ones(len(m.t_s))
    if feels_grade(m):
        felt = smooth(m.speed(Quantity.ACCELERATION), _GRADE_S) / STANDARD_GRAVITY
        y, others = felt - gathers, [gathers, ones]
        where = m.rolls
    else:
        y = _force(m) - gathers * m.vehicle.chassis.inertia_kgm2 / _leverage(m)
        others = [gathers, smooth(m.body, _GRADE_S) ** 2, ones]
        where = m.rolls & m.free
    x = smooth(np.sin(np.clip(m.speed(Quantity.GRADE), -np.pi / 2, np.pi / 2)), _GRADE_S)
    where = where & np.isfinite(x + y + gathers)
    if np.count_nonzero(where) * STEP_S < GRADE_S:
        return None
    return _compared(m, where, x, y, others, HILL_S)


def _leverage(m: Moments) -> float:
    """Return m r², kg·m²."""
    chassis = m.vehicle.chassis
    return chassis.mass_kg * chassis.wheel_radius_m**2


def _force(m: Moments) -> Floats:
    """Return the engine's force on the car over its weight ``[n]``; not-a-number unless one clutch is locked."""
    vehicle = m.vehicle
    row = np.arange(len(m.t_s))
    i = np.where(m.locked[0], 0, 1)
    one = (m.locked[0] != m.locked[1]) & (m.ratio[i, row] > 0.0)
    shafts = np.array([vehicle.shaft_inertia_kgm2(1), vehicle.shaft_inertia_kgm2(2)])[i]
    inertia = vehicle.engine_inertia_kgm2 + vehicle.damper.inertia_kgm2 + shafts
    torque = smooth(m.torque, _GRADE_S) - inertia * rate(m.engine, _GRADE_S)
    efficiency = vehicle.gear_efficiency * vehicle.final_drive_efficiency
    at_wheel = torque * m.ratio[i, row] * np.where(torque > 0.0, efficiency, 1.0 / efficiency)
    weight = vehicle.chassis.mass_kg * STANDARD_GRAVITY * vehicle.chassis.wheel_radius_m
    return np.where(lasting(one, _GRADE_S, _GRADE_S), at_wheel / weight, np.nan)


def _compared(
    m: Moments, where: Mask, x: Floats, y: Floats, others: list[Floats], block_s: float = BLOCK_S
) -> Compared | None:
    columns = [each[where] for each in others]
    x, y = x[where], y[where]
    found = slope(m.t_s[where], x, y, columns, STEP_S, block_s)
    return None if found is None else Compared(found, x - np.median(x), y - np.median(y))


class Share(NamedTuple):
    """How often something is so.

    Attributes:
        share: of the time.
        seconds: that time.
    """

    share: float
    seconds: float

    def is_most(self) -> bool:
        """Return whether it is nearly always so, and was seen for long enough."""
        return self.share > NEARLY_ALWAYS and self.seconds >= LEAST_S


@dataclass(frozen=True, slots=True)
class Braked:
    """What the signal of the brake says.

    Attributes:
        on: how often it says braking.
        on_gathering: … while the car gathers speed.
        on_slowing: … while the car slows down as by brakes alone.
        least, most: of the signal while the car gathers speed, but for one moment in a hundred each, in its unit.
        below, above: how often the car slows down while the signal is beyond these.
    """

    on: Share
    on_gathering: Share
    on_slowing: Share
    least: float
    most: float
    below: Share
    above: Share


def brake(m: Moments) -> Braked | None:
    """Return what the signal of the brake says; None where it says nothing, or the car never gathers speed."""
    if not m.has(Quantity.BRAKE):
        return None
    told, gathers = m.series.told(Quantity.BRAKE, m.t_s), speed_rate(m)
    known = m.rolls & np.isfinite(told + gathers)
    gathering = lasting(known & (gathers > GATHERS_M_S2), 0.3, 0.3)
    slowing = lasting(known & (gathers < -SLOWS_M_S2), 0.3, 0.3)
    if not gathering.any():
        return None
    least, most = (float(each) for each in np.quantile(told[gathering], [0.01, 0.99]))
    on, slows = told > 0.0, gathers < 0.0
    return Braked(
        _share(on, known),
        _share(on, gathering),
        _share(on, slowing),
        least,
        most,
        _share(slows, known & (told < least)),
        _share(slows, known & (told > most)),
    )


@dataclass(frozen=True, slots=True)
class Ways:
    """How often the signal of the direction says which way, of the time that the car certainly goes one way.

    Attributes:
        forward, backward: how often it says so in forward gears.
        forward_in_reverse: how often it says forward in reverse.
    """

    forward: Share
    backward: Share
    forward_in_reverse: Share


def ways(m: Moments) -> Ways | None:
    """Return what the signal of the direction says; None where there is none.

    Forwards: no car rolls backwards at 9 km/h with a forward gear in. Backwards: an engine that turns with the
    shaft of the reverse gear, since no engine turns backwards.
    """
    if not m.has(Quantity.DIRECTION):
        return None
    told = m.series.told(Quantity.DIRECTION, m.t_s)
    known = np.isfinite(told)
    forwards = lasting(m.rolls & known & ((m.ratio[0] > 0.0) | (m.ratio[1] > 0.0)), 0.5)
    backwards = known & False
    for i, quantity in enumerate(SHAFTS):
        if m.has(quantity):
            slip = np.abs(smooth(np.abs(m.engine) - np.abs(m.shaft[i])))
            turns = (np.abs(m.wheels) > TURNS_RAD_S) & (m.engine > RUNS_RAD_S) & (slip < 0.03 * m.engine)
            backwards |= lasting((m.gear[i] == _REVERSE) & turns & known, 0.5, 0.1)
    return Ways(_share(told > 0.5, forwards), _share(told < -0.5, forwards), _share(told > 0.5, backwards))


def _share(true: Mask, where: Mask) -> Share:
    """Return how often something is so, of the moments in ``where``."""
    count = np.count_nonzero(where)
    return Share(float(np.mean(true[where])) if count else 0.0, float(count * STEP_S))
