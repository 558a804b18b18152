"""What slows a car down: spin losses of shafts, drag of open clutches, rolling resistance and air drag.

They are set up with all that the equations of motion have found (`identification`), and stand apart for a reason.
A driver meets a hill with torque, so the level of the load says nothing of mass or losses. There it is left out;
of rolling resistance it is all that there is. What is wrong of the other numbers is not looked for here again: it
makes these less sure (`Posterior.considering`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import exp, hypot, log

from dctorque_can.config.load import Config
from dctorque_can.evidence.moments import Moments
from dctorque_can.identify.beliefs import belief, messages, shared
from dctorque_can.identify.drive import Drive
from dctorque_can.identify.equations import Equations, free_shafts, road
from dctorque_can.identify.identification import overfits, split
from dctorque_can.identify.regression import Belief, Posterior, solve
from dctorque_can.identify.results import Result
from dctorque_can.identify.unknowns import (
    SMALLEST,
    air_belief,
    car_belief,
    first_values,
    gain_belief,
    guess_of,
    late_name,
    shaft_parts,
    sure,
    unknowns,
)

SLOPE = 0.005
"""Standard deviation of the mean slope of a drive: 50 m in ten kilometres. Who comes home knows better."""
_ROLLING, _DRAG, _AREA = (
    f"vehicle.chassis.{name}" for name in ("rolling_resistance", "drag_coefficient", "frontal_area_m2")
)
_UNITS = {"nm": "N·m", "nms_per_rad": "N·m·s/rad"}


def drives(recordings: Sequence[Moments], config: Config) -> list[Drive]:
    """Return recordings with the numbers of a vehicle file, of which they are."""
    known = messages(config)
    names = {quantity: late_name(each) for each in known for quantity in each.quantities}
    guess = guess_of(config, first_values(config, unknowns(config, known, ()), known))
    return [Drive.of(m, guess, names) for m in recordings]


def spin_losses(recordings: Sequence[Drive], config: Config) -> list[Result]:
    """Return spin losses of the input shafts and drag of the open clutches.

    Args:
        recordings: of drives.
        config: the vehicle file.
    """
    keys = dict(_spin_keys())
    beliefs = {name: belief(config, key) for name, key in keys.items()}
    considered = {f"shaft{shaft}_share": _share(shaft_parts(config, shaft)) for shaft in (1, 2)}
    equations = [each for drive in recordings for each in free_shafts(drive)]
    found, refused = _solved(equations, beliefs, considered)
    results = []
    for name, key in keys.items():
        after = found.of(name) if name in found.names and name not in refused else beliefs[name]
        unit = _UNITS[name.partition("_")[2]]
        after = Belief(max(after.value, 0.0), min(after.sigma, beliefs[name].sigma))
        results.append(Result(key, "spin", unit, beliefs[name], after, name in refused))
    return results


def road_load(recordings: Sequence[Drive], config: Config) -> list[Result]:
    """Return rolling resistance and air drag, told apart from the slope of the road as far as may be.

    Args:
        recordings: of drives.
        config: the vehicle file.
    """
    drag, area = belief(config, _DRAG), belief(config, _AREA)
    shares = [Belief(log(each.value), each.sigma / each.value) for each in (drag, area)]
    air = air_belief(config)
    beliefs = {"rolling": belief(config, _ROLLING), "air_m2": air}
    slopes = [f"slope {n}" for n in range(len(recordings))]
    equations = [road(drive, name) for name, drive in zip(slopes, recordings, strict=True)]
    beliefs |= dict.fromkeys(slopes, Belief(0.0, SLOPE))
    found, refused = _solved(equations, beliefs, _of_the_rest(config))
    rolling, air_now = found.of("rolling"), found.of("air_m2")
    rolling = Belief(max(rolling.value, 0.0), min(rolling.sigma, beliefs["rolling"].sigma))
    total = Belief(log(max(air_now.value, SMALLEST * air.value)), min(air_now.sigma, air.sigma) / air.value)
    parts = [Belief(exp(each.value), exp(each.value) * each.sigma) for each in shared(total, shares)]
    before = {_ROLLING: beliefs["rolling"], _DRAG: drag, _AREA: area}
    after = {_ROLLING: rolling, _DRAG: parts[0], _AREA: parts[1]}
    back = {_ROLLING: "rolling" in refused, _DRAG: "air_m2" in refused, _AREA: "air_m2" in refused}
    units = {_ROLLING: "", _DRAG: "", _AREA: "m²"}
    return [
        Result(key, "road", units[key], before[key], before[key] if back[key] else after[key], back[key])
        for key in before
    ]


def _spin_keys() -> Iterator[tuple[str, str]]:
    """Yield unknowns and their keys."""
    for n in (1, 2):
        for unit in _UNITS:
            yield f"spin{n}_{unit}", f"vehicle.shafts.{n}.spin_loss_{unit}"
        yield f"drag{n}_nms_per_rad", f"vehicle.clutches.{n}.drag_nms_per_rad"


def _of_the_rest(config: Config) -> dict[str, float]:
    """Return by how much other numbers may be wrong that the load of the road depends on."""
    kalman = config.settings.kalman
    gears, final = (belief(config, f"vehicle.{part}_efficiency") for part in ("gear", "final_drive"))
    wrong = {
        "gain": gain_belief(config).sigma,
        "torque_nm": kalman.engine_torque_error_nm,
        "loss": hypot(gears.sigma, final.sigma),
        "car_share": _share([car_belief(config)]),
    }
    for name, key in _spin_keys():
        if name.startswith("spin"):
            wrong[name] = belief(config, key).sigma
    for unit in _UNITS:
        wrong[f"output_spin_{unit}"] = belief(config, f"vehicle.output_shaft.spin_loss_{unit}").sigma
    return wrong


def _share(parts: Sequence[Belief]) -> float:
    """Return the standard deviation of a sum as a share of it."""
    return hypot(*(part.sigma for part in parts)) / sum(part.value for part in parts)


def _solved(
    equations: Sequence[Equations], beliefs: Mapping[str, Belief], considered: Mapping[str, float]
) -> tuple[Posterior, set[str]]:
    """Return what equations say of what is believed, and what of that suits only what was fitted."""
    halves = [split(each) for each in equations]
    fitted, held = [half for half, _ in halves], [half for _, half in halves]
    nothing = {name: Belief(0.0, sure(Belief(0.0, sigma))) for name, sigma in considered.items() if sigma > 0.0}
    unsure = {name: replace(each, sigma=max(each.sigma, 1e-12)) for name, each in beliefs.items()}
    found = solve(fitted, {**unsure, **nothing})
    refused = {
        name
        for name, each in beliefs.items()
        if name in found.names and overfits(name, each.value, found, fitted, held)
    }
    for name, sigma in considered.items():
        found = found.considering(name, sigma)
    return found, refused
