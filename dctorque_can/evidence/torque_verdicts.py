"""What the accelerations say of engine torque, inertia and mass, and what would be right."""

from __future__ import annotations

from math import log

from dctorque_can.evidence.draft import Draft, number
from dctorque_can.evidence.findings import Finding, Picture
from dctorque_can.evidence.fits import Number
from dctorque_can.evidence.moments import Moments
from dctorque_can.evidence.pictures import against, thinned
from dctorque_can.evidence.torques import Factors, factors, idle_torque, overrun_torque
from dctorque_can.pipeline.samples import Quantity

HONEST_MASS = 0.12
"""Standard deviation of mass and torque together, natural logarithm, on a right file: load, a weak engine."""
HONEST_INERTIA = 0.25
"""… of the engine's inertia and torque: lag of the torque, what hangs on the crankshaft."""
HONEST_OFFSET_NM = 5.0
"""… of the engine torque at idle: alternator, pumps, drag of the open clutches."""
ALIKE = 1.5
"""Factors of engine and car within this of each other come from the torque."""
POUND_FOOT_NM = 1.355818
_FACTORS = frozenset(
    {"engine_torque_sign", "engine_torque_scale", "engine_torque_or_mass", "mass", "engine_inertia", "road_load"}
)
_OFFSET = frozenset({"engine_torque_offset", "road_load"})


def offset(m: Moments, draft: Draft) -> list[Finding]:
    """Return whether the engine torque has an offset, or friction is not taken off it."""
    idle, overrun = idle_torque(m), overrun_torque(m)
    key = draft.key_of(Quantity.ENGINE_TORQUE)
    if idle is None:
        return []
    friction = (
        overrun is not None
        and abs(overrun.value) < 0.5 * HONEST_OFFSET_NM
        and idle.value > 3.0 * max(idle.sigma, 0.5 * HONEST_OFFSET_NM)
    )
    if friction and overrun is not None:
        text = (
            f"friction is not taken off: {idle.shown('N·m')} at idle with open clutches, where net torque is "
            f"nearly zero, and never less than {overrun.value:+.0f} N·m while the engine brakes the car"
        )
        return [Finding("warning", key, text, -idle.value, idle.sigma, (), _OFFSET, _idle_picture(m, 0.0))]
    if not idle.is_off(0.0, HONEST_OFFSET_NM):
        return []
    text = f"an offset: {idle.shown('N·m')} at idle with open clutches, where net torque is nearly zero"
    fix = draft.shifted(Quantity.ENGINE_TORQUE, -idle.value) if draft.unit(Quantity.ENGINE_TORQUE) != "%" else ()
    return [Finding("error", key, text, -idle.value, idle.sigma, fix, _OFFSET, _idle_picture(m, idle.value))]


def scale(m: Moments, draft: Draft) -> list[Finding]:
    """Return whether sign or scale of the engine torque, the mass, or the engine's inertia is wrong."""
    found = factors(m)
    if found is None:
        return []
    key = draft.key_of(Quantity.ENGINE_TORQUE)
    mass, inertia = found.mass, found.inertia
    if mass.value + 3.0 * mass.sigma < 0.0 and found.correlation < -0.3:
        text = f"engine_torque: sign is reversed (correlation with J·ω̇ {found.correlation:+.2f})"
        fix = draft.scaled(Quantity.ENGINE_TORQUE, -1.0)
        return [Finding("error", key, text, -1.0, None, fix, _FACTORS, _torque_picture(found, -1.0))]
    if mass.value <= 0.0:
        return []
    off_mass = _is_off(mass, draft.honest("vehicle.chassis.mass_kg", HONEST_MASS))
    honest = draft.honest("vehicle.engine_inertia_kgm2", HONEST_INERTIA)
    off_inertia = inertia is not None and (inertia.value <= 0.0 or _is_off(inertia, honest))
    if off_mass and inertia is None:
        return [_either(m, found, key)]
    if inertia is not None and off_mass:
        alike = inertia.value > 0.0 and 1.0 / ALIKE < mass.value / inertia.value < ALIKE
        return [_torque(draft, found, key)] if alike else [_mass(m, found)]
    if inertia is not None and off_inertia and inertia.value > 0.0:
        return [_inertia(m, found, inertia)]
    return []


