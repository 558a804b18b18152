"""Numbers that no car has: a slip of the decimal point, or another unit."""

from __future__ import annotations

from collections.abc import Iterator

from dctorque_can.config.document import Document
from dctorque_can.config.problems import KeyPath, dotted

_LIMITS: dict[KeyPath, tuple[float, float, str]] = {
    ("engine_inertia_kgm2",): (0.02, 10.0, "kg·m²"),
    ("damper", "inertia_kgm2"): (0.001, 2.0, "kg·m²"),
    ("damper", "stiffness_nm_per_rad"): (50.0, 1e5, "N·m/rad"),
    ("shafts", "*", "inertia_kgm2"): (1e-4, 1.0, "kg·m²"),
    ("shafts", "*", "transfer_stiffness_nm_per_rad"): (500.0, 1e7, "N·m/rad"),
    ("clutches", "*", "effective_radius_m"): (0.04, 0.3, "m"),
    ("clutches", "*", "friction_static"): (0.05, 0.8, ""),
    ("clutches", "*", "friction_kinetic"): (0.05, 0.8, ""),
    ("clutches", "*", "max_normal_force_n"): (300.0, 1e5, "N"),
    ("gears", "*", "ratio"): (0.3, 25.0, ""),
    ("gears", "*", "final_drive"): (0.7, 12.0, ""),
    ("gear_efficiency",): (0.8, 1.0, ""),
    ("final_drive_efficiency",): (0.7, 1.0, ""),
    ("output_shaft", "stiffness_nm_per_rad"): (1000.0, 1e6, "N·m/rad"),
    ("chassis", "mass_kg"): (300.0, 80_000.0, "kg"),
    ("chassis", "wheel_radius_m"): (0.2, 0.75, "m"),
    ("chassis", "wheel_inertia_kgm2"): (0.2, 300.0, "kg·m²"),
    ("chassis", "rolling_resistance"): (0.003, 0.1, ""),
    ("chassis", "drag_coefficient"): (0.1, 1.5, ""),
    ("chassis", "frontal_area_m2"): (1.0, 12.0, "m²"),
}
"""Least and greatest of anything from a scooter's engine to a truck, chosen wide; ``*`` stands for any number."""


def note_magnitudes(document: Document) -> None:
    """Warn of each number of the vehicle that no car has, unless it is an error."""
    wrong = {problem.key for problem in document.problems}
    for pattern, (least, most, unit) in _LIMITS.items():
        for path in _places(document, ("vehicle",), pattern):
            value = document.value(path)
            if isinstance(value, bool) or not isinstance(value, int | float) or least <= value <= most:
                continue
            if dotted(path) in wrong:
                continue
            span = f"{least:g} … {most:g}{' ' + unit if unit else ''}"
            reason = f"no car has that: {span} is usual; is it the unit, or the decimal point?"
            document.problems.append(document.problem(path, reason, warning=True))


def _places(document: Document, path: KeyPath, pattern: KeyPath) -> Iterator[KeyPath]:
    if not pattern:
        yield path
        return
    first, *rest = pattern
    below = document.value(path)
    if not isinstance(below, dict):
        return
    for step in below if first == "*" else [first]:
        yield from _places(document, (*path, step), tuple(rest))
