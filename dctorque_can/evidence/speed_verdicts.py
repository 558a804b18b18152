"""What the speeds say against a vehicle file, and what would be right."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from dctorque_can.config.document import shown
from dctorque_can.config.units import Dimension, UnitError, factor_to_si
from dctorque_can.driveline.parameters import DrivenAxle
from dctorque_can.evidence.causes import Found, explain
from dctorque_can.evidence.draft import Draft, Fix, number
from dctorque_can.evidence.findings import Finding, Picture, Severity
from dctorque_can.evidence.fits import Number
from dctorque_can.evidence.moments import SHAFTS, WHEELS, Moments, rate, smooth
from dctorque_can.evidence.pictures import against, thinned
from dctorque_can.evidence.speeds import (
    NAMES,
    RADIUS,
    STEADY_RATE,
    backwards,
    causes,
    comparisons,
    drive_slope,
    exchange,
    log_ratio,
    misread_gears,
    unit_of,
    unit_of_wheels,
)
from dctorque_can.pipeline.samples import Quantity

LARGE = 0.04
"""Share by which a speed must be off for torques not to be valid: the filter takes it for a clutch that slips."""
TINY = 0.0007
"""Share by which a radius that is off in all gears alike is told: ratios with three digits are as good."""
FEWEST_GEARS = 3
FEW_CAUSES = 3
"""More wrong scales at once are none: something else is wrong."""
AXLE_SLOPE = 0.001
"""Slip per m/s² below which the driven axle is not decided: unequal brakes, hills."""
_RATIOS = frozenset({"gear_ratio", "wheel_speeds", "axle_speeds"})
_CROSSED = _RATIOS | {"shafts_exchanged", "gear_signal"}
_BY_NAME = {name: quantity for quantity, name in NAMES.items()}


def signs(m: Moments, draft: Draft) -> list[Finding]:
    """Return the speeds whose sign is reversed."""
    found = []
    for quantity in backwards(m):
        key = draft.key_of(quantity)
        text = "negative while the car is driven forwards: its sign is reversed"
        picture = _sign_picture(m, quantity)
        found.append(Finding("error", key, text, -1.0, None, draft.scaled(quantity, -1.0), _RATIOS, picture))
    return found


def exchanged_shafts(m: Moments, draft: Draft) -> list[Finding]:
    """Return whether the signals of both shafts are exchanged."""
    share = exchange(m)
    if share is None or not share.certain:
        return []
    first, second = (draft.key_of(quantity) for quantity in SHAFTS)
    text = (
        f"shaft1_speed and shaft2_speed are exchanged: {share.other:.0%} of the time in gear each turns as the "
        f"gear of the other one wants it, {share.own:.0%} as its own"
    )
    picture = _ratio_picture(m, 0)
    return [Finding("error", first, text, None, None, draft.exchanged(first, second), _CROSSED, picture)]


def driven_axle(m: Moments, draft: Draft) -> list[Finding]:
    """Return whether the other axle is driven than the file says."""
    slope = drive_slope(m)
    if slope is None or m.driven is DrivenAxle.ALL:
        return []
    drives_front = slope.value > 0.0
    certain = abs(slope.value) > 3.0 * slope.sigma and abs(slope.value) > AXLE_SLOPE + slope.sigma
    if not certain or drives_front == (m.driven is DrivenAxle.FRONT):
        return []
    axle = "front" if drives_front else "rear"
    percent = Number(100.0 * abs(slope.value), 100.0 * slope.sigma, slope.seconds).shown("% per m/s²")
    text = f"rolling axle: {axle} is driven: its wheels turn faster the harder the car accelerates, by {percent}"
    acceleration = rate(m.body, 0.15) * m.vehicle.chassis.wheel_radius_m
    slip = 100.0 * log_ratio(smooth(m.axle(True), 0.15), smooth(m.axle(False), 0.15))
    sign = 1.0 if m.driven is DrivenAxle.FRONT else -1.0
    picture = against(
        ("acceleration, m/s²", "front against rear wheels, %"),
        thinned(acceleration, slip, m.rolls & m.free & (np.abs(slip) < 10.0)),
        {
            f"the log: {slope.value:+.2%} per m/s²": lambda x: 100.0 * slope.value * x,
            "the file: the other axle": lambda x: sign * 100.0 * abs(slope.value) * x,
        },
    )
    fix = (("vehicle.driven_axle", axle),)
    return [Finding("error", "vehicle.driven_axle", text, None, None, fix, frozenset({"driven_axle"}), picture)]


def units(m: Moments, draft: Draft) -> list[Finding]:
    """Return the unit of the wheels, where gears are told by ratios alone and none fits."""
    factor = unit_of_wheels(m)
    return [] if factor is None else [_wheels_finding(m, draft, Number(-float(np.log(factor)), 0.01, 0.0))]


def scales(m: Moments, draft: Draft) -> list[Finding]:
    """Return the few scales and ratios that explain what the speeds contradict, or gears that are told wrongly."""
    radius = draft.honest("vehicle.chassis.wheel_radius_m", RADIUS)
    found = explain(comparisons(m), causes(m, radius))
    misread = misread_gears(m)
    if len(misread) > 1 and len(found) > 1:
        return list(_misread(m, draft, misread))
    if len(found) > FEW_CAUSES:
        return []
    return [each for cause in found for each in _scale(m, draft, cause)] or _radius(m, draft)


def _radius(m: Moments, draft: Draft) -> list[Finding]:
    """Return the wheel radius, where road speeds are turned by another one than the brakes have it.

    However honest a radius is: a filter that is told a stiff shaft takes what is left of a speed for its twist.
    """
    wheels = [each for each in WHEELS if m.has(each)]
    if not wheels or not _is_road_speed(draft.unit(wheels[0])):
        return []
    by_gear: dict[str, list[float]] = {}
    for each in comparisons(m):
        for part in each.parts:
            if part.startswith("gear "):
                by_gear.setdefault(part, []).append(each.log.value)
    off = np.array([np.mean(values) for values in by_gear.values()])
    if len(off) < FEWEST_GEARS:
        return []
    sigma = float(np.hypot(np.std(off, ddof=1) / np.sqrt(len(off)), TINY / 3.0))
    log = Number(-float(off.mean()), sigma, 0.0)
    return [_wheels_finding(m, draft, log)] if abs(log.value) > max(3.0 * sigma, TINY) else []


def _scale(m: Moments, draft: Draft, found: Found) -> Iterator[Finding]:
    name, log = found.cause.name, found.log
    if name.startswith(("gear ", "final drive ")):
        yield from _gear(m, draft, found)
    elif name == "wheels":
        yield _wheels_finding(m, draft, log)
    else:
        quantities = [_BY_NAME[part] for part in found.cause.parts]
        factor = Number(float(np.exp(log.value)), float(np.exp(log.value)) * log.sigma, log.seconds)
        key = draft.key_of(quantities[0])
        words = {"engine": "engine_speed is", "shafts": "both shaft speeds are", "front": "the front wheels are"}
        words |= {"rear": "the rear wheels are", "shaft1": "shaft1_speed is", "shaft2": "shaft2_speed is"}
        what = words.get(name, f"the wheel {name} is")
        fix: Fix = ()
        for quantity in quantities:
            fix += draft.scaled(quantity, 1.0 / factor.value)
        severity = _severity(log)
        text = f"{what} {_too(factor)} against the other speeds{_unit(log)}"
        explains = _RATIOS | {"clutch1_called_open", "clutch2_called_open"}
        told = 1.0 / factor.value
        sigma = factor.sigma / factor.value**2
        yield Finding(severity, key, text, told, sigma, fix, explains, _scale_picture(m, quantities[0], factor))


def _gear(m: Moments, draft: Draft, found: Found) -> Iterator[Finding]:
    """Yield a finding for one ratio, or for the final drive of several gears."""
    factor = float(np.exp(-found.log.value))
    numbers = [int(part.split()[1]) for part in found.cause.parts]
    single = len(numbers) == 1
    name = "ratio" if single else "final_drive"
    gear = m.vehicle.gear(numbers[0])
    told = gear.ratio if single else gear.final_drive
    right = Number(told * factor, told * factor * found.log.sigma, found.log.seconds)
    fix = tuple((f"vehicle.gears.{n}.{name}", number(right.value)) for n in numbers)
    key = f"vehicle.gears.{numbers[0]}.{name}"
    which = f"gears.{numbers[0]}" if single else f"final_drive of gears {', '.join(map(str, numbers))}"
    severity = _severity(found.log)
    text = f"{which}: the log has {right.shown()}, the file {told:g}"
    picture = _ratio_picture(m, gear.shaft - 1, gear.total_ratio, gear.total_ratio * factor, numbers[0])
    yield Finding(severity, key, text, right.value, right.sigma, fix, _RATIOS, picture)


def _wheels_finding(m: Moments, draft: Draft, log: Number) -> Finding:
    """Return the finding for all wheels alike, whose speeds are exp(log) times what shafts and ratios say."""
    factor = Number(float(np.exp(log.value)), float(np.exp(log.value)) * log.sigma, log.seconds)
    wheels = [each for each in WHEELS if m.has(each)]
    severity = _severity(log)
    unit = _unit(log)
    picture = _scale_picture(m, wheels[0], factor)
    if not unit and _is_road_speed(draft.unit(wheels[0])) and abs(log.value) < 0.2:
        told = m.vehicle.chassis.wheel_radius_m
        right = Number(told * factor.value, told * factor.sigma, log.seconds)
        key = "vehicle.chassis.wheel_radius_m"
        fits = f"{right.shown('m')} fits, the file has {told:g}"
        text = f"the wheel speeds are {_too(factor)}, or wheel_radius_m is: {fits}"
        return Finding(
            severity, key, text, right.value, right.sigma, ((key, number(right.value, 5)),), _RATIOS, picture
        )
    fix: Fix = ()
    for quantity in wheels:
        fix += draft.scaled(quantity, 1.0 / factor.value)
    text = f"the wheel speeds are {_too(factor)} against shafts and ratios{unit}"
    right = Number(1.0 / factor.value, factor.sigma / factor.value**2, log.seconds)
    return Finding(severity, "inputs.wheel_speeds", text, right.value, right.sigma, fix, _RATIOS, picture)


def _misread(m: Moments, draft: Draft, misread: dict[int, int]) -> Iterator[Finding]:
    """Yield a finding for each gear signal whose values mean other gears than told."""
    one = m.has(Quantity.GEAR)
    for shaft in (1,) if one else (1, 2):
        own = {told: is_ for told, is_ in misread.items() if one or m.vehicle.gear(told).shaft == shaft}
        if not own:
            continue
        key = "gears.actual.values" if draft.value("gears.actual") else f"gears.shaft{shaft}.values"
        values = draft.value(key)
        fix: Fix = ()
        if isinstance(values, dict):
            fix = ((key, shown({raw: own.get(gear, gear) for raw, gear in values.items()})),)
        words = ", ".join(f"what is told as gear {told} turns as gear {is_}" for told, is_ in own.items())
        text = f"{words}: the values of the gear signal are wrong"
        yield Finding("error", key, text, None, None, fix, _CROSSED, _ratio_picture(m, shaft - 1))


def _is_road_speed(unit: str) -> bool:
    try:
        factor_to_si(unit, Dimension.ROTATION, wheel_radius_m=1.0)
    except UnitError:
        return True
    return False


def _severity(log: Number) -> Severity:
    return "error" if abs(log.value) > LARGE else "warning"


def _unit(log: Number) -> str:
    unit = unit_of(log.value)
    return f": {unit}?" if unit else ""


def _too(factor: Number) -> str:
    """Return by how much something is too large or too small, in words."""
    if 0.7 < factor.value < 1.5:
        percent = Number(100.0 * abs(factor.value - 1.0), 100.0 * factor.sigma, factor.seconds)
        return f"{percent.shown()} % too {'large' if factor.value > 1.0 else 'small'}"
    return f"too {'large' if factor.value > 1.0 else 'small'} by a factor of {_larger(factor).shown()}"


def _larger(factor: Number) -> Number:
    return factor if factor.value > 1.0 else Number(1.0 / factor.value, factor.sigma / factor.value**2, 0.0)


def _sign_picture(m: Moments, quantity: Quantity) -> Picture:
    """Return a speed over the time."""
    labels = ("time, s", f"{NAMES[quantity]} as told, rad/s")
    return against(labels, thinned(m.t_s, m.speed(quantity)), {"the file: forwards is above": lambda t: 0.0 * t})


def _scale_picture(m: Moments, quantity: Quantity, factor: Number) -> Picture:
    """Return a speed against what the others say of it."""
    name = NAMES[quantity]
    if quantity in WHEELS:
        in_gear = np.argmax(m.ratio > 0.0, axis=0)
        row = np.arange(len(m.t_s))
        with np.errstate(divide="ignore", invalid="ignore"):
            x = np.where(m.ratio[in_gear, row] > 0.0, m.shaft[in_gear, row] / m.ratio[in_gear, row], np.nan)
        label = "by input shaft and ratio, rad/s"
    elif quantity is Quantity.ENGINE_SPEED:
        x, label = np.where(m.ratio[0] > 0.0, m.shaft[0], np.nan), "input shaft 1, rad/s"
    else:
        i = 0 if quantity is SHAFTS[0] else 1
        x, label = np.where(m.ratio[i] > 0.0, m.ratio[i] * m.wheels, np.nan), "by wheels and ratio, rad/s"
    lines = {"the file: alike": lambda v: v, f"the log: times {factor.value:.4g}": lambda v: factor.value * v}
    return against((label, f"{name} as told, rad/s"), thinned(x, m.speed(quantity), m.rolls), lines)


def _ratio_picture(
    m: Moments, i: int, told: float | None = None, right: float | None = None, gear: int | None = None
) -> Picture:
    """Return the ratio of an input shaft to the wheels over the time, with that of a gear as told and as it is."""
    ratio = np.exp(log_ratio(m.speed(SHAFTS[i]) if m.has(SHAFTS[i]) else m.engine, m.wheels))
    where = m.rolls & (np.abs(rate(m.wheels)) < STEADY_RATE * m.wheels) & (m.ratio[i] > 0.0)
    where &= ratio < 1.5 * max(each.total_ratio for each in m.vehicle.gears)
    lines = {
        f"the file: gear {each.number}": each.total_ratio for each in m.vehicle.gears_on(i + 1) if each.number > 0
    }
    if told is not None and right is not None:
        where &= (ratio > 0.8 * min(told, right)) & (ratio < 1.25 * max(told, right)) & (m.gear[i] == gear)
        lines = {"the file": told, "the log": right}
    drawn = {name: partial(np.full_like, fill_value=level) for name, level in lines.items()}
    label = f"input shaft {i + 1} over driven wheels"
    return against(("time, s", label), thinned(m.t_s, ratio, where), drawn)
