"""A road load that no road has: told once it has lasted for a kilometre."""

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.plausibility import state, torques
from dctorque_can.plausibility.findings import Finding
from dctorque_can.resources import shipped_config

SETTINGS = load_config(shipped_config("paper_car")).settings
CHASSIS = SETTINGS.vehicle.chassis
DT = 0.02  # s, from look to look


def driven(monitor, slope, metres, speed=20.0):
    """Drive up a slope (tan α) at a constant speed, m/s, by the force that mechanics ask for."""
    car = state.car(SETTINGS.vehicle, SETTINGS.driven_axle)[0]
    air = 0.5 * 1.2 * CHASSIS.drag_coefficient * CHASSIS.frontal_area_m2 * speed**2
    force = CHASSIS.mass_kg * 9.80665 * (slope + CHASSIS.rolling_resistance) + air
    m = monitor[0]
    m["w_b"] = speed / CHASSIS.wheel_radius_m
    for _ in range(round(metres / speed / DT)):
        torques.add_grade(m, car, CHASSIS.wheel_radius_m * force, DT)
        torques.judge_grade(m)
    return bool(m["findings"] & Finding.ROAD_LOAD), bool(m["strong"] & Finding.ROAD_LOAD)


@pytest.fixture
def monitor():
    found = np.zeros(1, state.MONITOR).view(np.recarray)
    state.first(found)
    return found


@pytest.mark.parametrize(
    ("slope", "told", "strong"),
    [(0.15, False, False), (0.22, True, False), (-0.22, True, False), (0.3, True, True)],
)
def test_a_grade_that_lasts_for_a_kilometre(monitor, slope, told, strong):
    assert driven(monitor, slope, 900.0) == (False, False)
    assert driven(monitor, slope, 200.0) == (told, strong)
    measured = monitor["measured"][0][int(Finding.ROAD_LOAD).bit_length() - 1]
    assert measured == pytest.approx(slope if told else 0.0, abs=1e-6)


def test_it_ends_with_its_evidence(monitor):
    assert driven(monitor, 0.22, 1500.0) == (True, False)
    assert driven(monitor, 0.0, 1000.0) == (False, False)
    assert monitor["ever"][0] & Finding.ROAD_LOAD
