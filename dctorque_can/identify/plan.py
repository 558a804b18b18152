"""Which drives to record for what is not known yet."""

from __future__ import annotations

from collections.abc import Sequence

from dctorque_can.identify.results import Result
from dctorque_can.identify.unknowns import GROUPS

ENOUGH = 0.5
"""Share of what was unknown from which a number counts as told."""
DRIVES = {
    "delays": "gather speed and brake firmly in every gear, ten times: delays show while speeds change",
    "ratios": "ten seconds of steady driving in each gear, faster than 20 km/h",
    "inertias": "full throttle from 20 km/h through the low gears, and kick-downs: the engine then turns apart "
    "from the car, or far faster in one gear than in another one",
    "stiffnesses": "tip-ins and tip-outs in each gear, from coasting to full throttle within half a second",
    "dampings": "the same tip-ins and tip-outs, twenty of each: a damper shows while its torque begins to change",
    "car": "gather speed and coast in turn for five minutes, on a road as flat as there is, with a known load",
    "losses": "the same road at full and at light throttle, and long coasting in gear",
    "spin": "let the car roll with both clutches open and a gear out, as when the lever is put to neutral",
    "road": "half an hour without brakes, half of it faster than 90 km/h, that ends where it began: hills cancel",
    "kissing_points": "ten gentle launches and some creeping, with each clutch that can launch",
    "noises": "a minute of steady driving",
}


def lacking(results: Sequence[Result]) -> dict[str, list[str]]:
    """Return by group the keys of numbers that recordings have hardly told."""
    found: dict[str, list[str]] = {}
    for result in results:
        if result.told < ENOUGH and result.before.sigma > 0.0:
            found.setdefault(result.group, []).append(result.key)
    return {group: found[group] for group in GROUPS if group in found}
