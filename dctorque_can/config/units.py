"""Units of bus signals: what a unit text of a DBC or a vehicle file means in SI.

Every conversion is one factor, because all units here share the zero of their SI unit; the offset of a DBC signal
is applied before. Spelling is forgiving (``N·m``, ``Nm``, ``N-m``; ``1/min``, ``U/min``, ``Unit_MinutInver``).
"""

from __future__ import annotations

from enum import Enum
from math import pi

from dctorque_can.driveline.parameters import STANDARD_GRAVITY
from dctorque_can.pipeline.samples import Quantity


class Dimension(Enum):
    """What kind of quantity an input is; the value is the SI unit shown to people."""

    ROTATION = "rad/s"
    WHEEL = "rad/s of the wheel"
    TORQUE = "N·m"
    ACCELERATION = "m/s²"
    ANGLE = "rad"
    AS_IS = "kept as it is"


DIMENSIONS = {
    Quantity.ENGINE_SPEED: Dimension.ROTATION,
    Quantity.ENGINE_TORQUE: Dimension.TORQUE,
    Quantity.SHAFT1_SPEED: Dimension.ROTATION,
    Quantity.SHAFT2_SPEED: Dimension.ROTATION,
    Quantity.WHEEL_SPEED_FL: Dimension.WHEEL,
    Quantity.WHEEL_SPEED_FR: Dimension.WHEEL,
    Quantity.WHEEL_SPEED_RL: Dimension.WHEEL,
    Quantity.WHEEL_SPEED_RR: Dimension.WHEEL,
    Quantity.GEAR1: Dimension.AS_IS,
    Quantity.GEAR2: Dimension.AS_IS,
    Quantity.CLUTCH1_POSITION: Dimension.AS_IS,
    Quantity.CLUTCH2_POSITION: Dimension.AS_IS,
    Quantity.CLUTCH1_OPEN: Dimension.AS_IS,
    Quantity.CLUTCH2_OPEN: Dimension.AS_IS,
    Quantity.CLUTCH1_COMMAND: Dimension.TORQUE,
    Quantity.CLUTCH2_COMMAND: Dimension.TORQUE,
    Quantity.ACCELERATION: Dimension.ACCELERATION,
    Quantity.GRADE: Dimension.ANGLE,
    Quantity.BRAKE: Dimension.AS_IS,
    Quantity.GEAR: Dimension.AS_IS,
    Quantity.TARGET_GEAR: Dimension.AS_IS,
    Quantity.SHIFT_IN_PROGRESS: Dimension.AS_IS,
    Quantity.CLUTCH_STATE: Dimension.AS_IS,
    Quantity.DIRECTION: Dimension.AS_IS,
    Quantity.TRANSMISSION_TORQUE: Dimension.TORQUE,
    Quantity.DRIVING_SHAFT_SPEED: Dimension.ROTATION,
}

_RPM = 2 * pi / 60
_DEGREE = pi / 180
_ROTATION = {
    **dict.fromkeys(("rad/s", "rad/sec", "rads-1", "rads^-1", "unit_radianpersecon", "unit_radiapersecon"), 1.0),
    **dict.fromkeys(
        ("rpm", "1/min", "u/min", "r/min", "rev/min", "min-1", "min^-1", "/min", "unit_minutinver"), _RPM
    ),
    **dict.fromkeys(("rev/s", "rps", "u/s"), 2 * pi),
    **dict.fromkeys(("deg/s", "°/s"), _DEGREE),
}
_SPEED = {  # to m/s
    **dict.fromkeys(("m/s", "mps", "unit_meterpersecon"), 1.0),
    **dict.fromkeys(("km/h", "kph", "kmh", "kmph", "unit_kilometerperhour"), 1 / 3.6),
    **dict.fromkeys(("mph", "mi/h", "unit_mileperhour"), 1609.344 / 3600),
}
_TORQUE = {
    **dict.fromkeys(("nm", "newtonmeter", "newtonmetre", "unit_newtometer"), 1.0),
    "knm": 1000.0,
}
_PERCENT = {"%", "percent", "pct", "unit_percent"}
_ACCELERATION = {
    **dict.fromkeys(("m/s2", "m/s^2", "m/ss", "ms-2", "ms^-2", "mps2", "unit_meterperseconsquar"), 1.0),
    "g": STANDARD_GRAVITY,
}
_ANGLE = {
    **dict.fromkeys(("rad", "unit_radia"), 1.0),
    **dict.fromkeys(("deg", "°", "degree", "degrees", "unit_degreofarc"), _DEGREE),
    **dict.fromkeys(_PERCENT, 0.01),  # slope; tan x ≈ x, 1.3 % too large at 20 % slope
}


class UnitError(Exception):
    """A unit that does not fit its quantity; the message says what would be right."""


def _plain(unit: str) -> str:
    """Return the unit text without case, blanks, brackets, multiplication signs and typographic superscripts."""
    text = unit.strip().casefold().replace("²", "2").replace("⁻¹", "-1").replace("⁻2", "-2")
    for sign in (" ", "·", "⋅", "*", "[", "]", "(", ")"):
        text = text.replace(sign, "")
    if text in {"n.m", "n-m", "n_m"}:
        text = "nm"
    return text


def factor_to_si(
    unit: str, dimension: Dimension, *, wheel_radius_m: float, reference_nm: float | None = None
) -> float:
    """Return the factor from ``unit`` to the SI unit of ``dimension``.

    Args:
        unit: text as in a DBC or a vehicle file.
        dimension: what is measured.
        wheel_radius_m: turns road speed (km/h) into wheel speed (rad/s).
        reference_nm: the torque that is 100 %, for a torque in per cent.

    Raises:
        UnitError: the unit is unknown, does not fit, or needs ``reference_nm``.
    """
    plain = _plain(unit)
    match dimension:
        case Dimension.AS_IS:
            return 1.0
        case Dimension.TORQUE if plain in _PERCENT:
            if reference_nm is None:
                raise UnitError("a torque in % needs the torque that is 100 %: give reference_nm")
            return reference_nm / 100
        case Dimension.TORQUE:
            known = _TORQUE
            right = "N·m, kNm, or % with reference_nm"
        case Dimension.ROTATION:
            known = _ROTATION
            right = "rpm, 1/min, U/min, rad/s, rev/s or deg/s"
        case Dimension.WHEEL:
            known = _ROTATION | {name: factor / wheel_radius_m for name, factor in _SPEED.items()}
            right = "km/h, m/s, mph, rpm or rad/s"
        case Dimension.ACCELERATION:
            known = _ACCELERATION
            right = "m/s² or g"
        case Dimension.ANGLE:
            known = _ANGLE
            right = "rad, deg or %"
    if plain not in known:
        raise UnitError(f"the unit {unit!r} does not fit here: use {right}")
    return known[plain]


def share_of(unit: str) -> float | None:
    """Return the factor of a unit that makes a mere number: of per cent, or of none; None for any other unit."""
    plain = _plain(unit)
    if plain in _PERCENT:
        return 0.01
    return 1.0 if plain in ("", "1", "-") else None


def same_unit(first: str, second: str) -> bool:
    """Return whether two unit texts are spellings of the same unit."""
    a, b = _plain(first), _plain(second)
    if a == b or {a, b} <= _PERCENT:
        return True
    return any(
        a in table and b in table and table[a] == table[b]
        for table in (_ROTATION, _SPEED, _TORQUE, _ACCELERATION, _ANGLE)
    )
