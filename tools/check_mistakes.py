"""Mistakes in the vehicle file of any car: what `tools/check-score` lays over the right one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dctorque_can.config.document import shown
from dctorque_can.config.load import Config
from dctorque_can.driveline.parameters import DrivenAxle
from dctorque_can.driveline.phases import PhaseSource
from dctorque_can.evidence.draft import Draft, Fix
from dctorque_can.pipeline.samples import Quantity

SHAFTS = (Quantity.SHAFT1_SPEED, Quantity.SHAFT2_SPEED)
FRONT = (Quantity.WHEEL_SPEED_FL, Quantity.WHEEL_SPEED_FR)
REAR = (Quantity.WHEEL_SPEED_RL, Quantity.WHEEL_SPEED_RR)
KEYS = {
    "torque": ("inputs.engine_torque",),
    "mass": ("inputs.engine_torque", "vehicle.chassis.mass_kg"),
    "inertia": ("vehicle.engine_inertia_kgm2",),
    "shafts": ("inputs.shaft",),
    "engine": ("inputs.engine_speed",),
    "wheels": ("inputs.wheel_speeds", "vehicle.chassis.wheel_radius_m"),
    "gears": ("vehicle.gears", "gears", "vehicle.chassis.wheel_radius_m"),
    "axle": ("vehicle.driven_axle",),
    "clutches": ("clutch_phase",),
    "protection": ("protection",),
    "timeout": ("inputs.engine_speed.timeout_ms",),
    "brake": ("inputs.brake",),
    "acceleration": ("inputs.acceleration",),
    "grade": ("inputs.grade",),
    "direction": ("inputs.direction",),
}
"""How a key must begin that is named, by kind."""


def is_named(kind: str, keys: Sequence[str]) -> bool:
    """Return whether the first of the keys that are told, or one as good, is about a kind of mistake."""
    return any(key.startswith(KEYS[kind]) for key in keys[:2])


def mistakes(config: Config) -> Iterator[tuple[str, str, Fix]]:
    """Yield each mistake that this car can have: its name, its kind in `KEYS`, and what is laid over the file."""
    draft = Draft(config)
    mapped = {given.quantity for given in config.inputs}
    yield from _torques(draft)
    yield from _speeds(draft, mapped)
    yield from _gears(draft)
    yield from _clutches(draft)
    yield from _delays(draft, mapped)
    yield from _motion(draft, mapped)
    yield from _frames(draft)


def _torques(draft: Draft) -> Iterator[tuple[str, str, Fix]]:
    torque, vehicle = Quantity.ENGINE_TORQUE, draft.config.settings.vehicle
    for name, factor in (("sign", -1.0), ("half", 0.5), ("twice", 2.0), ("ten times", 10.0)):
        yield f"engine torque: {name}", "torque", draft.scaled(torque, factor) + _wide(draft, torque)
    if draft.shifted(torque, 1.0) and draft.unit(torque) != "%":
        for offset in (40.0, -40.0):
            yield f"engine torque {offset:+g} N·m", "torque", draft.shifted(torque, offset)
    section = draft.value("inputs.engine_torque")
    if isinstance(section, dict) and len(section.get("sum", ())) == 2:
        first = section["sum"][0]
        alone = {key: value for key, value in section.items() if key != "sum"} | {"sum": [first]}
        yield "engine friction left out", "torque", (("inputs.engine_torque", shown(alone)),)
    mass, inertia = vehicle.chassis.mass_kg, vehicle.engine_inertia_kgm2
    for factor in (10.0, 0.1):
        yield f"mass × {factor:g}", "mass", (("vehicle.chassis.mass_kg", f"{factor * mass:g}"),)
        yield (
            f"engine inertia × {factor:g}",
            "inertia",
            (("vehicle.engine_inertia_kgm2", f"{factor * inertia:g}"),),
        )


def _wide(draft: Draft, quantity: Quantity) -> Fix:
    """Return what opens a range that the file gives: it would tell at once."""
    section = draft.value(draft.key_of(quantity))
    given = isinstance(section, dict) and "range" in section
    return ((f"{draft.key_of(quantity)}.range", "[-1e5, 1e5]"),) if given else ()


def _speeds(draft: Draft, mapped: set[Quantity]) -> Iterator[tuple[str, str, Fix]]:
    engine = Quantity.ENGINE_SPEED
    yield "engine speed: half", "engine", draft.scaled(engine, 0.5)
    yield "engine speed in another unit", "engine", draft.scaled(engine, 0.1047198)
    shafts = [each for each in SHAFTS if each in mapped]
    for each in shafts:
        yield f"{each.name.lower()}: twice", "shafts", draft.scaled(each, 2.0)
    if len(shafts) == 2:
        keys = [draft.key_of(each) for each in shafts]
        yield "shaft speeds exchanged", "shafts", draft.exchanged(*keys)
        both = draft.scaled(shafts[0], 0.1047198) + draft.scaled(shafts[1], 0.1047198)
        yield "shaft speeds in another unit", "shafts", both
        yield "sign of shaft 1", "shafts", draft.scaled(shafts[0], -1.0)
    wheels = [each for each in (*FRONT, *REAR) if each in mapped]
    for name, factor in (("km/h as m/s", 3.6), ("mph as km/h", 1 / 1.609344)):
        yield f"wheel speeds: {name}", "wheels", tuple(f for w in wheels for f in draft.scaled(w, factor))
    radius = draft.config.settings.vehicle.chassis.wheel_radius_m
    for factor in (1.05, 0.95):
        if draft.unit(wheels[0]) not in ("rad/s", "rpm"):
            key = "vehicle.chassis.wheel_radius_m"
            yield f"wheel radius × {factor:g}", "wheels", ((key, f"{factor * radius:g}"),)
    for name, axle in (("front", FRONT), ("rear", REAR)):
        if set(axle) <= mapped and len(wheels) == 4:
            yield f"{name} wheels +5 %", "wheels", tuple(f for w in axle for f in draft.scaled(w, 1.05))
    if len(wheels) == 4:
        yield "one wheel +4 %", "wheels", draft.scaled(wheels[0], 1.04)
        axle = draft.config.settings.driven_axle
        if axle is not DrivenAxle.ALL:
            other = "rear" if axle is DrivenAxle.FRONT else "front"
            yield "wrong driven axle", "axle", (("vehicle.driven_axle", other),)


def _gears(draft: Draft) -> Iterator[tuple[str, str, Fix]]:
    gears = {gear.number: gear for gear in draft.config.settings.vehicle.gears}
    for number, factor in ((2, 1.05), (3, 0.9), (1, 1.03)):
        key = f"vehicle.gears.{number}.ratio"
        yield f"ratio of gear {number} × {factor:g}", "gears", ((key, f"{factor * gears[number].ratio:g}"),)
    drive = gears[2].final_drive
    same = [number for number, gear in gears.items() if gear.final_drive == drive and number > 0]
    fixes = tuple((f"vehicle.gears.{number}.final_drive", f"{0.93 * drive:g}") for number in same)
    yield "a final drive × 0.93", "gears", fixes
    for key in ("gears.shaft1.values", "gears.actual.values"):
        values = draft.value(key)
        if isinstance(values, dict):
            told = sorted({value for value in values.values() if isinstance(value, int)})
            turned = dict(zip(told, told[1:] + told[:1], strict=True))
            text = ", ".join(f"{raw}: {turned.get(value, value)}" for raw, value in values.items())
            yield "gear signal shifted", "gears", ((key, f"{{{text}}}"),)


def _clutches(draft: Draft) -> Iterator[tuple[str, str, Fix]]:
    clutches = draft.config.settings.phases.clutches
    keys = [f"clutch_phase.clutch{i}" for i in (1, 2)]
    one, other = (draft.value(f"{key}.signal") for key in keys)
    if one and other:
        laid = ((f"{keys[0]}.signal", other), (f"{keys[1]}.signal", one))
        yield "clutches exchanged", "clutches", laid
    if any(clutch.source is not PhaseSource.POSITION for clutch in clutches):
        return
    turned = ["decreasing" if clutch.closes_increasing else "increasing" for clutch in clutches]
    both = tuple((f"{key}.closes", way) for key, way in zip(keys, turned, strict=True))
    yield "positions close the other way", "clutches", both
    yield "position 1 closes the other way", "clutches", both[:1]
    for name, i in (("1", (0,)), ("1 and 2", (0, 1))):
        for way in (0.6, -0.6):
            points = tuple((f"{keys[k]}.kissing_point", f"{_beyond(draft, k, way):g}") for k in i)
            yield f"kissing point of {name}: {'later' if way > 0 else 'sooner'}", "clutches", points


def _beyond(draft: Draft, i: int, share: float) -> float:
    """Return a kissing point that is further by a share of the way from the open end of the range."""
    clutch = draft.config.settings.phases.clutches[i]
    size = abs(clutch.threshold) if clutch.closes_increasing else abs(100.0 - clutch.threshold)
    return clutch.threshold + share * max(size, 1.0) * (1.0 if clutch.closes_increasing else -1.0)


def _delays(draft: Draft, mapped: set[Quantity]) -> Iterator[tuple[str, str, Fix]]:
    told = {given.quantity: 1e-3 * given.delay_us for given in draft.config.inputs}
    cases = [("engine speed", "engine", (Quantity.ENGINE_SPEED,), 15.0)]
    cases += [("shaft 1", "shafts", (SHAFTS[0],), 10.0)] if set(SHAFTS) <= mapped else []
    cases.append(("wheels", "wheels", tuple(each for each in (*FRONT, *REAR) if each in mapped), 20.0))
    for name, kind, quantities, late_ms in cases:
        fixes = tuple(f for q in quantities for f in draft.with_key(q, "delay_ms", f"{told[q] + late_ms:g}"))
        yield f"delay of {name} {late_ms:+g} ms", kind, fixes


def _motion(draft: Draft, mapped: set[Quantity]) -> Iterator[tuple[str, str, Fix]]:
    if Quantity.BRAKE in mapped:
        yield (
            "brake: on and off exchanged",
            "brake",
            draft.taken_from(Quantity.BRAKE, _most(draft, Quantity.BRAKE)),
        )
        yield "brake: always on", "brake", draft.shifted(Quantity.BRAKE, 0.02 * _most(draft, Quantity.BRAKE))
    acceleration, grade = Quantity.ACCELERATION, Quantity.GRADE
    if acceleration in mapped:
        for name, factor in (("sign", -1.0), ("g as m/s²", 1 / 9.80665), ("m/s² as g", 9.80665), ("half", 0.5)):
            yield f"acceleration: {name}", "acceleration", draft.scaled(acceleration, factor)
    if grade in mapped:
        for name, factor in (("sign", -1.0), ("three times", 3.0), ("a third", 1 / 3)):
            yield f"grade: {name}", "grade", draft.scaled(grade, factor)
    key = "inputs.direction.values"
    values = draft.value(key)
    if isinstance(values, dict):
        other = {"forward": "backward", "backward": "forward"}
        turned = {raw: other.get(way, way) for raw, way in values.items()}
        yield "direction: forward and backward exchanged", "direction", ((key, shown(turned)),)


def _most(draft: Draft, quantity: Quantity) -> float:
    """Return the largest value of a signal of its own, by the DBC."""
    entry = next(each for each in draft.config.entries if each.input.quantity is quantity)
    (term,) = entry.input.terms
    signal = draft.config.database.get_message_by_name(term.message).get_signal_by_name(term.signal)
    return float(signal.maximum)


def _frames(draft: Draft) -> Iterator[tuple[str, str, Fix]]:
    for protection in draft.config.protections[:1]:
        key = f"protection.{protection.message}"
        if protection.crc.startswith("e2e"):
            yield "data id", "protection", ((f"{key}.data_id", "7"),)
        elif protection.crc != "none":
            kind = "crc8_j1850" if protection.crc != "crc8_j1850" else "crc8_8h2f"
            yield "checksum", "protection", ((f"{key}.crc", kind),)
        if protection.counter_signal and not protection.crc.startswith("e2e"):
            modulus = 15 if protection.counter_modulus == 16 else 16
            yield "counter modulus", "protection", ((f"{key}.counter_modulus", f"{modulus}"),)
    yield "timeout too short", "timeout", draft.with_key(Quantity.ENGINE_SPEED, "timeout_ms", "8")
