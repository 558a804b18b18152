"""What the speeds say of brake, acceleration, grade and direction, and what would be right."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, log

import numpy as np

from dctorque_can.config.document import shown
from dctorque_can.driveline.parameters import STANDARD_GRAVITY
from dctorque_can.evidence.draft import Draft, Fix, number
from dctorque_can.evidence.findings import Finding, Picture
from dctorque_can.evidence.fits import Number, Slope
from dctorque_can.evidence.moments import Moments
from dctorque_can.evidence.motion import (
    ALIKE,
    GATHERS_M_S2,
    LEAST_S,
    SLOWS_M_S2,
    Compared,
    Share,
    acceleration,
    brake,
    feels_grade,
    grade,
    speed_rate,
    ways,
)
from dctorque_can.evidence.pictures import against, thinned
from dctorque_can.pipeline.samples import Quantity

HONEST_ACCELERATION = 0.08
"""Standard deviation of the scale of an accelerometer on a right file, natural logarithm: pitch, tyres."""
HONEST_GRADE = 0.15
"""… of a grade, which control units filter and round."""
HONEST_MASS = 0.15
"""… of mass and torque together, by which a grade is measured where no acceleration is told."""
REVERSED = -0.5
"""Correlation below which a sign is reversed."""
STRANGE = 0.2
"""Correlation with dv/dt below which an acceleration is none along the car: that of a good one is nearly 1."""
HALF, SELDOM = 0.5, 0.1
"""Shares of the time."""
_DEGREE = np.pi / 180.0
_ACCELERATIONS = {
    "g instead of m/s²": STANDARD_GRAVITY,
    "m/s² instead of g": 1.0 / STANDARD_GRAVITY,
    "cm/s² instead of m/s²": 0.01,
    "mg instead of m/s²": 1e-3 * STANDARD_GRAVITY,
}
_GRADES = {
    "% instead of deg": 0.01 / _DEGREE,
    "% instead of rad": 0.01,
    "deg instead of %": _DEGREE / 0.01,
    "deg instead of rad": _DEGREE,
    "rad instead of deg": 1.0 / _DEGREE,
    "rad instead of %": 100.0,
}
"""What the bus has instead of what the file says, and the factor that corrects it."""
_BRAKED = frozenset({"road_load", "driven_axle"})


def brakes(m: Moments, draft: Draft) -> list[Finding]:
    """Return whether the brake is told the wrong way round, or as on while the car gathers speed."""
    found = brake(m)
    if found is None or found.on_gathering.seconds < LEAST_S:
        return []
    key = draft.key_of(Quantity.BRAKE)
    value: float | None = None
    fix: Fix = ()
    if found.on_gathering.share > HALF:
        told = f"told as on for {_of_time(found.on_gathering)} in which the car gathers speed"
        if found.above.is_most():
            text = f"an offset of up to {found.most:.3g}: {told}"
            value, fix = -found.most, draft.shifted(Quantity.BRAKE, -found.most)
        elif found.below.is_most():
            text = f"on and off are exchanged: {told}, and as less while it slows down"
            value, fix = -1.0, draft.taken_from(Quantity.BRAKE, found.least)
        else:
            text = f"another signal, or stuck: {told}"
    elif found.on.share == 0.0 and found.below.is_most():
        text = f"its sign is reversed: never told as on, and less than {found.least:.3g} while the car slows down"
        value, fix = -1.0, draft.taken_from(Quantity.BRAKE, found.least)
    else:
        return []
    text = f"brake: {text}"
    return [Finding("warning", key, text, value, None, fix, _BRAKED, _brake_picture(m))]


def brakes_untold(m: Moments, draft: Draft) -> list[Finding]:
    """Return whether no brake is told while the car slows down as by brakes alone."""
    found = brake(m)
    if found is None or found.on_slowing.seconds < LEAST_S or found.on_slowing.share > SELDOM:
        return []
    text = (
        f"brake: another signal, or its values? Told as on for {_of_time(found.on_slowing)} in which the car "
        f"slows down by more than {SLOWS_M_S2:g} m/s², as by brakes alone"
    )
    return [Finding("warning", draft.key_of(Quantity.BRAKE), text, explains=_BRAKED, picture=_brake_picture(m))]


def accelerations(m: Moments, draft: Draft) -> list[Finding]:
    """Return whether sign or scale of the acceleration is wrong, or it is none along the car."""
    found = acceleration(m)
    if found is None:
        return []
    labels = ("acceleration as told, changes over 0.8 s, m/s²", "dv/dt by the wheels, m/s²")
    picture = _slope_picture(found, labels)
    if abs(found.slope.correlation) < STRANGE and not found.slope.least.is_off(0.0, 0.0):
        text = (
            "acceleration: another signal than that along the car: it has nothing to do with that of the wheels "
            f"(correlation {found.slope.correlation:+.2f})"
        )
        return [Finding("warning", draft.key_of(Quantity.ACCELERATION), text, picture=picture)]
    return _scale(draft, Quantity.ACCELERATION, found.slope, HONEST_ACCELERATION, _ACCELERATIONS, picture)


def grades(m: Moments, draft: Draft) -> list[Finding]:
    """Return whether sign or scale of the grade is wrong."""
    found = grade(m)
    if found is None:
        return []
    by_torque = not feels_grade(m)
    honest = (
        hypot(HONEST_GRADE, draft.honest("vehicle.chassis.mass_kg", HONEST_MASS)) if by_torque else HONEST_GRADE
    )
    source = "engine torque and dv/dt" if by_torque else "acceleration less dv/dt"
    labels = ("grade as told, sine, less its median", f"grade by {source}, sine, less its median")
    return _scale(draft, Quantity.GRADE, found.slope, honest, _GRADES, _slope_picture(found, labels))


def told_direction(m: Moments, draft: Draft) -> list[Finding]:
    """Return whether the direction is told the wrong way round, or not at all."""
    said = ways(m)
    if said is None:
        return []
    key = draft.key_of(Quantity.DIRECTION)
    fix: Fix = ()
    if said.backward.is_most():
        text = f"both are exchanged: says backward for {_of_time(said.backward)} driven in forward gears"
        other = {"forward": "backward", "backward": "forward"}
        values = {raw: other.get(way, way) for raw, way in draft.value(f"{key}.values").items()}
        fix = ((f"{key}.values", shown(values)),)
    elif said.forward.seconds >= LEAST_S and said.forward.share < SELDOM:
        text = f"says forward for {_of_time(said.forward)} driven in forward gears: look at values"
    elif said.forward_in_reverse.is_most():
        text = f"says forward for {_of_time(said.forward_in_reverse)} driven in reverse: stuck, or wrong values"
    else:
        return []
    return [Finding("warning", key, f"direction: {text}", fix=fix, picture=_direction_picture(m))]


def _of_time(share: Share) -> str:
    return f"{share.share:.0%} of the {share.seconds:.0f} s"


def _is_reversed(found: Slope) -> bool:
    return found.least.value + 3.0 * found.least.sigma < 0.0 and found.correlation < REVERSED


def _scale(
    draft: Draft, quantity: Quantity, found: Slope, honest: float, units: Mapping[str, float], picture: Picture
) -> list[Finding]:
    """Return whether a signal has another sign or another scale than the speeds mean."""
    right = found.number
    reversed_ = _is_reversed(found)
    if abs(found.correlation) < ALIKE:
        size, off = Number(1.0, 0.0, right.seconds), False
    else:
        size = Number(abs(right.value), right.sigma, right.seconds)
        off = Number(log(size.value), size.sigma / size.value, right.seconds).is_off(0.0, honest)
    if not reversed_ and (right.value < 0.0 or not off):
        return []
    factor, words = -1.0 if reversed_ else 1.0, []
    if reversed_:
        words.append(f"its sign is reversed (correlation {found.correlation:+.2f})")
    if off:
        unit = min(units, key=lambda each: abs(log(size.value / units[each])))
        is_unit = abs(log(size.value / units[unit])) < 2.0 * hypot(size.sigma / size.value, honest)
        words.append(f"it is to be multiplied with {size.shown()}" + (f" ({unit}?)" if is_unit else ""))
        factor *= units[unit] if is_unit else float(number(size.value, 3))
    text = f"{quantity.name.lower()}: {' and '.join(words)}, by the speeds of the wheels"
    fix = draft.scaled(quantity, factor)
    return [Finding("warning", draft.key_of(quantity), text, right.value, right.sigma, fix, picture=picture)]


def _slope_picture(found: Compared, labels: tuple[str, str]) -> Picture:
    factor = found.slope.number.value
    lines = {"the file: alike": lambda x: x, f"the log: times {factor:.3g}": lambda x: factor * x}
    return against(labels, thinned(found.x, found.y), lines)


def _brake_picture(m: Moments) -> Picture:
    """Return the acceleration against what is told of the brake."""
    told = m.series.told(Quantity.BRAKE, m.t_s)
    labels = ("brake as told", "dv/dt while the car rolls, m/s²")
    lines = {"not braked, to be sure": lambda x: 0.0 * x + GATHERS_M_S2}
    return against(labels, thinned(told, speed_rate(m), m.rolls), lines)


def _direction_picture(m: Moments) -> Picture:
    told = m.series.told(Quantity.DIRECTION, m.t_s)
    labels = ("time, s", "direction as told: 1 forward, -1 backward")
    in_gear = (m.ratio[0] > 0.0) | (m.ratio[1] > 0.0)
    lines = {"forward gears": lambda x: 0.0 * x + 1.0}
    return against(labels, thinned(m.t_s, told, m.rolls & in_gear), lines)
