"""Which manoeuvres tell of which numbers, and for how long recordings hold them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dctorque_can.config.load import Config
from dctorque_can.evidence.moments import RUNS_RAD_S, STEP_S, Mask, lasting, rate, smooth
from dctorque_can.identify.beliefs import LAG_KEY, gear_key
from dctorque_can.identify.drive import REACH, Drive
from dctorque_can.identify.equations import SLOW_S
from dctorque_can.identify.plan import ENOUGH
from dctorque_can.identify.results import Result

_STEADY_M_S2, _FIRM_M_S2 = 0.5, 1.0
_CITY_M_S, _FAST_M_S = 5.5, 25.0
_TIP_NM_PER_S = 150.0  # from coasting to full throttle within half a second, and the half of it
_TURNS_UP_RAD_S2 = 60.0  # an engine at full throttle in the low gears
_STRONG_SHARE = 0.3  # of what a clutch can hold at most: most of the torque of an engine that suits it
_SLIDES_RAD_S = 10.0
_IDLES_RAD_S = 70.0  # a clutch must slip while its shaft is slower than an engine that idles


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """What has to be driven.

    Attributes:
        name: as in "no … in these logs".
        keys: numbers that it tells of.
        needed_s: seconds of it that mostly do.
    """

    name: str
    keys: tuple[str, ...]
    needed_s: float


@dataclass(frozen=True, slots=True)
class Missing:
    """A manoeuvre of which recordings hold too little.

    Attributes:
        name: of the manoeuvre.
        seen_s, needed_s: seconds that there are, and that mostly do.
        keys: numbers that stayed unknown, of which it would tell.
    """

    name: str
    seen_s: float
    needed_s: float
    keys: tuple[str, ...]

    def __str__(self) -> str:
        if self.seen_s <= 0.0:
            there = f"no {self.name} in these logs"
        else:
            there = f"only {self.seen_s:.1f} s of {self.name} in these logs, {self.needed_s:g} s would do"
        return f"{there}; it would tell {', '.join(self.keys)}"


def missing(
    recordings: Sequence[Drive], config: Config, results: Sequence[Result]
) -> tuple[list[Missing], list[str]]:
    """Return what recordings lack for what stayed unknown.

    Args:
        recordings: of drives.
        config: the vehicle file.
        results: what was found.

    Returns:
        The manoeuvres, and the keys of what stayed unknown although the recordings hold all that could tell of it.
    """
    unknown = {each.key for each in results if each.told < ENOUGH and each.before.sigma > 0.0}
    found = []
    for manoeuvre, masks in _seen(recordings, config).items():
        seen_s = STEP_S * sum(int(np.count_nonzero(mask)) for mask in masks)
        keys = tuple(key for key in manoeuvre.keys if key in unknown)
        if keys and seen_s < manoeuvre.needed_s:
            found.append(Missing(manoeuvre.name, seen_s, manoeuvre.needed_s, keys))
    named = {key for each in found for key in each.keys}
    return found, [each.key for each in results if each.key in unknown - named]


def _seen(recordings: Sequence[Drive], config: Config) -> Mapping[Manoeuvre, list[Mask]]:
    """Return where each recording holds each manoeuvre."""
    found: dict[Manoeuvre, list[Mask]] = {}
    for drive in recordings:
        for manoeuvre, mask in _manoeuvres(drive, config):
            found.setdefault(manoeuvre, []).append(mask)
    return found


def _manoeuvres(drive: Drive, config: Config) -> Iterator[tuple[Manoeuvre, Mask]]:
    """Yield every manoeuvre that tells something, and where a recording holds it."""
    m, vehicle = drive.m, config.settings.vehicle
    radius = vehicle.chassis.wheel_radius_m
    speed, acceleration = radius * smooth(m.body, 0.2), np.abs(radius * rate(m.body, 0.2))
    engine, torque_rate = np.abs(rate(m.engine, SLOW_S)), np.abs(rate(m.torque, SLOW_S))
    drives, rolls = drive.has >= 0, speed > 1.0

    keys: tuple[str, ...] = (*(f"{entry.key}.delay_ms" for entry in config.entries), LAG_KEY)
    yield Manoeuvre("gathering speed and braking", keys, 30.0), acceleration > _FIRM_M_S2
    for gear in vehicle.gears:
        if gear.number > 0:
            steady = (
                np.isclose(drive.ratio, gear.total_ratio) & (acceleration < _STEADY_M_S2) & (speed > _CITY_M_S)
            )
            name = f"steady driving in gear {gear.number}"
            yield Manoeuvre(name, (gear_key(gear.number, "ratio"),), 10.0), steady
    keys = ("vehicle.engine_inertia_kgm2", "vehicle.damper.inertia_kgm2")
    turns_up = drives & (engine > _TURNS_UP_RAD_S2)
    yield Manoeuvre("full throttle in the low gears or kick-down", keys, 20.0), turns_up
    tips = rolls & (torque_rate > _TIP_NM_PER_S)
    keys = ("vehicle.damper.stiffness_nm_per_rad", "vehicle.output_shaft.stiffness_nm_per_rad")
    keys += tuple(f"{each}.damping_nms_per_rad" for each in ("vehicle.damper", "vehicle.output_shaft"))
    yield Manoeuvre("tip-in or tip-out", keys, 5.0), tips & (m.locked[0] | m.locked[1])
    for n in (1, 2):
        own, shaft = drive.has == n - 1, f"vehicle.shafts.{n}"
        gears = tuple(gear_key(gear.number, "inertia_kgm2") for gear in vehicle.gears_on(n))
        name = f"full throttle in the low gears on clutch {n}"
        yield Manoeuvre(name, (f"{shaft}.inertia_kgm2", *gears), 10.0), own & turns_up
        name = f"tip-in or tip-out on clutch {n}"
        yield Manoeuvre(name, (f"{shaft}.transfer_stiffness_nm_per_rad",), 5.0), own & tips & m.locked[n - 1]
        name = f"launch with clutch {n}"
        below_idle = m.shaft[n - 1] < _IDLES_RAD_S
        slides = own & below_idle & (smooth(m.engine - m.shaft[n - 1]) > _SLIDES_RAD_S)
        yield Manoeuvre(name, (f"clutch_phase.clutch{n}.kissing_point",), 3.0), slides
        name = f"rolling with input shaft {n} out of gear and its clutch open"
        keys = (
            f"{shaft}.spin_loss_nm",
            f"{shaft}.spin_loss_nms_per_rad",
            f"vehicle.clutches.{n}.drag_nms_per_rad",
        )
        free = m.neutral[n - 1] & (m.closed_told[n - 1] == 0) & (m.engine > RUNS_RAD_S)
        yield (
            Manoeuvre(name, keys, 5.0),
            lasting(free, REACH * SLOW_S, REACH * SLOW_S),
        )  # a synchroniser is sooner done
    keys = ("vehicle.chassis.mass_kg", "vehicle.chassis.wheel_inertia_kgm2")
    yield Manoeuvre("gathering speed in gear", keys, 60.0), drives & m.free & (acceleration > _STEADY_M_S2)
    strong = drives & (
        smooth(m.torque) > _STRONG_SHARE * min(each.static_capacity_nm for each in vehicle.clutches)
    )
    keys = ("vehicle.gear_efficiency", "vehicle.final_drive_efficiency")
    yield Manoeuvre("full throttle in gear", keys, 20.0), strong
    keys = ("vehicle.chassis.rolling_resistance",)
    yield (
        Manoeuvre("driving without brake slower than 90 km/h", keys, 1200.0),
        m.free & rolls & (speed < _FAST_M_S),
    )
    keys = ("vehicle.chassis.drag_coefficient", "vehicle.chassis.frontal_area_m2")
    yield Manoeuvre("driving without brake faster than 90 km/h", keys, 300.0), m.free & (speed > _FAST_M_S)
