"""The numbers that the equations of motion are solved for, and what equations are set up with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, hypot

from dctorque_can.config.load import Config
from dctorque_can.identify.beliefs import (
    LAG_KEY,
    LAG_MS,
    Message,
    belief,
    by_road_speed,
    gear_key,
    with_delays,
    with_vehicle,
)
from dctorque_can.identify.drive import Guess
from dctorque_can.identify.regression import Belief, Posterior

EQUATIONS = ("delays", "ratios", "inertias", "stiffnesses", "dampings", "car", "losses")
"""Groups of numbers that all equations of motion together are solved for."""
GROUPS = (*EQUATIONS, "spin", "road", "kissing_points", "noises")
"""What can be chosen to be identified."""
CAR, GAIN, LAG = "car_share", "gain", "lag_s"
DAMPINGS = {"damper_damping_s": "vehicle.damper", "output_damping_s": "vehicle.output_shaft"}
"""Damping over stiffness, and of what."""
_LATE = "late "
_SURE = 1e-4  # of a belief: of a number that is taken to be right
SMALLEST = 0.2
"""Share of itself that a number keeps which cannot be nothing."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """One number.

    Attributes:
        name: as columns of `Equations` are called.
        group: of `GROUPS`, or "" of those that are solved for anyway.
        prior: what is believed of it, SI.
        corrects: equations are set up with the latest value, and what they are solved for is what it is wrong by.
    """

    name: str
    group: str
    prior: Belief
    corrects: bool = True


def late_name(message: Message) -> str:
    """Return how the delay of a message is called."""
    return _LATE + message.name


def unknowns(config: Config, messages: Sequence[Message], groups: Sequence[str]) -> list[Unknown]:
    """Return all unknowns; those of groups that are not chosen are taken to be right, and belong to none."""
    vehicle = config.settings.vehicle
    found = [
        Unknown(late_name(each), "delays", Belief(each.late.value / 1000.0, each.late.sigma / 1000.0))
        for each in messages
    ]
    lag_s = config.settings.kalman.engine_torque_lag_s
    found.append(Unknown(LAG, "delays", Belief(lag_s, config.sigmas.get(LAG_KEY, LAG_MS) / 1000.0)))
    for gear in vehicle.gears:
        if gear.number > 0:
            ratio = belief(config, gear_key(gear.number, "ratio"))
            found.append(Unknown(f"ratio_{gear.number}", "ratios", Belief(0.0, ratio.sigma / ratio.value)))
    radius = belief(config, "vehicle.chassis.wheel_radius_m")
    share = radius.sigma / radius.value if by_road_speed(config) else 0.0
    found.append(Unknown("radius", "ratios", Belief(0.0, max(share, 1e-9))))
    engine, damper = belief(config, "vehicle.engine_inertia_kgm2"), belief(config, "vehicle.damper.inertia_kgm2")
    found.append(Unknown("engine_inertia_kgm2", "inertias", _total([engine, damper])))
    for shaft in (1, 2):
        found.append(Unknown(f"shaft{shaft}_inertia_kgm2", "inertias", _total(shaft_parts(config, shaft))))
    found.append(_compliance(config, "damper_compliance", "vehicle.damper.stiffness_nm_per_rad"))
    found.append(_compliance(config, "output_compliance", "vehicle.output_shaft.stiffness_nm_per_rad"))
    for shaft in (1, 2):
        key = f"vehicle.shafts.{shaft}.transfer_stiffness_nm_per_rad"
        found.append(_compliance(config, f"transfer{shaft}_compliance", key))
    for name, key in DAMPINGS.items():
        found.append(Unknown(name, "dampings", _damping(config, key), corrects=False))
    found.append(Unknown(CAR, "car", car_belief(config)))
    gears, final = belief(config, "vehicle.gear_efficiency"), belief(config, "vehicle.final_drive_efficiency")
    loss = Belief(1.0 - gears.value * final.value, hypot(gears.sigma, final.sigma))
    found.append(Unknown("loss", "losses", loss))
    found.append(Unknown(GAIN, "", Belief(0.0, sure(gain_belief(config))), corrects=False))
    found.append(Unknown("air_m2", "", Belief(0.0, air_belief(config).sigma), corrects=False))
    found.append(Unknown("axles", "", Belief(0.0, 0.02), corrects=False))
    found += [Unknown(f"{name}_wheels", "", Belief(0.0, 0.02), corrects=False) for name in ("front", "rear")]
    found.append(Unknown("slip_per_nm", "", Belief(0.0, 1e-3), corrects=False))
    found.append(Unknown("tyre_lag_s", "", Belief(0.0, 3e-3), corrects=False))
    return [
        each
        if each.group in ("", *groups)
        else replace(each, group="", prior=Belief(each.prior.value, sure(each.prior)))
        for each in found
    ]


def sure(prior: Belief) -> float:
    """Return the standard deviation with which a number is taken to be right."""
    return max(_SURE * prior.sigma, 1e-12)


def _total(parts: Sequence[Belief]) -> Belief:
    return Belief(sum(part.value for part in parts), max(hypot(*(part.sigma for part in parts)), 1e-12))


def shaft_parts(config: Config, shaft: int) -> list[Belief]:
    """Return what is believed of the inertias of an input shaft: its own, and those of all its gears together.

    Gears of one transmission are wrong alike.
    """
    own = belief(config, f"vehicle.shafts.{shaft}.inertia_kgm2")
    gears = [
        belief(config, gear_key(gear.number, "inertia_kgm2")) for gear in config.settings.vehicle.gears_on(shaft)
    ]
    return [own, Belief(sum(gear.value for gear in gears), sum(gear.sigma for gear in gears))]


def gain_belief(config: Config) -> Belief:
    """Return what is believed of the share by which the engine's torque is above the nominal one.

    Twice the torque on twice the mass drives alike: recordings do not tell it (`Posterior.considering`).
    """
    return Belief(0.0, max(config.settings.kalman.engine_torque_error_share, 1e-6))


def air_belief(config: Config) -> Belief:
    """Return what is believed of C_d A, m²."""
    drag, area = (belief(config, f"vehicle.chassis.{key}") for key in ("drag_coefficient", "frontal_area_m2"))
    value = drag.value * area.value
    return Belief(value, max(hypot(drag.sigma * area.value, area.sigma * drag.value), 1e-12))


def car_belief(config: Config) -> Belief:
    """Return what is believed of M = m r² + J_w, at the radius of the file."""
    mass, wheels = belief(config, "vehicle.chassis.mass_kg"), belief(config, "vehicle.chassis.wheel_inertia_kgm2")
    radius = config.settings.vehicle.chassis.wheel_radius_m
    return _total([Belief(mass.value * radius**2, mass.sigma * radius**2), wheels])


def _compliance(config: Config, name: str, key: str) -> Unknown:
    stiffness = belief(config, key)
    sigma = max(stiffness.sigma, 1e-9) / stiffness.value**2
    return Unknown(name, "stiffnesses", Belief(1.0 / stiffness.value, sigma), corrects=False)


def _damping(config: Config, key: str) -> Belief:
    """Return what is believed of the time by which a twist follows its torque: damping over stiffness, s."""
    damping, stiffness = (
        belief(config, f"{key}.damping_nms_per_rad"),
        belief(config, f"{key}.stiffness_nm_per_rad"),
    )
    sigma = hypot(damping.sigma, damping.value * stiffness.sigma / stiffness.value)
    return Belief(damping.value / stiffness.value, max(sigma / stiffness.value, 1e-12))


def first_values(config: Config, known: Sequence[Unknown], messages: Sequence[Message]) -> dict[str, float]:
    """Return the values that equations are first set up with: those of the file."""
    told = {late_name(each): each.told_ms / 1000.0 for each in messages}
    return {each.name: told.get(each.name, each.prior.value) for each in known}


def believed(known: Sequence[Unknown], values: Mapping[str, float]) -> dict[str, Belief]:
    """Return what is believed of what equations that are set up with ``values`` are solved for."""
    found = {}
    for each in known:
        prior, value = each.prior, values[each.name]
        if each.name == CAR:
            found[CAR] = Belief((value - prior.value) / value, prior.sigma / value)
        else:
            found[each.name] = Belief(prior.value - value, prior.sigma) if each.corrects else prior
    return found


def corrected(known: Sequence[Unknown], values: Mapping[str, float], found: Posterior) -> dict[str, float]:
    """Return the values after a solution."""
    result = dict(values)
    for each in known:
        if each.name not in found.names:
            continue
        change = found.of(each.name).value
        if each.name == CAR:
            result[CAR] = values[CAR] / max(1.0 + change, SMALLEST)
        else:
            result[each.name] = values[each.name] + change if each.corrects else change
        if each.group in ("inertias", "stiffnesses", "dampings", "car"):
            result[each.name] = max(result[each.name], SMALLEST * each.prior.value)
    result[LAG] = max(result[LAG], 0.0)
    late = [each.name for each in known if each.name.startswith(_LATE)]
    too_soon = min((result[name] for name in late), default=0.0)
    for name in late if too_soon < 0.0 else ():  # nothing is told before it happens; differences are known best
        result[name] -= too_soon
    return result


def guess_of(config: Config, values: Mapping[str, float]) -> Guess:
    """Return what equations are set up with."""
    vehicle = config.settings.vehicle
    first, second = vehicle.shafts
    return Guess(
        engine_inertia_kgm2=values["engine_inertia_kgm2"],
        damper_inertia_kgm2=vehicle.damper.inertia_kgm2,
        shaft_inertia_kgm2=(values["shaft1_inertia_kgm2"], values["shaft2_inertia_kgm2"]),
        spin_loss=(
            (first.spin_loss_nm, first.spin_loss_nms_per_rad),
            (second.spin_loss_nm, second.spin_loss_nms_per_rad),
        ),
        drag=(vehicle.clutches[0].drag_nms_per_rad, vehicle.clutches[1].drag_nms_per_rad),
        loss=values["loss"],
        car_inertia_kgm2=values[CAR],
        compliance=(values["damper_compliance"], values["output_compliance"]),
        lag_s=values[LAG],
    )


def config_of(config: Config, values: Mapping[str, float], messages: Sequence[Message]) -> Config:
    """Return the configuration by which recordings are read: with these delays, ratios and this wheel radius."""
    vehicle = config.settings.vehicle
    gears = tuple(replace(g, ratio=g.ratio * exp(values.get(f"ratio_{g.number}", 0.0))) for g in vehicle.gears)
    chassis = replace(vehicle.chassis, wheel_radius_m=vehicle.chassis.wheel_radius_m * exp(values["radius"]))
    late_ms = {quantity: 1000.0 * values[late_name(each)] for each in messages for quantity in each.quantities}
    return with_delays(with_vehicle(config, replace(vehicle, gears=gears, chassis=chassis)), late_ms)