def _is_off(factor: Number, honest: float) -> bool:
    """Return whether a factor is not one; what is honest of it is a share."""
    share = Number(log(factor.value), factor.sigma / factor.value, factor.seconds)
    return share.is_off(0.0, honest)


def _torque(draft: Draft, found: Factors, key: str) -> Finding:
    right = Number(1.0 / found.mass.value, found.mass.sigma / found.mass.value**2, found.mass.seconds)
    near = abs(log(right.value / POUND_FOOT_NM)) < 2.0 * right.sigma / right.value
    unit = ": lb·ft instead of N·m?" if near else ""
    text = f"engine and car both accelerate as by {right.shown()} times the engine torque that is told{unit}"
    fix = draft.scaled(Quantity.ENGINE_TORQUE, right.value)
    picture = _torque_picture(found, found.mass.value)
    return Finding("error", key, text, right.value, right.sigma, fix, _FACTORS, picture)


def _mass(m: Moments, found: Factors) -> Finding:
    told = m.vehicle.chassis.mass_kg
    right = _right_mass(m, found)
    key = "vehicle.chassis.mass_kg"
    text = f"mass: {right.shown('kg')} fits, the file has {told:g}; the engine alone accelerates as it should"
    fix = ((key, number(right.value, 3)),)
    picture = _torque_picture(found, found.mass.value)
    return Finding("warning", key, text, right.value, right.sigma, fix, _FACTORS, picture)


def _right_mass(m: Moments, found: Factors) -> Number:
    """Return the mass that fits, without what the wheels have of the inertia."""
    chassis = m.vehicle.chassis
    square = chassis.wheel_radius_m**2
    mass = (chassis.inertia_kgm2 * found.mass.value - chassis.wheel_inertia_kgm2) / square
    return Number(mass, chassis.inertia_kgm2 * found.mass.sigma / square, found.mass.seconds)


def _inertia(m: Moments, found: Factors, inertia: Number) -> Finding:
    vehicle = m.vehicle
    told, damper = vehicle.engine_inertia_kgm2, vehicle.damper.inertia_kgm2
    right = Number((told + damper) * inertia.value - damper, (told + damper) * inertia.sigma, inertia.seconds)
    key = "vehicle.engine_inertia_kgm2"
    text = f"engine inertia: {right.shown('kg·m²')} fits, the file has {told:g}; the car accelerates as it should"
    fix = ((key, number(right.value, 3)),) if right.value > 0.0 else ()
    return Finding("warning", key, text, right.value, right.sigma, fix, frozenset({"engine_inertia"}))


def _either(m: Moments, found: Factors, key: str) -> Finding:
    right = Number(1.0 / found.mass.value, found.mass.sigma / found.mass.value**2, found.mass.seconds)
    mass = _right_mass(m, found).value
    text = (
        f"the car accelerates as by {right.shown()} times the engine torque that is told, or as with {mass:.0f} "
        f"kg instead of {m.vehicle.chassis.mass_kg:g}: the engine never turned alone, so nothing tells which"
    )
    picture = _torque_picture(found, found.mass.value)
    return Finding("error", key, text, right.value, right.sigma, (), _FACTORS, picture)


def _torque_picture(found: Factors, factor: float) -> Picture:
    lines = {"the file: alike": lambda x: x, f"the log: times {factor:.2g}": lambda x: factor * x}
    labels = ("torque that accelerates engine and car by the file, changes over 0.8 s, N·m", "engine torque, N·m")
    return against(labels, thinned(found.x, found.y), lines)


def _idle_picture(m: Moments, level: float) -> Picture:
    where = ~m.locked[0] & ~m.locked[1] & (m.engine < 150.0)
    lines = {"net torque at idle": lambda x: 0.0 * x, f"the log: {level:+.0f} N·m": lambda x: 0.0 * x + level}
    labels = ("engine speed, rad/s", "engine torque as told, no clutch locked, N·m")
    return against(labels, thinned(m.engine, m.torque, where), lines)
