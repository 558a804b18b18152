"""A solution in the numbers of the vehicle file: before and after, with what is left unknown of each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, hypot

import numpy as np

from dctorque_can.config.load import Config
from dctorque_can.identify.beliefs import LAG_KEY, belief, gear_key, shared
from dctorque_can.identify.identification import Solution
from dctorque_can.identify.regression import Belief
from dctorque_can.identify.unknowns import CAR, DAMPINGS, Unknown, late_name, shaft_parts

MODEL = {"ratios": 5e-4, "inertias": 0.04, "stiffnesses": 0.04, "car": 0.02}
"""Standard deviations by what the equations leave out, as a share: damping, tyres, the engine's lag."""
MODEL_LATE_MS, MODEL_LOSS = 0.5, 0.005
LITTLE = 0.1
"""Share of what was unknown below which recordings count as telling nothing."""
CORRELATED = 0.7


@dataclass(frozen=True, slots=True)
class Result:
    """One number of a vehicle file.

    Attributes:
        key: where it stands.
        group: of `unknowns.GROUPS`.
        unit: of it.
        before: what was believed.
        after: what is known now.
        refused: it suits what was fitted and not what was held out, so it stays as it was.
    """

    key: str
    group: str
    unit: str
    before: Belief
    after: Belief
    refused: bool

    @property
    def told(self) -> float:
        """How much of what was unknown the recordings told: 0 nothing, 1 everything."""
        return max(1.0 - self.after.sigma / self.before.sigma, 0.0) if self.before.sigma > 0.0 else 0.0

    @property
    def changes(self) -> bool:
        """Whether the vehicle file gets another value."""
        return not self.refused and self.told >= LITTLE


def results(solution: Solution, config: Config) -> list[Result]:
    """Return what was found of each number, in the order of the groups."""
    return [result for each in solution.unknowns if each.group for result in _results(each, solution, config)]


def _results(unknown: Unknown, solution: Solution, config: Config) -> list[Result]:
    """Return the numbers that one unknown stands for; as they were where no equation holds it."""
    refused, after = unknown.name in solution.refused, unknown.prior
    if unknown.name in solution.posterior.names:
        sigma = solution.posterior.of(unknown.name).sigma * (solution.values[CAR] if unknown.name == CAR else 1.0)
        value = solution.values[unknown.name]
        after = Belief(value, min(hypot(sigma, _model(unknown, value)), unknown.prior.sigma))

    def one(key: str, unit: str, before: Belief, now: Belief) -> Result:
        return Result(key, unknown.group, unit, before, now if not refused else before, refused)

    vehicle, name = config.settings.vehicle, unknown.name
    if unknown.group == "delays":
        before, now = (Belief(1000.0 * each.value, 1000.0 * each.sigma) for each in (unknown.prior, after))
        late = next((each.keys for each in solution.messages if late_name(each) == name), (LAG_KEY,))
        return [one(key, "ms", before, now) for key in late]
    if name == "radius":
        radius = belief(config, "vehicle.chassis.wheel_radius_m")
        return [one("vehicle.chassis.wheel_radius_m", "m", radius, _times(radius, after))]
    if unknown.group == "ratios":
        key = gear_key(int(name.removeprefix("ratio_")), "ratio")
        return [one(key, "", belief(config, key), _times(belief(config, key), after))]
    if unknown.group == "stiffnesses":
        key = _STIFFNESSES[name]
        before = belief(config, key)
        now = Belief(1.0 / after.value, after.sigma / after.value**2)
        return [one(key, "N·m/rad", before, replace(now, sigma=min(now.sigma, before.sigma)))]
    if unknown.group == "dampings":
        key = f"{DAMPINGS[name]}.damping_nms_per_rad"
        before = belief(config, key)
        stiff = 1.0 / solution.values[f"{'damper' if name.startswith('damper') else 'output'}_compliance"]
        return [one(key, "N·m·s/rad", before, Belief(after.value * stiff, min(after.sigma * stiff, before.sigma)))]
    if name == "engine_inertia_kgm2":
        keys = ["vehicle.engine_inertia_kgm2", "vehicle.damper.inertia_kgm2"]
        parts = [belief(config, key) for key in keys]
        return [one(key, "kg·m²", *pair) for key, *pair in zip(keys, parts, shared(after, parts), strict=True)]
    if unknown.group == "inertias":
        shaft = int(name[len("shaft")])
        parts = shaft_parts(config, shaft)
        own, gears = shared(after, parts)
        found = [one(f"vehicle.shafts.{shaft}.inertia_kgm2", "kg·m²", parts[0], own)]
        for gear in vehicle.gears_on(shaft):
            key = gear_key(gear.number, "inertia_kgm2")
            factor, share = gears.value / parts[1].value, gears.sigma / max(parts[1].sigma, 1e-12)
            before = belief(config, key)
            found.append(one(key, "kg·m²", before, Belief(before.value * factor, before.sigma * share)))
        return found
    if name == CAR:
        keys = ["vehicle.chassis.mass_kg", "vehicle.chassis.wheel_inertia_kgm2"]
        square = (vehicle.chassis.wheel_radius_m * exp(solution.values["radius"])) ** 2
        mass, wheels = (belief(config, key) for key in keys)
        heavy, turning = shared(after, [Belief(mass.value * square, mass.sigma * square), wheels])
        now = Belief(heavy.value / square, heavy.sigma / square)
        return [one(keys[0], "kg", mass, now), one(keys[1], "kg·m²", wheels, turning)]
    keys = ["vehicle.gear_efficiency", "vehicle.final_drive_efficiency"]
    efficiencies = [belief(config, key) for key in keys]
    losses = shared(after, [Belief(1.0 - each.value, each.sigma) for each in efficiencies])
    now_each = [Belief(min(1.0 - each.value, 1.0), each.sigma) for each in losses]
    return [one(key, "", *pair) for key, *pair in zip(keys, efficiencies, now_each, strict=True)]


