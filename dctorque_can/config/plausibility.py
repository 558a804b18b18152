"""What pydantic cannot see: gears that make the observer singular, gear maps that do not fit the vehicle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations, pairwise
from typing import NamedTuple

from dctorque_can.config.estimation import RatioSection
from dctorque_can.config.problems import KeyPath
from dctorque_can.config.signals import GearSignalSection
from dctorque_can.driveline.gear_pair import SMALLEST_RATIO_STEP
from dctorque_can.driveline.parameters import Gear

SAME_RATIO = 1e-6  # relative difference of total ratios that is rounding
CLOSE_RATIO = 0.05  # … below which R/(R_1 - R_2) amplifies errors more than 20 times


class Doubt(NamedTuple):
    """Something implausible: an error, or with ``warning`` only worth a look."""

    path: KeyPath
    reason: str
    warning: bool


def gear_doubts(gears: Mapping[KeyPath, Gear], complete: bool) -> Iterator[Doubt]:
    """Yield what is implausible in the gears of a vehicle, by the key path of each gear.

    Args:
        gears: all gears that are free of errors.
        complete: whether these are all there are; else nothing is said about missing ones.
    """
    forward = sorted(
        ((gear.number, path, gear) for path, gear in gears.items() if gear.number > 0), key=lambda item: item[0]
    )
    if complete:
        yield from _missing_gears(forward, {gear.shaft for gear in gears.values()})
    for (_, _, lower), (_, path, higher) in pairwise(forward):
        if higher.total_ratio > lower.total_ratio * (1 + SAME_RATIO):
            reason = f"total ratio {higher.total_ratio:.4g} is more than that of gear {lower.number}"
            yield Doubt(path, f"{reason}, {lower.total_ratio:.4g}: which final drive belongs to it?", True)
    for (_, _, first), (_, path, second) in combinations(forward, 2):
        if first.shaft == second.shaft:
            continue
        apart = abs(first.total_ratio - second.total_ratio) / max(first.total_ratio, second.total_ratio)
        if apart < SMALLEST_RATIO_STEP:
            reason = f"the pair with gear {first.number} is singular: both have (nearly) the total ratio"
            yield Doubt(path, f"{reason} {second.total_ratio:.4g}, so their torques cannot be told apart", False)
        elif apart < CLOSE_RATIO:
            reason = f"total ratio only {100 * apart:.2g} % from that of gear {first.number} on the other shaft"
            yield Doubt(path, f"{reason}: errors of the observer grow {1 / apart:.0f} times", True)


def _missing_gears(forward: list[tuple[int, KeyPath, Gear]], shafts: set[int]) -> Iterator[Doubt]:
    for shaft in {1, 2} - shafts:
        yield Doubt(("vehicle", "gears"), f"no gear is on shaft {shaft}", False)
    for expected, (number, path, _) in enumerate(forward, start=1):
        if number != expected:
            yield Doubt(path, f"gear {expected} is missing", True)
            break


def gear_map_doubts(
    path: KeyPath, shaft: int | None, section: GearSignalSection, gears: Mapping[int, Gear], complete: bool
) -> Iterator[Doubt]:
    """Yield where the map from raw values to gears of a shaft, or of both, does not fit the vehicle.

    Args:
        path: key path of the map's section.
        shaft: 1 or 2; None for both.
        section: signal and map.
        gears: all gears of the vehicle that are free of errors, by number.
        complete: whether these are all there are; else nothing is said about unknown ones.
    """
    for key, number in section.values.items():
        if number == 0:
            continue
        name = _name(int(number))
        if number not in gears and complete:
            have = ", ".join(_name(n) for n in sorted(gears, key=lambda n: (n < 0, n)))
            yield Doubt((*path, "values", key), f"the vehicle has no gear {name}; there is: {have}", False)
        elif shaft is not None and number in gears and gears[int(number)].shaft != shaft:
            reason = f"gear {name} is on shaft {gears[int(number)].shaft}, not on shaft {shaft}"
            yield Doubt((*path, "values", key), reason, False)
    if shaft is not None and 0 not in section.values.values():
        yield Doubt((*path, "values"), "no raw value means neutral: the gear is unknown while it is changed", True)
    for number, gear in gears.items():
        if shaft in (None, gear.shaft) and number not in section.values.values():
            yield Doubt((*path, "values"), f"no raw value means gear {_name(number)}", True)


def inference_doubts(section: RatioSection, gears: Mapping[int, Gear]) -> Iterator[Doubt]:
    """Yield gears of one shaft that the tolerances cannot tell apart."""
    tolerance = section.release_tolerance
    for first, second in combinations(gears.values(), 2):
        low, high = sorted((abs(first.total_ratio), abs(second.total_ratio)))
        if first.shaft == second.shaft and low * (1 + tolerance) >= high * (1 - tolerance):
            reason = f"cannot tell gears {_name(first.number)} and {_name(second.number)} apart"
            totals = f"total ratios {high:.4g} and {low:.4g}"
            largest = (high - low) / (high + low)
            yield Doubt(("gears", "release_tolerance"), f"{reason} ({totals}): must be below {largest:.3f}", False)


def _name(number: int) -> str:
    return "R" if number < 0 else str(number)
