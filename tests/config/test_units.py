"""Unit conversion against physical facts, not against the factors of the code."""

import math

import pytest

from dctorque_can.config.units import DIMENSIONS, Dimension, UnitError, factor_to_si, same_unit
from dctorque_can.pipeline.samples import Quantity

RADIUS = 0.312


def to_si(value: float, unit: str, dimension: Dimension, reference_nm: float | None = None) -> float:
    return value * factor_to_si(unit, dimension, wheel_radius_m=RADIUS, reference_nm=reference_nm)


@pytest.mark.parametrize("unit", ["rpm", "1/min", "U/min", "r/min", "RPM", "min-1", "min^-1", "min⁻¹", "[1/min]"])
def test_sixty_revolutions_a_minute_are_one_turn_a_second(unit: str) -> None:
    assert to_si(60, unit, Dimension.ROTATION) == pytest.approx(2 * math.pi)


@pytest.mark.parametrize("unit", ["Nm", "N·m", "N⋅m", "N*m", "N m", "N.m", "N-m", "NM", "Unit_NewtoMeter"])
def test_spellings_of_newton_metre(unit: str) -> None:
    assert to_si(123, unit, Dimension.TORQUE) == 123


def test_torque_in_per_cent_of_a_reference() -> None:
    assert to_si(50, "%", Dimension.TORQUE, reference_nm=400) == pytest.approx(200)
    with pytest.raises(UnitError, match="give reference_nm"):
        to_si(50, "%", Dimension.TORQUE)


@pytest.mark.parametrize(
    ("value", "unit", "metres"),
    [(36, "km/h", 10), (36, "kph", 10), (10, "m/s", 10), (22.369363, "mph", 10)],
)
def test_road_speed_rolls_the_wheel(value: float, unit: str, metres: float) -> None:
    turns = metres / (2 * math.pi * RADIUS)  # a second
    assert to_si(value, unit, Dimension.WHEEL) == pytest.approx(2 * math.pi * turns, rel=1e-7)


@pytest.mark.parametrize(
    ("value", "unit", "dimension", "si"),
    [
        (600, "rpm", Dimension.WHEEL, 20 * math.pi),
        (5, "rad/s", Dimension.WHEEL, 5),
        (360, "deg/s", Dimension.ROTATION, 2 * math.pi),
        (2, "rev/s", Dimension.ROTATION, 4 * math.pi),
        (1.5, "kNm", Dimension.TORQUE, 1500),
        (1, "g", Dimension.ACCELERATION, 9.80665),
        (3, "m/s²", Dimension.ACCELERATION, 3),
        (3, "m/s^2", Dimension.ACCELERATION, 3),
        (180, "°", Dimension.ANGLE, math.pi),
        (180, "deg", Dimension.ANGLE, math.pi),
        (7, "mm", Dimension.AS_IS, 7),
        (7, "anything", Dimension.AS_IS, 7),
    ],
)
def test_other_units(value: float, unit: str, dimension: Dimension, si: float) -> None:
    assert to_si(value, unit, dimension) == pytest.approx(si)


def test_slope_in_per_cent_is_nearly_its_angle() -> None:
    assert to_si(20, "%", Dimension.ANGLE) == pytest.approx(math.atan(0.20), rel=0.014)


@pytest.mark.parametrize(
    ("unit", "dimension", "right"),
    [
        ("km/h", Dimension.ROTATION, "rpm"),
        ("furlong", Dimension.WHEEL, "km/h"),
        ("rpm", Dimension.TORQUE, "N·m"),
        ("mm", Dimension.ACCELERATION, "m/s²"),
        ("V", Dimension.ANGLE, "rad"),
    ],
)
def test_a_unit_that_does_not_fit_says_what_does(unit: str, dimension: Dimension, right: str) -> None:
    with pytest.raises(UnitError, match=right):
        to_si(1, unit, dimension)


def test_same_unit_in_other_words() -> None:
    assert same_unit("1/min", "rpm")
    assert same_unit("Nm", "N·m")
    assert same_unit("%", "percent")
    assert not same_unit("km/h", "mph")
    assert not same_unit("rpm", "rad/s")


def test_every_quantity_has_a_dimension() -> None:
    assert set(DIMENSIONS) == set(Quantity)
