"""What is believed of the numbers of a vehicle file before any recording, and the same file with other numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import hypot
from typing import Any

from dctorque_can.config.load import Config
from dctorque_can.config.vehicle_class import SHARES
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.evidence.moments import WHEELS
from dctorque_can.evidence.series import Series
from dctorque_can.identify.regression import Belief
from dctorque_can.pipeline.samples import Quantity

LATE, WHEELS_LATE = Belief(8.0, 8.0), Belief(14.0, 9.0)
"""A delay of which the file tells nothing, ms: a filter, a cycle of the sender, the bus. Wheels are filtered."""
TOLD_LATE_MS = 4.0
"""How wrong one is that it tells, without a standard deviation."""
LAG_MS = 10.0
"""How wrong the lag of the engine behind its nominal torque is."""
LAG_KEY = "estimator.kalman.engine_torque_lag_ms"
MEASURED = (
    Quantity.ENGINE_SPEED,
    Quantity.ENGINE_TORQUE,
    Quantity.SHAFT1_SPEED,
    Quantity.SHAFT2_SPEED,
    *WHEELS,
)
"""Quantities whose delay is identified."""
_ROAD_SPEEDS = ("km/h", "m/s", "mph")


@dataclass(frozen=True, slots=True)
class Message:
    """Quantities that come in one message, and so are as late.

    Attributes:
        name: how its delay is called among the unknowns.
        keys: of their delays in the vehicle file.
        quantities: these.
        late: what is believed of the delay, ms.
        told_ms: what the file says.
    """

    name: str
    keys: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    late: Belief
    told_ms: float


def number_of(vehicle: Vehicle, key: str) -> float:
    """Return a number of the vehicle by its dotted key."""
    here: Any = vehicle
    steps = key.split(".")[1:]
    while steps:
        step = steps.pop(0)
        if step in ("shafts", "clutches"):
            here = getattr(here, step)[int(steps.pop(0)) - 1]
        elif step == "gears":
            number = steps.pop(0)
            here = vehicle.gear(-1 if number == "R" else int(number))
        else:
            here = getattr(here, step)
    return abs(float(here))


def belief(config: Config, key: str) -> Belief:
    """Return what is believed of a number of the vehicle: its value, as sure as told or as usual of its kind."""
    value = number_of(config.settings.vehicle, key)
    told = config.sigmas.get(key)
    return Belief(value, SHARES[key.rpartition(".")[2]] * value if told is None else told)


def gear_key(number: int, name: str) -> str:
    """Return the key of a number of a gear."""
    return f"vehicle.gears.{'R' if number < 0 else number}.{name}"


def messages(config: Config) -> list[Message]:
    """Return the messages whose delays are identified."""
    found: dict[tuple[str, ...], list[Any]] = {}
    for entry in config.entries:
        if entry.input.quantity in MEASURED:
            found.setdefault(tuple(sorted({term.message for term in entry.input.terms})), []).append(entry)
    result = []
    for names, entries in found.items():
        keys = tuple(f"{entry.key}.delay_ms" for entry in entries)
        told_ms = sum(entry.input.delay_us for entry in entries) / 1000.0 / len(entries)
        quantities = tuple(entry.input.quantity for entry in entries)
        sigmas = [config.sigmas[key] for key in keys if key in config.sigmas]
        if sigmas:
            late = Belief(told_ms, sum(sigmas) / len(sigmas))
        else:
            untold = WHEELS_LATE if set(quantities) <= set(WHEELS) else LATE
            late = Belief(told_ms, TOLD_LATE_MS) if told_ms > 0.0 else untold
        result.append(Message("+".join(names), keys, quantities, late, told_ms))
    return result


def by_road_speed(config: Config) -> bool:
    """Return whether wheel speeds are told as road speeds, which the wheel radius turns into rad/s."""
    units = {unit for entry in config.entries if entry.input.quantity in WHEELS for unit in entry.units}
    return bool(units & set(_ROAD_SPEEDS))


def with_delays(config: Config, late_ms: Mapping[Quantity, float]) -> Config:
    """Return a configuration with other delays."""
    inputs = tuple(
        replace(each, delay_us=round(1000.0 * late_ms[each.quantity])) if each.quantity in late_ms else each
        for each in config.settings.inputs
    )
    return replace(config, settings=replace(config.settings, inputs=inputs))


def with_vehicle(config: Config, vehicle: Vehicle) -> Config:
    """Return a configuration with another vehicle."""
    return replace(config, settings=replace(config.settings, vehicle=vehicle))


def seen_by(series: Series, config: Config) -> Series:
    """Return a recording as another configuration of the same car reads it: its delays and its wheel radius."""
    signals = dict(series.signals)
    old, new = (each.settings.vehicle.chassis.wheel_radius_m for each in (series.config, config))
    if old != new and by_road_speed(config):
        for wheel in WHEELS:
            if wheel in signals:
                signals[wheel] = replace(signals[wheel], value=signals[wheel].value * (old / new))
    return replace(series, signals=signals, config=config)


def shared(total: Belief, parts: list[Belief]) -> list[Belief]:
    """Return what is known of parts when their sum is known: what it was wrong by goes to the least sure.

    The sum of normal numbers, and their distributions given it.
    """
    spread = hypot(*(part.sigma for part in parts))
    if spread == 0.0:
        return parts
    excess = total.value - sum(part.value for part in parts)
    found = []
    for part in parts:
        share = (part.sigma / spread) ** 2
        left = part.sigma**2 * (1.0 - share) + (share * total.sigma) ** 2
        found.append(Belief(part.value + share * excess, left**0.5))
    return found
