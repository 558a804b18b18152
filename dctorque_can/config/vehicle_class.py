"""What a vehicle file leaves to the class of its car, and how sure each of its numbers is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from dctorque_can.config.document import Document, parse
from dctorque_can.config.problems import KeyPath, dotted
from dctorque_can.config.section import absent, nearest
from dctorque_can.resources import shipped_class, shipped_classes

SHARES = {
    "inertia_kgm2": 0.3,
    "engine_inertia_kgm2": 0.3,
    "wheel_inertia_kgm2": 0.3,
    "stiffness_nm_per_rad": 0.3,
    "transfer_stiffness_nm_per_rad": 0.3,
    "damping_nms_per_rad": 0.5,
    "transfer_damping_nms_per_rad": 0.5,
    "spin_loss_nm": 0.5,
    "spin_loss_nms_per_rad": 0.5,
    "drag_nms_per_rad": 0.5,
    "effective_radius_m": 0.1,
    "friction_static": 0.15,
    "friction_kinetic": 0.15,
    "max_normal_force_n": 0.15,
    "gear_efficiency": 0.01,
    "final_drive_efficiency": 0.015,
    "mass_kg": 0.15,
    "wheel_radius_m": 0.05,
    "rolling_resistance": 0.3,
    "drag_coefficient": 0.15,
    "frontal_area_m2": 0.1,
    "ratio": 0.002,
    "final_drive": 0.002,
}
"""By how much a car is another one than its class, as a share of each value (standard deviation); chosen, wide."""


def take_sigmas(document: Document) -> dict[str, float]:
    """Take ``{value: 1500, sigma: 30}`` apart wherever it stands for a number: the value stays.

    Returns:
        Standard deviations by dotted key.
    """
    sigmas: dict[str, float] = {}
    for above, step, path in list(_stated(document.data, ())):
        stated = above[step]
        sigma = stated["sigma"]
        if isinstance(sigma, bool) or not isinstance(sigma, int | float) or not sigma >= 0:
            document.problems.append(document.problem((*path, "sigma"), "must be a number, 0 or more"))
        else:
            sigmas[dotted(path)] = float(sigma)
        above[step] = stated["value"]
    return sigmas


def _stated(value: Any, path: KeyPath) -> Iterator[tuple[Any, str | int, KeyPath]]:
    """Yield what holds each stated number, at which key, and its path."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for step, below in items:
        if isinstance(below, dict) and set(below) == {"value", "sigma"}:
            yield value, step, (*path, step)
        else:
            yield from _stated(below, (*path, step))


def take_class(document: Document) -> dict[str, float]:
    """Give ``vehicle`` what it leaves to its ``class``.

    Returns:
        The numbers that the class gave, by dotted key.
    """
    vehicle = document.data.get("vehicle")
    if not isinstance(vehicle, dict) or "class" not in vehicle:
        return {}
    name = vehicle["class"]
    known = [path.stem for path in shipped_classes()]
    if name not in known:
        place = document.problem(("vehicle", "class"), "no such class of cars" + nearest(str(name), known))
        document.problems.append(replace(place, key="vehicle"))  # in place of all that it would have given
        document.unreadable["vehicle"] = document.problems[-1]
        return {}
    given = parse(shipped_class(name).read_bytes(), f"class {name}")
    assert not given.problems
    of_class = given.data["vehicle"]
    del of_class["driven_axle"]
    paths = [*_take_gears(vehicle, of_class.pop("gears")), *_fill(vehicle, of_class, ("vehicle",))]
    del vehicle["class"]
    return {dotted(path): document.value(path) for path in paths}


def class_sigmas(of_class: Mapping[str, float]) -> dict[str, float]:
    """Return the standard deviations of the numbers that a class gave, by dotted key."""
    return {key: SHARES.get(key.rsplit(".", 1)[-1], 0.0) * abs(value) for key, value in of_class.items()}


def _take_gears(vehicle: dict[Any, Any], of_class: dict[Any, Any]) -> Iterator[KeyPath]:
    """Give each gear of the file the inertia of the class's gear of that number, or of its highest one."""
    gears = vehicle.get("gears")
    if not isinstance(gears, dict):
        return
    highest = of_class[max(number for number in of_class if isinstance(number, int))]
    for number, gear in gears.items():
        if isinstance(gear, dict) and absent(gear.get("inertia_kgm2")):
            gear["inertia_kgm2"] = of_class.get(number, highest)["inertia_kgm2"]
            yield ("vehicle", "gears", number, "inertia_kgm2")


def _fill(own: dict[Any, Any], of_class: dict[Any, Any], path: KeyPath) -> Iterator[KeyPath]:
    """Put what is missing into ``own``, and yield where."""
    for key, value in of_class.items():
        if isinstance(value, dict):
            if absent(own.get(key)):
                own[key] = {}
            if isinstance(own[key], dict):
                yield from _fill(own[key], value, (*path, key))
        elif absent(own.get(key)):
            own[key] = value
            yield (*path, key)