_STIFFNESSES = {
    "damper_compliance": "vehicle.damper.stiffness_nm_per_rad",
    "output_compliance": "vehicle.output_shaft.stiffness_nm_per_rad",
    "transfer1_compliance": "vehicle.shafts.1.transfer_stiffness_nm_per_rad",
    "transfer2_compliance": "vehicle.shafts.2.transfer_stiffness_nm_per_rad",
}


_BY_DIFFERENCES = {"delays": "late ", "ratios": ""}


def common(solution: Solution) -> dict[str, tuple[float, float]]:
    """Return how sure delays (ms) and ratios with the wheel radius (a share) are, together and against each other.

    Recordings tell when something comes against all the rest, and how fast it turns against the rest.

    Returns:
        By group two standard deviations: of their mean, and of the least sure difference to it.
    """
    found = {}
    for group, prefix in _BY_DIFFERENCES.items():
        names = [
            each.name
            for each in solution.unknowns
            if each.group == group and each.name in solution.posterior.names and each.name.startswith(prefix)
        ]
        if len(names) < 2:
            continue
        rows = [solution.posterior.names.index(name) for name in names]
        covariance = solution.posterior.covariance[np.ix_(rows, rows)]
        n = len(rows)
        centre = np.eye(n) - 1.0 / n
        apart = np.sqrt(np.maximum(np.diag(centre @ covariance @ centre.T), 0.0).max())
        scale, model = (1000.0, MODEL_LATE_MS) if group == "delays" else (1.0, MODEL["ratios"])
        found[group] = (scale * float(np.sqrt(covariance.mean())), hypot(scale * float(apart), model))
    return found


def _model(unknown: Unknown, value: float) -> float:
    if unknown.group in ("delays", "dampings"):
        return MODEL_LATE_MS / 1000.0
    if unknown.group == "losses":
        return MODEL_LOSS
    return MODEL[unknown.group] * (1.0 if unknown.group == "ratios" else value)


def _times(before: Belief, share: Belief) -> Belief:
    value = before.value * exp(share.value)
    return Belief(value, value * share.sigma)


def correlations(solution: Solution, config: Config) -> list[tuple[str, str, float]]:
    """Return what the recordings cannot tell apart: two numbers, and the correlation of their errors.

    Delays and ratios are known by their differences (`common`), and not among these.
    """
    names = {"gain": "the engine's torque over the nominal one"}
    for each in solution.unknowns:
        found = _results(each, solution, config) if each.group else []
        if found and each.group not in _BY_DIFFERENCES:
            names[each.name] = found[0].key
    shown = [name for name in solution.posterior.names if name in names]
    found_pairs = []
    for n, first in enumerate(shown):
        for second in shown[n + 1 :]:
            together = solution.posterior.correlation(first, second)
            if abs(together) >= CORRELATED:
                found_pairs.append((names[first], names[second], together))
    return sorted(found_pairs, key=lambda pair: -abs(pair[2]))
